"""Who drives: the table row by row, the conditions that raise the events, and what no sequence can bring about."""

from itertools import chain
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.narrowing import at_present
from vehicle_iface import Reason
from vehicle_iface.safety.engagement import MAX_TRANSITIONS, Engagement, EngagementTiming
from vehicle_iface.safety.modes import TABLE, Event, Mode
from vehicle_iface.status import ControllerState, Gear, VehicleMode, VehicleStatus

MS = 1_000_000
TIMING = EngagementTiming(
    settle_ns=500 * MS,
    stale_ns=50 * MS,
    lost_ns=500 * MS,
    status_stale_ns=100 * MS,
    engage_timeout_ns=3000 * MS,
    end_ns=10_000 * MS,
    steer_torque_nm=3.0,
)
ENABLING = {Mode.ENGAGING, Mode.ENGAGED, Mode.HALTING, Mode.HALTED, Mode.ENDING}
LATCHED_STOP = {Mode.HALTING, Mode.HALTED}
LATCHED = {Mode.OVERRIDDEN, Mode.FAULT, Mode.SILENT, Mode.RELEASED}

ROWS = """
OBSERVING    NO_OTHER_DRIVER       STARTING   NOT_ENGAGED
OBSERVING    LINK_DOWN           SILENT     LINK_DOWN
OBSERVING    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STARTING   FRESH               STANDBY    NOT_ENGAGED
STARTING   LINK_DOWN           SILENT     LINK_DOWN
STARTING   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STARTING   END                 RELEASED   SHUTDOWN
STANDBY    STALE               STARTING   NOT_ENGAGED
STARTING   STATUS_LOST         OBSERVING    NOT_ENGAGED
STANDBY    STATUS_LOST         OBSERVING    NOT_ENGAGED
STANDBY    VEHICLE_READY       ENGAGING   NOMINAL
STANDBY    LINK_DOWN           SILENT     LINK_DOWN
STANDBY    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STANDBY    END                 RELEASED   SHUTDOWN
ENGAGING   VEHICLE_AUTONOMOUS  ENGAGED    NOMINAL
ENGAGING   ENGAGE_TIMEOUT             FAULT      VEHICLE_NOT_AUTONOMOUS
ENGAGING   OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
ENGAGING   VEHICLE_FAULT       FAULT      VEHICLE_FAULT
ENGAGING   STATE_LOST          SILENT     STATE_STALE
ENGAGING   LINK_DOWN           SILENT     LINK_DOWN
ENGAGING   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
ENGAGING   END                 ENDING     SHUTDOWN
ENGAGED    VEHICLE_DISENGAGED        FAULT      VEHICLE_NOT_AUTONOMOUS
ENGAGED    OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
ENGAGED    VEHICLE_FAULT       FAULT      VEHICLE_FAULT
ENGAGED    STATE_LOST          SILENT     STATE_STALE
ENGAGED    LINK_DOWN           SILENT     LINK_DOWN
ENGAGED    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
ENGAGED    END                 ENDING     SHUTDOWN
ENGAGING   STOP_LATCHED        HALTING    FRAME_MISMATCH
ENGAGED    STOP_LATCHED        HALTING    FRAME_MISMATCH
HALTING    STANDSTILL          HALTED     -
HALTING    VEHICLE_DISENGAGED        FAULT      VEHICLE_NOT_AUTONOMOUS
HALTING    OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
HALTING    VEHICLE_FAULT       FAULT      VEHICLE_FAULT
HALTING    STATE_LOST          SILENT     STATE_STALE
HALTING    LINK_DOWN           SILENT     LINK_DOWN
HALTING    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
HALTING    END                 ENDING     SHUTDOWN
HALTED     ARMED               ENGAGED    NOMINAL
HALTED     VEHICLE_DISENGAGED        FAULT      VEHICLE_NOT_AUTONOMOUS
HALTED     OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
HALTED     VEHICLE_FAULT       FAULT      VEHICLE_FAULT
HALTED     STATE_LOST          SILENT     STATE_STALE
HALTED     LINK_DOWN           SILENT     LINK_DOWN
HALTED     DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
HALTED     END                 ENDING     SHUTDOWN
OVERRIDDEN ARMED               STARTING   NOT_ENGAGED
OVERRIDDEN LINK_DOWN           SILENT     LINK_DOWN
OVERRIDDEN DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
OVERRIDDEN END                 RELEASED   SHUTDOWN
FAULT      ARMED               STARTING   NOT_ENGAGED
FAULT      LINK_DOWN           SILENT     LINK_DOWN
FAULT      DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
FAULT      END                 RELEASED   SHUTDOWN
SILENT     ARMED               OBSERVING    NOT_ENGAGED
ENDING     STANDSTILL          RELEASED   SHUTDOWN
ENDING     OVERRIDE            RELEASED   DRIVER_OVERRIDE
ENDING     VEHICLE_DISENGAGED        RELEASED   SHUTDOWN
ENDING     VEHICLE_FAULT       RELEASED   VEHICLE_FAULT
ENDING     STATE_LOST          SILENT     STATE_STALE
ENDING     LINK_DOWN           SILENT     LINK_DOWN
ENDING     DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
RELEASED   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
"""
STOP_REASON = Reason.FRAME_MISMATCH
"""Of the latched stop in the rows above; – keeps the reason that there was."""
EXPECTED = {
    (Mode[mode], Event[event]): (Mode[then], Reason[reason] if reason != "-" else None)
    for mode, event, then, reason in (line.split() for line in ROWS.strip().splitlines())
}
ALL_PAIRS = [(mode, event) for mode in Mode for event in Event]


def in_mode(mode: Mode) -> Engagement:
    engagement = Engagement(TIMING, armed=mode is not Mode.SHADOW)
    engagement.mode = mode
    engagement.latched_fault = Reason.LINK_DOWN if mode.latched else None
    return engagement


def status(mode: VehicleMode = VehicleMode.READY, **driver: Any) -> VehicleStatus:
    return VehicleStatus(stamp_ns=0, mode=mode, gear=Gear.DRIVE, **driver)


class Run:
    """An engagement with samples and status reports on their periods."""

    def __init__(self, *, armed: bool = True) -> None:
        self.engagement = Engagement(TIMING, armed=armed)
        self.now_ns = 10**9

    def mode(self) -> Mode:
        return self.engagement.mode

    def for_ms(self, duration: int, report: VehicleStatus | None = None, *, samples: bool = True) -> "Run":
        for _ in range(duration // 10):
            self.now_ns += 10 * MS
            if samples:
                self.engagement.on_sample(self.now_ns, self.now_ns)
            if report is not None:
                self.engagement.on_status(replace(report, stamp_ns=self.now_ns), self.now_ns)
            self.engagement.on_tick(self.now_ns)
        return self

    def until_engaged(self) -> "Run":
        self.for_ms(520, status()).for_ms(20, status(VehicleMode.AUTONOMOUS))
        assert self.mode() is Mode.ENGAGED
        return self


# The table


@pytest.mark.parametrize(("mode", "event"), ALL_PAIRS, ids=lambda value: value.name)
def test_every_event_in_every_mode_has_the_transition_of_the_table_or_none(mode: Mode, event: Event) -> None:
    engagement = in_mode(mode)
    before = engagement.reason
    changed = engagement.apply(event, 7, STOP_REASON)
    then, reason = EXPECTED.get((mode, event), (mode, before))
    if reason is None:
        reason = STOP_REASON
    assert (engagement.mode, engagement.reason) == (then, reason)
    assert changed is ((mode, event) in EXPECTED)
    assert engagement.transitions == ([(7, engagement.mode, engagement.reason)] if changed else [])


def test_a_stop_that_latches_keeps_its_reason_at_standstill() -> None:
    engagement = in_mode(Mode.ENGAGED)
    engagement.apply(Event.STOP_LATCHED, 1, Reason.STATE_INVALID)
    engagement.apply(Event.STANDSTILL, 2)
    assert (engagement.mode, engagement.reason) == (Mode.HALTED, Reason.STATE_INVALID)


def test_the_program_has_no_row_that_is_not_here() -> None:
    kept = {
        pair: (then, reason) if reason is not STOP_REASON else (then, None) for pair, (then, reason) in EXPECTED.items()
    }
    assert kept == TABLE


def test_nothing_leads_out_of_listening() -> None:
    assert not any(mode is Mode.SHADOW for mode, _ in TABLE)
    assert not any(mode is Mode.SHADOW for mode, _ in TABLE.values())


def test_only_arming_leads_out_of_a_latched_mode() -> None:
    for (mode, event), (then, _) in TABLE.items():
        if mode in LATCHED and then not in LATCHED:
            assert event is Event.ARMED


# Armed or not


def test_an_unarmed_loop_sends_nothing_whatever_comes() -> None:
    run = Run(armed=False).for_ms(1000, status()).for_ms(1000, status(VehicleMode.AUTONOMOUS))
    run.engagement.apply(Event.ARMED, run.now_ns)
    run.for_ms(2000, status())
    assert run.mode() is Mode.SHADOW
    assert not run.engagement.mode.may_send
    assert not run.engagement.mode.enables
    assert run.engagement.mode.computes, "a shadow compares its commands with another commander's"


def test_a_rejected_arming_names_the_reason_and_the_vehicles_state() -> None:
    said = {mode: in_mode(mode).refusal_to_arm(None) for mode in Mode if (mode, Event.ARMED) not in TABLE}
    assert "--arm" in said[Mode.SHADOW]
    assert "another node" in said[Mode.OBSERVING]
    assert "samples" in said[Mode.STARTING]
    assert said[Mode.STANDBY] == "it is armed, and waits for the vehicle to be READY"
    assert len({said[mode] for mode in (Mode.ENGAGING, Mode.ENGAGED, Mode.HALTING, Mode.ENDING)}) == 4
    assert "does not stand yet" in said[Mode.HALTING]
    standby = in_mode(Mode.STANDBY)
    manual = standby.refusal_to_arm(status(VehicleMode.MANUAL, driver_brake=True))
    assert manual == f"{said[Mode.STANDBY]}; the vehicle is MANUAL, and the driver operates it"
    assert standby.refusal_to_arm(status()) == f"{said[Mode.STANDBY]}; the vehicle is READY"
    assert in_mode(Mode.ENGAGED).refusal_to_arm(status()) == said[Mode.ENGAGED]


def observing(before: Mode | None = None) -> Engagement:
    """Just armed, at the start or out of this mode; or without a status for long."""
    if before is None:
        return Engagement(TIMING, armed=True)
    engagement = in_mode(before)
    engagement.on_sample(0, 0)
    engagement.on_status(status(VehicleMode.MANUAL), 0)
    if before is Mode.SILENT:
        engagement.apply(Event.ARMED, 0)
    engagement.on_tick(500 * MS)
    assert engagement.mode is (Mode.OBSERVING if before is Mode.SILENT else Mode.STARTING)
    engagement.on_tick(500 * MS + 1)
    assert engagement.mode is Mode.OBSERVING
    return engagement


HEARERS = [None, Mode.SILENT, Mode.STARTING, Mode.STANDBY]


@pytest.mark.parametrize("before", HEARERS)
@pytest.mark.parametrize("first", ["sample", "status"])
@pytest.mark.parametrize(("after_ns", "then"), [(200 * MS, Mode.OBSERVING), (200 * MS + 1, Mode.STARTING)])
def test_a_vehicle_is_observed_for_200_ms_to_the_nanosecond_before_commands_are_sent(
    before: Mode | None, first: str, after_ns: int, then: Mode
) -> None:
    engagement = observing(before)
    engagement.on_tick(10**18)  # a bus on which nothing is received shows nothing
    assert at_present(engagement.mode) is Mode.OBSERVING
    for later_ns in (0, 150 * MS):
        if first == "sample":
            engagement.on_sample(10**18 + later_ns, 10**18 + later_ns)
        else:
            engagement.on_status(status(VehicleMode.AUTONOMOUS), 10**18 + later_ns)
    engagement.on_tick(10**18 + after_ns)
    assert engagement.mode is then
    assert engagement.mode.may_send is (then is Mode.STARTING)


@pytest.mark.parametrize("mode", list(VehicleMode))
def test_observing_ends_when_the_vehicle_reports_that_it_is_not_driven(mode: VehicleMode) -> None:
    engagement = observing()
    engagement.on_status(status(mode), 0)
    assert engagement.mode is (Mode.OBSERVING if mode is VehicleMode.AUTONOMOUS else Mode.STARTING)


@pytest.mark.parametrize("received", ["nothing", "sample", "status"])
@pytest.mark.parametrize(("after_ns", "reports"), [(200 * MS, False), (200 * MS + 1, True)])
def test_without_a_vehicle_it_reports_after_200_ms_until_there_is_one(
    received: str, after_ns: int, reports: bool
) -> None:
    engagement = observing()
    assert not engagement.may_report(10**18)
    engagement.on_tick(10**18)
    if received == "sample":
        engagement.on_sample(10**18 + after_ns, 10**18 + after_ns)
    elif received == "status":
        engagement.on_status(status(VehicleMode.AUTONOMOUS), 10**18 + after_ns)
    assert engagement.may_report(10**18 + after_ns) is (reports and received == "nothing")
    assert not engagement.mode.may_send


def test_in_every_mode_but_observing_it_reports_where_it_may_send() -> None:
    for mode in set(Mode) - {Mode.OBSERVING}:
        assert in_mode(mode).may_report(10**18) is in_mode(mode).mode.may_send


def test_a_fault_is_cleared_only_by_a_later_status() -> None:
    assert not observing().ends_in_fault
    assert not observing(Mode.STANDBY).ends_in_fault
    again = observing(Mode.SILENT)
    assert at_present(again.ends_in_fault)
    again.on_status(status(), 0)
    assert not at_present(again.ends_in_fault)
    again.apply(Event.STATUS_LOST, 0)
    assert again.mode is Mode.OBSERVING
    assert not again.ends_in_fault


@pytest.mark.parametrize("missing_ns", [0, 1])
def test_it_takes_half_a_second_of_fresh_samples_to_the_nanosecond(missing_ns: int) -> None:
    engagement = in_mode(Mode.STARTING)
    for i in range(50):
        engagement.on_sample(i * 10 * MS, i * 10 * MS)
    assert engagement.mode is Mode.STARTING
    engagement.on_sample(500 * MS - missing_ns, 500 * MS)
    assert engagement.mode is (Mode.STARTING if missing_ns else Mode.STANDBY)


@pytest.mark.parametrize(("gap_ns", "restarts"), [(50 * MS - 1, False), (50 * MS, False), (50 * MS + 1, True)])
def test_a_gap_longer_than_50_ms_restarts_the_half_second(gap_ns: int, restarts: bool) -> None:
    engagement = in_mode(Mode.STARTING)
    last_ns = 0
    for i in range(40):
        last_ns = i * 10 * MS
        engagement.on_sample(last_ns, last_ns)
    resumed_ns = last_ns + gap_ns
    for i in range(12):
        engagement.on_sample(resumed_ns + i * 10 * MS, resumed_ns + i * 10 * MS)
    assert engagement.mode is (Mode.STARTING if restarts else Mode.STANDBY)


def test_a_gap_that_was_noticed_counts_also_when_the_samples_were_only_held_up() -> None:
    engagement = in_mode(Mode.STARTING)
    for i in range(40):
        engagement.on_sample(i * 10 * MS, i * 10 * MS)
    engagement.on_tick(450 * MS)
    for i in range(40, 60):
        engagement.on_sample(i * 10 * MS, 600 * MS)
    assert engagement.mode is Mode.STARTING


def test_in_standby_samples_that_stop_lead_back_to_starting() -> None:
    run = Run().for_ms(520)
    assert run.mode() is Mode.STANDBY
    run.for_ms(50, samples=False)
    assert run.mode() is Mode.STANDBY
    run.for_ms(10, samples=False)
    assert run.mode() is Mode.STARTING


@pytest.mark.parametrize("mode", [mode for mode in VehicleMode if mode is not VehicleMode.READY])
def test_a_vehicle_that_is_not_ready_is_not_engaged(mode: VehicleMode) -> None:
    run = Run().for_ms(2000, status(mode))
    assert run.mode() is Mode.STANDBY


@pytest.mark.parametrize(
    "driver", [{"driver_brake": True}, {"driver_throttle": True}, {"driver_steer_torque_nm": -3.0}]
)
def test_a_driver_on_the_controls_keeps_it_from_engaging(driver: dict[str, Any]) -> None:
    run = Run().for_ms(2000, status(**driver))
    assert run.mode() is Mode.STANDBY
    run.for_ms(10, status())
    assert run.mode() is Mode.ENGAGING


def test_it_engages_once_for_each_arming() -> None:
    run = Run().until_engaged()
    run.for_ms(20, status(VehicleMode.MANUAL))
    assert run.mode() is Mode.OVERRIDDEN
    run.for_ms(5000, status())
    assert run.mode() is Mode.OVERRIDDEN
    run.engagement.apply(Event.ARMED, run.now_ns)
    assert run.mode() is Mode.STARTING
    run.for_ms(480, status())
    assert not run.engagement.mode.enables
    run.for_ms(40, status())
    assert run.mode() is Mode.ENGAGING


# Leaving


@pytest.mark.parametrize(
    ("driver", "leaves"),
    [
        ({"driver_brake": True}, True),
        ({"driver_throttle": True}, True),
        ({"driver_steer_torque_nm": 2.9}, False),
        ({"driver_steer_torque_nm": 3.0}, True),
        ({"driver_steer_torque_nm": -2.9}, False),
        ({"driver_steer_torque_nm": -3.0}, True),
        ({}, False),
    ],
)
def test_pedals_and_steering_torque_override_from_their_thresholds_on(driver: dict[str, Any], leaves: bool) -> None:
    run = Run().until_engaged().for_ms(10, status(VehicleMode.AUTONOMOUS, **driver))
    assert run.mode() is (Mode.OVERRIDDEN if leaves else Mode.ENGAGED)
    assert run.engagement.mode.enables is not leaves
    assert not leaves or run.engagement.reason is Reason.DRIVER_OVERRIDE


@pytest.mark.parametrize(
    ("mode", "then", "reason"),
    [
        (VehicleMode.MANUAL, Mode.OVERRIDDEN, Reason.DRIVER_OVERRIDE),
        (VehicleMode.READY, Mode.FAULT, Reason.VEHICLE_NOT_AUTONOMOUS),
        (VehicleMode.FAULT, Mode.FAULT, Reason.VEHICLE_FAULT),
        (VehicleMode.EMERGENCY_STOP, Mode.FAULT, Reason.VEHICLE_FAULT),
    ],
)
def test_a_vehicle_that_disengages_by_itself_is_released_for_good(
    mode: VehicleMode, then: Mode, reason: Reason
) -> None:
    run = Run().until_engaged().for_ms(10, status(mode))
    assert (run.engagement.mode, run.engagement.reason) == (then, reason)
    run.for_ms(5000, status()).for_ms(1000, status(VehicleMode.AUTONOMOUS))
    assert run.mode() is then


@pytest.mark.parametrize(("gap_ns", "then"), [(500 * MS, Mode.ENGAGED), (500 * MS + 1, Mode.SILENT)])
def test_half_a_second_without_a_sample_silences_to_the_nanosecond(gap_ns: int, then: Mode) -> None:
    run = Run().until_engaged()
    run.engagement.on_tick(run.now_ns + gap_ns)
    assert run.mode() is then


def test_silence_stays_when_samples_come_back() -> None:
    run = Run().until_engaged().for_ms(600, samples=False)
    assert run.mode() is Mode.SILENT
    run.for_ms(5000, status())
    assert run.mode() is Mode.SILENT
    assert not run.engagement.mode.may_send


@pytest.mark.parametrize(("after_ns", "then"), [(3000 * MS, Mode.ENGAGING), (3000 * MS + 1, Mode.FAULT)])
def test_engaging_is_aborted_after_three_seconds_without_the_vehicle(after_ns: int, then: Mode) -> None:
    run = Run().for_ms(500, status()).for_ms(10, status())
    assert run.mode() is Mode.ENGAGING
    begun_ns = run.engagement.transitions[-1][0]
    run.engagement.on_sample(begun_ns + after_ns, begun_ns + after_ns)
    run.engagement.on_tick(begun_ns + after_ns)
    assert run.mode() is then


@pytest.mark.parametrize(("after_ns", "then"), [(10_000 * MS, Mode.ENDING), (10_000 * MS + 1, Mode.RELEASED)])
def test_a_stop_for_good_is_waited_for_ten_seconds(after_ns: int, then: Mode) -> None:
    run = Run().until_engaged()
    run.engagement.apply(Event.END, run.now_ns)
    later_ns = run.now_ns + after_ns
    run.engagement.on_sample(later_ns, later_ns)
    run.engagement.on_tick(later_ns)
    assert run.mode() is then


def test_without_any_sample_nothing_is_lost() -> None:
    engagement = in_mode(Mode.STARTING)
    engagement.on_tick(10**15)
    assert engagement.mode is Mode.STARTING


# What is reported


def test_every_mode_has_a_wire_state() -> None:
    for mode in Mode:
        assert isinstance(in_mode(mode).wire_state(stopping=False), ControllerState)
    assert in_mode(Mode.ENGAGED).wire_state(stopping=True) is ControllerState.STOPPING
    assert in_mode(Mode.ENGAGED).wire_state(stopping=False) is ControllerState.ENGAGED
    assert in_mode(Mode.SHADOW).wire_state(stopping=True) is ControllerState.SHADOW


def test_only_faults_silence_and_latched_stops_are_latched() -> None:
    assert {mode for mode in Mode if in_mode(mode).ends_in_fault} == {Mode.FAULT, Mode.SILENT} | LATCHED_STOP
    assert {mode for mode in Mode if mode.stops and not mode.ends} == LATCHED_STOP


@pytest.mark.parametrize(
    ("column", "modes"),
    [
        ("computes", {Mode.SHADOW, Mode.ENGAGING, Mode.ENGAGED}),
        ("engages", {Mode.ENGAGING}),
        ("stops", {*LATCHED_STOP, Mode.ENDING}),
        ("ends", {Mode.ENDING}),
        ("disengaged", {Mode.OVERRIDDEN, Mode.FAULT, Mode.RELEASED}),
        ("observes", {Mode.OBSERVING}),
    ],
)
def test_a_property_belongs_to_these_modes_alone(column: str, modes: set[Mode]) -> None:
    assert {mode for mode in Mode if getattr(mode, column)} == modes


def test_a_latched_fault_keeps_its_reason_until_it_is_armed_again() -> None:
    engagement = in_mode(Mode.ENGAGED)
    engagement.apply(Event.VEHICLE_FAULT, 1)
    assert engagement.latched_fault is Reason.VEHICLE_FAULT
    engagement.apply(Event.ARMED, 2)
    assert at_present(engagement.latched_fault) is None


def test_a_status_of_which_a_part_is_old_does_not_engage_to_the_nanosecond() -> None:
    engagement, stale_ns = in_mode(Mode.STANDBY), TIMING.status_stale_ns
    assert not engagement.on_status(status(VehicleMode.READY), stale_ns + 1)
    assert engagement.on_status(status(VehicleMode.READY), stale_ns)


def test_only_the_status_that_begins_a_drive_says_so() -> None:
    engagement = in_mode(Mode.STANDBY)
    assert engagement.on_status(status(VehicleMode.READY), 1)
    assert not engagement.on_status(status(VehicleMode.READY), 2)
    assert engagement.on_status(status(VehicleMode.AUTONOMOUS), 3)
    assert not engagement.on_status(status(VehicleMode.AUTONOMOUS), 4)
    assert not engagement.on_status(status(VehicleMode.MANUAL), 5)


def test_only_a_released_vehicle_is_released() -> None:
    engagement = Engagement(TIMING, armed=True)
    for mode in Mode:
        engagement.mode = mode
        assert engagement.is_released is (mode is Mode.RELEASED)


def test_the_first_thousand_transitions_are_kept_and_the_mode_changes_after_them_as_well() -> None:
    engagement = Engagement(TIMING, armed=True)
    for now_ns in range(MAX_TRANSITIONS + 7):
        engagement.mode = Mode.STARTING
        assert engagement.apply(Event.FRESH, now_ns)
    assert engagement.mode is Mode.STANDBY
    assert [transition.at_ns for transition in engagement.transitions] == list(range(MAX_TRANSITIONS))


def test_samples_whose_sources_disagree_do_not_engage() -> None:
    run = Run().for_ms(520, status(VehicleMode.MANUAL))
    assert run.mode() is Mode.STANDBY
    run.engagement.on_sample(run.now_ns, run.now_ns, is_usable=False)
    assert run.mode() is Mode.STARTING
    run.for_ms(490, status())
    assert run.mode() is Mode.STARTING
    run.for_ms(40, status())
    assert run.mode() is Mode.ENGAGING


def test_commands_are_enabled_in_five_modes_and_sent_in_all_but_three() -> None:
    assert {mode for mode in Mode if in_mode(mode).mode.enables} == ENABLING
    assert {mode for mode in Mode if not in_mode(mode).mode.may_send} == {Mode.SHADOW, Mode.OBSERVING, Mode.SILENT}


# What no sequence can bring about


ENGAGES = [Event.NO_OTHER_DRIVER, Event.FRESH, Event.VEHICLE_READY]
EVENTS = st.lists(st.one_of(st.sampled_from(list(Event)).map(lambda event: [event]), st.just(ENGAGES)), max_size=30)


@settings(max_examples=300)
@given(st.booleans(), EVENTS)
def test_no_sequence_of_events_enables_without_an_arming_before_it(armed: bool, events: list[list[Event]]) -> None:
    engagement = Engagement(TIMING, armed=armed)
    may_enable = armed
    for now_ns, event in enumerate(chain.from_iterable(events)):
        before, enabled = engagement.mode, engagement.mode.enables
        engagement.apply(event, now_ns)
        if event is Event.ARMED and before is not Mode.SHADOW:
            may_enable = True
        if engagement.mode in LATCHED or (enabled and not engagement.mode.enables):
            may_enable = False
        assert not engagement.mode.enables or may_enable
        assert not engagement.mode.enables or engagement.mode.may_send
        assert armed or engagement.mode is Mode.SHADOW


ANY_STATUS = st.builds(
    VehicleStatus,
    stamp_ns=st.just(0),
    mode=st.sampled_from(list(VehicleMode)),
    gear=st.just(Gear.DRIVE),
    driver_brake=st.booleans(),
    driver_steer_torque_nm=st.sampled_from([0.0, 2.9, 3.0, -3.0]),
)
ACTS = st.one_of(
    st.just("arm"),
    st.just("end"),
    st.tuples(st.integers(1, 700), ANY_STATUS, st.booleans()),
    st.tuples(st.just(600), st.just(status()), st.just(True)),
    st.tuples(st.just(50), st.just(status(VehicleMode.AUTONOMOUS)), st.just(True)),
)


@settings(max_examples=100)
@given(st.booleans(), st.lists(ACTS, max_size=15))
def test_each_engaging_has_an_arming_of_its_own(armed: bool, acts: list[object]) -> None:
    run = Run(armed=armed)
    armings = int(armed)
    for act in acts:
        if act == "arm":
            armings += 1
            run.engagement.apply(Event.ARMED, run.now_ns)
        elif act == "end":
            run.engagement.apply(Event.END, run.now_ns)
        elif isinstance(act, tuple):
            duration, report, samples = act
            run.for_ms(duration, report, samples=samples)
        engagings = sum(mode is Mode.ENGAGING for _, mode, _ in run.engagement.transitions)
        assert engagings <= armings
        assert armed or not engagings
