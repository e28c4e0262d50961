"""What reads foreign bytes, under inputs that nobody would think of: those found once, and a short hunt for more."""

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest
from fuzzing.engine import judge

from .running import ROOT

NAMES = judge.target_names()
NOT_MENDED = pytest.mark.xfail(strict=True, reason="found, not mended; then drop `open-` from the file's name")
REPLAYS = [
    *(pytest.param(name, [f for f in judge.corpus_files(name) if not judge.is_open(f)], id=name) for name in NAMES),
    *(
        pytest.param(name, [file], id=f"{name}/{file.name}", marks=NOT_MENDED)
        for name in NAMES
        for file in judge.corpus_files(name)
        if judge.is_open(file)
    ),
]
"""Target and files: those that are mended together, and each open one for itself."""
RUNS = {"loop": 8, "orders": 50, "profile": 8, "dbc": 40, "frames": 50, "candump": 25, "page": 100}
"""Inputs of a short hunt, a second or two each; of the other targets 1000."""

has_atheris = pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="atheris exists for Linux on x86-64 only"
)

FORGETFUL_CELL = """
from vehicle_iface.trajectories import csv_file
csv_file._number = lambda text, index, column, cell: float(cell)
"""
GENEROUS_GATE = """
import dataclasses
from vehicle_iface.safety.gate import Gate
right = Gate.permit
def permit(self, wish, state, **how):
    safe = right(self, wish, state, **how)
    return dataclasses.replace(safe, accel_mps2=3.5) if state.y_m > 0.05 else safe
Gate.permit = permit
"""
ENDLESS = """
from fuzzing import posted
judge.LIMIT_S = 0.1
def fetch(path):
    while path.stat().st_size == 35:
        pass
    raise posted.TrajectoryFileError("no")
posted.fetch = fetch
"""


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A process of its own: targets limit its memory and turn its warnings into errors."""
    path = os.pathsep.join(str(folder) for folder in (ROOT, ROOT / "viewer", ROOT / "tools"))
    return subprocess.run(
        [sys.executable, "-P", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": "0"},
        stdin=subprocess.DEVNULL,
    )


def findings(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What a hunt has found; fails when it did not come to its end."""
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Done " in done.stderr, done.stderr
    lines = [line.removeprefix("FINDING ") for line in done.stdout.splitlines() if line.startswith("FINDING ")]
    return [f"{found['fault']}: {found['input']}" for found in map(json.loads, lines)]


def planted(fault: str, name: str, folder: Path, runs: int) -> list[str]:
    """What a hunt finds in a program with this fault."""
    script = f"import sys, atheris\nfrom fuzzing.engine import hunt, judge\nhunt.loaded({name!r})\n{fault}\n"
    return findings(python("-c", script + "hunt.main(sys.argv[1:])", name, str(folder), f"-runs={runs}", "-seed=1"))


@pytest.mark.parametrize(("name", "files"), REPLAYS)
def test_seeds_and_what_was_found_once_are_taken_well(name: str, files: list[Path]) -> None:
    done = python("-m", "fuzzing.engine.judge", name, *map(str, files))
    assert done.returncode == 0, done.stdout + done.stderr


@has_atheris
@pytest.mark.parametrize("name", NAMES)
def test_a_short_hunt_finds_nothing_new(name: str, tmp_path: Path) -> None:
    runs = RUNS.get(name, 1000)
    assert findings(python("-m", "fuzzing.engine.hunt", name, str(tmp_path), f"-runs={runs}", "-seed=1")) == []


@has_atheris
@pytest.mark.parametrize(
    ("fault", "name", "runs", "what"),
    [
        (FORGETFUL_CELL, "csv_file", 2000, "ValueError at vehicle_iface/trajectories/csv_file.py"),
        (GENEROUS_GATE, "loop", 15, "AssertionError at tools/fuzzing/loop.py"),
        (ENDLESS, "posted", 100, "hang: more than 0.1 s"),
    ],
    ids=["a foreign exception", "a limit that is not kept", "a hang"],
)
def test_a_hunt_finds_a_planted_fault(fault: str, name: str, runs: int, what: str, tmp_path: Path) -> None:
    assert any(found.startswith(what) for found in planted(fault, name, tmp_path, runs))


@has_atheris
def test_a_hunt_is_led_by_the_branches_that_inputs_take(tmp_path: Path) -> None:
    done = python("-m", "fuzzing.engine.hunt", "csv_file", str(tmp_path), "-runs=5000", "-seed=1")
    first, last = (re.search(rf"{word}\s+cov: (\d+)", done.stderr) for word in ("INITED", "DONE"))
    assert first is not None, done.stderr
    assert last is not None, done.stderr
    assert int(last[1]) > int(first[1]) > 50


def test_a_file_that_fails_is_reported_with_its_traceback(tmp_path: Path) -> None:
    script = "from fuzzing import posted\nfrom fuzzing.engine import judge\nposted.fetch = None\nexit(judge.main())"
    done = python("-c", script, "posted", str(tmp_path / "any"))
    assert done.returncode != 0
    (tmp_path / "any").write_bytes(b"any")
    done = python("-c", script, "posted", str(tmp_path / "any"))
    assert done.returncode == 1
    assert "TypeError" in done.stdout
