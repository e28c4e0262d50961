"""tools/promises: its plan fits the page of failures and the code, its table fits the plan, and it tells a test that
notices a broken promise from one that does not."""

import re
import subprocess
from pathlib import Path

import pytest
from promise_testing.failure_page import Row, rows
from promise_testing.run import (
    NOT_NOTICED,
    PAGE,
    TABLE,
    UNSOUND,
    Defect,
    Outcome,
    Plan,
    faults_of,
    judge,
    load_plan,
    table_of,
    updated_table,
)

STOPS = Row("B1", "link down", "an error", "stops within 10 ms", "`LINK_DOWN`", ("tests/test_brake.py::test_it_stops",))
LETS_GO = Row("B2", "link up", "no error", "lets go", "–", ("tests/test_brake.py::test_it_lets_go",))
BRAKE = "LIMIT_MS = 10\nFORCE = 3\n"
TESTS = """
from brake import FORCE, LIMIT_MS

def test_it_stops():
    assert LIMIT_MS <= 10

def test_it_lets_go():
    assert {lets_go}
"""


def broken(
    row: str = "B1", promise: str = "within 10 ms", was: str = "10", becomes: str = "20", test: str = ""
) -> Defect:
    """A defect of the brake."""
    return Defect(row, promise, "brake.py", was, becomes, (test,) if test else ())


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of one module and its tests."""
    root = tmp_path / "project"
    (root / "tests").mkdir(parents=True)
    (root / "brake.py").write_text(BRAKE)
    (root / "tests" / "test_brake.py").write_text(TESTS.format(lets_go="FORCE"))
    (root / "pytest.ini").write_text("[pytest]\naddopts = -ra\n")
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    return root


def test_every_row_of_the_page_has_a_defect_that_fits_page_and_code() -> None:
    assert faults_of(load_plan().defect, rows(PAGE.read_text(encoding="utf-8"))) == []


def test_the_table_has_every_defect_of_the_plan_and_the_test_that_noticed_it() -> None:
    page, plan = TABLE.read_text(encoding="utf-8"), load_plan()
    table = updated_table((), plan, page)
    assert page.endswith(table)
    lines = table.splitlines()[2:]
    assert len(lines) == len(plan.defect)
    assert [line for line in lines if not re.search(r" \| `tests/[a-z_0-9/]+\.py::test_\w+` \|$", line)] == []


def test_a_defect_that_is_not_judged_keeps_its_line_and_one_that_is_gone_has_none() -> None:
    kept, judged, gone = broken(), broken("B2", "lets go", "3", "4"), broken("B2", "lets go", "3", "0")
    page = table_of([Outcome(gone, "tests/a.py::test_a"), Outcome(kept, "tests/b.py::test_b")])
    found = updated_table([Outcome(judged, NOT_NOTICED)], Plan((kept, judged)), f"# Page\n\n{page}")
    assert found == table_of([Outcome(kept, "tests/b.py::test_b"), Outcome(judged, NOT_NOTICED)])


@pytest.mark.parametrize(
    ("defect", "fault"),
    [
        (broken(), None),
        (broken(row="B3"), "B3: no such row: 'within 10 ms'"),
        (broken(promise="within 5 ms"), "B1: no row has: 'within 5 ms'"),
        (broken(was="11"), "B1: brake.py: occurs 0 times instead of once: '11'"),
        (broken(was=" = "), "B1: brake.py: occurs 2 times instead of once: ' = '"),
        (broken(becomes="10"), "B1: brake.py: changes nothing: '10'"),
        (broken(becomes="1 0"), "B1: brake.py: does not compile"),
        (broken(test="tests/test_brake.py::test_it_lets_go"), "B1: not a test of the row: "),
    ],
)
def test_a_defect_that_does_not_fit_is_named(project: Path, defect: Defect, fault: str | None) -> None:
    found = faults_of([defect, broken("B2", "lets go", "3", "4")], [STOPS, LETS_GO], project)
    assert [line for line in found if "no defect" not in line] == ([] if fault is None else [found[0]])
    assert fault is None or found[0].startswith(fault)


def test_a_row_without_a_defect_is_named(project: Path) -> None:
    assert faults_of([broken()], [STOPS, LETS_GO], project) == ["B2: no defect for: link up"]


def test_a_broken_promise_is_noticed_by_the_test_that_guards_it_and_not_by_one_that_does_not(project: Path) -> None:
    defects = [broken(), broken("B2", "lets go", "3", "4"), broken("B2", "lets go", "3", "0")]
    outcomes = judge(defects, [STOPS, LETS_GO], bus=False, jobs=1, root=project)
    assert [outcome.noticed_by for outcome in outcomes] == [STOPS.tests[0], NOT_NOTICED, LETS_GO.tests[0]]
    assert (project / "brake.py").read_text() == BRAKE


def test_a_test_that_fails_anyhow_proves_nothing(project: Path) -> None:
    (project / "tests" / "test_brake.py").write_text(TESTS.format(lets_go="False"))
    (outcome,) = judge([broken("B2", "lets go", "3", "4")], [LETS_GO], bus=False, jobs=1, root=project)
    assert outcome.noticed_by == UNSOUND
