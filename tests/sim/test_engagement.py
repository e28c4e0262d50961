"""The table of modes, every cell of it, and the row of pairs."""

import itertools

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, EMERGENCY_STOP, FAULT, MANUAL, READY

from vehicle_iface.sim.engagement import TRANSITIONS, WATCHDOG_PERIODS, CommandWatch, Event
from vehicle_iface.sim.parameters import Driver

from .harness import VehicleHarness

MODES = (MANUAL, READY, AUTONOMOUS, FAULT, EMERGENCY_STOP)
WRITTEN = {
    Event.PAIRS_RECEIVED: {READY: AUTONOMOUS},
    Event.RELEASED: {AUTONOMOUS: READY},
    Event.OVERRIDE: {AUTONOMOUS: MANUAL},
    Event.COMMANDS_LOST: {AUTONOMOUS: FAULT},
    Event.FAULT: {MANUAL: FAULT, READY: FAULT, AUTONOMOUS: FAULT},
    Event.EMERGENCY_STOP: dict.fromkeys((MANUAL, READY, AUTONOMOUS, FAULT), EMERGENCY_STOP),
    Event.MADE_READY: {MANUAL: READY},
    Event.RESET: {FAULT: MANUAL, EMERGENCY_STOP: MANUAL},
}


@pytest.mark.parametrize(("event", "mode"), list(itertools.product(Event, MODES)))
def test_every_mode_answers_every_event_as_written(event: Event, mode: int) -> None:
    got = {(int(at), what): int(to) for (at, what), to in TRANSITIONS.items()}
    assert got.get((mode, event), mode) == WRITTEN[event].get(mode, mode)


@pytest.mark.parametrize("line", ["brake 1", "throttle 1", "steer 9", "ready", "reset", "fault 1", "emergency_stop"])
def test_no_driver_action_leads_to_autonomous(line: str) -> None:
    for mode in MODES:
        harness = VehicleHarness(mode=type(VehicleHarness().vehicle.mode)(mode))
        harness.send_line(line)
        assert harness.vehicle.mode != AUTONOMOUS or mode == AUTONOMOUS


def test_a_driver_at_rest_is_the_default() -> None:
    assert Driver() == Driver(brake=False, throttle=False, steer_torque_nm=0.0)


def test_a_watch_has_no_deadline_before_each_kind_was_received() -> None:
    watch = CommandWatch({"a": 10, "b": 10})
    watch.note("a", enabled=True, seen_ns=5)
    assert watch.expires_ns is None
    watch.note("b", enabled=True, seen_ns=7)
    assert watch.expires_ns == 5 + WATCHDOG_PERIODS * 10


def test_each_kind_has_ten_of_its_own_periods() -> None:
    watch = CommandWatch({"fast": 10, "slow": 100})
    watch.note("slow", enabled=True, seen_ns=0)
    watch.note("fast", enabled=True, seen_ns=850)
    assert watch.expires_ns == 950
    watch.note("fast", enabled=True, seen_ns=945)
    assert watch.expires_ns == 1000


def test_a_vehicle_with_one_command_message_counts_each_as_a_pair() -> None:
    watch = CommandWatch({"both": 10})
    for i in range(3):
        watch.note("both", enabled=True, seen_ns=i)
    assert watch.pairs == 3


def test_a_gap_breaks_the_row_once() -> None:
    watch = CommandWatch({"a": 10, "b": 10})
    for start_ns in (0, WATCHDOG_PERIODS * 10):
        watch.note("a", enabled=True, seen_ns=start_ns)
        watch.note("b", enabled=True, seen_ns=start_ns)
        assert watch.pairs == 1


def test_a_command_that_comes_twice_as_often_comes_twice_for_a_pair_and_no_more() -> None:
    watch = CommandWatch({"fast": 10, "slow": 20})
    for kind in ("fast", "slow", "fast", "fast", "slow"):
        watch.note(kind, enabled=True, seen_ns=0)
    assert watch.pairs == 2
    for _ in range(3):
        watch.note("fast", enabled=True, seen_ns=0)
    assert watch.pairs == 0
