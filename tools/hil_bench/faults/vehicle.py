"""Faults of the vehicle itself: its driver, its mode, its pose and its mechanics."""

import itertools
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from vehicle_bus_contract.reference import S

from hil_bench.faults.base import Injection, call_each_tick
from hil_bench.rig import Rig
from hil_bench.vehicle import MODES


def change_vehicle(**changed: object) -> Injection:
    """Set attributes of the vehicle, or of its plant (`plant_…`), and restore them at the end."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        before = []
        for name, value in changed.items():
            owner, attribute = _find(rig, name)
            before.append((owner, attribute, getattr(owner, attribute)))
            setattr(owner, attribute, value)
        yield
        for owner, attribute, value in before:
            setattr(owner, attribute, value)

    return inject


def tow_forward() -> Injection:
    """Tow the vehicle against its brakes, so that it becomes too fast but not as fast as it never can be."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        return change_vehicle(plant_push_mps2=rig.wire.tow_mps2)(rig)

    return inject


def change_until_ready(**changed: object) -> Injection:
    """Set attributes of the vehicle; they stay so until the driver makes it ready."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        for name, value in changed.items():
            setattr(rig.vehicle, name, value)
        yield

    return inject


def change_after(after_s: float, **changed: object) -> Injection:
    """Set attributes of the vehicle, or of its plant, so long after the beginning; they stay so."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        due_ns = rig.now_ns + round(after_s * S)
        left = dict(changed)

        def change() -> None:
            while left and rig.now_ns >= due_ns:
                name, value = left.popitem()
                setattr(*_find(rig, name), value)

        with call_each_tick(rig, change):
            yield

    return inject


def _find(rig: Rig, name: str) -> tuple[object, str]:
    """Owner and name of an attribute."""
    return (rig.vehicle.plant, name[6:]) if name.startswith("plant_") else (rig.vehicle, name)


def change_and_make_ready(**changed: object) -> Injection:
    """Set attributes of the vehicle; at the end the driver makes it ready, and nobody arms the device."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        with change_until_ready(**changed)(rig):
            yield
        rig.vehicle.make_ready()

    return inject


def change_modes() -> Injection:
    """The mode changes every three statuses, from each one to each other one, MANUAL first; at the end it is READY."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        numbers = [number for number, name in enumerate(MODES) if rig.wire.can_report(name)]
        order = [number for pair in itertools.permutations(numbers, 2) for number in pair]
        ticks = itertools.count()
        every = max(1, round(3.0 * float(rig.wire.profile["timing"]["status_period_s"]) * S / rig.vehicle.period_ns))

        def change() -> None:
            rig.vehicle.mode = order[next(ticks) // every % len(order)]

        change()
        with call_each_tick(rig, change):
            yield
        rig.vehicle.make_ready()

    return inject
