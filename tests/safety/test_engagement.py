"""Who drives: the table row by row, the conditions that raise the events, and what no sequence can bring about."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface import Reason
from vehicle_iface.safety.engagement import TABLE, Engagement, EngagementTiming, Event, Mode
from vehicle_iface.status import ControllerState, Gear, VehicleMode, VehicleStatus

MS = 1_000_000
TIMING = EngagementTiming(
    fresh_ns=500 * MS,
    stale_ns=50 * MS,
    lost_ns=500 * MS,
    give_up_ns=3000 * MS,
    end_ns=10_000 * MS,
    steer_torque_nm=3.0,
)
ENABLING = {Mode.ENGAGING, Mode.ENGAGED, Mode.ENDING}
LATCHED = {Mode.OVERRIDDEN, Mode.FAULT, Mode.SILENT, Mode.RELEASED}

ROWS = """
HEARING    NOBODY_DRIVES       STARTING   NOT_ENGAGED
HEARING    LINK_DOWN           SILENT     LINK_DOWN
HEARING    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STARTING   FRESH               STANDBY    NOT_ENGAGED
STARTING   LINK_DOWN           SILENT     LINK_DOWN
STARTING   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STARTING   END                 RELEASED   SHUTDOWN
STANDBY    STALE               STARTING   NOT_ENGAGED
STARTING   STATUS_LOST         HEARING    NOT_ENGAGED
STANDBY    STATUS_LOST         HEARING    NOT_ENGAGED
STANDBY    VEHICLE_READY       ENGAGING   NOMINAL
STANDBY    LINK_DOWN           SILENT     LINK_DOWN
STANDBY    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
STANDBY    END                 RELEASED   SHUTDOWN
ENGAGING   VEHICLE_AUTONOMOUS  ENGAGED    NOMINAL
ENGAGING   GAVE_UP             FAULT      VEHICLE_NOT_AUTONOMOUS
ENGAGING   OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
ENGAGING   VEHICLE_FAULT       FAULT      VEHICLE_FAULT
ENGAGING   STATE_LOST          SILENT     STATE_STALE
ENGAGING   LINK_DOWN           SILENT     LINK_DOWN
ENGAGING   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
ENGAGING   END                 ENDING     SHUTDOWN
ENGAGED    VEHICLE_LEFT        FAULT      VEHICLE_NOT_AUTONOMOUS
ENGAGED    OVERRIDE            OVERRIDDEN DRIVER_OVERRIDE
ENGAGED    VEHICLE_FAULT       FAULT      VEHICLE_FAULT
ENGAGED    STATE_LOST          SILENT     STATE_STALE
ENGAGED    LINK_DOWN           SILENT     LINK_DOWN
ENGAGED    DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
ENGAGED    END                 ENDING     SHUTDOWN
OVERRIDDEN ARMED               STARTING   NOT_ENGAGED
OVERRIDDEN LINK_DOWN           SILENT     LINK_DOWN
OVERRIDDEN DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
OVERRIDDEN END                 RELEASED   SHUTDOWN
FAULT      ARMED               STARTING   NOT_ENGAGED
FAULT      LINK_DOWN           SILENT     LINK_DOWN
FAULT      DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
FAULT      END                 RELEASED   SHUTDOWN
SILENT     ARMED               HEARING    NOT_ENGAGED
ENDING     STANDSTILL          RELEASED   SHUTDOWN
ENDING     OVERRIDE            RELEASED   DRIVER_OVERRIDE
ENDING     VEHICLE_LEFT        RELEASED   SHUTDOWN
ENDING     VEHICLE_FAULT       RELEASED   VEHICLE_FAULT
ENDING     STATE_LOST          SILENT     STATE_STALE
ENDING     LINK_DOWN           SILENT     LINK_DOWN
ENDING     DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
RELEASED   DUPLICATE_COMMANDER SILENT     DUPLICATE_COMMANDER
"""
EXPECTED = {
    (Mode[mode], Event[event]): (Mode[then], Reason[reason])
    for mode, event, then, reason in (line.split() for line in ROWS.strip().splitlines())
}
ALL_PAIRS = [(mode, event) for mode in Mode for event in Event]


def in_mode(mode: Mode) -> Engagement:
    engagement = Engagement(TIMING, armed=mode is not Mode.LISTENING)
    engagement.mode = mode
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
                self.engagement.see_sample(self.now_ns, self.now_ns)
            if report is not None:
                self.engagement.see_status(report, self.now_ns)
            self.engagement.see_time(self.now_ns)
        return self

    def until_engaged(self) -> "Run":
        self.for_ms(520, status()).for_ms(20, status(VehicleMode.AUTONOMOUS))
        assert self.mode() is Mode.ENGAGED
        return self


# The table


@pytest.mark.parametrize(("mode", "event"), ALL_PAIRS, ids=lambda value: value.name)
def test_every_event_in_every_mode_does_what_the_table_says_or_nothing(mode: Mode, event: Event) -> None:
    engagement = in_mode(mode)
    before = engagement.reason
    changed = engagement.happened(event, 7)
    assert (engagement.mode, engagement.reason) == EXPECTED.get((mode, event), (mode, before))
    assert changed is ((mode, event) in EXPECTED)
    assert engagement.transitions == ([(7, engagement.mode, engagement.reason)] if changed else [])


def test_the_program_has_no_row_that_is_not_here() -> None:
    assert TABLE == EXPECTED


def test_nothing_leads_out_of_listening() -> None:
    assert not any(mode is Mode.LISTENING for mode, _ in TABLE)
    assert not any(mode is Mode.LISTENING for mode, _ in TABLE.values())


def test_out_of_what_is_latched_only_arming_leads_to_where_commands_may_follow() -> None:
    for (mode, event), (then, _) in TABLE.items():
        if mode in LATCHED and then not in LATCHED:
            assert event is Event.ARMED


# Armed or not


def test_who_is_not_armed_sends_nothing_whatever_comes() -> None:
    run = Run(armed=False).for_ms(1000, status()).for_ms(1000, status(VehicleMode.AUTONOMOUS))
    run.engagement.happened(Event.ARMED, run.now_ns)
    run.for_ms(2000, status())
    assert run.mode() is Mode.LISTENING
    assert not run.engagement.sends
    assert not run.engagement.enables


def test_what_cannot_be_armed_says_why_and_what_the_vehicle_lacks() -> None:
    said = {mode: in_mode(mode).refusal_to_arm(None) for mode in Mode if (mode, Event.ARMED) not in TABLE}
    assert "--arm" in said[Mode.LISTENING]
    assert "somebody else" in said[Mode.HEARING]
    assert "samples" in said[Mode.STARTING]
    assert said[Mode.STANDBY] == "it is armed, and waits for the vehicle to be READY"
    assert len({said[mode] for mode in (Mode.ENGAGING, Mode.ENGAGED, Mode.ENDING)}) == 3
    standby = in_mode(Mode.STANDBY)
    manual = standby.refusal_to_arm(status(VehicleMode.MANUAL, driver_brake=True))
    assert manual == f"{said[Mode.STANDBY]}; it is MANUAL, and the driver acts"
    assert standby.refusal_to_arm(status()) == f"{said[Mode.STANDBY]}; it is READY"
    assert in_mode(Mode.ENGAGED).refusal_to_arm(status()) == said[Mode.ENGAGED]


def hearing(before: Mode | None = None) -> Engagement:
    """Just armed, at the start or out of this mode; or without a status for long."""
    if before is None:
        return Engagement(TIMING, armed=True)
    engagement = in_mode(before)
    engagement.see_sample(0, 0)
    engagement.see_status(status(VehicleMode.MANUAL), 0)
    if before is Mode.SILENT:
        engagement.happened(Event.ARMED, 0)
    engagement.see_time(500 * MS)
    assert engagement.mode is (Mode.HEARING if before is Mode.SILENT else Mode.STARTING)
    engagement.see_time(500 * MS + 1)
    assert engagement.mode is Mode.HEARING
    return engagement


HEARERS = [None, Mode.SILENT, Mode.STARTING, Mode.STANDBY]


@pytest.mark.parametrize("before", HEARERS)
@pytest.mark.parametrize("first", ["sample", "status"])
@pytest.mark.parametrize(("after_ns", "then"), [(200 * MS, Mode.HEARING), (200 * MS + 1, Mode.STARTING)])
def test_a_vehicle_is_heard_for_200_ms_to_the_nanosecond_from_its_first_word_before_it_is_answered(
    before: Mode | None, first: str, after_ns: int, then: Mode
) -> None:
    engagement = hearing(before)
    engagement.see_time(10**18)  # a bus on which nothing is heard says nothing
    assert engagement.mode is Mode.HEARING
    for later_ns in (0, 150 * MS):
        if first == "sample":
            engagement.see_sample(10**18 + later_ns, 10**18 + later_ns)
        else:
            engagement.see_status(status(VehicleMode.AUTONOMOUS), 10**18 + later_ns)
    engagement.see_time(10**18 + after_ns)
    assert engagement.mode is then
    assert engagement.sends is (then is Mode.STARTING)


@pytest.mark.parametrize("mode", list(VehicleMode))
def test_it_hears_no_longer_than_until_the_vehicle_says_that_nobody_drives_it(mode: VehicleMode) -> None:
    engagement = hearing()
    engagement.see_status(status(mode), 0)
    assert engagement.mode is (Mode.HEARING if mode is VehicleMode.AUTONOMOUS else Mode.STARTING)


@pytest.mark.parametrize("heard", ["nothing", "sample", "status"])
@pytest.mark.parametrize(("after_ns", "reports"), [(200 * MS, False), (200 * MS + 1, True)])
def test_where_there_is_no_vehicle_it_reports_after_200_ms_and_no_more_when_there_is_one(
    heard: str, after_ns: int, reports: bool
) -> None:
    engagement = hearing()
    assert not engagement.reports(10**18)
    engagement.see_time(10**18)
    if heard == "sample":
        engagement.see_sample(10**18 + after_ns, 10**18 + after_ns)
    elif heard == "status":
        engagement.see_status(status(VehicleMode.AUTONOMOUS), 10**18 + after_ns)
    assert engagement.reports(10**18 + after_ns) is (reports and heard == "nothing")
    assert not engagement.sends


def test_out_of_hearing_it_reports_where_it_sends() -> None:
    for mode in set(Mode) - {Mode.HEARING}:
        assert in_mode(mode).reports(10**18) is in_mode(mode).sends


def test_a_fault_is_forgotten_only_when_it_speaks_again() -> None:
    assert not hearing().latched
    assert not hearing(Mode.STANDBY).latched
    again = hearing(Mode.SILENT)
    assert again.latched
    again.see_status(status(), 0)
    assert not again.latched
    again.happened(Event.STATUS_LOST, 0)
    assert again.mode is Mode.HEARING
    assert not again.latched


@pytest.mark.parametrize("missing_ns", [0, 1])
def test_it_takes_half_a_second_of_fresh_samples_to_the_nanosecond(missing_ns: int) -> None:
    engagement = in_mode(Mode.STARTING)
    for i in range(50):
        engagement.see_sample(i * 10 * MS, i * 10 * MS)
    assert engagement.mode is Mode.STARTING
    engagement.see_sample(500 * MS - missing_ns, 500 * MS)
    assert engagement.mode is (Mode.STARTING if missing_ns else Mode.STANDBY)


@pytest.mark.parametrize(("gap_ns", "starts_anew"), [(50 * MS - 1, False), (50 * MS, False), (50 * MS + 1, True)])
def test_a_gap_longer_than_50_ms_begins_the_half_second_anew(gap_ns: int, starts_anew: bool) -> None:
    engagement = in_mode(Mode.STARTING)
    last_ns = 0
    for i in range(40):
        last_ns = i * 10 * MS
        engagement.see_sample(last_ns, last_ns)
    resumed_ns = last_ns + gap_ns
    for i in range(12):
        engagement.see_sample(resumed_ns + i * 10 * MS, resumed_ns + i * 10 * MS)
    assert engagement.mode is (Mode.STARTING if starts_anew else Mode.STANDBY)


def test_a_gap_that_was_noticed_counts_also_when_the_samples_were_only_held_up() -> None:
    engagement = in_mode(Mode.STARTING)
    for i in range(40):
        engagement.see_sample(i * 10 * MS, i * 10 * MS)
    engagement.see_time(450 * MS)
    for i in range(40, 60):
        engagement.see_sample(i * 10 * MS, 600 * MS)
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
    run.engagement.happened(Event.ARMED, run.now_ns)
    assert run.mode() is Mode.STARTING
    run.for_ms(480, status())
    assert not run.engagement.enables
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
def test_feet_and_hands_take_over_from_their_thresholds_on(driver: dict[str, Any], leaves: bool) -> None:
    run = Run().until_engaged().for_ms(10, status(VehicleMode.AUTONOMOUS, **driver))
    assert run.mode() is (Mode.OVERRIDDEN if leaves else Mode.ENGAGED)
    assert run.engagement.enables is not leaves
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
def test_a_vehicle_that_leaves_by_itself_is_let_go_for_good(mode: VehicleMode, then: Mode, reason: Reason) -> None:
    run = Run().until_engaged().for_ms(10, status(mode))
    assert (run.engagement.mode, run.engagement.reason) == (then, reason)
    run.for_ms(5000, status()).for_ms(1000, status(VehicleMode.AUTONOMOUS))
    assert run.mode() is then


@pytest.mark.parametrize(("gap_ns", "then"), [(500 * MS, Mode.ENGAGED), (500 * MS + 1, Mode.SILENT)])
def test_half_a_second_without_a_sample_silences_to_the_nanosecond(gap_ns: int, then: Mode) -> None:
    run = Run().until_engaged()
    run.engagement.see_time(run.now_ns + gap_ns)
    assert run.mode() is then


def test_silence_stays_when_samples_come_back() -> None:
    run = Run().until_engaged().for_ms(600, samples=False)
    assert run.mode() is Mode.SILENT
    run.for_ms(5000, status())
    assert run.mode() is Mode.SILENT
    assert not run.engagement.sends


@pytest.mark.parametrize(("after_ns", "then"), [(3000 * MS, Mode.ENGAGING), (3000 * MS + 1, Mode.FAULT)])
def test_a_vehicle_that_does_not_engage_is_given_up_after_three_seconds(after_ns: int, then: Mode) -> None:
    run = Run().for_ms(500, status()).for_ms(10, status())
    assert run.mode() is Mode.ENGAGING
    begun_ns = run.engagement.transitions[-1][0]
    run.engagement.see_sample(begun_ns + after_ns, begun_ns + after_ns)
    run.engagement.see_time(begun_ns + after_ns)
    assert run.mode() is then


@pytest.mark.parametrize(("after_ns", "then"), [(10_000 * MS, Mode.ENDING), (10_000 * MS + 1, Mode.RELEASED)])
def test_a_stop_for_good_is_waited_for_ten_seconds(after_ns: int, then: Mode) -> None:
    run = Run().until_engaged()
    run.engagement.happened(Event.END, run.now_ns)
    later_ns = run.now_ns + after_ns
    run.engagement.see_sample(later_ns, later_ns)
    run.engagement.see_time(later_ns)
    assert run.mode() is then


def test_without_any_sample_nothing_is_lost() -> None:
    engagement = in_mode(Mode.STARTING)
    engagement.see_time(10**15)
    assert engagement.mode is Mode.STARTING


# What is told


def test_every_mode_has_a_word_on_the_bus() -> None:
    for mode in Mode:
        assert isinstance(in_mode(mode).wire_state(stopping=False), ControllerState)
    assert in_mode(Mode.ENGAGED).wire_state(stopping=True) is ControllerState.STOPPING
    assert in_mode(Mode.ENGAGED).wire_state(stopping=False) is ControllerState.ENGAGED
    assert in_mode(Mode.LISTENING).wire_state(stopping=True) is ControllerState.SHADOW


def test_only_faults_and_silence_are_latched() -> None:
    assert {mode for mode in Mode if in_mode(mode).latched} == {Mode.FAULT, Mode.SILENT}


def test_commands_are_enabled_in_three_modes_and_sent_in_all_but_three() -> None:
    assert {mode for mode in Mode if in_mode(mode).enables} == ENABLING
    assert {mode for mode in Mode if not in_mode(mode).sends} == {Mode.LISTENING, Mode.HEARING, Mode.SILENT}


# What no sequence can bring about


@settings(max_examples=300)
@given(st.booleans(), st.lists(st.sampled_from(list(Event)), max_size=60))
def test_no_sequence_of_events_enables_without_an_arming_before_it(armed: bool, events: list[Event]) -> None:
    engagement = Engagement(TIMING, armed=armed)
    may_enable = armed
    for now_ns, event in enumerate(events):
        before = engagement.mode
        engagement.happened(event, now_ns)
        if event is Event.ARMED and before is not Mode.LISTENING:
            may_enable = True
        if engagement.mode in LATCHED:
            may_enable = False
        assert not engagement.enables or may_enable
        assert not engagement.enables or engagement.sends
        assert armed or engagement.mode is Mode.LISTENING


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
            run.engagement.happened(Event.ARMED, run.now_ns)
        elif act == "end":
            run.engagement.happened(Event.END, run.now_ns)
        elif isinstance(act, tuple):
            duration, report, samples = act
            run.for_ms(duration, report, samples=samples)
        engagings = sum(mode is Mode.ENGAGING for _, mode, _ in run.engagement.transitions)
        assert engagings <= armings
        assert armed or not engagings
