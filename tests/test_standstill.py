"""A failure of a test on vcan counts unless the machine stood still, and then only for so many times."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CONFTEST = """
from pathlib import Path

from tests.vcan.claims import Claims
from tests.vcan.standstill import Standstill

DELAYS_S = []

def pytest_addoption(parser):
    parser.addoption("--defer-to", type=Path)
    parser.addoption("--share", type=Path)

def pytest_configure(config):
    defer_to = config.getoption("--defer-to")
    take_delays_s = lambda: [DELAYS_S.pop()] if DELAYS_S else []
    claims = Claims(config.getoption("--share"), lambda item: item.nodeid)
    config.pluginmanager.register(Standstill(take_delays_s, lambda item: item.path.name, defer_to, claims))
"""
TEST = """
import pytest
from conftest import DELAYS_S

made = []

@pytest.fixture(scope="module")
def shared():
    made.append(len(made))
    if len(made) in {stands_still}:
        DELAYS_S.append(0.055)
    return len(made)

def test_first(shared):
    pass

def test_second(shared):
    assert shared == {passes_with}

def test_third(shared):
    assert shared == {passes_with}
"""


def run_pytest(
    folder: Path, stands_still: list[int], passes_with: int, *options: str
) -> subprocess.CompletedProcess[str]:
    """The three tests, on a machine that stands still in the named attempts."""
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "test_it.py").write_text(TEST.format(stands_still=stands_still, passes_with=passes_with))
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(folder), *options, str(folder)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},  # needs none, 1 s to load
    )


@pytest.mark.parametrize(
    ("stands_still", "passes_with", "summary", "again"),
    [
        ([], 1, "3 passed", 0),
        ([], 2, "1 passed, 2 failed", 0),
        ([1], 1, "3 passed", 0),
        ([1], 2, "3 passed", 1),
        ([1], 3, "1 passed, 2 failed", 1),
        ([1, 2], 3, "3 passed", 2),
        ([1, 2, 3, 4, 5], 6, "1 passed, 2 failed", 4),
    ],
)
def test_a_failure_counts_unless_the_machine_stood_still(
    tmp_path: Path, stands_still: list[int], passes_with: int, summary: str, again: int
) -> None:
    done = run_pytest(tmp_path, stands_still, passes_with)
    counts = {word: int(number) for number, word in (part.split() for part in summary.split(", "))}
    found = done.stdout.splitlines()[-1]
    assert all(f"{number} {word}" in found for word, number in counts.items()), done.stdout + done.stderr
    assert ("failed" in found) is ("failed" in counts)
    assert done.stdout.count("run again, the machine stood still for 55 ms") == again


@pytest.mark.parametrize(
    ("stands_still", "why"),
    [([1], "the machine stood still for 55 ms"), ([], "beside another kernel, which did not stand still")],
)
def test_beside_another_kernel_every_failed_test_is_deferred_with_its_reason(
    tmp_path: Path, stands_still: list[int], why: str
) -> None:
    file = tmp_path / "deferred"
    done = run_pytest(tmp_path, stands_still, 9, "--defer-to", str(file))
    assert done.returncode == 0
    assert "1 passed" in done.stdout.splitlines()[-1], done.stdout
    assert file.read_text().splitlines() == ["test_it.py::test_second", "test_it.py::test_third"]
    assert done.stdout.count(f"deferred, {why}: test_it.py") == 2
    assert done.stdout.count("assert 1 == 9") == 2


def test_runs_that_share_the_tests_run_each_of_them_once(tmp_path: Path) -> None:
    claims = tmp_path / "claims"
    claims.mkdir()
    share = ("--share", str(claims))
    only_second = run_pytest(tmp_path, [], 1, *share, "-k", "second")
    assert "1 passed, 2 deselected" in only_second.stdout
    the_others = run_pytest(tmp_path, [], 1, *share, "-v")
    assert "2 passed" in the_others.stdout.splitlines()[-1]
    assert "test_first PASSED" in the_others.stdout
    assert "test_second" not in the_others.stdout
    assert "test_third PASSED" in the_others.stdout
