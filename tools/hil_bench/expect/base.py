"""What an expectation is, and what it is judged by: everything on the bus, by the kernel's stamps."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import DecodedFrame, Frame, S

from hil_bench.result import Check, Event, Verdict
from hil_bench.routes import Route
from hil_bench.vehicle import Instant
from hil_bench.vocabulary import Wait
from hil_bench.wire import Wire


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Everything that a case is judged by. Instants are monotonic, ns."""

    begin_ns: int
    inject_ns: int
    """The injection begins; 0 where there is none."""
    end_ns: int
    """The injection is over."""
    then_ns: int
    """The operator acts again, or asks the device to end."""
    samples_ns: Sequence[int]
    """When each complete sample was on the bus."""
    pairs: Sequence[Pair]
    decoded: Sequence[DecodedFrame]
    """Every intact frame of the device."""
    frames: Sequence[Frame]
    """Every frame of the device."""
    history: Sequence[Instant]
    exit_status: int | None
    exit_ns: int
    route: Route
    wire: Wire
    """The vehicle's bus."""
    said: str = ""
    """The device's output from the injection until the operator acts again."""

    def later_s(self, waits_for: Wait) -> float:
        """How much later than with the reference vehicle a reaction may come."""
        return self.wire.later_s[waits_for]

    def has_reason(self, pair: Pair, reasons: Sequence[str]) -> bool:
        """Whether a command has one of these reasons, as far as the vehicle has a signal for it."""
        return not self.wire.tells_reasons or pair.reason in reasons

    def at_s(self, stamp_ns: int) -> float:
        """On the case's time line."""
        return (stamp_ns - self.begin_ns) / S

    def since_s(self, stamp_ns: int) -> float:
        """After the beginning of the injection; 0 for what was sent before."""
        return max(0.0, (stamp_ns - self.inject_ns) / S)

    def between(self, begin_ns: int, end_ns: int) -> list[Pair]:
        """The commands of that time."""
        return [pair for pair in self.pairs if begin_ns <= pair.stamp_ns < end_ns]


class Expectation(Protocol):
    """One thing that must be observed."""

    def judge(self, observed: Observation) -> tuple[Check, list[Event]]:
        """The check, and its events on the time line."""
        ...


def check(text: str, wrong: Iterable[str], measured: float | None = None, limit: float | None = None) -> Check:
    """A check that passes if `wrong` is empty and `measured` (s) is within `limit` (s)."""
    found = list(wrong)
    if measured is not None and limit is not None and measured > limit:
        found.insert(0, f"{measured * 1e3:.1f} ms, more than {limit * 1e3:.0f} ms")
    return Check(
        text=text,
        verdict=Verdict.FAIL if found else Verdict.PASS,
        measured=None if measured is None else measured * 1e3,
        limit=None if limit is None else limit * 1e3,
        unit="" if measured is None and limit is None else "ms",
        found=found[:8],
    )


def not_applicable(text: str, why: str) -> Check:
    """A requirement that this vehicle has nothing for."""
    return Check(text=text, verdict=Verdict.NOT_APPLICABLE, found=[why])


def describe(observed: Observation, pair: Pair) -> str:
    """A command with its time, for a report."""
    stop = ", stop" if pair.is_stop else ""
    return f"{observed.at_s(pair.stamp_ns):.3f} s: ENABLE {pair.is_enabled:d}{stop}, {pair.reason}"
