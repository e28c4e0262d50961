"""tools/benchmark as users run it: each benchmark runs, proves its comparison fair, and prints table and JSON."""

import argparse
import json
import subprocess
from functools import partial

import pytest
from benchmarks import codec
from benchmarks.parts import per_signal, report, timing

from .running import TOOLS, run_module


def benchmark(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run_module("benchmarks", *arguments)


@pytest.mark.parametrize("name", ["bulk", "codec", "control", "long_work", "rate", "start"])
def test_a_benchmark_prints_its_figures_with_the_machine_and_whether_its_targets_are_reached(name: str) -> None:
    done = benchmark(name, "--quick", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["benchmark"] == name
    assert set(found["machine"]) == {"cpu", "cores", "python", "kernel", "realtime", "user_mode_kernel"}
    assert found["tables"]
    assert found["targets"]
    for table in found["tables"]:
        assert table["rows"]
        assert {len(row) for row in table["rows"]} == {len(table["columns"])}


def test_the_help_names_each_benchmark_with_its_time_and_target() -> None:
    done = benchmark("--help")
    assert done.returncode == 0
    names = [path.stem for path in (TOOLS / "benchmarks").glob("[a-z]*.py")]
    for name in names:
        said = done.stdout.split(f"\n{name}\n")[1].split("\n\n")[0]
        assert "Takes" in said
        assert "Target:" in said


def test_an_unknown_benchmark_is_bad_usage() -> None:
    done = benchmark("speed")
    assert done.returncode == 2
    assert "invalid choice: 'speed'" in done.stderr
    assert done.stdout == ""


def test_a_contestant_that_comes_to_something_else_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    right = per_signal.PerSignalCodec.encode

    def wrong(self: per_signal.PerSignalCodec, values: dict[str, float]) -> bytes:
        data = right(self, values)
        return bytes([data[0] ^ 1]) + data[1:] if self.length == 32 else data

    monkeypatch.setattr(per_signal.PerSignalCodec, "encode", wrong)
    with pytest.raises(report.BenchmarkError, match="STATE: per signal: not the same"):
        codec.run(argparse.Namespace(quick=True))


def test_a_target_is_reached_up_to_its_bound_and_missed_beyond() -> None:
    assert report.Target(what="rate", value=6.0, at_least=6.0).is_reached
    assert not report.Target(what="rate", value=5.999, at_least=6.0).is_reached
    assert report.Target(what="cost", value=1.6, at_most=1.6).is_reached
    assert str(report.Target(what="cost", value=1.7, at_most=1.6, unit="x")).startswith("MISSED   cost: 1.7x")


def test_a_disturbed_round_moves_no_median() -> None:
    steady, disturbed = [100.0] * 9, [200.0] * 8 + [90_000.0]
    spread = timing.ratios(disturbed, steady)
    assert spread.median == 2.0
    assert spread.p10 == 2.0


def test_contestants_take_turns_and_each_begins_as_often() -> None:
    calls: list[str] = []
    took = timing.interleaved({name: partial(calls.append, name) for name in "abc"}, 3)
    assert calls == [*"abc", *"abc", *"bca", *"cab"]
    assert {name: len(times) for name, times in took.items()} == {"a": 3, "b": 3, "c": 3}
