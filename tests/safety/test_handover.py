"""The warning before control is given back."""

import pytest

from vehicle_iface.safety.handover import Handover

WARNING_NS = 3_000
PLANNED_NS = 10_000


def asked_to_end(*, holds: bool = False, planned_ns: int | None = None) -> Handover:
    handover = Handover(WARNING_NS, hold_until_warned=holds)
    if planned_ns is not None:
        handover.plan(planned_ns)
    return handover


def test_without_a_planned_end_there_is_no_warning() -> None:
    handover = asked_to_end(planned_ns=None)
    assert not handover.update(10**18, is_driven=True, is_ending=False)
    assert not handover.warns
    assert handover.left_ns(10**18, is_ending=False) == handover.left_ns(0, is_ending=True) == 0


@pytest.mark.parametrize(("now_ns", "warns"), [(6_999, False), (7_000, True), (7_001, True), (10_000, True)])
def test_before_a_planned_end_the_warning_begins_exactly_then_and_once(now_ns: int, warns: bool) -> None:
    handover = asked_to_end(planned_ns=PLANNED_NS)
    assert handover.update(now_ns, is_driven=True, is_ending=False) is warns
    assert handover.warns is warns
    assert not handover.update(now_ns, is_driven=True, is_ending=False)
    assert handover.left_ns(now_ns, is_ending=False) == (PLANNED_NS - now_ns if warns else 0)


def test_an_end_that_was_not_planned_is_warned_of_when_it_begins() -> None:
    handover = asked_to_end()
    assert handover.update(500, is_driven=True, is_ending=True)
    assert handover.warns


@pytest.mark.parametrize("is_ending", [False, True])
def test_without_control_there_is_no_handover_and_a_new_drive_is_warned_again(is_ending: bool) -> None:
    handover = asked_to_end(planned_ns=PLANNED_NS)
    assert not handover.update(8_000, is_driven=False, is_ending=is_ending)
    assert not handover.warns
    assert handover.update(8_500, is_driven=True, is_ending=False)
    assert not handover.update(8_600, is_driven=False, is_ending=False)
    assert not handover.warns
    assert handover.update(8_700, is_driven=True, is_ending=False)


def test_a_vehicle_that_may_be_released_at_standstill_is_released_at_once() -> None:
    handover = asked_to_end()
    assert handover.may_release(0)
    handover.update(500, is_driven=True, is_ending=True)
    assert handover.may_release(500)
    assert handover.left_ns(500, is_ending=True) == 0


@pytest.mark.parametrize(
    ("now_ns", "may", "left_ns"), [(500, False, 3_000), (3_499, False, 1), (3_500, True, 0), (9_000, True, 0)]
)
def test_a_held_vehicle_is_released_when_the_warning_is_over(now_ns: int, may: bool, left_ns: int) -> None:
    handover = asked_to_end(holds=True)
    assert handover.may_release(0)
    handover.update(500, is_driven=True, is_ending=True)
    assert handover.may_release(now_ns) is may
    assert handover.left_ns(now_ns, is_ending=True) == left_ns


def test_a_warning_that_was_given_before_a_planned_end_is_not_given_again_after_it() -> None:
    handover = asked_to_end(holds=True, planned_ns=PLANNED_NS)
    handover.update(7_000, is_driven=True, is_ending=False)
    assert handover.left_ns(10_001, is_ending=False) == 0
    assert not handover.update(PLANNED_NS, is_driven=True, is_ending=True)
    assert handover.may_release(PLANNED_NS)


def test_an_end_before_the_planned_one_counts_from_the_warning() -> None:
    handover = asked_to_end(holds=True, planned_ns=PLANNED_NS)
    handover.update(7_000, is_driven=True, is_ending=False)
    handover.update(8_000, is_driven=True, is_ending=True)
    assert handover.left_ns(8_000, is_ending=True) == 2_000
    assert not handover.may_release(9_999)
    assert handover.may_release(10_000)
