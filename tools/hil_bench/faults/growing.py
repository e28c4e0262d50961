"""Faults that grow until the device acts, and take the vehicle back to its route afterwards."""

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from vehicle_bus_contract.reference import S

from hil_bench.faults.base import Injection, call_each_tick, release, with_fault
from hil_bench.faults.frames import change_frames, drop
from hil_bench.faults.vehicle import change_vehicle
from hil_bench.rig import Rig
from hil_bench.vehicle import Fault, SignalValues
from hil_bench.vocabulary import Wait

ACCEPTED_S = 1.4
"""A position that has jumped is accepted again after 100 samples that agree, and their sources have to."""
LOST_S = 0.3


def take_back(injection: Injection) -> Injection:
    """Afterwards the vehicle stands, released, where and as it was at the beginning."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        plant = rig.vehicle.plant
        place = plant.x_m, plant.y_m, plant.heading_rad
        with injection(rig):
            yield
        release(rig)
        plant.speed_mps = plant.accel_mps2 = plant.force_mps2 = plant.wheel_rad = 0.0
        plant.x_m, plant.y_m, plant.heading_rad = place
        rig.run_for(ACCEPTED_S * max(1.0, rig.wire.period_s / 0.01))

    return inject


def begin_again(injection: Injection) -> Injection:
    """Afterwards the vehicle stands, released, at the origin, and dead reckoning begins there: its state was lost."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        plant = rig.vehicle.plant
        with injection(rig):
            yield
        release(rig)
        plant.speed_mps = plant.accel_mps2 = plant.force_mps2 = plant.wheel_rad = 0.0
        plant.x_m = plant.y_m = plant.heading_rad = 0.0
        with change_frames(drop)(rig):
            rig.run_for(LOST_S + rig.wire.later_s[Wait.STATE])
        rig.run_for(LOST_S)

    return inject


def drift_and_return(to_left_mps: float, for_s: float) -> Injection:
    """The vehicle drifts to the left, then as far to the right, whatever the steering, and then no longer."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        plant, ticks = rig.vehicle.plant, itertools.count()

        def drift() -> None:
            passed_s = next(ticks) * rig.vehicle.period_ns / S
            plant.drift_mps = to_left_mps if passed_s < for_s else -to_left_mps if passed_s < 2.0 * for_s else 0.0

        with call_each_tick(rig, drift):
            yield
        plant.drift_mps = 0.0

    return inject


def push_against_travel(accel_mps2: float) -> Injection:
    """A slope accelerates the vehicle against its direction of travel."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        way = 1.0 if rig.vehicle.plant.speed_mps >= 0.0 else -1.0
        return change_vehicle(plant_push_mps2=-way * accel_mps2)(rig)

    return take_back(inject)


def tow_along() -> Injection:
    """A tow accelerates the vehicle in its direction of travel, against its brakes."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        way = 1.0 if rig.vehicle.plant.speed_mps >= 0.0 else -1.0
        return change_vehicle(plant_push_mps2=way * rig.wire.tow_mps2)(rig)

    return take_back(inject)


def turn_away(wheel_rad: float, rate_radps: float) -> Injection:
    """The wheels turn to this angle and stay there, whatever is commanded."""
    return take_back(_turn_wheels(lambda _: wheel_rad, rate_radps))


def turn_off(curvature_per_m: float, rate_radps: float) -> Injection:
    """The wheels turn until the vehicle's curvature differs by this from the one that it drives, and stay there."""

    def find_target_rad(rig: Rig) -> float:
        plant = rig.vehicle.plant
        return math.atan(math.tan(plant.wheel_rad) + curvature_per_m * plant.wheelbase_m)

    return take_back(_turn_wheels(find_target_rad, rate_radps))


def _turn_wheels(find_target_rad: Callable[[Rig], float], rate_radps: float) -> Injection:
    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        plant, target_rad = rig.vehicle.plant, find_target_rad(rig)
        most_rad = rate_radps * rig.vehicle.period_ns / S

        def turn() -> None:
            left_rad = target_rad - plant.wheel_rad
            plant.wheel_rad += max(-most_rad, min(most_rad, left_rad))

        with change_vehicle(plant_wheel_rate_limit_radps=0.0)(rig), call_each_tick(rig, turn):
            yield

    return inject


def let_grow(attribute: str, begin: float, per_s: float) -> Injection:
    """An attribute of the vehicle grows from `begin`, while its mode does not follow what the driver does."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        ticks = itertools.count()

        def grow() -> None:
            setattr(rig.vehicle, attribute, begin + per_s * next(ticks) * rig.vehicle.period_ns / S)

        rig.vehicle.yields_to_driver = False
        grow()
        with call_each_tick(rig, grow):
            yield
        rig.vehicle.make_ready()

    return inject


def act_without_the_vehicle(**changed: object) -> Injection:
    """The driver acts, and the vehicle reports that alone: its mode stays as it is."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.vehicle.yields_to_driver = False
        for name, value in changed.items():
            setattr(rig.vehicle, name, value)
        yield

    return inject


class _GrowingSteps(Fault):
    """Every n-th frame of a message is changed, and the next ones with it, each time by more."""

    def __init__(
        self, rig: Rig, message: str, every: int, change: Callable[[SignalValues, int], None], in_a_row: int
    ) -> None:
        self._vehicle, self._message = rig.vehicle, message
        self._every, self._change, self._in_a_row, self._count = every, change, in_a_row, 0

    def values(self, values: SignalValues) -> None:
        if not self._vehicle.is_due(self._message):
            return
        self._count += 1
        if self._count >= self._every and self._count % self._every < self._in_a_row:
            self._change(values, self._count // self._every)


def offset_each(every: int, step: float, *names: str, in_a_row: int = 1) -> Injection:
    """Every n-th frame, and the next ones of its row, have `step` more in these signals than the time before."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        def change(values: SignalValues, number: int) -> None:
            for name in names:
                values[rig.wire.part_of(name)][name] += step * number

        return with_fault(rig, _GrowingSteps(rig, rig.wire.part_of(names[0]), every, change, in_a_row))

    return inject


def skip_each(every: int) -> Injection:
    """Before every n-th sample one more counter value is skipped than the time before."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        ticks = itertools.count(1)

        def skip() -> None:
            tick, count = next(ticks), every * rig.wire.ticks_per_sample
            if tick % count == count - 1:
                rig.vehicle.step_counters(tick // count + 1)

        with call_each_tick(rig, skip):
            yield

    return inject
