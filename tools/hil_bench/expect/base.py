"""What an expectation is, and what it is judged by: everything on the bus, by the kernel's stamps."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import DecodedFrame, Frame, S

from hil_bench.result import Check, Event, Measured, Verdict
from hil_bench.routes import Route
from hil_bench.vehicle import Instant
from hil_bench.vocabulary import Wait
from hil_bench.wire import Wire

QUIET_S = 0.15
"""Commands have ended after this long without one."""


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
    told: Sequence[DecodedFrame] = ()
    """Every intact frame of the vehicle."""
    armed_ns: Sequence[int] = ()
    """When the bench armed the device again."""
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


class Measurement(Protocol):
    """Thresholds that can be read from an observation."""

    def measure(self, observed: Observation) -> list[Measured]:
        """Where the device acted."""
        ...


def measure(measurements: Iterable[Measurement], observed: Observation) -> list[Measured]:
    """All of them; none before the injection has begun."""
    return [one for each in measurements for one in each.measure(observed)] if observed.inject_ns else []


def check_measured(measured: Measured) -> Check:
    """A threshold as a requirement."""
    place = f", {measured.place}" if measured.place else ""
    found = "it did not act" if measured.acts_at is None else f"acts at {measured.acts_at:.4g} {measured.unit}"
    return Check(
        text=f"{measured.name}{place}: acts {_where(measured)} (profile {measured.profile:.4g})",
        verdict=measured.verdict,
        measured=measured.acts_at,
        limit=measured.highest,
        unit=measured.unit,
        found=[] if measured.verdict is Verdict.PASS else [found],
    )


def _where(measured: Measured) -> str:
    """'between 2.9 and 3.2 m', 'at 2.9 m or more', 'at 3.2 m or less'."""
    low, high, unit = measured.lowest, measured.highest, measured.unit
    if low is not None and high is not None:
        return f"between {low:.4g} and {high:.4g} {unit}"
    return f"at {high:.4g} {unit} or less" if low is None else f"at {low:.4g} {unit} or more"


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
