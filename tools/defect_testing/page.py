"""The page of what was measured, `docs/bench_defects.md`."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from defect_testing.findings import Findings, Outcome, Scope
from defect_testing.plan import ROOT, Defect

PAGE = ROOT / "docs" / "bench_defects.md"
HEAD = """# What the bench catches

`tools/bench_defects` puts one defect after the other into a copy of the project and runs the [bench](bench.md) on
vcan0. The defects are one-line changes of the program and of the independent minimal controller; the plan is
[tools/bench_defects.toml](../tools/bench_defects.toml). This page is written by the command.

```
tools/bench_defects                 # every defect that was not measured yet, with the cases expected to catch it
tools/bench_defects --quick         # with the quick run, where it is not known yet whether that catches it
tools/bench_defects --whole         # with the whole catalogue, where its own cases did not catch it
tools/bench_defects --sample 5      # five of those that were caught, each time the same
tools/bench_defects ID… --again     # these, even if they were measured
```

What was measured is kept in `tools/bench_defects.json`, so that a measurement may be interrupted. A defect is caught
where a case fails that the device without the defect passes. A failure by lateness alone counts only for defects of
timing. Each line below that has no case is a gap of the bench, or was not measured.
"""
NOT_MEASURED, NOT_CAUGHT, NOT_BY_ITS_CASES = "not measured", "**not caught**", "**not caught by its cases**"


def make_page(defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    """All of it, in Markdown."""
    seen = [defect for defect in defects if not defect.unseen]
    parts = [
        HEAD,
        _summary("Of the defects below", seen, findings, quick),
        *(
            part
            for title, chosen in (
                ("Defects of the program", [d for d in seen if d.cases and not d.is_minimal]),
                ("Defects of the minimal controller", [d for d in seen if d.cases and d.is_minimal]),
            )
            for part in (f"## {title}\n", _table(chosen, findings, quick))
        ),
    ]
    if hidden := [defect for defect in seen if defect.not_visible]:
        parts += ["## Not visible on the bus\n", _hidden_table(hidden)]
    if unseen := [defect for defect in defects if defect.unseen]:
        parts += [
            "## Written without looking at the cases\n",
            _summary("Of these defects", unseen, findings, quick),
            _table([d for d in unseen if d.cases], findings, quick),
        ]
        if hidden := [d for d in unseen if d.not_visible]:
            parts.append(_hidden_table(hidden))
    return "\n".join(parts)


def write_page(defects: Sequence[Defect], findings: Findings, quick: frozenset[str], path: Path = PAGE) -> None:
    path.write_text(make_page(defects, findings, quick), encoding="utf-8")


def share_caught(
    defects: Iterable[Defect], findings: Findings, quick: frozenset[str] | None = None
) -> tuple[int, int, int]:
    """How many were caught, how many were measured, how many are visible on the bus."""
    caught = measured = visible = 0
    for defect in defects:
        if not defect.cases:
            continue
        visible += 1
        is_caught = findings.catch(defect, quick=quick) is not None
        caught += is_caught
        measured += is_caught or _is_known(defect, findings, quick)
    return caught, measured, visible


def _is_known(defect: Defect, findings: Findings, quick: frozenset[str] | None) -> bool:
    """Whether it was measured that it is not caught."""
    if quick is None:
        return findings.is_judged(defect, Scope.NAMED) or findings.is_judged(defect, Scope.WHOLE)
    return findings.is_judged(defect, Scope.QUICK)


def _summary(of: str, defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    lines = [f"{of}:\n", "| run | caught | measured | visible on the bus |", "|---|---|---|---|"]
    for run, cases in (("all cases", None), ("quick", quick)):
        caught, measured, visible = share_caught(defects, findings, cases)
        percent = f" ({caught / measured:.0%})" if measured else ""
        lines.append(f"| {run} | {caught}{percent} | {measured} | {visible} |")
    return "\n".join(lines) + "\n"


def _table(defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    lines = ["| defect | the controller | caught by | quick |", "|---|---|---|---|"]
    for defect in defects:
        caught = findings.catch(defect)
        by = _cell(caught) if caught else _missed(defect, findings)
        lines.append(f"| {defect.id} | {defect.does} | {by} | {_quick_cell(defect, findings, quick)} |")
    return "\n".join(lines) + "\n"


def _hidden_table(defects: Sequence[Defect]) -> str:
    lines = ["| defect | the controller | why it cannot be seen |", "|---|---|---|"]
    lines += [f"| {defect.id} | {defect.does} | {defect.not_visible} |" for defect in defects]
    return "\n".join(lines) + "\n"


def _cell(outcome: Outcome) -> str:
    check = outcome.check.replace("|", "\\|")
    return f"`{outcome.case}`: {check}"


def _missed(defect: Defect, findings: Findings) -> str:
    if findings.is_judged(defect, Scope.WHOLE):
        return NOT_CAUGHT
    if findings.is_judged(defect, Scope.NAMED):
        return f"{NOT_BY_ITS_CASES}: {', '.join(f'`{case}`' for case in defect.cases)}"
    return NOT_MEASURED


def _quick_cell(defect: Defect, findings: Findings, quick: frozenset[str]) -> str:
    caught = findings.catch(defect, quick=quick)
    if caught is not None:
        return f"`{caught.case}`"
    return "no" if findings.is_judged(defect, Scope.QUICK) else NOT_MEASURED
