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
tools/bench_defects --virtual       # in virtual time: no vcan0, seconds instead of minutes
tools/bench_defects ID… --again     # these, even if they were measured
```

What was measured is kept in `tools/bench_defects.json`, so that a measurement may be interrupted. A defect is caught
where a case fails that the device without the defect passes. A failure by lateness alone counts only for defects of
timing. In virtual time the same cases and judges have the program's loop or the minimal controller as their device,
without kernel, process and bus. Each line below that has no case is a gap of the bench, or was not measured; the share
of all visible defects is the least that is known. A defect counts as measured with the quick run where a quick case
caught it, or where the whole quick run was made.
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
                ("Defects of the program", [d for d in seen if d.is_visible and not d.is_minimal]),
                ("Defects of the minimal controller", [d for d in seen if d.is_visible and d.is_minimal]),
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
            _table([d for d in unseen if d.is_visible], findings, quick),
        ]
        if hidden := [d for d in unseen if d.not_visible]:
            parts.append(_hidden_table(hidden))
    return "\n".join(parts)


def write_page(defects: Sequence[Defect], findings: Findings, quick: frozenset[str], path: Path = PAGE) -> None:
    path.write_text(make_page(defects, findings, quick), encoding="utf-8")


def summarise(defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    """The shares that were caught, in one line."""
    seen, unseen = [one for one in defects if not one.unseen], [one for one in defects if one.unseen]
    parts = []
    for run, chosen, cases in (("all cases", seen, None), ("quick", seen, quick), ("written apart", unseen, None)):
        caught, measured, visible = share_caught(chosen, findings, cases)
        if visible:
            parts.append(f"{run} {caught} of {visible} ({caught / visible:.0%}), {visible - measured} not measured")
    return f"caught: {'; '.join(parts) or 'nothing is visible'}"


def share_caught(
    defects: Iterable[Defect], findings: Findings, quick: frozenset[str] | None = None, *, virtual: bool = True
) -> tuple[int, int, int]:
    """How many were caught, how many were measured, how many are visible on the bus."""
    caught = measured = visible = 0
    for defect in defects:
        if not defect.is_visible:
            continue
        visible += 1
        is_caught = findings.catch(defect, quick=quick, virtual=virtual) is not None
        caught += is_caught
        measured += is_caught or _is_known(defect, findings, is_quick=quick is not None, virtual=virtual)
    return caught, measured, visible


def _is_known(defect: Defect, findings: Findings, *, is_quick: bool, virtual: bool) -> bool:
    """Whether it was measured that it is not caught."""
    return any(
        findings.is_judged(defect, scope)
        for scope in Scope
        if scope.is_quick is is_quick and (virtual or not scope.is_virtual)
    )


def _summary(of: str, defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    lines = [f"{of}:\n", "| run | caught | measured | visible on the bus | share |", "|---|---|---|---|---|"]
    for run, cases, virtual in (
        ("all cases, on vcan0", None, False),
        ("all cases, on vcan0 or in virtual time", None, True),
        ("quick, on vcan0", quick, False),
        ("quick, on vcan0 or in virtual time", quick, True),
    ):
        caught, measured, visible = share_caught(defects, findings, cases, virtual=virtual)
        share = f"{caught / visible:.0%}" if visible else "–"
        lines.append(f"| {run} | {caught} | {measured} | {visible} | {'' if measured == visible else '≥ '}{share} |")
    return "\n".join(lines) + "\n"


def _table(defects: Sequence[Defect], findings: Findings, quick: frozenset[str]) -> str:
    lines = ["| defect | the controller | caught by | quick |", "|---|---|---|---|"]
    for defect in defects:
        caught = findings.catch(defect)
        by = _cell(*caught) if caught else _missed(defect, findings)
        lines.append(f"| {defect.id} | {defect.does} | {by} | {_quick_cell(defect, findings, quick)} |")
    return "\n".join(lines) + "\n"


def _hidden_table(defects: Sequence[Defect]) -> str:
    lines = ["| defect | the controller | why it cannot be seen |", "|---|---|---|"]
    lines += [f"| {defect.id} | {defect.does} | {defect.not_visible} |" for defect in defects]
    return "\n".join(lines) + "\n"


def _cell(scope: Scope, outcome: Outcome) -> str:
    check = outcome.check.replace("|", "\\|")
    return f"{'*in virtual time* ' if scope.is_virtual else ''}`{outcome.case}`: {check}"


def _missed(defect: Defect, findings: Findings) -> str:
    judged = [scope for scope in Scope if findings.is_judged(defect, scope)]
    if any(scope.is_whole for scope in judged):
        return NOT_CAUGHT
    if any(scope.is_named for scope in judged):
        return f"{NOT_BY_ITS_CASES}: {', '.join(f'`{case}`' for case in defect.cases)}"
    return NOT_MEASURED


def _quick_cell(defect: Defect, findings: Findings, quick: frozenset[str]) -> str:
    caught = findings.catch(defect, quick=quick)
    if caught is not None:
        return f"`{caught[1].case}`"
    return "no" if _is_known(defect, findings, is_quick=True, virtual=True) else NOT_MEASURED
