"""Latency of each answer, and periods of all that the device sends, whatever samples it missed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

import pytest
from hil_bench.judges import regularity
from hil_bench.result import Verdict
from scenes import WIRE
from vehicle_bus_contract.judge import Record, examine
from vehicle_bus_contract.reference import AUTONOMOUS, MS, Frame, S

SAMPLES = 800


def record(
    late_s: Callable[[int], float | None] = lambda _: 0.0003, besides_s: Callable[[int], float] = lambda n: n / 10
) -> Record:
    """Eight seconds of samples; each is answered so late, or not at all. `besides_s`: when each report is sent."""
    said: list[tuple[float, Frame]] = []
    counters: dict[str, int] = {}

    def add_frame(at_s: float, name: str, **values: float) -> None:
        counters[name] = counters.get(name, -1) + 1
        said.append((at_s, WIRE.pack(name, counters[name] % 15, **values)))

    for tick in range(SAMPLES):
        for name in WIRE.sample:
            add_frame(tick / 100, name)
        if tick % 2 == 0:
            add_frame(tick / 100, "VEHICLE_STATUS", MODE=AUTONOMOUS)
        wait_s = late_s(tick)
        if wait_s is not None:
            add_frame(tick / 100 + wait_s, "DRIVE_COMMAND", ENABLE=1, GEAR_REQUEST=7)
            add_frame(tick / 100 + wait_s, "STEER_COMMAND", ENABLE=1)
    for number in range(int(SAMPLES / 10)):
        add_frame(besides_s(number) + 0.002, "BODY_COMMAND")
        add_frame(besides_s(number) + 0.002, "CONTROLLER_STATUS", STATE=3)
    in_order = sorted(said, key=lambda one: one[0])
    return examine([replace(frame, stamp_ns=S + round(at_s * S) + n) for n, (at_s, frame) in enumerate(in_order)], WIRE)


def latencies_s(found: Record) -> list[float]:
    return [(pair.stamp_ns - begin_ns) / S for begin_ns, pair in found.answers]


def verdict(latencies: Sequence[float]) -> list[Verdict]:
    return [check.verdict for check in regularity.check_jitter(WIRE, latencies, latencies)]


@pytest.mark.parametrize("missed", [{100}, {100, 300, 301}, set(range(50, 800, 60))])
def test_a_missed_sample_shifts_no_later_answer(missed: set[int]) -> None:
    found = record(lambda tick: None if tick in missed else 0.0003)
    assert max(latencies_s(found)) < 0.001
    assert len(found.answers) + len(missed) == len(record().answers)
    assert [round(float(text.split()[-2]), 2) for text in found.unanswered] == [tick / 100 for tick in sorted(missed)]
    assert found.doubled == []


def test_answers_that_wait_and_catch_up_are_late_and_not_missed() -> None:
    found = record(lambda tick: 0.045 - 0.0095 * (tick - 300) if 300 <= tick <= 304 else 0.0003)
    assert found.unanswered == found.doubled == []
    assert max(latencies_s(found)) == pytest.approx(0.045, abs=0.001)
    assert median(latencies_s(found)) < 0.001


def test_a_pair_that_answers_nothing_is_found_after_a_missed_sample_too() -> None:
    found = record(lambda tick: None if tick == 200 else 0.0003)
    frames = [
        replace(
            WIRE.pack(one.name, one.counter, **{name: one[name] for name in one.signals if name != "COUNTER"}),
            stamp_ns=one.stamp_ns,
        )
        for one in found.decoded
    ]
    doubled_ns = next(pair.stamp_ns for pair in found.pairs if pair.stamp_ns > 6 * S) + 3 * MS
    for number, name in enumerate(WIRE.command):
        frames.append(replace(WIRE.pack(name, 1, ENABLE=1, GEAR_REQUEST=7), stamp_ns=doubled_ns + number))
    again = examine(frames, WIRE)
    assert len(again.unanswered) == len(again.doubled) == 1


def test_answers_that_scatter_over_five_milliseconds_are_found() -> None:
    assert verdict(latencies_s(record())) == [Verdict.PASS]
    assert verdict(latencies_s(record(lambda tick: 0.0003 + 0.005 * (tick * 7 % 10) / 10))) == [Verdict.FAIL]
    assert verdict(latencies_s(record(lambda tick: 0.0003 + 0.0015 * (tick * 7 % 10) / 10))) == [Verdict.PASS]
    rare = latencies_s(record(lambda tick: 0.0053 if tick % 20 == 0 else 0.0003))
    assert verdict(rare) == [Verdict.PASS]
    assert verdict(rare[:20]) == []


@pytest.mark.parametrize(
    ("besides_s", "words"),
    [
        (lambda n: n / 10, ""),
        (lambda n: n / 10 + 0.02 * (n % 2), ""),
        (lambda n: n * 0.115, ""),
        (lambda n: n * 0.085, "every 85.0 ms, where its period is 100 ms"),
        (lambda n: n * 0.125, "every 125.0 ms"),
        (lambda n: n / 10 + 0.05 * (n % 2), "in periods of 50.0 to 150.0 ms, 20 of 20 not about 100 ms"),
    ],
)
def test_reports_with_a_wrong_or_uneven_period_are_found(besides_s: Callable[[int], float], words: str) -> None:
    found = list(regularity.find_irregular(WIRE, record(besides_s=besides_s)))
    assert bool(found) == bool(words)
    assert all(words in text for text in found)
    assert {text.split()[2] for text in found} == ({"BODY_COMMAND", "CONTROLLER_STATUS"} if words else set())
