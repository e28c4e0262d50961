"""Differences between two runs: verdicts first, then measurements."""

import math
from dataclasses import dataclass

from hil_bench.report.formatting import Group, clean, groups, number, quantity
from hil_bench.result import Run, Verdict

NOTABLE_RATIO = 1.25
RESOLUTION = {"s": 0.001, "ms": 1.0, "µs": 1000.0, "m": 0.02, "m/s": 0.05, "m/s²": 0.1, "rad": 0.002, "rad/s": 0.01}
"""Differences up to it are noise or the wire's steps, not a change; of whole numbers 1, of any other unit none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictChange:
    """A case whose verdict changed."""

    name: str
    old: Verdict
    new: Verdict
    old_share: str
    """'19/20' where there were repetitions."""
    new_share: str
    why: str
    """Of what did not pass now."""

    @property
    def is_worse(self) -> bool:
        return self.old is Verdict.PASS or self.new is Verdict.FAIL


@dataclass(frozen=True, slots=True, kw_only=True)
class Moved:
    """A measurement that changed notably, as the worst of all repetitions."""

    name: str
    what: str
    unit: str
    old: float
    new: float

    @property
    def ratio(self) -> float:
        return self.new / self.old if self.old else math.inf

    @property
    def is_worse(self) -> bool:
        """Measurements are compared with upper limits: more is nearer to them."""
        return self.new > self.old


@dataclass(frozen=True, slots=True, kw_only=True)
class Differences:
    """All of them, each list with the most important first."""

    old_began: str
    new_began: str
    loud: list[str]
    """Why the two runs may not be comparable at all."""
    verdicts: list[VerdictChange]
    new_cases: list[str]
    gone_cases: list[str]
    moved: list[Moved]
    environment: list[tuple[str, str, str]]
    """Other differences: name, then, now."""


def differences(old: Run, new: Run) -> Differences:
    """From the older to the newer."""
    before = {group.name: group for group in groups(old)}
    after = {group.name: group for group in groups(new)}
    both = [(before[name], group) for name, group in after.items() if name in before]
    changes = [_change(was, now) for was, now in both if (was.verdict, was.share) != (now.verdict, now.share)]
    moved = [moved for was, now in both for moved in _moved(was, now)]
    return Differences(
        old_began=old.began,
        new_began=new.began,
        loud=_loud(old, new),
        verdicts=sorted((c for c in changes if _is_change(c)), key=lambda change: not change.is_worse),
        new_cases=[name for name in after if name not in before],
        gone_cases=[name for name in before if name not in after],
        moved=sorted(moved, key=lambda m: (not m.is_worse, -abs(math.log(max(m.ratio, 1e-9))))),
        environment=_environment(old, new),
    )


def text(found: Differences) -> str:
    """For a terminal."""
    lines = [f"Compared with the run of {found.old_began}:"]
    lines += [f"  !! {warning}" for warning in found.loud]
    lines += [f"  {_verdict_line(change)}" for change in found.verdicts] or ["  no verdict has changed"]
    lines += [f"  new:  {name}" for name in found.new_cases]
    lines += [f"  gone: {name}" for name in found.gone_cases]
    lines += [f"  {_moved_line(moved)}" for moved in found.moved] or ["  no measurement has changed notably"]
    lines += [f"  {name}: {then} → {now}" for name, then, now in found.environment]
    return "\n".join(clean(line) for line in lines)


def factor(moved: Moved) -> str:
    """'× 1.4'; of nothing before, that it is new."""
    return f"× {number(round(moved.ratio, 2))}" if math.isfinite(moved.ratio) else "from nothing"


def _verdict_line(change: VerdictChange) -> str:
    then, now = (" ".join(filter(None, pair)) for pair in _shared(change))
    return f"{'worse' if change.is_worse else 'better':<6} {change.name}: {then} → {now}" + (
        f" ({change.why})" if change.why else ""
    )


def _shared(change: VerdictChange) -> tuple[tuple[str, str], tuple[str, str]]:
    return (change.old_share, change.old), (change.new_share, change.new)


def _moved_line(moved: Moved) -> str:
    then, now = quantity(moved.old, moved.unit), quantity(moved.new, moved.unit)
    return f"{'more' if moved.is_worse else 'less':<6} {moved.name}, {moved.what}: {then} → {now} ({factor(moved)})"


def _change(was: Group, now: Group) -> VerdictChange:
    why = "" if now.verdict is Verdict.PASS else now.worst.why
    return VerdictChange(
        name=now.name, old=was.verdict, new=now.verdict, old_share=was.share, new_share=now.share, why=why
    )


def _is_change(change: VerdictChange) -> bool:
    """20/20 after 5/5 is none; 17/20 after 19/20 is one."""
    return change.old is not change.new or change.new is Verdict.FAIL


def _moved(was: Group, now: Group) -> list[Moved]:
    then, today = _measured(was), _measured(now)
    return [
        Moved(name=now.name, what=what, unit=unit, old=then[what, unit], new=value)
        for (what, unit), value in today.items()
        if (what, unit) in then and _is_notable(then[what, unit], value, unit)
    ]


def _measured(group: Group) -> dict[tuple[str, str], float]:
    """By what was measured and in which unit: the worst of all repetitions."""
    found: dict[tuple[str, str], float] = {}
    for what, unit, value in _all_measured(group):
        if math.isfinite(value):
            found[what, unit] = max(value, found.get((what, unit), -math.inf))
    return found


def _all_measured(group: Group) -> list[tuple[str, str, float]]:
    checks = [(c.text, c.unit, c.measured) for case in group.cases for c in case.checks if c.measured is not None]
    wide = [distribution for case in group.cases for distribution in case.distributions]
    return [
        *checks,
        *((f"{one.name} p99", one.unit, one.p99) for one in wide),
        *((f"{one.name} max", one.unit, one.max) for one in wide),
    ]


def _is_notable(old: float, new: float, unit: str) -> bool:
    small, large = sorted((abs(old), abs(new)))
    resolution = RESOLUTION.get(unit, 1.0 if old == int(old) and new == int(new) else 0.0)
    return abs(new - old) > resolution and (old * new < 0.0 or large >= NOTABLE_RATIO * small)


def _loud(old: Run, new: Run) -> list[str]:
    found = []
    if old.evidence is not new.evidence:
        found.append(f"ANOTHER CLASS OF EVIDENCE: {old.evidence} then, {new.evidence} now")
    if old.profile_hash != new.profile_hash:
        found.append(
            f"ANOTHER PROFILE: {old.profile} {old.profile_hash[:12]} then, {new.profile} {new.profile_hash[:12]} now"
        )
    return found


def _environment(old: Run, new: Run) -> list[tuple[str, str, str]]:
    then, now = (
        {
            "device": run.device,
            "version of the device": run.device_version,
            "files of the device (SHA-256)": run.device_hash,
            "channel": run.channel,
            "seed": str(run.seed),
            **run.environment,
        }
        for run in (old, new)
    )
    return [
        (name, then.get(name, "—"), now.get(name, "—"))
        for name in dict.fromkeys([*then, *now])
        if then.get(name) != now.get(name)
    ]
