"""What the bench injects: each a context in which something is wrong, and which mends it at its end.

A context is entered while the vehicle drives; it may say itself when the fault began (`rig.injects`), otherwise it is
its entry. Nothing here waits without the vehicle going on.
"""

import errno
import random
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bus_contract import GREATEST_STEP, Frame, S

from hil.process import Process
from hil.vehicle import Fault, Utterance, Values

if TYPE_CHECKING:
    from hil.rig import Rig

Injection = Callable[["Rig"], AbstractContextManager[None]]
ALWAYS = 1 << 40
STRANGERS_BITS = 131
"""On the wire: a classical frame of 8 bytes, with some stuffing."""
VIEWER_S = 60.0
TOOLS = Path(__file__).resolve().parents[1]


class BusIsEmptyError(OSError):
    """The load that was to be borne was not there."""


class NotApplicableError(OSError):
    """This vehicle cannot have the fault."""


class _Frames(Fault):
    """The next so many frames of some messages go through a function."""

    def __init__(self, names: Sequence[str], count: int, change: Callable[[Utterance], list[Frame]]) -> None:
        self._left = dict.fromkeys(names, count)
        self._change = change

    def frames(self, spoken: list[Utterance]) -> list[Frame]:
        out: list[Frame] = []
        for utterance in spoken:
            if self._left.get(utterance.name, 0) > 0:
                self._left[utterance.name] -= 1
                out += self._change(utterance)
            else:
                out.append(utterance.frame)
        return out


class _Values(Fault):
    """The next so many samples go through a function that changes signals in place."""

    def __init__(self, count: int, change: Callable[[Values], None]) -> None:
        self._left, self._change = count, change

    def values(self, values: Values) -> None:
        if self._left > 0:
            self._left -= 1
            self._change(values)


@contextmanager
def _on(rig: "Rig", fault: Fault) -> Iterator[None]:
    rig.vehicle.faults.append(fault)
    try:
        yield
    finally:
        rig.vehicle.faults.remove(fault)


def frames(
    change: Callable[["Rig", Utterance], list[Frame]], *, of: Sequence[str] = (), count: int = ALWAYS
) -> Injection:
    """The next `count` frames of some messages (the sample's, if none are named) are changed."""

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        return _on(rig, _Frames(of or rig.wire.sample, count, lambda utterance: change(rig, utterance)))

    return inject


def lost(_rig: "Rig", _utterance: Utterance) -> list[Frame]:
    """On the way."""
    return []


def crc_wrong(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """One bit of the checksum."""
    data = utterance.frame.data
    return [replace(utterance.frame, data=bytes((data[0] ^ 0x10,)) + data[1:])]


def bit_flipped(rig: "Rig", utterance: Utterance) -> list[Frame]:
    """One bit of the payload, the checksum as it was."""
    data = bytearray(utterance.frame.data)
    data[rig.random.randrange(rig.wire.crc_bytes, len(data))] ^= 1 << rig.random.randrange(8)
    return [replace(utterance.frame, data=bytes(data))]


def too_short(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """Without its last two bytes."""
    return [replace(utterance.frame, data=utterance.frame.data[:-2])]


def empty(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """Without any data."""
    return [replace(utterance.frame, data=b"")]


def extended(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """With an extended identifier of the same number."""
    return [replace(utterance.frame, is_extended=True)]


def remote(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """As a request for it."""
    return [replace(utterance.frame, is_remote=True, is_fd=False, data=bytes(min(8, len(utterance.frame.data))))]


def other_format(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """CAN FD where it is classical; the other way round where it fits."""
    return [replace(utterance.frame, is_fd=not utterance.frame.is_fd, data=utterance.frame.data[:8])]


def foreign_data_id(rig: "Rig", utterance: Utterance) -> list[Frame]:
    """Sealed for another message."""
    return [rig.wire.seal(utterance.frame, data_id=0x3F0)]


def twice(_rig: "Rig", utterance: Utterance) -> list[Frame]:
    """Once more."""
    return [utterance.frame, utterance.frame]


def also(change: Callable[["Rig", Utterance], list[Frame]]) -> Callable[["Rig", Utterance], list[Frame]]:
    """The sound frame, and after it the changed one."""
    return lambda rig, utterance: [utterance.frame, *change(rig, utterance)]


def sometimes(
    share: float, change: Callable[["Rig", Utterance], list[Frame]]
) -> Callable[["Rig", Utterance], list[Frame]]:
    """To this share of the frames, by the case's seed."""
    return lambda rig, utterance: change(rig, utterance) if rig.random.random() < share else [utterance.frame]


def counter_of(choose: Callable[[int], int]) -> Injection:
    """Every frame of the sample with another counter, sealed anew."""

    def change(rig: "Rig", utterance: Utterance) -> list[Frame]:
        return [with_counter(rig, utterance.frame, choose(utterance.counter) % rig.wire.counters)]

    return frames(change)


def with_counter(rig: "Rig", frame: Frame, counter: int) -> Frame:
    """The same content under another counter."""
    told = rig.wire.intact(frame)
    assert told is not None
    values = {word: value for word, value in told.signals.items() if word != "COUNTER"}
    return rig.wire.pack(told.name, counter, **values)


def skips(by: int, every: int = ALWAYS) -> Injection:
    """So many counter values of the sample are left out, at once and then after every n-th sample."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        tick = [0]

        def skip() -> None:
            if tick[0] % every == 0:
                rig.vehicle.step_counters(by)
            tick[0] += 1

        with _each_tick(rig, skip):
            yield

    return inject


def mixed_cycles() -> Injection:
    """Of one sample only its last part is sent, of the next only the others, and so on: none is ever whole."""

    class _Late(Fault):
        def __init__(self) -> None:
            self._tick = 0

        def frames(self, spoken: list[Utterance]) -> list[Frame]:
            self._tick += 1
            last = spoken[-1].name
            return [u.frame for u in spoken if u.name == "VEHICLE_STATUS" or (u.name == last) is bool(self._tick % 2)]

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        if len(rig.wire.sample) < 2:
            raise NotApplicableError("a sample of this vehicle's is one message: its parts cannot be mixed")
        return _on(rig, _Late())

    return inject


def older_again(every: int) -> Injection:
    """After every n-th sample, the one of 80 ms before comes once more, as it was."""

    class _Again(Fault):
        def __init__(self) -> None:
            self._past: list[list[Frame]] = []

        def frames(self, spoken: list[Utterance]) -> list[Frame]:
            out = [utterance.frame for utterance in spoken]
            self._past.append(out)
            return out + self._past[-9] if len(self._past) > 8 and len(self._past) % every == 0 else out

    return lambda rig: _on(rig, _Again())


def values(count: int = ALWAYS, **changed: float) -> Injection:
    """Signals of the next samples have these values."""

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        return _on(rig, _Values(count, lambda all_values: _set(rig, all_values, changed)))

    return inject


def out_of_range(word: str) -> Injection:
    """A signal is above the greatest value that the DBC gives it, as far as its bits allow."""

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        most, most_of_bits = rig.wire.greatest(word)
        if most_of_bits <= most:
            raise NotApplicableError(f"{word} of this vehicle's can say nothing beyond its range")
        value = min(most_of_bits, most + max(1.0, abs(most)) / 5.0)
        return _on(rig, _Values(ALWAYS, lambda all_values: _set(rig, all_values, {word: value})))

    return inject


def added(count: int = ALWAYS, **by: float) -> Injection:
    """Signals of the next samples are off by so much."""

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        def change(all_values: Values) -> None:
            for word, offset in by.items():
                all_values[rig.wire.part_of(word)][word] += offset

        return _on(rig, _Values(count, change))

    return inject


def _set(rig: "Rig", all_values: Values, changed: dict[str, float]) -> None:
    for word, value in changed.items():
        all_values[rig.wire.part_of(word)][word] = value


def frozen() -> Injection:
    """Everything of the sample stands still, with a live counter, while the vehicle moves."""

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        kept: Values = {}

        def change(all_values: Values) -> None:
            for name in rig.wire.sample:
                kept.setdefault(name, dict(all_values[name]))
                all_values[name].update(kept[name])

        return _on(rig, _Values(ALWAYS, change))

    return inject


def left_out(every: int) -> Injection:
    """Every n-th sample is not sent. The commands must show the same gaps, as much later as the device is slow."""

    class _LeftOut(Fault):
        def __init__(self) -> None:
            self._tick = 0

        def frames(self, spoken: list[Utterance]) -> list[Frame]:
            self._tick += 1
            return [u.frame for u in spoken if u.name == "VEHICLE_STATUS" or self._tick % every]

    return lambda rig: _on(rig, _LeftOut())


def jitter(most_s: float) -> Injection:
    """Every sample comes late by up to so much, as it happens."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        rig.delay_s = lambda: rig.random.uniform(0.0, most_s)
        try:
            yield
        finally:
            rig.delay_s = lambda: 0.0

    return inject


def attribute(**changed: object) -> Injection:
    """The vehicle itself is changed: driver, mode, pose, plant (`plant_…`); put back at the end."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        before = {}
        for name, value in changed.items():
            owner, short = (rig.vehicle.plant, name[6:]) if name.startswith("plant_") else (rig.vehicle, name)
            before[name] = getattr(owner, short)
            setattr(owner, short, value)
        yield
        for name, value in before.items():
            owner, short = (rig.vehicle.plant, name[6:]) if name.startswith("plant_") else (rig.vehicle, name)
            setattr(owner, short, value)

    return inject


def becomes(**changed: object) -> Injection:
    """Like `attribute`, but it stays so until the driver makes the vehicle ready."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        for name, value in changed.items():
            setattr(rig.vehicle, name, value)
        yield

    return inject


def for_a_moment(**changed: object) -> Injection:
    """Like `becomes`; at the end the driver makes the vehicle ready, and nobody arms the device."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        with becomes(**changed)(rig):
            yield
        rig.vehicle.make_ready()

    return inject


@contextmanager
def nothing(_rig: "Rig") -> Iterator[None]:
    """The vehicle is driven, that is all."""
    yield


def link(down_s: float | None = None) -> Injection:
    """The interface goes down, and up again at the end, or after `down_s`."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        rig.set_link(up=False)
        rig.injects()
        try:
            if down_s is not None:
                rig.run_for(down_s)
                rig.set_link(up=True)
            yield
        finally:
            rig.set_link(up=True)

    return inject


def made_anew() -> Injection:
    """The interface is deleted, and made anew under its name at the end."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        channel = rig.device_channel
        rig.command(["ip", "link", "del", channel])
        rig.injects()
        try:
            yield
        finally:
            rig.command(["ip", "link", "add", channel, "type", "vcan"])
            rig.command(["ip", "link", "set", channel, "mtu", "72", "up"])
            rig.bus.reopen()

    return inject


def queue(*words: str, at: str = "{device}") -> Injection:
    """A queueing discipline on one side of the cable, taken away at the end."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        side = at.format(device=rig.device_channel, bench=rig.bus.channel)
        rig.command(["tc", "qdisc", "replace", "dev", side, "root", *words])
        rig.injects()
        try:
            yield
        finally:
            rig.command(["tc", "qdisc", "del", "dev", side, "root"])

    return inject


def both(*injections: Injection) -> Injection:
    """At once."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        with ExitStack() as stack:
            for injection in injections:
                stack.enter_context(injection(rig))
            yield

    return inject


def signals(*numbers: signal.Signals, apart_s: float = 0.0) -> Injection:
    """To the device, one after the other."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        for number in numbers:
            rig.device.send(number)
            rig.run_for(apart_s)
        yield

    return inject


def paused() -> Injection:
    """The device is stopped by the operating system, and goes on at the end."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        rig.device.send(signal.SIGSTOP)
        try:
            yield
        finally:
            rig.device.send(signal.SIGCONT)

    return inject


def recorder_gets(number: signal.Signals) -> Injection:
    """Whoever writes the drive down gets a signal, and goes on at the end if it still can."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        writers = rig.device.writers(Path(rig.words["record"]).parent)
        if not writers:
            raise NotApplicableError("no process that the device has begun writes the drive down")
        try:
            for writer in writers:
                writer.send(number)
            yield
        finally:
            for writer in writers:
                writer.send(signal.SIGCONT)
                writer.close()

    return inject


@contextmanager
def full_disk(rig: "Rig") -> Iterator[None]:
    """The disk on which the drive is written down has no room left; some comes back at the end."""
    filler = Path(rig.words["record"]).parent / "filler"
    with open(filler, "wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(1 << 12)):
            pass
    rig.injects()
    try:
        yield
        if filler.stat().st_size == 0:
            raise NotApplicableError("there was no room to take away")
    finally:
        filler.unlink()


def viewer(change: Callable[["Rig", Process], AbstractContextManager[None]]) -> Injection:
    """A viewer is begun and waited for; then `change` begins."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        process = rig.beside(rig.viewer)
        try:
            _wait_for_page(rig, process)
            rig.injects()
            with change(rig, process):
                yield
        finally:
            rig.rest(process)

    return inject


@contextmanager
def viewer_stopped(_rig: "Rig", process: Process) -> Iterator[None]:
    """By the operating system; it goes on at the end."""
    process.send(signal.SIGSTOP)
    yield
    process.send(signal.SIGCONT)
    _must_live(process, "the viewer")


@contextmanager
def viewer_killed(rig: "Rig", process: Process) -> Iterator[None]:
    """And another one is begun in its place."""
    process.send(signal.SIGKILL)
    again = rig.beside(rig.viewer)
    try:
        _wait_for_page(rig, again)
        yield
        _must_live(again, "the other viewer")
    finally:
        rig.rest(again)


@contextmanager
def many_pages(rig: "Rig", process: Process) -> Iterator[None]:
    """Browsers come that ask for everything, read nothing and send nonsense."""
    pages = rig.beside([sys.executable, str(TOOLS / "hil" / "pages.py"), rig.words["port"]])
    try:
        yield
        _must_live(pages, "who floods")
        _must_live(process, "the viewer")
    finally:
        rig.rest(pages)


def _wait_for_page(rig: "Rig", process: Process) -> None:
    port = int(rig.words["port"])
    rig.wait_for(lambda: _answers(port) or not process.lives, VIEWER_S, "the viewer to answer")
    _must_live(process, "the viewer")
    if not _answers(port):
        raise NotApplicableError("the viewer does not answer")


def _must_live(process: Process, who: str) -> None:
    if not process.lives:
        raise NotApplicableError(f"{who} has ended, see what it said")


def _answers(port: int) -> bool:
    with socket.socket() as page:
        page.setblocking(False)
        page.connect_ex(("127.0.0.1", port))
        return page.connect_ex(("127.0.0.1", port)) in (0, errno.EISCONN)


@contextmanager
def without_memory(rig: "Rig") -> Iterator[None]:
    """The device gets no more memory than it has, until the end."""
    with rig.device.without_memory():
        yield


def wall_clock(by_s: float) -> Injection:
    """The wall clock steps, and back at the end: while nothing waits to be heard that bears a stamp from before."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        rig.hear_answers()
        time.clock_settime(time.CLOCK_REALTIME, time.time() + by_s)
        try:
            yield
            rig.hear_answers()
        finally:
            time.clock_settime(time.CLOCK_REALTIME, time.time() - by_s)

    return inject


def flood(make: Callable[["Rig", int], Frame], per_tick: int) -> Injection:
    """So many frames of the bench's own besides, each tick."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        count = [0]

        def send() -> None:
            for _ in range(per_tick):
                count[0] += 1
                rig.bus.send(make(rig, count[0]))

        with _each_tick(rig, send):
            yield

    return inject


@contextmanager
def _each_tick(rig: "Rig", call: Callable[[], None]) -> Iterator[None]:
    """A rig that has fallen silent has forgotten it by then."""
    rig.every_tick.append(call)
    try:
        yield
    finally:
        if call in rig.every_tick:
            rig.every_tick.remove(call)


def damaged_sample(rig: "Rig", number: int) -> Frame:
    """A frame with the sample's identifier, and nothing in it that fits."""
    name = rig.wire.sample[number % len(rig.wire.sample)]
    data = rig.random.randbytes(rig.wire.lengths[name])
    return Frame(0, rig.wire.ids[name], data, is_fd=rig.wire.is_fd)


def rival_command(rig: "Rig", number: int) -> Frame:
    """A sound command of somebody else's."""
    names = rig.wire.command
    return rig.wire.pack(names[number % len(names)], number // len(names) % rig.wire.counters, ENABLE=1)


def error_frame(kind: int, data: bytes = bytes(8)) -> Callable[["Rig", int], Frame]:
    """As a CAN controller reports it; `kind` by linux/can/error.h."""
    return lambda _rig, _number: Frame(0, kind, data, is_error=True)


def second_vehicle() -> Injection:
    """Another vehicle of the same kind speaks, from another place, with counters of its own.

    By the case's seed they are ahead. Were they the same, or so little behind that the vehicle's own next sample is
    still a step that is allowed, all that the other one says would be dropped, and would be harmless.
    """

    def make(rig: "Rig", number: int, ahead: int) -> Frame:
        names = rig.wire.sample
        plant = rig.vehicle.plant
        place = {"POS_X": plant.x_m + 40.0, "POS_Y": 25.0, "SPEED": 0.0, "POSE_VALID": 1.0}
        name = names[(number - 1) % len(names)]
        known = {word: value for word, value in place.items() if rig.wire.part_of(word) == name}
        if rig.wire.has("POSE_FRAME") and rig.wire.part_of("POSE_FRAME") == name:
            known["POSE_FRAME"] = rig.wire.number("POSE_FRAME", "MAP")
        return rig.wire.pack(name, (rig.vehicle.counter_of(name) + ahead) % rig.wire.counters, **known)

    def inject(rig: "Rig") -> AbstractContextManager[None]:
        ahead = rig.random.randrange(1, rig.wire.counters - GREATEST_STEP + 1)
        return flood(lambda rig, number: make(rig, number, ahead), len(rig.wire.sample))(rig)

    return inject


def replayed(back_s: float) -> Injection:
    """What was on the whole bus since `back_s` ago is played once more, by the clock, while the vehicle is silent."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        begin_ns = time.monotonic_ns()
        since_ns = begin_ns - round(back_s * S)
        old = [h.frame for h in rig.heard if h.frame.stamp_ns > since_ns and not h.frame.is_error]

        def send() -> None:
            while old and old[0].stamp_ns + round(back_s * S) <= time.monotonic_ns():
                rig.bus.send(old.pop(0))

        rig.vehicle_speaks = False
        with _each_tick(rig, send):
            yield
        rig.vehicle_speaks = True

    return inject


def load(share: float) -> Injection:
    """Strangers' frames of low priority fill the bus up to this share, from a process of their own."""

    @contextmanager
    def inject(rig: "Rig") -> Iterator[None]:
        since_ns = time.monotonic_ns() - S
        own_per_second = sum(heard.frame.stamp_ns > since_ns for heard in rig.heard)
        all_per_second = share * rig.wire.profile["bus"]["bitrate"] / STRANGERS_BITS
        per_second = max(0.0, all_per_second - own_per_second)
        words = [str(TOOLS / "hil" / "load.py"), rig.bus.channel, f"{per_second:.0f}", f"{rig.wire.free_block():x}"]
        filler = rig.beside([sys.executable, *words])
        rig.run_for(0.5)
        rig.injects()
        begin_s, before = time.monotonic(), rig.bus.packets()
        try:
            yield
            seen_per_second = (rig.bus.packets() - before) / (time.monotonic() - begin_s)
        finally:
            rig.rest(filler)
        if seen_per_second < all_per_second / 2.0:
            raise BusIsEmptyError(f"{seen_per_second:.0f} of {all_per_second:.0f} frames a second were on the bus")

    return inject


def rng(seed: int, name: str) -> random.Random:
    """The case's own, the same for every run with this seed."""
    return random.Random(f"{seed} {name}")
