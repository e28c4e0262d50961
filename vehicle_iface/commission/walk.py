"""The walk: one step after the other, each ended by its result, its time limit, or the person."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from vehicle_iface.commission.checks import PERIOD_S, PREPARED, CheckResult
from vehicle_iface.commission.readings import Moment, Readings
from vehicle_iface.commission.steps import Step
from vehicle_iface.frame import CanFrame
from vehicle_iface.review.findings import Judgement
from vehicle_iface.units import ns_from_s


class Listener(Protocol):
    """A bus that only receives."""

    def wait(self, until_ns: int) -> bool:
        """Sleep until a frame is received (true) or the monotonic clock reaches `until_ns` (false)."""
        ...

    def drain(self) -> list[CanFrame]:
        """Return all frames received since the last call, oldest first, without waiting."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """Result of one step."""

    ask: str
    results: tuple[CheckResult, ...]
    was_skipped: bool = False

    @property
    def judgement(self) -> Judgement:
        """The worst result of its checks."""
        judgements = {one.judgement for one in self.results}
        return next(one for one in (Judgement.CONTRADICTED, Judgement.UNKNOWN, Judgement.AGREES) if one in judgements)


class Presenter(Protocol):
    """Shows the walk to the person, and reads their input."""

    def begin(self, step: Step, number: int, count: int) -> None:
        """Ask the person for a step."""
        ...

    def show(self, step: Step, moment: Moment) -> None:
        """Show the present measurements."""
        ...

    def end(self, result: StepResult) -> None:
        """Show the result of a step."""
        ...

    def wants_to_skip(self) -> bool:
        """Return whether the person skips this step; called once for each moment."""
        ...

    def wants_to_end(self) -> bool:
        """Return whether the person ends the walk."""
        ...


class Walk:
    """Runs the steps on a bus, and never sends."""

    def __init__(
        self,
        bus: Listener,
        readings: Readings,
        record: Callable[[Sequence[CanFrame]], None],
        presenter: Presenter,
        *,
        step_timeout_s: float,
        now_ns: Callable[[], int],
    ) -> None:
        self._bus, self._readings, self._record, self._presenter = bus, readings, record, presenter
        self._step_timeout_ns, self._now_ns = ns_from_s(step_timeout_s), now_ns
        self._due_ns = now_ns()

    def go(self, steps: Sequence[Step]) -> list[StepResult]:
        """Run the steps; `BusError` when the bus is lost."""
        results = []
        for number, step in enumerate(steps, start=1):
            if self._presenter.wants_to_end():
                results.append(_conclude(step, was_skipped=True))
                continue
            self._prepare(step)
            self._presenter.begin(step, number, len(steps))
            results.append(_conclude(step, was_skipped=self._watch(step)))
            self._presenter.end(results[-1])
        return results

    def _prepare(self, step: Step) -> None:
        """Watch the bus for a quarter of a second before the person is asked."""
        for _ in range(PREPARED):
            moment = self._next_moment()
            for check in step.checks:
                check.prepare(moment)

    def _watch(self, step: Step) -> bool:
        """Watch until each check has a result or the time is over; return whether the person skipped it."""
        begin_ns = self._now_ns()
        while not all(check.results for check in step.checks):
            if self._now_ns() - begin_ns >= self._step_timeout_ns:
                return False
            if self._presenter.wants_to_skip() or self._presenter.wants_to_end():
                return True
            moment = self._next_moment()
            for check in step.checks:
                if not check.results:
                    check.take(moment)
            self._presenter.show(step, moment)
        return False

    def _next_moment(self) -> Moment:
        """Receive until the next moment on the grid of `PERIOD_S`, and return its values."""
        self._due_ns = max(self._due_ns + ns_from_s(PERIOD_S), self._now_ns())
        is_over = False
        while not is_over:
            self._bus.wait(self._due_ns)
            is_over = self._now_ns() >= self._due_ns
            frames = self._bus.drain()
            self._record(frames)
            for frame in frames:
                self._readings.take(frame)
        return self._readings.read(self._due_ns)


def _conclude(step: Step, *, was_skipped: bool) -> StepResult:
    results = tuple(result for check in step.checks for result in check.results or (check.give_up(),))
    return StepResult(ask=step.ask, results=results, was_skipped=was_skipped)
