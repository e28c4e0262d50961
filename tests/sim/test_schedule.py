"""Each message of the simulated vehicle at its own period."""

from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.sim.schedule import Due, SendSchedule

PERIODS_NS = {"slow": 20, "fast": 5, "odd": 7}


def test_messages_are_due_on_one_absolute_grid_and_none_is_made_up_for() -> None:
    schedule = SendSchedule(PERIODS_NS, 100)
    assert schedule.take_due(99) is None
    assert schedule.take_due(100) == Due(("slow", "fast", "odd"), 100, 0)
    assert schedule.take_due(104) is None
    assert schedule.next_due_ns == 105
    assert schedule.take_due(113) == Due(("fast", "odd"), 110, 1)
    assert schedule.next_due_ns == 114
    assert schedule.take_due(170) == Due(("slow", "fast", "odd"), 170, 11)


@given(steps_ns=st.lists(st.integers(0, 40), min_size=1, max_size=60))
@settings(max_examples=40, deadline=None)
def test_time_never_goes_back_and_what_is_due_is_sent(steps_ns: list[int]) -> None:
    schedule, now_ns, before_ns = SendSchedule(PERIODS_NS, 0), 0, -1
    for step_ns in steps_ns:
        now_ns += step_ns
        due = schedule.take_due(now_ns)
        if due is not None:
            assert before_ns < due.instant_ns <= now_ns
            before_ns = due.instant_ns
        assert now_ns < schedule.next_due_ns <= now_ns + 5
