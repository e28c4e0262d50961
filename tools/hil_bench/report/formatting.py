"""How texts, numbers and verdicts are formatted, the same in every report."""

import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

from hil_bench.result import CaseResult, Check, Evidence, Measured, Run, Verdict, verdict_of

LONGEST_TEXT = 2000
NOTHING = "—"

SHOWS = {
    Evidence.VIRTUAL_BUS: "Shows what the program under test does with these inputs, on a simulated bus and with a "
    "simulated vehicle. Shows nothing about adapters, wiring, the timing of a physical bus, actuators or a vehicle: "
    "a run on a virtual bus is never evidence about hardware.",
    Evidence.REAL_BUS: "Shows what the device under test does on this physical bus with this adapter. The vehicle is "
    "simulated: shows nothing about actuators, brakes, tyres or a real vehicle.",
    Evidence.REAL_VEHICLE: "Shows what was measured on this vehicle under the conditions listed below. Shows nothing "
    "about other vehicles, loads, roads or weather.",
}
"""What a class of evidence does and does not prove."""

_WORST_FIRST = (Verdict.FAIL, Verdict.NOT_EXECUTED, Verdict.PASS, Verdict.NOT_APPLICABLE)
_ATTEMPTS = {2: "second attempt", 3: "third attempt"}


def clean(text: str) -> str:
    """The text with control and direction characters made visible, so that it cannot disguise itself."""
    shown = text[:LONGEST_TEXT]
    if not shown.isprintable():
        shown = "".join(_visible(character) for character in shown)
    return shown if len(text) <= LONGEST_TEXT else f"{shown}… ({len(text) - LONGEST_TEXT} more characters)"


def is_finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def number(value: float | None) -> str:
    """At most three significant digits, with a true minus; a dash where there is no number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == int(value) and abs(value) < 1e12:
        text = f"{int(value):,}".replace(",", " ") if abs(value) >= 10_000 else str(int(value))
    elif 1e-4 <= abs(value) < 1e6:
        digits = max(0, 2 - math.floor(math.log10(abs(value))))
        text = f"{value:.{digits}f}".rstrip("0").rstrip(".") if digits else f"{value:.0f}"
    else:
        text = f"{value:.3g}"
    return text.replace("-", "−")


def scale_of(unit: str, size: float) -> tuple[float, str]:
    """Factor and unit for display: times below a second are shown in ms."""
    return (1e3, "ms") if unit == "s" and 0.0 < size < 1.0 else (1.0, unit)


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit; times below a second in ms."""
    if value is None or not math.isfinite(value):
        return NOTHING
    scale, shown = scale_of(unit, abs(value))
    return f"{number(value * scale)} {shown}".rstrip()


def measured_of_limit(check: Check) -> str:
    """'34 of 150 ms'; empty without a measurement."""
    if check.measured is None:
        return ""
    if check.limit is None or not math.isfinite(check.limit):
        return quantity(check.measured, check.unit)
    scale, shown = scale_of(check.unit, abs(check.limit))
    return f"{number(check.measured * scale)} of {number(check.limit * scale)} {shown}".rstrip()


def exact(value: float | None, unit: str) -> str:
    """As `quantity`, with one digit more: a measured threshold differs little from the stated one."""
    if value is None or not math.isfinite(value):
        return NOTHING
    scale, shown = scale_of(unit, abs(value))
    return f"{value * scale:.4g} {shown}".rstrip().replace("-", "−")


def acts_at(measured: Measured) -> str:
    """'3.04 m'."""
    return "did not act" if measured.acts_at is None else exact(measured.acts_at, measured.unit)


def tolerance(measured: Measured) -> str:
    """'2.9 m to 3.2 m'."""
    lowest, highest = (exact(end, measured.unit) for end in (measured.lowest, measured.highest))
    if measured.lowest is None:
        return f"at most {highest}"
    return f"at least {lowest}" if measured.highest is None else f"{lowest} to {highest}"


def describe_threshold(measured: Measured) -> str:
    """'lateral deviation, to the left: acts at 3.04 m, profile 3 m'."""
    place = f", {measured.place}" if measured.place else ""
    profile = exact(measured.profile, measured.unit)
    return f"{measured.name}{place}: acts at {acts_at(measured)}, profile {profile}"


def duration(seconds: float) -> str:
    """Of a case or a run."""
    if not math.isfinite(seconds):
        return NOTHING
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def used(check: Check) -> float | None:
    """Share of its limit that a measurement used; None without a limit."""
    if check.measured is None or check.limit is None:
        return None
    if not (math.isfinite(check.measured) and math.isfinite(check.limit)):
        return None
    if check.limit > 0.0:
        return max(0.0, check.measured / check.limit)
    return 0.0 if check.measured <= check.limit else math.inf


def closest(case: CaseResult) -> Check | None:
    """The check that used most of its limit."""
    compared = [(share, check) for check in case.checks if (share := used(check)) is not None]
    return max(compared, key=lambda pair: pair[0])[1] if compared else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """All repetitions of one case."""

    name: str
    cases: tuple[CaseResult, ...]

    @property
    def verdict(self) -> Verdict:
        return verdict_of(list(self.cases))

    @property
    def passed(self) -> int:
        return sum(case.verdict is Verdict.PASS for case in self.cases)

    @property
    def share(self) -> str:
        """'20/20' where there were repetitions."""
        return f"{self.passed}/{len(self.cases)}" if len(self.cases) > 1 else ""

    @property
    def worst(self) -> CaseResult:
        """A failed repetition if there is one, else the one closest to a limit."""
        return min(self.cases, key=lambda case: (_WORST_FIRST.index(case.verdict), -_used_most(case)))

    @property
    def duration_s(self) -> float:
        return sum(case.duration_s for case in self.cases)


def groups(run: Run) -> list[Group]:
    """Failed ones first, then those not executed; otherwise in the order in which they were run."""
    names = dict.fromkeys(case.name for case in run.cases)
    found = [Group(name=name, cases=tuple(case for case in run.cases if case.name == name)) for name in names]
    return sorted(found, key=lambda group: _WORST_FIRST.index(group.verdict))


def count(run: Run, verdict: Verdict) -> int:
    """Case results, each repetition for itself."""
    return sum(case.verdict is verdict for case in run.cases)


def thresholds(found: Sequence[Group]) -> list[tuple[str, str, Measured]]:
    """The address of each case's details, its name, and what it measured: failed ones first."""
    rows = [
        (f"case-{number}", group.name, one) for number, group in enumerate(found, 1) for one in group.worst.measured
    ]
    return sorted(rows, key=lambda row: row[2].verdict is not Verdict.FAIL)


def main_figure(case: CaseResult) -> str:
    """One line: why it did not pass, else how close it was to a limit."""
    if case.verdict is not Verdict.PASS:
        return case.why
    check = closest(case)
    figure = f"{check.text}: {measured_of_limit(check)}" if check else ""
    return "; ".join(filter(None, (attempt(case), figure)))


def attempt(case: CaseResult) -> str:
    """Which attempt the result is of, and why there were earlier ones; empty of the first."""
    if not case.void:
        return ""
    which = _ATTEMPTS.get(len(case.void) + 1, f"attempt {len(case.void) + 1}")
    return f"{which}: {'; '.join(case.void)}"


def _used_most(case: CaseResult) -> float:
    check = closest(case)
    return (used(check) or 0.0) if check else 0.0


def _visible(character: str) -> str:
    """Controls, line separators, invisible marks that turn or hide text, halves of surrogate pairs."""
    if ord(character) < 0x20:
        return chr(0x2400 + ord(character))
    category = unicodedata.category(character)
    return f"<U+{ord(character):04X}>" if category[0] == "C" or category in {"Zl", "Zp"} else character
