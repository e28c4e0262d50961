"""Faults by other nodes on the bus: load, floods, a second commander, a second vehicle, a replayed log."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

from vehicle_bus_contract.reference import GREATEST_STEP, Frame, S

from hil_bench.faults.base import Injection, call_each_tick
from hil_bench.places import PACKAGE
from hil_bench.rig import Rig

LOAD_FRAME_BITS = 131
"""On the wire: a classical frame of 8 bytes, with some stuffing."""


class BusIsEmptyError(OSError):
    """The load that the device was to bear was not on the bus."""


def flood(make: Callable[[Rig, int], Frame], per_tick: int) -> Injection:
    """Send this many frames more in each tick; `make` gets their number."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        count = 0

        def send() -> None:
            nonlocal count
            for _ in range(per_tick):
                count += 1
                rig.bus.send(make(rig, count))

        with call_each_tick(rig, send):
            yield

    return inject


def damaged_sample(rig: Rig, number: int) -> Frame:
    """A frame with an identifier of the sample, and random data."""
    name = rig.wire.sample[number % len(rig.wire.sample)]
    return replace(rig.wire.pack(name, 0), data=rig.random.randbytes(rig.wire.lengths[name]))


def rival_command(rig: Rig, number: int) -> Frame:
    """A sound command of another commander."""
    names = rig.wire.command
    return rig.wire.pack(names[number % len(names)], number // len(names) % rig.wire.counters, ENABLE=1)


def error_frame(kind: int, data: bytes = bytes(8)) -> Callable[[Rig, int], Frame]:
    """An error frame as a CAN controller reports it; `kind` by linux/can/error.h."""
    return lambda _rig, _number: Frame(0, kind, data, is_error=True)


def add_second_vehicle() -> Injection:
    """Send samples of a second vehicle of the same kind, 40 m away, with counters of its own.

    Its counters are ahead, by the case's seed. With the same counters, or so little behind that the first vehicle's
    next sample is still an allowed step, all of its samples would be dropped, and it would be harmless.
    """

    def make(rig: Rig, number: int, ahead: int) -> Frame:
        plant = rig.vehicle.plant
        place = {"POS_X": plant.x_m + 40.0, "POS_Y": 25.0, "SPEED": 0.0, "POSE_VALID": 1.0}
        name = rig.wire.sample[(number - 1) % len(rig.wire.sample)]
        signals = {signal: value for signal, value in place.items() if rig.wire.part_of(signal) == name}
        if rig.wire.has("POSE_FRAME") and rig.wire.part_of("POSE_FRAME") == name:
            signals["POSE_FRAME"] = rig.wire.number("POSE_FRAME", "MAP")
        return rig.wire.pack(name, (rig.vehicle.counter_of(name) + ahead) % rig.wire.counters, **signals)

    def inject(rig: Rig) -> AbstractContextManager[None]:
        ahead = rig.random.randrange(1, rig.wire.counters - GREATEST_STEP + 1)
        return flood(lambda rig, number: make(rig, number, ahead), len(rig.wire.sample))(rig)

    return inject


def replay(back_s: float) -> Injection:
    """Send all frames of the last `back_s` again, in their timing, while the vehicle is silent."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        since_ns = time.monotonic_ns() - round(back_s * S)
        old = [rx.frame for rx in rig.received if rx.frame.stamp_ns > since_ns and not rx.frame.is_error]

        def send() -> None:
            while old and old[0].stamp_ns + round(back_s * S) <= time.monotonic_ns():
                rig.bus.send(old.pop(0))

        rig.vehicle_transmits = False
        with call_each_tick(rig, send):
            yield
        rig.vehicle_transmits = True

    return inject


def add_load(share: float) -> Injection:
    """Fill the bus up to this share with unknown frames of low priority, from a process of their own."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        since_ns = time.monotonic_ns() - S
        own_per_second = sum(rx.frame.stamp_ns > since_ns for rx in rig.received)
        all_per_second = share * rig.wire.profile["bus"]["bitrate"] / LOAD_FRAME_BITS
        per_second = max(0.0, all_per_second - own_per_second)
        arguments = [rig.bus.channel, f"{per_second:.0f}", f"{rig.wire.free_block():x}"]
        generator = rig.start_process([sys.executable, str(PACKAGE / "load.py"), *arguments])
        rig.run_for(0.5)
        rig.mark_injection()
        begin_s, before = time.monotonic(), rig.bus.packets()
        try:
            yield
            measured_per_second = (rig.bus.packets() - before) / (time.monotonic() - begin_s)
        finally:
            rig.stop_process(generator)
        if measured_per_second < all_per_second / 2.0:
            raise BusIsEmptyError(f"{measured_per_second:.0f} of {all_per_second:.0f} frames a second were on the bus")

    return inject
