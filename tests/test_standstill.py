"""A failure of a test on vcan counts unless the machine stood still, and then only for so many times."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
CONFTEST = """
from vcan.standstill import Standstill

NEWS = []

def pytest_configure(config):
    config.pluginmanager.register(Standstill(lambda: [NEWS.pop()] if NEWS else [], lambda item: item.path.name))
"""
TEST = """
import pytest
from conftest import NEWS

made = []

@pytest.fixture(scope="module")
def shared():
    made.append(len(made))
    if len(made) in {stands_still}:
        NEWS.append(0.055)
    return len(made)

def test_first(shared):
    pass

def test_second(shared):
    assert shared == {passes_with}

def test_third(shared):
    assert shared == {passes_with}
"""


@pytest.mark.parametrize(
    ("stands_still", "passes_with", "said", "again"),
    [
        ([], 1, "3 passed", 0),
        ([], 2, "1 passed, 2 failed", 0),
        ([1], 1, "3 passed", 0),
        ([1], 2, "3 passed", 1),
        ([1], 3, "1 passed, 2 failed", 1),
        ([1, 2], 3, "3 passed", 2),
        ([1, 2, 3, 4], 5, "1 passed, 2 failed", 2),
    ],
)
def test_a_failure_counts_unless_the_machine_stood_still(
    tmp_path: Path, stands_still: list[int], passes_with: int, said: str, again: int
) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_it.py").write_text(TEST.format(stands_still=stands_still, passes_with=passes_with))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(TESTS)},
    )
    counts = {word: int(number) for number, word in (part.split() for part in said.split(", "))}
    found = done.stdout.splitlines()[-1]
    assert all(f"{number} {word}" in found for word, number in counts.items()), done.stdout + done.stderr
    assert ("failed" in found) is ("failed" in counts)
    assert done.stdout.count("run again, the machine stood still for 55 ms") == again
