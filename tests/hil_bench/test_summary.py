"""Tables about a whole run: coverage of the catalogue of faults, and where the time went."""

from pathlib import Path

import example_run
import msgspec
from hil_bench.cases import CATALOGUE
from hil_bench.fault_rows import list_fault_rows
from hil_bench.report import formatting, html, summary
from hil_bench.result import FaultRow, Verdict
from hil_bench.stages import STAGES, durations_s
from test_over_time import case
from vehicle_bus_contract.reference import S

PAGE = """
| word | means |
|---|---|
| stop | brakes |

| # | failure | detected by |
|---|---|---|
| B1 | link `down` | **counter** |
| X9 | nothing | – |

| # | why |
|---|---|
| X9 | needs another vehicle |
"""


def test_every_row_of_the_page_is_listed_with_its_cases() -> None:
    injecting = next(case for case in CATALOGUE if case.fault.split()[:1] == ["B1"])
    rows = list_fault_rows([injecting], PAGE)
    assert rows == [
        FaultRow(row="B1", text="link down", cases=[injecting.name]),
        FaultRow(row="X9", text="nothing", cases=[], why_none="needs another vehicle"),
    ]


def test_every_case_of_the_catalogue_injects_a_row_that_the_page_has() -> None:
    rows = {row.row: row for row in list_fault_rows(CATALOGUE)}
    named = {fault for case in CATALOGUE for fault in case.fault.split()}
    assert named <= set(rows)
    assert {row for row, found in rows.items() if found.cases} == named


def test_coverage_tells_what_passed_from_what_failed_was_left_out_or_has_no_case(tmp_path: Path) -> None:
    rows = [
        FaultRow(row="B1", text="link down", cases=["passed", "also"]),
        FaultRow(row="B2", text="lost", cases=["passed", "failed"]),
        FaultRow(row="B3", text="late", cases=["elsewhere"]),
        FaultRow(row="X9", text="<b>nothing</b>", cases=[], why_none="needs another vehicle"),
    ]
    cases = [case(name="passed"), case(name="also"), case(name="failed", verdict=Verdict.FAIL)]
    run = msgspec.structs.replace(example_run.run_of(cases), faults=rows)
    covered = summary.cover(run, formatting.groups(run))
    assert [one.has_passed for one in covered] == [True, False, False, False]
    assert covered[2].cases[0].verdict is None
    text = html.write(run, tmp_path).read_text(encoding="utf-8")
    assert "3 of 4 rows of FAILURES.md have cases; 1 passed in this run. Without a case: X9." in text
    assert "none: needs another vehicle" in text
    assert "&lt;b&gt;nothing" in text


def test_the_time_of_all_cases_is_summed_by_stage() -> None:
    one = case(spent_s={"start of the device": 3.0, "engaging": 1.0})
    stages = summary.sum_stages(example_run.run_of([one, msgspec.structs.replace(one, repetition=2), case()]))
    assert [(stage.name, stage.spent_s, stage.share) for stage in stages] == [
        ("start of the device", 6.0, 0.75),
        ("engaging", 2.0, 0.25),
    ]


def test_a_stage_that_a_case_skips_takes_no_time() -> None:
    ends_s = (3.0, 0.0, 5.0, 4.0, 7.0, 8.5, 9.0)
    found = dict(durations_s(S, zip(STAGES, (round(end_s * S) for end_s in ends_s), strict=True)))
    assert list(found.values()) == [2.0, 2.0, 0.0, 2.0, 1.5, 0.5]
    assert "engaging" not in found
