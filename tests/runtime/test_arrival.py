"""Samples that come faster than the vehicle measures were held up: not all of them are used."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import ms
from vehicle_iface.runtime.arrival import Arrival, ArrivalFilter

PERIOD_NS, GAP_NS = ms(10), ms(50)
BUS_NS = ms(0.7)
"""Three frames at 500 kbit/s."""


def judged(stamps_ns: list[int]) -> dict[int, Arrival]:
    """What each sample is good for, by its stamp."""
    arrival = ArrivalFilter(PERIOD_NS, GAP_NS)
    return {stamp_ns: arrival.judge(stamp_ns) for stamp_ns in stamps_ns}


def young(stamps_ns: list[int]) -> list[int]:
    """Which of these samples are driven by."""
    return [stamp_ns for stamp_ns, arrival in judged(stamps_ns).items() if arrival is Arrival.YOUNG]


@given(st.lists(st.integers(-ms(2.4), ms(2.4)), min_size=2, max_size=200))
def test_each_sample_is_used_however_unevenly_it_comes(jitters_ns: list[int]) -> None:
    stamps_ns = [number * PERIOD_NS + jitter_ns for number, jitter_ns in enumerate(jitters_ns)]
    assert young(stamps_ns) == stamps_ns


def test_a_vehicle_whose_clock_is_a_tenth_fast_is_used_for_ever() -> None:
    stamps_ns = [ms(9) * number for number in range(20_000)]
    assert young(stamps_ns) == stamps_ns


@pytest.mark.parametrize("lost", [1, 2, 3, 4])
def test_a_lost_sample_costs_no_other(lost: int) -> None:
    stamps_ns = [number * PERIOD_NS for number in range(100) if not 50 <= number < 50 + lost]
    assert young(stamps_ns) == stamps_ns


@pytest.mark.parametrize("late_ms", [5, 9])
def test_a_late_sample_and_the_next_one_are_both_used(late_ms: int) -> None:
    stamps_ns = [number * PERIOD_NS + (ms(late_ms) if number == 50 else 0) for number in range(100)]
    assert young(stamps_ns) == stamps_ns


def test_the_first_sample_after_a_gap_is_not_used() -> None:
    before = [number * PERIOD_NS for number in range(10)]
    at_gap = [before[-1] + GAP_NS + number * PERIOD_NS for number in range(10)]
    after_gap = [before[-1] + GAP_NS + 1 + number * PERIOD_NS for number in range(10)]
    assert young([*before, *at_gap]) == [*before, *at_gap]
    assert young([*before, *after_gap]) == [*before, *after_gap[1:]]


@pytest.mark.parametrize("held_ms", [60, 100, 300, 450])
def test_samples_that_were_held_up_longer_than_the_gap_are_not_driven_by(held_ms: int) -> None:
    before = [number * PERIOD_NS for number in range(100)]
    released_ns = before[-1] + ms(held_ms)
    held = [released_ns + number * BUS_NS for number in range(held_ms // 10)]
    after = [held[-1] + ms(8) + number * PERIOD_NS for number in range(100)]
    assert young([*before, *held, *after]) == [*before, *after]
    arrivals = judged([*before, *held, *after])
    answered = [stamp_ns for stamp_ns in held if arrivals[stamp_ns] is Arrival.DOUBTFUL]
    assert answered[0] == released_ns
    assert len(answered) <= 1 + (held[-1] - held[0]) // ms(8)


def test_after_a_gap_a_sample_is_young_again_eight_tenths_of_a_period_after_the_first() -> None:
    before = [number * PERIOD_NS for number in range(100)]
    first_ns = before[-1] + ms(60)
    assert judged([*before, first_ns, first_ns + ms(8)])[first_ns + ms(8)] is Arrival.YOUNG
    assert judged([*before, first_ns, first_ns + ms(8) - 1])[first_ns + ms(8) - 1] is Arrival.BURST


@pytest.mark.parametrize(
    ("since_ns", "arrival"),
    [(ms(5), Arrival.YOUNG), (ms(5) - 1, Arrival.DOUBTFUL), (ms(4), Arrival.DOUBTFUL)],
)
def test_a_burst_is_over_after_a_sample_half_a_period_after_its_predecessor(since_ns: int, arrival: Arrival) -> None:
    """That sample itself comes too soon to be answered; the next one shows whether the doubt has ended."""
    before = [number * PERIOD_NS for number in range(100)]
    first_ns = before[-1] + ms(60)
    third_ns = first_ns + since_ns + ms(4)
    arrivals = judged([*before, first_ns, first_ns + since_ns, third_ns])
    assert arrivals[first_ns + since_ns] is Arrival.BURST
    assert arrivals[third_ns] is arrival


def test_two_samples_of_a_shorter_hold_up_are_used() -> None:
    before = [number * PERIOD_NS for number in range(100)]
    held = [before[-1] + ms(45) + number * BUS_NS for number in range(4)]
    after = [held[-1] + ms(8) + number * PERIOD_NS for number in range(100)]
    arrivals = judged([*before, *held, *after])
    assert [arrivals[stamp_ns] for stamp_ns in held] == [Arrival.YOUNG, Arrival.YOUNG, Arrival.BURST, Arrival.BURST]
    assert young([*before, *held, *after]) == [*before, *held[:2], *after]
