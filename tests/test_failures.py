"""The page of failures keeps its word: what it names exists, and no fault of the list is missing."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from promise_testing.failure_page import HEADER, TESTS, rows, tables

from vehicle_iface import Reason
from vehicle_iface.profile import load_profile

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "vehicle_iface" / "FAILURES.md").read_text(encoding="utf-8")
FAULTS = {
    *(
        f"{letter}{i + 1}"
        for letter, count in {"B": 18, "F": 8, "S": 10, "T": 6, "C": 9, "V": 4, "P": 7, "W": 8}.items()
        for i in range(count)
    ),
}
"""The list of faults to survive."""
NONE = "–"
MOST_CHARACTERS = 300
"""Of a row; the rest belongs into the list below its table."""
BUDGET = ["fault is in", "terms", "ms"]
OFF_THE_BUS = ["#", "why"]
ON_THE_BUS = "tests/vcan/"
JUDGED_FIXTURES = {"bus", "programs", "loop_end", "cable_programs"}
"""Whoever asks for one of these is judged by the bus contract from the first frame to the last, see `tests/vcan`."""
JUDGED_BY_ITSELF = {
    "tests/vcan/test_drive.py::test_a_viewer_that_is_killed_and_restarted_changes_nothing_on_the_bus",
    "tests/vcan/test_fd.py::test_frames_of_another_kind_or_a_wrong_checksum_change_nothing",
    "tests/vcan/test_two_buses.py::test_the_loss_of_one_of_two_buses_silences_the_loop_names_the_bus_and_stops_the_vehicle",
}
"""A part of one long drive, and tests on the layout for CAN FD and on two buses."""
ALLOWED_MS = 150.0


@cache
def functions_in(file: str) -> dict[str, frozenset[str]]:
    """Test functions in a file below the root, each with what it asks for; none when there is no such file."""
    path = ROOT / file
    if not path.is_file() or not path.name.startswith("test_"):
        return {}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    functions = (node for body in bodies for node in body if isinstance(node, ast.FunctionDef))
    return {
        function.name: frozenset(argument.arg for argument in function.args.args)
        for function in functions
        if function.name.startswith("test_")
    }


def faults_of(page: str) -> list[str]:
    """Everything that is wrong with the page's rows."""
    found, seen = [], set()
    for cells in tables(page, HEADER):
        if len(cells) != len(HEADER):
            found.append(f"{cells[0]}: {len(cells)} cells instead of {len(HEADER)}")
            continue
        number, *words, reason = cells
        seen.add(number)
        found += [f"{number}: an empty cell"] if not all(words) else []
        found += [f"{number}: {what}" for what in _faults_of_reason(reason)]
        characters = len(" | ".join(cells))
        found += [f"{number}: {characters} characters"] if characters > MOST_CHARACTERS else []
    for number, tests in tables(page, TESTS):
        found += [f"{number}: {what}" for what in _faults_of_tests(tests)]
    return found + [f"{number}: no row" for number in sorted(FAULTS - seen)]


def faults_off_the_bus(page: str) -> list[str]:
    """Rows that no test injects on a bus and that are not listed as such, and the other way round."""
    on_the_bus: dict[str, bool] = {}
    for row in rows(page):
        on_the_bus[row.number] = on_the_bus.get(row.number, False) or any(
            test.startswith(ON_THE_BUS) for test in row.tests
        )
    listed = {number for number, why in tables(page, OFF_THE_BUS) if why}
    missing = {number for number, is_on_the_bus in on_the_bus.items() if not is_on_the_bus}
    return [
        *(f"{number}: not injected on a bus" for number in sorted(missing - listed)),
        *(f"{number}: listed for nothing" for number in sorted(listed - missing)),
    ]


def _faults_of_reason(cell: str) -> Iterator[str]:
    names = [] if cell == NONE else cell.split(", ")
    yield from (f"no reason {name}" for name in names if name.strip("`") not in Reason.__members__)


def _faults_of_tests(cell: str) -> Iterator[str]:
    names = re.findall(r"`([^`]+)`", cell)
    if not names:
        yield "no test"
    for name in names:
        file, _, function = name.partition("::")
        if function not in functions_in(file):
            yield f"no test {name}"
        elif file.startswith(ON_THE_BUS) and not (
            name in JUDGED_BY_ITSELF or functions_in(file)[function] & JUDGED_FIXTURES
        ):
            yield f"not judged by the bus contract: {name}"


def faults_of_budget(page: str) -> list[str]:
    """Sums that are wrong or too great, and terms that are not the profile's."""
    found, profile = [], load_profile("reference")
    for _, terms, total in tables(page, BUDGET):
        figures = [float(term.rsplit(" ", 1)[1]) for term in terms.split(" + ")]
        for times, name, figure in re.findall(r"(?:(\d) × )?`(\w+)` ([\d.]+)", terms):
            table = profile.timing if hasattr(profile.timing, name) else profile.plausibility
            of_profile = float(times or 1) * getattr(table, name) * 1000.0
            if float(figure) != pytest.approx(of_profile):
                found.append(f"{name}: {figure} instead of {of_profile:g}")
        if sum(figures) != float(total) or float(total) > ALLOWED_MS:
            found.append(f"{terms}: {total} instead of {sum(figures):g}, at most {ALLOWED_MS:g}")
    return found


def test_every_fault_has_a_row_and_every_row_names_reasons_and_tests_that_exist() -> None:
    assert faults_of(PAGE) == []


def test_every_row_is_injected_on_a_bus_but_for_those_that_the_page_gives_a_reason_for() -> None:
    assert faults_off_the_bus(PAGE) == []


def test_the_time_budgets_sums_are_right_within_what_is_allowed_and_made_of_the_profiles_figures() -> None:
    assert len(list(tables(PAGE, BUDGET))) >= 5
    assert faults_of_budget(PAGE) == []


GOOD = "`tests/test_failures.py::test_a_faulty_row_is_found`"


def page_of(row: str, tests: str) -> str:
    """A page of two tables, in which every fault but B1 has good rows, and B1 these."""
    good = [f"| {number} | x | x | x | {NONE} |" for number in sorted(FAULTS - {"B1"})]
    proven = [f"| {number} | {GOOD} |" for number in sorted(FAULTS - {"B1"})]
    head = ["# A page", "", f"| {' | '.join(HEADER)} |", "|---|---|---|---|---|"]
    middle = ["", f"| {' | '.join(TESTS)} |", "|---|---|"]
    return "\n".join([*head, *good, row, *middle, *proven, tests, "", "| another | table |", "|---|---|", "| B1 | x |"])


@pytest.mark.parametrize(
    ("row", "found"),
    [
        ("| B1 | x | x | x | `LINK_DOWN` |", []),
        ("| B1 | x | x | x | `LINK_DOWN`, `STATE_STALE` |", []),
        ("", ["B1: no row"]),
        ("| B1 | x | x | x | `LINK_UP` |", ["B1: no reason `LINK_UP`"]),
        ("| B1 | x | x | x | |", ["B1: no reason "]),
        ("| B1 | x | | x | – |", ["B1: an empty cell"]),
        ("| B1 | x | x | – |", ["B1: 4 cells instead of 5", "B1: no row"]),
        (f"| B1 | x | x | {'x' * 283} | – |", []),
        (f"| B1 | x | x | {'x' * 284} | – |", ["B1: 301 characters"]),
    ],
)
def test_a_faulty_row_is_found(row: str, found: list[str]) -> None:
    assert faults_of(page_of(row, f"| B1 | {GOOD} |")) == found


@pytest.mark.parametrize(
    ("tests", "found"),
    [
        (f"{GOOD}<br>{GOOD}", []),
        ("by hand", ["B1: no test"]),
        (
            f"{GOOD}<br>`tests/test_failures.py::test_nothing`",
            ["B1: no test tests/test_failures.py::test_nothing"],
        ),
        (
            "`tests/vcan/test_contract.py::test_a_correct_record_has_no_findings`",
            ["B1: not judged by the bus contract: tests/vcan/test_contract.py::test_a_correct_record_has_no_findings"],
        ),
        ("`tests/test_none.py::test_a`", ["B1: no test tests/test_none.py::test_a"]),
        ("`tests/test_failures.py::page_of`", ["B1: no test tests/test_failures.py::page_of"]),
    ],
)
def test_a_row_whose_tests_are_none_is_found(tests: str, found: list[str]) -> None:
    assert faults_of(page_of("| B1 | x | x | x | – |", f"| B1 | {tests} |")) == found


@pytest.mark.parametrize(
    ("tests", "fault"),
    [
        ("", "B1: its row of tests is missing"),
        (f"| B2 | {GOOD} |", "B1: its row of tests is missing"),
        (f"| B1 | {GOOD} |\n| B1 | {GOOD} |", "B1: tests of no row"),
        (f"| B1 | {GOOD} |\n\n* **B1, B99**: x", "details of no row: B99"),
    ],
)
def test_rows_tests_and_details_that_do_not_fit_are_found(tests: str, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        rows(page_of("| B1 | x | x | x | – |", tests))


def test_a_detail_belongs_to_its_row() -> None:
    page = page_of("| B1 | a | b | c | – |", f"| B1 | {GOOD} |\n\n* **B1, B2**: more\n  of it.\n* **B1**: And more.\n")
    (row,) = (row for row in rows(page) if row.number == "B1")
    assert row.text == "a | b | c | – | more of it. And more."


VCAN = "tests/vcan/test_stops.py::test_an_invalid_pose_stops_the_vehicle_until_it_is_valid"


@pytest.mark.parametrize(
    ("proven", "listed", "found"),
    [
        ([("B1", VCAN)], [], []),
        ([("B1", "tests/cli/test_commands.py::test_a")], [("B1", "nobody can")], []),
        ([("B1", "tests/cli/test_commands.py::test_a")], [], ["B1: not injected on a bus"]),
        ([("B1", "tests/cli/test_commands.py::test_a")], [("B1", "")], ["B1: not injected on a bus"]),
        ([("B1", "tests/cli/test_commands.py::test_a"), ("B1", VCAN)], [], []),
        ([("B1", VCAN)], [("B1", "nobody can")], ["B1: listed for nothing"]),
        ([("B1", VCAN)], [("B2", "nobody can")], ["B2: listed for nothing"]),
    ],
)
def test_a_row_that_is_not_injected_on_a_bus_is_found(
    proven: list[tuple[str, str]], listed: list[tuple[str, str]], found: list[str]
) -> None:
    head = [f"| {' | '.join(HEADER)} |", "|---|---|---|---|---|"]
    lines = [f"| {number} | x | x | x | {NONE} |" for number, _ in proven]
    lines += ["", f"| {' | '.join(TESTS)} |", "|---|---|", *(f"| {number} | `{test}` |" for number, test in proven)]
    off = [f"| {' | '.join(OFF_THE_BUS)} |", "|---|---|", *(f"| {number} | {why} |" for number, why in listed)]
    assert faults_off_the_bus("\n".join([*head, *lines, "", *off])) == found


@pytest.mark.parametrize(
    ("terms", "total", "found"),
    [
        ("`state_stale_s` 50 + 3 × `command_period_s` 30 + pass 10", "90", 0),
        ("`state_stale_s` 50 + pass 10", "61", 1),
        ("`state_stale_s` 40 + pass 10", "50", 1),
        ("3 × `command_period_s` 10 + pass 10", "20", 1),
        ("`state_stale_s` 50 + pass 101", "151", 1),
    ],
)
def test_a_budget_that_does_not_add_up_is_found(terms: str, total: str, found: int) -> None:
    page = f"| {' | '.join(BUDGET)} |\n|---|---|---|\n| a fault | {terms} | {total} |\n"
    assert len(faults_of_budget(page)) == found
