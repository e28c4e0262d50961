"""tools/bench_defects: its plan fits code and catalogue, it counts only what a sound device passes, and its page says
what was measured."""

from pathlib import Path

import pytest
from defect_testing.findings import Findings, Outcome, Scope, sound_key
from defect_testing.page import NOT_CAUGHT, NOT_MEASURED, PAGE, make_page, share_caught
from defect_testing.plan import Defect, draw_sample, find_faults, load_plan
from defect_testing.run import CASES, QUICK, Bench, NotExecutedError, find_open, main, measure, read_flags
from promise_testing.project_copy import PlanError, ProjectCopy

PLAN = load_plan()
BRAKES = Defect(id="weak", does="brakes weakly", file="brake.py", was="3", becomes="2", cases=("state-lost",))
LATE = Defect(id="late", does="answers late", flag="late_by_30_ms", cases=("jitter",), timing=True)
HIDDEN = Defect(id="hidden", does="thinks", file="brake.py", was="3", becomes="4", not_visible="nobody sees it")
FAILS = Outcome("state-lost", "a stop brakes: it does not", ("state-lost",))
PASSES = Outcome(cases=("state-lost",))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of one module."""
    root = tmp_path / "project"
    root.mkdir()
    (root / "brake.py").write_text("FORCE = 3\n")
    return root


def found(defect: Defect, outcome: Outcome, scope: Scope = Scope.NAMED) -> Findings:
    findings = Findings()
    findings.note(defect, scope, outcome)
    return findings


class ScriptedBench(Bench):
    """Finds what the test says, and notes what it was asked."""

    def __init__(self, outcome: Outcome | None) -> None:
        self.outcome = outcome
        self.asked: list[tuple[str, list[str]]] = []

    def judge(self, defect: Defect, cases: list[str]) -> Outcome:  # type: ignore[override]
        self.asked.append((defect.id, cases))
        if self.outcome is None:
            raise NotExecutedError("late")
        return self.outcome


def test_every_change_occurs_once_and_every_case_and_flag_exists() -> None:
    assert find_faults(PLAN, CASES, read_flags()) == []


def test_the_plan_has_at_least_sixty_visible_defects_of_both_controllers() -> None:
    visible = [defect for defect in PLAN if defect.is_visible and not defect.unseen]
    assert len(visible) >= 60
    assert {defect.is_minimal for defect in visible} == {False, True}


def test_every_flag_of_the_minimal_controller_is_a_defect_of_the_plan() -> None:
    assert {defect.flag for defect in PLAN if defect.flag} == read_flags()


@pytest.mark.parametrize(
    ("defect", "fault"),
    [
        (Defect(id="a", does="", file="brake.py", was="5", becomes="6", cases=("x",)), "occurs 0 times"),
        (Defect(id="a", does="", file="brake.py", was="3", becomes="(", cases=("x",)), "does not compile"),
        (Defect(id="a", does="", file="brake.py", was="3", becomes="4", cases=("y",)), "no such case: y"),
        (Defect(id="a", does="", file="brake.py", was="3", becomes="4"), "cases or not_visible"),
        (Defect(id="a", does="", flag="none", cases=("x",)), "no such flag: none"),
        (Defect(id="a", does="", cases=("x",)), "or flag"),
    ],
)
def test_a_plan_that_does_not_fit_is_named(defect: Defect, fault: str, project: Path) -> None:
    assert fault in "\n".join(find_faults([defect], {"x"}, {"late_by_30_ms"}, project))


def test_a_name_is_given_once(project: Path) -> None:
    assert "weak: named twice" in find_faults([BRAKES, BRAKES], {"state-lost"}, set(), project)


def test_a_change_is_made_and_undone_in_the_copy_alone(project: Path, tmp_path: Path) -> None:
    copy = ProjectCopy(project, tmp_path / "copy")
    with copy.with_change(BRAKES):
        assert (copy.root / "brake.py").read_text() == "FORCE = 2\n"
    assert (copy.root / "brake.py").read_text() == (project / "brake.py").read_text() == "FORCE = 3\n"


def test_the_sample_is_the_same_each_time_and_does_not_depend_on_the_order() -> None:
    assert draw_sample(PLAN, 5) == draw_sample(tuple(reversed(PLAN)), 5)


def test_each_measurement_is_saved_at_once_and_a_later_run_continues(tmp_path: Path) -> None:
    results, bench = tmp_path / "found.json", ScriptedBench(FAILS)
    measure([BRAKES], bench, Findings(), Scope.NAMED, results, float("inf"))
    assert bench.asked == [("weak", ["state-lost"])]
    assert list(find_open([BRAKES, LATE, HIDDEN], Findings.read(results), Scope.NAMED)) == [LATE]


def test_a_defect_whose_case_was_not_executed_is_measured_again(tmp_path: Path) -> None:
    results = tmp_path / "found.json"
    assert measure([BRAKES], ScriptedBench(None), Findings(), Scope.NAMED, results, float("inf")) == []
    assert list(find_open([BRAKES], Findings.read(results), Scope.NAMED)) == [BRAKES]


def test_nothing_is_begun_after_the_end(tmp_path: Path) -> None:
    bench = ScriptedBench(FAILS)
    assert measure([BRAKES], bench, Findings(), Scope.NAMED, tmp_path / "found.json", 0.0) == []
    assert bench.asked == []


def test_a_changed_defect_is_not_known() -> None:
    findings = found(BRAKES, FAILS)
    changed = Defect(id="weak", does="brakes weakly", file="brake.py", was="3", becomes="1", cases=("state-lost",))
    assert findings.catch(changed) is None
    assert list(find_open([changed], findings, Scope.NAMED)) == [changed]


def test_a_defect_that_its_cases_missed_is_open_again_with_other_cases() -> None:
    other = Defect(id="weak", does="", file="brake.py", was="3", becomes="2", cases=("emergency-stop-from-12-mps",))
    assert list(find_open([BRAKES], found(BRAKES, PASSES), Scope.NAMED)) == []
    assert list(find_open([other], found(BRAKES, PASSES), Scope.NAMED)) == [other]


def test_a_case_that_the_sound_device_fails_catches_nothing() -> None:
    findings = found(BRAKES, FAILS)
    assert findings.catch(BRAKES) == (Scope.NAMED, FAILS)
    findings.sound[sound_key(BRAKES, "state-lost", Scope.NAMED)] = False
    assert findings.catch(BRAKES) is None


def test_a_quick_case_that_caught_a_defect_needs_no_quick_run() -> None:
    assert "drive-u-turn" in QUICK
    quick = Outcome("drive-u-turn", "it does not end", ("end-of-space",))
    assert list(find_open([BRAKES], found(BRAKES, quick), Scope.QUICK)) == []
    slow = Outcome("jitter", "late", ("jitter",))
    assert list(find_open([LATE], found(LATE, slow), Scope.QUICK)) == [LATE]


def test_shares_count_what_was_measured_and_leave_out_what_cannot_be_seen() -> None:
    quick = frozenset(QUICK)
    assert share_caught([BRAKES, LATE, HIDDEN], found(BRAKES, FAILS)) == (1, 1, 2)
    assert share_caught([BRAKES, HIDDEN], found(BRAKES, PASSES)) == (0, 1, 1)
    assert share_caught([BRAKES, HIDDEN], found(BRAKES, PASSES), quick) == (0, 0, 1)
    assert share_caught([BRAKES], found(BRAKES, PASSES, Scope.QUICK), quick) == (0, 1, 1)


def test_a_defect_that_was_caught_in_virtual_time_is_listed_as_open_on_the_bus() -> None:
    findings = found(BRAKES, FAILS, Scope.VIRTUAL_NAMED)
    in_process = Defect(id="full", does="ends with 0", flag="full", cases=("state-lost",), process=True)
    assert list(find_open([BRAKES, LATE, in_process], findings, Scope.VIRTUAL_NAMED)) == [LATE]
    assert list(find_open([BRAKES], findings, Scope.NAMED)) == [BRAKES]
    assert share_caught([BRAKES], findings) == (1, 1, 1)
    assert share_caught([BRAKES], findings, virtual=False) == (0, 0, 1)
    assert "*in virtual time* `state-lost`" in make_page([BRAKES], findings, frozenset(QUICK))


def test_the_page_distinguishes_caught_missed_and_not_measured() -> None:
    quick = frozenset({"state-lost"})
    page = make_page([BRAKES, LATE, HIDDEN], found(BRAKES, FAILS), quick)
    assert "| weak | brakes weakly | `state-lost`: a stop brakes: it does not | `state-lost` |" in page
    assert f"| late | answers late | {NOT_MEASURED} | {NOT_MEASURED} |" in page
    assert "| hidden | thinks | nobody sees it |" in page
    assert NOT_CAUGHT in make_page([BRAKES], found(BRAKES, PASSES, Scope.WHOLE), quick)


def test_the_page_of_the_project_is_that_of_what_was_measured() -> None:
    assert PAGE.read_text(encoding="utf-8") == make_page(PLAN, Findings.read(), frozenset(QUICK))


def test_a_defect_that_was_caught_in_virtual_time_is_caught_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--virtual", "--sample", "1", "--no-page", "--results", str(tmp_path / "found.json")]
    assert main(words) == 0
    assert "caught: all cases 1 of 1 (100%), 0 not measured" in capsys.readouterr().out


def test_a_defect_caught_by_an_unsound_case_is_measured_again() -> None:
    findings = found(BRAKES, FAILS)
    findings.sound[sound_key(BRAKES, "state-lost", Scope.NAMED)] = False
    assert list(find_open([BRAKES], findings, Scope.NAMED)) == [BRAKES]


def test_a_plan_with_an_unknown_key_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('[[defect]]\nid = "a"\ndoes = "b"\ncase = "c"\n')
    with pytest.raises(PlanError, match="case"):
        load_plan(path)
