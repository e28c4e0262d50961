"""tools/mutation on a project of a few lines: what tests notice is killed, the rest is shown."""

import json
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from mutation_testing.mutants import mutants

from .running import ROOT, run_module

BRAKE = '''
"""Brakes."""
HARDEST = 3.0


class Brake:
    @property
    def hardest(self):
        return HARDEST

    def force(self, wanted):
        if wanted > self.hardest:
            wanted = self.hardest
        return wanted
'''
LOOSE = """
from brake import Brake

def test_a_wish_within_the_range_is_granted():
    assert Brake().force(1.0) == 1.0
    assert Brake().force(9.0) == 3.0
"""
HALVES = """

def halves(count):
    while count > 1:
        count = count // 2
    return count
"""
HALVING = """
from brake import halves

def test_halving_ends():
    assert halves(9) == 1
"""
EQUIVALENT = """
[[equivalent]]
module = "brake.py"
function = "Brake.force"
was = "if wanted > self.hardest:"
becomes = ["if wanted >= self.hardest:"]
reason = "At the limit both are the limit."
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "brake.py").write_text(BRAKE)
    (tmp_path / "test_brake.py").write_text(LOOSE)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "plan.toml").write_text('[tests]\n"brake.py" = ["test_brake.py"]\n')
    return tmp_path


def mutation(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    options = ["--root", str(project), "--plan", str(project / "plan.toml"), *arguments]
    return run_module("mutation_testing.run", *options, cwd=project)


def judged(project: Path, *arguments: str) -> dict[str, Any]:
    done = mutation(project, "--json", *arguments)
    assert done.returncode in (0, 1), done.stderr
    (module,) = json.loads(done.stdout)["modules"]
    assert module["mutants"] == module["killed"] + module["equivalent"] + len(module["survivors"])
    found: dict[str, Any] = module
    return found


def test_an_unnoticed_mutant_survives_and_is_shown_with_its_change(project: Path) -> None:
    done = mutation(project)
    assert done.returncode == 1
    assert (
        "brake.py:12 Brake.force\n-        if wanted > self.hardest:\n+        if wanted >= self.hardest:"
        in done.stdout
    )
    assert "left: brake.py" in done.stderr
    assert "survived: brake.py:12" in done.stderr  # at once, long before the table


def test_a_noticed_mutant_is_killed_in_functions_properties_and_module_code(project: Path) -> None:
    found = judged(project)
    shown = "\n".join(survivor["diff"] for survivor in found["survivors"])
    assert (found["killed"], len(found["survivors"])) == (6, 1)
    for killed in ("HARDEST = 4.5", "return None", "if False:", "if wanted <= self.hardest"):
        assert killed not in shown


def test_a_mutant_that_never_ends_is_killed_by_its_time_limit(project: Path) -> None:
    (project / "brake.py").write_text(HALVES)
    (project / "test_brake.py").write_text(HALVING)
    shown = "\n".join(survivor["diff"] for survivor in judged(project)["survivors"])
    assert "count / 2" not in shown
    assert "while count >= 1" not in shown


def test_a_survivor_that_means_the_same_is_set_apart_with_its_reason(project: Path) -> None:
    before = judged(project)
    with (project / "plan.toml").open("a") as plan:
        plan.write(EQUIVALENT)
    after = judged(project)
    assert (before["equivalent"], after["equivalent"]) == (0, 1)
    assert len(after["survivors"]) == len(before["survivors"]) - 1
    assert after["stale"] == []


def test_a_reason_for_a_mutant_that_is_killed_or_gone_is_an_error(project: Path) -> None:
    with (project / "plan.toml").open("a") as plan:
        plan.write(EQUIVALENT.replace(">= self", "< self"))
    assert judged(project)["stale"] == ["Brake.force: if wanted > self.hardest: → if wanted < self.hardest:"]


def test_tests_that_fail_by_themselves_judge_nothing(project: Path) -> None:
    (project / "test_brake.py").write_text(LOOSE + "    assert Brake().force(1.0) == 2.0\n")
    done = mutation(project)
    assert done.returncode == 2
    assert "do not pass without any mutant" in done.stderr
    assert "assert 1.0 == 2.0" in done.stderr


def git(project: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=nobody", "-c", "user.email=nobody@localhost")
    subprocess.run(["git", *identity, *arguments], cwd=project, check=True, capture_output=True)


def committed(project: Path) -> None:
    git(project, "add", ".")
    git(project, "commit", "--quiet", "--message", "all of it")


def test_only_what_changed_since_a_revision_is_judged(project: Path) -> None:
    git(project, "init", "--quiet")
    committed(project)
    unchanged = mutation(project, "--json", "--since", "HEAD")
    assert json.loads(unchanged.stdout) == {"modules": []}
    (project / "test_brake.py").write_text(LOOSE + "    assert Brake().force(2.0) == 2.0\n")
    assert judged(project, "--since", "HEAD")["mutants"] > 0


def two_modules(project: Path) -> None:
    (project / "gas.py").write_text(HALVES)
    (project / "test_gas.py").write_text(HALVING.replace("brake", "gas") + "    assert halves(8) == 1\n")
    with (project / "plan.toml").open("a") as plan:
        plan.write('"gas.py" = ["test_gas.py"]\n')


def modules_of(project: Path, *arguments: str) -> tuple[list[str], str]:
    """Which modules are judged, and what is said of them first."""
    done = mutation(project, "--json", "--sample", "1", *arguments)
    return [module["module"] for module in json.loads(done.stdout)["modules"]], done.stderr.splitlines()[0]


def test_changed_modules_are_compared_with_the_merge_base_and_on_main_with_the_previous_commit(
    project: Path,
) -> None:
    two_modules(project)
    git(project, "init", "--quiet", "--initial-branch", "main")
    committed(project)
    modules, said = modules_of(project, "--changed")
    assert modules == ["brake.py", "gas.py"]
    assert said.endswith("mutants of 2 modules; no earlier commit is known here")
    git(project, "checkout", "--quiet", "-b", "branch")
    for text in ("# one\n", "# two\n"):
        (project / "test_gas.py").write_text(HALVING.replace("brake", "gas") + text)
        committed(project)
        (project / "README").write_text(text)
        committed(project)
    modules, said = modules_of(project, "--changed")
    assert modules == ["gas.py"]
    assert "mutants of 1 modules that changed since " in said
    git(project, "branch", "--force", "main")
    git(project, "checkout", "--quiet", "main")
    modules, said = modules_of(project, "--changed")  # the last commit is of no module
    assert modules == ["brake.py", "gas.py"]
    assert "mutants of 2 modules; none changed since " in said


def test_every_module_is_judged_without_a_history(project: Path) -> None:
    assert modules_of(project, "--changed")[0] == ["brake.py"]


def test_a_sample_is_the_same_each_time_and_reports_its_share(project: Path) -> None:
    first, again = (mutation(project, "--sample", "3", "--json") for _ in range(2))
    (module,), (same,) = (json.loads(done.stdout)["modules"] for done in (first, again))
    assert module["mutants"] == 3
    assert module["survivors"] == same["survivors"]
    assert first.stderr.splitlines()[0] == "3 of 7 mutants of 1 modules"


def test_in_a_sample_a_reason_is_stale_only_where_no_mutant_of_all_fits_it(project: Path) -> None:
    with (project / "plan.toml").open("a") as plan:
        plan.write(EQUIVALENT)
    assert all(judged(project, "--sample", str(count))["stale"] == [] for count in (1, 6))
    with (project / "plan.toml").open("a") as plan:
        plan.write(EQUIVALENT.replace("if wanted >= self", "if desired >= self"))
    assert len(judged(project, "--sample", "1")["stale"]) == 1
    assert mutation(project, "--sample", "1").returncode == 1


@pytest.mark.parametrize("count", ["0", "-1", "few"])
def test_a_sample_of_nothing_is_refused(project: Path, count: str) -> None:
    assert mutation(project, "--sample", count).returncode == 2


@pytest.mark.parametrize(("least", "status"), [(85.0, 0), (86.0, 1)])
def test_fewer_killed_than_the_plan_requires_is_a_failure(project: Path, least: float, status: int) -> None:
    plan = project / "plan.toml"
    plan.write_text(f"least_percent = {least}\n" + plan.read_text())
    done = mutation(project)  # six of seven
    assert done.returncode == status
    assert ("brake.py: 85.71 % killed: must be at least 86.0" in done.stderr) is (status == 1)


def test_one_module_below_the_figure_is_a_failure_however_good_the_others_are_and_of_a_sample_the_whole_counts(
    project: Path,
) -> None:
    two_modules(project)
    plan = project / "plan.toml"
    plan.write_text("least_percent = 90.0\n" + plan.read_text())
    done = mutation(project)
    assert done.returncode == 1
    assert [line for line in done.stderr.splitlines() if "must be" in line] == [
        "mutation: brake.py: 85.71 % killed: must be at least 90.0"
    ]
    assert mutation(project, "--sample", "100").returncode == 0


def test_a_reason_for_a_module_that_no_test_answers_for_is_refused(project: Path) -> None:
    with (project / "plan.toml").open("a") as plan:
        plan.write(EQUIVALENT.replace("brake.py", "steering.py"))
    done = mutation(project)
    assert done.returncode == 2
    assert "steering.py: has a reason in the plan and no tests" in done.stderr


def test_a_module_that_is_not_in_the_plan_is_refused(project: Path) -> None:
    done = mutation(project, "gas.py")
    assert done.returncode == 2
    assert "gas.py: not in the plan" in done.stderr


@pytest.mark.parametrize(
    ("source", "changes"),
    [
        ("a = b <= c", {"a = b < c", "a = b > c"}),
        ("a = b - c", {"a = b + c"}),
        ("a = b and c", {"a = b or c"}),
        ("a = not b", {"a =  b"}),
        ("a = 7", {"a = 8"}),
        ("a = min(b)", {"a = max(b)"}),
        ("a = {b: c, d: e}", {"a = { d: e}", "a = {b: c, }"}),
        ("def f():\n    a.b = c", {"def f():\n    pass"}),
        ("def f():\n    return a", {"def f():\n    return None"}),
        ("a = b if c else d", {"a = b if True else d", "a = b if False else d"}),
        ('"""Ä: 1 < 2"""\na: int = f"{1 + 1}"', set()),
        ("log.info(1 + 1)", set()),
    ],
)
def test_each_kind_of_change_is_made_in_its_place(source: str, changes: set[str]) -> None:
    assert {mutant.changed.decode() for mutant in mutants("a.py", source.encode())} == changes


def own_plan() -> dict[str, Any]:
    return tomllib.loads((ROOT / "tools" / "mutation.toml").read_text())


def test_every_module_of_the_projects_own_plan_and_each_of_its_tests_is_there() -> None:
    for module, tests in own_plan()["tests"].items():
        assert all((ROOT / path).is_file() for path in (module, *tests))


def test_every_module_of_the_safety_room_is_in_the_projects_own_plan() -> None:
    rooms = {path.relative_to(ROOT).as_posix() for path in (ROOT / "vehicle_iface" / "safety").glob("[!_]*.py")}
    assert rooms <= own_plan()["tests"].keys()


def test_every_reason_of_the_projects_own_plan_fits_a_mutant_of_todays_code() -> None:
    plan = own_plan()
    known = {mutant.key for module in plan["tests"] for mutant in mutants(module, (ROOT / module).read_bytes())}
    for entry in plan["equivalent"]:
        assert entry["reason"]
        for becomes in entry["becomes"]:
            assert (entry["module"], entry["function"], entry["was"], becomes) in known
