"""Each step of the set-up holds, or says that it does not; and the loop leaves nothing to collect."""

import gc
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.harness import Drive
from vehicle_iface.runtime import realtime
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import make_route

ROOT = Path(__file__).resolve().parents[2]
LOOK = """
import ctypes, gc, json, os, resource, sys, threading
import vehicle_iface.cli.run
from vehicle_iface.runtime import realtime

WITHOUT_RIGHTS, CPU = json.loads(sys.argv[1])
if WITHOUT_RIGHTS:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
    if os.geteuid() == 0:
        os.setgid(65534)
        os.setuid(65534)

def status():
    return dict(line.split(":", 1) for line in open("/proc/self/status"))

def resident():
    return int(status()["VmRSS"].split()[0])

before = resident()
lacks = realtime.apply_settings(cpu=CPU)
later = []
thread = threading.Thread(target=lambda: later.append(os.sched_getscheduler(0)))
thread.start()
thread.join()
blas = [ctypes.CDLL(path) for path in realtime._blas_libraries()]
asked = [name.replace("set", "get") for name in realtime._BLAS_SETTERS if "openblas" in name]
print(json.dumps({
    "lacks": lacks,
    "is_fifo": os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO,
    "later_is_fifo": later[0] == os.SCHED_FIFO,
    "locked_kb": int(status()["VmLck"].split()[0]),
    "grown_kb": resident() - before,
    "frozen": gc.get_freeze_count(),
    "cpus": sorted(os.sched_getaffinity(0)),
    "slack_ns": ctypes.CDLL(None).prctl(30, 0, 0, 0, 0),
    "blas_threads": [getattr(library, name)() for library in blas for name in asked if hasattr(library, name)],
}))
"""


def claimed(*, without_rights: bool = False, cpu: int | None = None) -> dict[str, Any]:
    """What a process of its own has after the set-up."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", LOOK, json.dumps([without_rights, cpu])]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def lacking(found: dict[str, Any], word: str) -> bool:
    return any(word in lack for lack in found["lacks"])


@pytest.mark.parametrize("without_rights", [False, True])
def test_each_step_succeeds_or_reports_that_it_failed(without_rights: bool) -> None:
    found = claimed(without_rights=without_rights)
    assert found["is_fifo"] != lacking(found, "SCHED_FIFO")
    assert (found["locked_kb"] > 0) != lacking(found, "memory is not locked")
    assert found["frozen"] > 10_000
    assert set(found["blas_threads"]) <= {1}
    assert found["slack_ns"] in (0, 1)  # newer kernels say 0 of every SCHED_FIFO thread


def test_each_missing_permission_is_reported_with_its_command() -> None:
    found = claimed(without_rights=True)
    assert not found["is_fifo"]
    assert len(found["lacks"]) == 2
    assert all(lack.count("`") >= 2 for lack in found["lacks"])
    assert any(realtime.FIX_FIFO in lack for lack in found["lacks"])
    assert any(realtime.FIX_LOCK in lack for lack in found["lacks"])


def test_threads_that_are_started_later_have_no_priority() -> None:
    assert not claimed()["later_is_fifo"]


def test_locking_memory_makes_the_process_no_bigger() -> None:
    assert claimed()["grown_kb"] < 4096


def test_the_loop_is_bound_to_a_processor_only_when_asked() -> None:
    allowed = sorted(os.sched_getaffinity(0))
    assert claimed()["cpus"] == allowed
    assert claimed(cpu=allowed[0])["cpus"] == allowed[:1]


def test_a_missing_processor_is_reported() -> None:
    found = claimed(cpu=100_000)
    assert lacking(found, "CPU 100000 is not available")
    assert found["cpus"] == sorted(os.sched_getaffinity(0))


def test_a_system_without_these_settings_is_reported(monkeypatch: pytest.MonkeyPatch, collector: None) -> None:  # noqa: ARG001
    monkeypatch.delattr(os, "sched_setscheduler")
    monkeypatch.delattr(os, "sched_setaffinity")
    lacks = realtime.apply_settings(cpu=0)
    assert len(lacks) == 3
    assert all("this system" in lack for lack in lacks)
    assert not realtime.may_fifo()
    assert not realtime.may_lock()


@pytest.fixture
def collector() -> Iterator[None]:
    """Python's collector, put back as it was."""
    yield
    gc.unfreeze()
    gc.enable()


@pytest.fixture
def collections(collector: None) -> Iterator[list[dict[str, int]]]:  # noqa: ARG001
    """Every collection that has ended."""
    seen: list[dict[str, int]] = []

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "stop":
            seen.append(dict(info))

    gc.collect()
    gc.freeze()
    gc.callbacks.append(note)
    yield seen
    gc.callbacks.remove(note)


class _Ring:
    """Garbage that only a collection finds."""

    def __init__(self) -> None:
        self.me = self


def test_nothing_is_collected_between_two_calls_and_everything_in_them(collections: list[dict[str, int]]) -> None:
    realtime.collect_garbage_if_due()
    collections.clear()
    for _ in range(20):
        for _ in range(1000):
            _Ring()
        assert collections == []
        realtime.collect_garbage_if_due()
        assert len(collections) == 1
        assert collections.pop()["collected"] >= 1000


def test_a_call_with_nothing_to_do_collects_nothing(collections: list[dict[str, int]]) -> None:
    realtime.collect_garbage_if_due()
    collections.clear()
    for _ in range(1000):
        realtime.collect_garbage_if_due()
    assert collections == []


def test_no_pass_leaves_a_cycle_behind_and_memory_stays_flat(collections: list[dict[str, int]]) -> None:
    route = make_route("figure8")
    drive = Drive(RecedingRoute(route, frame_id="map"))
    drive.run_s(20.0)
    drive.sent.clear()
    gc.collect()
    collections.clear()
    objects = len(gc.get_objects())
    for _ in range(4000):
        drive.step()
        drive.sent.clear()
        realtime.collect_garbage_if_due()
    gc.collect()
    assert sum(collection["collected"] for collection in collections) == 0
    assert len(gc.get_objects()) - objects < 200


RUN = """
import json, os, sys
from vehicle_iface import cli
from vehicle_iface.cli import run
from vehicle_iface.runtime.loop import Loop

step, found = Loop.step, {}

def watched_step(loop):
    found["while it runs"] = os.sched_getparam(0).sched_priority
    step(loop)

def watched_table(what):
    found["at its summary"] = os.sched_getparam(0).sched_priority
    return json.dumps(found)

Loop.step, run.table = watched_step, watched_table
sys.exit(cli.main(["run", "--interface", "embedded", "--duration", "0.2", *sys.argv[1:]]))
"""


def test_a_loop_that_only_watches_yields_to_one_that_drives_and_one_that_has_ended_to_all(tmp_path: Path) -> None:
    granted = realtime.may_fifo()
    for arming, priority in (["--arm"], realtime.FIFO_PRIORITY), ([], realtime.UNARMED_PRIORITY):
        arguments = ["--route", "figure8", "--telemetry", str(tmp_path / "telemetry"), *arming]
        command = [sys.executable, "-c", RUN, *arguments]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
        assert json.loads(done.stdout) == {"while it runs": priority if granted else 0, "at its summary": 0}
