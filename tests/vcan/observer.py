"""An observer on a CAN interface. It shares nothing with the program: socket and decoding are the bus contract's."""

import select
import threading
import time
from bisect import bisect
from collections.abc import Callable, Iterable

from vehicle_bus_contract.judge import JITTER_NS, LEAST_LOSS_NS, Pair, Record, examine
from vehicle_bus_contract.reference import CONTROLLER_SENDS, LAYOUT, REFERENCE, DecodedFrame, Frame, intact
from vehicle_bus_contract.socketcan import open_socket, receive_frames

CHANNEL = "vcan0"
GEAR_CHANGE_MPS = REFERENCE.limits.gear_change_mps
PATIENCE_S = 60.0
"""How long something may take that is expected; only a failing test ever waits so long."""
CONTROLLER_IDS = frozenset(LAYOUT[name][0] for name in CONTROLLER_SENDS)


class Observer:
    """Keeps every frame on an interface in the order of arrival, from a thread of its own."""

    def __init__(self, channel: str = CHANNEL, can_ids: Iterable[int] | None = None) -> None:
        """With `can_ids`, only these: so that a flood of others takes no time from the programs under test."""
        self.frames: list[Frame] = []
        self.on_failure: Callable[[], str] = lambda: ""
        """More to say when something does not come."""
        self.is_foreign: Callable[[Frame], bool] = lambda _: False
        """Of frames with the controller's identifiers: those that the test itself has another node send."""
        self._channel, self._can_ids = channel, can_ids
        self._raws = [open_socket(channel, can_ids)]
        self._changed = threading.Condition()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="observer")
        self._thread.start()

    def close(self) -> None:
        """Stop watching; the record stays."""
        self._over.set()
        self._thread.join()
        for raw in self._raws:
            raw.close()

    def reconnect(self) -> None:
        """Watch the interface that has the name now: the one before it was deleted."""
        self._raws.append(open_socket(self._channel, self._can_ids))

    def now(self) -> int:
        """Index of the next frame: the present, as a place in the record."""
        return len(self.frames)

    def wait_for(
        self, what: str, *names: str, since: int = 0, patience_s: float = PATIENCE_S, **wanted: float | str
    ) -> tuple[int, DecodedFrame]:
        """The first intact frame of one of the messages from index `since` on whose signals are as wanted.

        REASON is wanted in words. Fails the test, naming `what`, when it does not come.
        """

        def fits(decoded: DecodedFrame) -> bool:
            return decoded.name in names and all(_value(decoded, signal) == value for signal, value in wanted.items())

        return self.wait_until(what, fits, since=since, patience_s=patience_s)

    def wait_until(
        self, what: str, fits: Callable[[DecodedFrame], bool], *, since: int = 0, patience_s: float = PATIENCE_S
    ) -> tuple[int, DecodedFrame]:
        """The first intact frame from index `since` on that fits, and its index."""
        deadline_s = time.monotonic() + patience_s
        index = since
        while True:
            while index < len(self.frames):
                decoded = intact(self.frames[index])
                if decoded is not None and fits(decoded):
                    return index, decoded
                index += 1
            with self._changed:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0:
                    raise AssertionError(f"{what}: did not come in {patience_s:.0f} s; {self._recent()}")
                if index >= len(self.frames):
                    self._changed.wait(left_s)

    def wait_samples(self, count: int, since: int | None = None) -> int:
        """Let the vehicle send so many samples (each 10 ms); the index after them."""
        index = self.now() if since is None else since
        for _ in range(count):
            index = self.wait_for("the vehicle's next sample", "CHASSIS", since=index)[0] + 1
        return index

    def record(self, since: int = 0, until: int | None = None) -> Record:
        """Judge a part of what was seen."""
        return examine(self.frames[since:until])

    def pairs(self, since: int = 0, until: int | None = None) -> list[Pair]:
        """The command pairs of a part of what was seen."""
        return self.record(since, until).pairs

    def sent_by_controller(self, since: int = 0, until: int | None = None) -> list[Frame]:
        """Every frame that carries an identifier of the controller's."""
        return [frame for frame in self.frames[since:until] if frame.can_id in CONTROLLER_IDS]

    def _recent(self) -> str:
        record = examine(self.frames[-200:])
        newest = {decoded.name: decoded for decoded in record.decoded}
        return "; ".join(
            f"{name} { ({signal: round(value, 4) for signal, value in decoded.signals.items()}) }"
            for name, decoded in newest.items()
        )

    def _watch(self) -> None:
        while not self._over.is_set():
            raw = self._raws[-1]
            select.select([raw], [], [], 0.2)
            fresh = receive_frames(raw)
            if fresh:
                with self._changed:
                    self.frames += fresh
                    self._changed.notify_all()


def _value(decoded: DecodedFrame, signal: str) -> float | str:
    return decoded.reason if signal == "REASON" else decoded[signal]


def reasons(pairs: Iterable[Pair]) -> list[str]:
    """The reasons of the pairs, each named once as long as it stays the same."""
    found: list[str] = []
    for pair in pairs:
        if not found or found[-1] != pair.reason:
            found.append(pair.reason)
    return found


def decided(record: Record) -> list[str]:
    """The reasons of a record's pairs, without the stops for state that really did not come.

    On a machine that stands still for a moment the vehicle's samples are late on the wire, and a stop is right, also
    when that moment fell between a sample and its answer.
    """
    stamps = [sample.stamp_ns for sample in record.samples]

    def is_right(pair: Pair) -> bool:
        place = bisect(stamps, pair.drive.stamp_ns)
        if pair.reason not in ("STATE_STALE", "DEADLINE_MISSED") or place < 2:
            return pair.reason == "STATE_STALE"
        last_ns, before_ns = stamps[place - 1], stamps[place - 2]
        waited_ns = pair.drive.stamp_ns - last_ns
        return waited_ns > LEAST_LOSS_NS or (waited_ns < JITTER_NS and last_ns - before_ns > LEAST_LOSS_NS)

    return reasons(pair for pair in record.pairs if not is_right(pair))
