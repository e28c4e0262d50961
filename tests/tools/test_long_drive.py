"""tools/long_drive where there is no bus: what it refuses, and what it makes of a run's summary."""

import copy
from collections.abc import Callable
from typing import Any

import pytest
from drive_checks.long_drive import wrong_with_run

from .running import run_module

CLEAN: dict[str, Any] = {
    "latched_fault": None,
    "incomplete_samples": 0,
    "drops": {},
    "lost": {"STATE": 0},
    "implausible": {},
    "deviations": {},
    "tx_blocked": {},
    "counts": {
        "frames_not_sent": 0,
        "commands_refused": 0,
        "foreign_commands": 0,
        "controller_errors": 0,
        "trajectories_rejected": 0,
        "link_losses": 0,
    },
    "bus_counters": {"error_frames": 0, "receive_overflow": 0, "send_missed": 0, "send_no_room": 0},
    "link": {"state": "UP", "transitions": []},
}


def test_a_run_without_incident_is_clean() -> None:
    assert wrong_with_run(CLEAN, 0) == []


@pytest.mark.parametrize(
    ("change", "incident"),
    [
        (lambda summary: summary.update(latched_fault="LINK_DOWN"), "latched fault LINK_DOWN"),
        (lambda summary: summary["drops"].update({"bad CRC STATE": 2}), "drops: bad CRC STATE 2"),
        (lambda summary: summary["lost"].update(STATE=1), "lost: STATE 1"),
        (lambda summary: summary["implausible"].update(position=1), "implausible: position 1"),
        (lambda summary: summary.update(incomplete_samples=1), "incomplete samples 1"),
        (lambda summary: summary["counts"].update(frames_not_sent=3), "frames not sent 3"),
        (lambda summary: summary["bus_counters"].update(receive_overflow=4), "receive overflow 4"),
        (lambda summary: summary["link"]["transitions"].append({}), "link UP, changed 1 times"),
        (lambda summary: summary["link"].update(state="DOWN"), "link DOWN, changed 0 times"),
    ],
)
def test_each_incident_of_a_run_is_named(change: Callable[[dict[str, Any]], None], incident: str) -> None:
    summary = copy.deepcopy(CLEAN)
    change(summary)
    assert wrong_with_run(summary, 0) == [incident]


def test_a_run_that_failed_or_left_nothing_is_not_clean() -> None:
    assert wrong_with_run(CLEAN, 4) == ["the loop ended with status 4"]
    assert wrong_with_run({}, 0) == ["the loop left no summary (status 0)"]
    assert wrong_with_run({}, None) == ["the loop left no summary (status None)"]


def refused(*arguments: str) -> str:
    """What it says when it refuses to drive."""
    done = run_module("drive_checks.long_drive", *arguments)
    assert done.returncode == 2, done.stderr
    return done.stderr


def test_it_drives_on_virtual_can_interfaces_only() -> None:
    assert "lo is no virtual CAN interface" in refused("--channel", "lo")
    assert "there is no vcan9; run: sudo ip link add" in refused("--channel", "vcan9")


def test_a_drive_that_is_too_short_to_be_one_is_refused() -> None:
    assert "at least 10" in refused("--duration", "3")
