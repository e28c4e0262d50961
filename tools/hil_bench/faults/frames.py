"""Faults of the vehicle's frames: lost, damaged, late, repeated, or with another counter."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

from vehicle_bus_contract.reference import Frame, S

from hil_bench.faults.base import ALWAYS, Injection, NotApplicableError, call_each_tick, with_fault
from hil_bench.rig import Rig
from hil_bench.vehicle import Fault, TxFrame

Change = Callable[[Rig, TxFrame], list[Frame]]
"""The frames to send instead of one."""


class _ChangedFrames(Fault):
    """Passes the next `count` frames of each named message through a function."""

    def __init__(self, names: Sequence[str], count: int, change: Callable[[TxFrame], list[Frame]]) -> None:
        self._left = dict.fromkeys(names, count)
        self._change = change

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        out: list[Frame] = []
        for tx in outgoing:
            if self._left.get(tx.name, 0) > 0:
                self._left[tx.name] -= 1
                out += self._change(tx)
            else:
                out.append(tx.frame)
        return out


def change_frames(change: Change, *, of_status: bool = False, count: int = ALWAYS) -> Injection:
    """Change the next `count` frames of each message of the state sample, or of the status."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        names = rig.wire.status if of_status else rig.wire.sample
        return with_fault(rig, _ChangedFrames(names, count, lambda tx: change(rig, tx)))

    return inject


def change_message(name: str, change: Change) -> Injection:
    """Change every frame of one message."""
    return lambda rig: with_fault(rig, _ChangedFrames((name,), ALWAYS, lambda tx: change(rig, tx)))


class _MutedBus(Fault):
    def __init__(self, bus: int) -> None:
        self._bus = bus

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        return [tx.frame for tx in outgoing if tx.frame.bus != self._bus]


def mute_bus(bus: int) -> Injection:
    """Lose every frame of the vehicle on this bus."""
    return lambda rig: with_fault(rig, _MutedBus(bus))


# Changes of one frame


def drop(_rig: Rig, _tx: TxFrame) -> list[Frame]:
    """Lose it."""
    return []


def break_crc(rig: Rig, tx: TxFrame) -> list[Frame]:
    """Flip one bit of the checksum."""
    return [rig.wire.break_checksum(tx.frame)]


def flip_bit(rig: Rig, tx: TxFrame) -> list[Frame]:
    """Flip one random bit of the payload and keep the checksum."""
    data = bytearray(tx.frame.data)
    place = rig.random.choice(rig.wire.covered_bits(tx.frame))
    data[place // 8] ^= 1 << place % 8
    return [replace(tx.frame, data=bytes(data))]


def shorten(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Cut off the last two bytes."""
    return [replace(tx.frame, data=tx.frame.data[:-2])]


def empty(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Remove all data."""
    return [replace(tx.frame, data=b"")]


def make_extended(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Use the extended identifier of the same number."""
    return [replace(tx.frame, is_extended=True)]


def make_remote(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Send a remote request in its place."""
    return [replace(tx.frame, is_remote=True, is_fd=False, data=bytes(min(8, len(tx.frame.data))))]


def swap_format(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Send CAN FD where it is classical, and the first 8 bytes as classical CAN where it is FD."""
    return [replace(tx.frame, is_fd=not tx.frame.is_fd, data=tx.frame.data[:8])]


def seal_as_another(rig: Rig, tx: TxFrame) -> list[Frame]:
    """Compute the checksum with the data id of another message."""
    return [rig.wire.seal(tx.frame, data_id=0x3F0)]


def add_to_sound_frame(change: Change) -> Change:
    """Send the sound frame, then the changed one."""
    return lambda rig, tx: [tx.frame, *change(rig, tx)]


def with_probability(share: float, change: Change) -> Change:
    """Change this share of the frames, at random by the case's seed."""
    return lambda rig, tx: change(rig, tx) if rig.random.random() < share else [tx.frame]


def lengthen(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Add a byte."""
    return [replace(tx.frame, data=tx.frame.data + b"\0")]


def repeat(_rig: Rig, tx: TxFrame) -> list[Frame]:
    """Send it twice."""
    return [tx.frame, tx.frame]


# Counters


def hold_counter(rig: Rig, tx: TxFrame) -> list[Frame]:
    """Keep the counter at 1, under a good checksum."""
    decoded = rig.wire.intact(tx.frame)
    assert decoded is not None
    signals = {name: value for name, value in decoded.signals.items() if name != "COUNTER"}
    return [rig.wire.pack(decoded.name, 1, **signals)]


def change_counter(choose: Callable[[int], int]) -> Injection:
    """Send every frame of the sample with the counter `choose(counter)` and a good checksum."""

    def change(rig: Rig, tx: TxFrame) -> list[Frame]:
        decoded = rig.wire.intact(tx.frame)
        assert decoded is not None
        signals = {name: value for name, value in decoded.signals.items() if name != "COUNTER"}
        return [rig.wire.pack(decoded.name, choose(tx.counter) % rig.wire.counters, **signals)]

    return change_frames(change)


def skip_counters(by: int, every: int = ALWAYS) -> Injection:
    """Skip `by` counter values of the sample at once, and again after every n-th sample."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        tick = 0

        def skip() -> None:
            nonlocal tick
            if tick % every == 0:
                rig.vehicle.step_counters(by)
            tick += 1

        with call_each_tick(rig, skip):
            yield

    return inject


# Samples


class _MixedCycles(Fault):
    def __init__(self, sample: Sequence[str]) -> None:
        self._sample, self._tick = sample, 0

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        self._tick += 1
        last = outgoing[-1].name
        return [tx.frame for tx in outgoing if tx.name not in self._sample or (tx.name == last) is bool(self._tick % 2)]


def mix_cycles() -> Injection:
    """Send only the last message of one sample, only the others of the next, and so on: no sample is complete."""

    def inject(rig: Rig) -> AbstractContextManager[None]:
        if len(rig.wire.sample) < 2:
            raise NotApplicableError("a sample of this vehicle is one message: its parts cannot be mixed")
        return with_fault(rig, _MixedCycles(rig.wire.sample))

    return inject


class _RepeatedSamples(Fault):
    def __init__(self, every: int) -> None:
        self._every = every
        self._past: list[list[Frame]] = []

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        out = [tx.frame for tx in outgoing]
        self._past.append(out)
        return out + self._past[-9] if len(self._past) > 8 and len(self._past) % self._every == 0 else out


def repeat_old_sample(every: int) -> Injection:
    """After every n-th sample send the one of 80 ms before once more, unchanged."""
    return lambda rig: with_fault(rig, _RepeatedSamples(every))


class _DelayedSamples(Fault):
    def __init__(self, samples: int) -> None:
        self._waiting: list[Frame] = []
        self._left = samples

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        frames = [tx.frame for tx in outgoing]
        self._left -= 1
        if self._left > 0:
            self._waiting += frames
            return []
        released, self._waiting = self._waiting + frames, []
        return released


def delay_in_gateway(hold_s: float) -> Injection:
    """Hold back the frames of this time, then send all of them at once."""
    return lambda rig: with_fault(rig, _DelayedSamples(round(hold_s * S / rig.vehicle.period_ns)))


class _DroppedSamples(Fault):
    """Loses every n-th frame of each message of the sample, whatever its period."""

    def __init__(self, every: int, sample: Sequence[str]) -> None:
        self._every, self._counts = every, dict.fromkeys(sample, 0)

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        for name in {tx.name for tx in outgoing} & self._counts.keys():
            self._counts[name] += 1
        return [tx.frame for tx in outgoing if self._counts.get(tx.name, 1) % self._every]


def drop_samples(every: int) -> Injection:
    """Drop every n-th sample. The commands must show the same gaps, delayed by the device's reaction time."""
    return lambda rig: with_fault(rig, _DroppedSamples(every, rig.wire.sample))


def delay_randomly(most_s: float) -> Injection:
    """Send every sample late, by a random time of up to `most_s`."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        rig.delay_s = lambda: rig.random.uniform(0.0, most_s)
        try:
            yield
        finally:
            rig.delay_s = lambda: 0.0

    return inject
