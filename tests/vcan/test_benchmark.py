"""The part of the benchmark of reactions that needs a bus."""

import json

import pytest
from benchmarks.parts import reaction_vcan

from tests.tools.running import run_module


@pytest.mark.timeout(300)
def test_every_process_answers_and_its_calls_are_counted(vcan0: None) -> None:  # noqa: ARG001
    done = run_module("benchmarks.parts.reaction_vcan", "1", "20")
    assert done.returncode == 0, done.stderr
    on_vcan = json.loads(done.stdout.splitlines()[-1])
    assert set(on_vcan["latencies"]) == set(reaction_vcan.NAMES)
    for name, found in on_vcan["latencies"].items():
        assert found["first_s"], name
        assert all(0.0 < first <= second for first, second in zip(found["first_s"], found["second_s"], strict=True))
    calls = on_vcan["calls"]
    assert calls is not None, "strace is missing"
    assert calls["echo"].keys() == {"recvfrom", "sendto"}
    assert not any("clock_gettime" in found for found in calls.values())
