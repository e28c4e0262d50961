"""One complete sample: messages of one counter value within the window, and nothing else."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from types import MappingProxyType

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.harness import ms, reference
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.pose import Locator
from vehicle_iface.row import Locate, MeasuredState, Row, RowReader
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.state import VehicleState
from vehicle_iface.state_assembler import Freshness, Sample, StateAssembler
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

WINDOW_NS = ms(50)
STALE_NS = ms(200)
NAMES = ("POSE", "MOTION", "CHASSIS")
FIELDS = {
    "POSE": ("x_m", "y_m", "pose_frame", "pose_valid"),
    "MOTION": ("heading_rad", "speed_mps", "yaw_rate_radps"),
    "CHASSIS": ("accel_mps2", "lateral_speed_mps", "front_wheel_angle_rad"),
}
STATUS = ("gear", "driver_brake", "mode", "driver_throttle", "driver_steer_torque_nm", "rear_wheel_angle_rad", "")


def row_reader(
    messages: Mapping[str, Sequence[str]], frames: Mapping[int, str], omissible: Collection[str] = ()
) -> RowReader:
    """Of messages whose values are the fields named; "" is a value that nobody needs."""
    columns = [(message, field) for message, fields in messages.items() for field in fields]
    first = {name: next(i for i, (message, _) in enumerate(columns) if message == name) for name in messages}
    state_fields = {field.name for field in fields(VehicleState)} | {"pose_frame", "pose_valid"}
    own = {field: column for column, (message, field) in reversed(list(enumerate(columns))) if message in NAMES}
    others = {field: column for column, (message, field) in enumerate(columns) if message not in NAMES}
    places = others | own

    def read_state(stamp_ns: int, row: Row, _: Locate) -> MeasuredState | None:
        values = {field: row[column] for field, column in places.items() if field in state_fields}
        frame, is_valid = values.pop("pose_frame", None), values.pop("pose_valid", True)
        if None in values.values() or is_valid is None or ("pose_frame" in places and frame is None):
            return None
        frame_id = frames[int(frame)] if frame is not None else next(iter(frames.values()))
        numbers = {field: value for field, value in values.items() if value is not None}
        return MeasuredState(VehicleState(stamp_ns=stamp_ns, frame_id=frame_id, **numbers), bool(is_valid))

    def read_status(stamp_ns: int, row: Row) -> VehicleStatus:
        words = {field: row[column] or 0 for field, column in places.items() if row[column] is not None}
        return VehicleStatus(
            stamp_ns=stamp_ns,
            mode=VehicleMode(int(words["mode"])),
            gear=Gear(int(words["gear"])) if "gear" in words else None,
            driver_brake=bool(words.get("driver_brake")),
            driver_throttle=bool(words.get("driver_throttle")),
            driver_steer_torque_nm=float(words.get("driver_steer_torque_nm", 0.0)),
            fault_code=int(words.get("fault_code", 0)),
        )

    needed = {column for column, (_, field) in enumerate(columns) if field in {*state_fields, "mode"}}
    return RowReader(
        empty=tuple(0 if field in state_fields else None for _, field in columns),
        places={name: slice(first[name], first[name] + len(messages[name])) for name in messages},
        status_messages=frozenset(name for name, words in messages.items() if "mode" in words),
        driver_messages=frozenset(name for name in messages if name not in {*NAMES, "EXTRA"}),
        needed={
            name: frozenset(needed.intersection(range(first[name], first[name] + len(messages[name]))))
            for name in messages
        },
        multiplexed=frozenset({"EXTRA"}),
        read_state=read_state,
        read_status=read_status,
        omissible=tuple(column for column, (_, field) in enumerate(columns) if field in omissible),
    )


def assembler_of(
    sample: Mapping[str, Sequence[str]],
    others: Mapping[str, Sequence[str]],
    *,
    frames: Mapping[int, str] = MappingProxyType({0: "odom", 1: "map"}),
    counter_states: int = 1,
    freshness: Freshness | None = None,
    omissible: Collection[str] = (),
) -> StateAssembler:
    return StateAssembler(
        row_reader({**sample, **others}, frames, omissible),
        Locator(reference().profile),
        sample=list(sample),
        window_ns=WINDOW_NS,
        stale_ns=STALE_NS,
        counter_states=counter_states,
        freshness=freshness,
    )


def assembler(sample: Iterable[str] = NAMES, *, counter_states: int = 1) -> StateAssembler:
    others = {"STATUS": STATUS, "EXTRA": ("accel_mps2",)}
    return assembler_of({name: FIELDS[name] for name in sample}, others, counter_states=counter_states)


def part(name: str, cycle: int, stamp_ns: int | None = None, *, valid: bool = True, frame: int = 1) -> DecodedMessage:
    """One message of a cycle; the cycle can be read off its values."""
    mark = float(cycle)
    values = {"POSE": (mark, mark, frame, valid), "MOTION": (mark,) * 3, "CHASSIS": (mark,) * 3}[name]
    return DecodedMessage(name, ms(10) * cycle if stamp_ns is None else stamp_ns, cycle % 15, values)


def status(stamp_ns: int = 0, mode: int = 1, rear: float = 0.0, torque: float = 0.0) -> DecodedMessage:
    return DecodedMessage("STATUS", stamp_ns, 0, (3, 1, mode, 0, torque, rear, 99))


def cycle_of(sample: Sample) -> int:
    """The one cycle that all its values are of."""
    s = sample.state
    marks = {s.x_m, s.y_m, s.heading_rad, s.speed_mps, s.yaw_rate_radps, s.accel_mps2, s.lateral_speed_mps}
    assert len(marks | {s.front_wheel_angle_rad}) == 1, "parts of different cycles were mixed"
    return int(s.x_m)


def taken(t: StateAssembler, parts: Iterable[DecodedMessage]) -> list[Sample]:
    return [sample for sample in map(t.take, parts) if sample is not None]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_a_sample_is_complete_with_its_last_message_in_any_order(order: tuple[int, ...]) -> None:
    t = assembler()
    first, second, last = (part(NAMES[i], 4, 100 + 10 * n) for n, i in enumerate(order))
    assert t.take(first) is None
    assert t.take(second) is None
    sample = t.take(last)
    assert sample is not None
    assert sample is t.newest
    assert (sample.state.stamp_ns, sample.completed_ns, sample.counter) == (100, 120, 4)
    assert (sample.state.frame_id, sample.pose_valid) == ("map", True)
    assert (t.completed, t.incomplete) == (1, 0)


def test_messages_of_different_counters_are_no_sample() -> None:
    t = assembler()
    assert taken(t, [part("POSE", 1), part("MOTION", 2), part("CHASSIS", 3)]) == []


def test_a_late_chassis_of_the_previous_counter_still_completes_that_sample() -> None:
    t = assembler()
    parts = [part("POSE", 1), part("MOTION", 1), part("POSE", 2), part("CHASSIS", 1, ms(21)), part("MOTION", 2)]
    assert [cycle_of(sample) for sample in taken(t, [*parts, part("CHASSIS", 2)])] == [1, 2]


@pytest.mark.parametrize(("late_ns", "completes"), [(WINDOW_NS, True), (WINDOW_NS + 1, False)])
def test_the_window_ends_to_the_nanosecond(late_ns: int, completes: bool) -> None:
    t = assembler()
    parts = [part("POSE", 1, 1000), part("MOTION", 1, 1000), part("CHASSIS", 1, 1000 + late_ns)]
    assert bool(taken(t, parts)) is completes
    assert t.incomplete == (0 if completes else 1)


def test_a_counter_that_comes_round_again_does_not_meet_its_last_round() -> None:
    t = assembler()
    assert taken(t, [part("POSE", 3), part("MOTION", 3)]) == []
    assert taken(t, [part("CHASSIS", 18)]) == []
    assert [cycle_of(sample) for sample in taken(t, [part("POSE", 18), part("MOTION", 18)])] == [18]
    assert t.incomplete == 1


def test_every_cycle_of_a_whole_stream_is_taken_once_through_the_counters_wrap() -> None:
    t = assembler()
    samples = taken(t, [part(name, cycle) for cycle in range(100) for name in NAMES])
    assert [cycle_of(sample) for sample in samples] == list(range(100))
    assert (t.completed, t.incomplete, t.repeated) == (100, 0, 0)


def test_the_same_messages_again_are_not_a_second_sample() -> None:
    t = assembler()
    once = [part(name, 5, ms(50)) for name in NAMES]
    again = [part(name, 5, ms(51)) for name in NAMES]
    assert len(taken(t, once + again + again)) == 1
    assert (t.completed, t.incomplete, t.repeated) == (1, 0, 6)


def test_a_message_repeated_before_its_sample_is_complete_counts_once() -> None:
    t = assembler()
    assert taken(t, [part("POSE", 5), part("POSE", 5), part("POSE", 5), part("MOTION", 5)]) == []


def test_without_counters_every_cycle_is_assembled() -> None:
    t = assembler()
    parts = [part(name, cycle) for cycle in range(20) for name in NAMES]
    plain = [DecodedMessage(p.name, p.stamp_ns, -1, p.values) for p in parts]
    assert [cycle_of(sample) for sample in taken(t, plain)] == list(range(20))


@st.composite
def arrivals(draw: st.DrawFn, latest_ns: int) -> list[DecodedMessage]:
    """A stream in which each message is lost, comes once or comes twice, each time up to so late."""
    stream: list[tuple[int, int, DecodedMessage]] = []
    for cycle in range(draw(st.integers(1, 40))):
        for number, name in enumerate(NAMES):
            for late_ns in draw(st.lists(st.integers(0, latest_ns), max_size=2)):
                stamp_ns = ms(10) * cycle + late_ns
                stream.append((stamp_ns, number, part(name, cycle, stamp_ns)))
    return [received for _, _, received in sorted(stream, key=lambda arrival: arrival[:2])]


@settings(max_examples=200, deadline=None)
@given(arrivals(latest_ns=ms(99)))
def test_no_sample_mixes_cycles_with_lost_repeated_or_late_messages(stream: list[DecodedMessage]) -> None:
    """Later than a round of the counter less the window nothing could be told apart; E2E drops that before."""
    for sample in taken(assembler(), stream):
        assert cycle_of(sample) % 15 == sample.counter
        assert 0 <= sample.completed_ns - sample.state.stamp_ns <= WINDOW_NS


@settings(max_examples=200, deadline=None)
@given(arrivals(latest_ns=ms(50)))
def test_no_sample_is_completed_twice_with_lost_repeated_or_late_messages(stream: list[DecodedMessage]) -> None:
    t = assembler()
    cycles = [cycle_of(sample) for sample in taken(t, stream)]
    assert len(set(cycles)) == len(cycles)
    assert t.completed == len(cycles)


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, 14), st.integers(0, ms(400))), max_size=60))
def test_any_messages_in_any_order_are_put_together_only_with_their_own_counter(
    messages: list[tuple[str, int, int]],
) -> None:
    t = assembler()
    for name, counter, stamp_ns in messages:
        sample = t.take(part(name, counter, stamp_ns))
        assert sample is None or (cycle_of(sample) == counter and sample.counter == counter)
        assert len(t._pending) <= 15


def test_after_forgetting_nothing_from_before_is_combined_with_anything_after() -> None:
    t = assembler()
    taken(t, [status(rear=0.25), *(part(name, 4) for name in NAMES), part("POSE", 5), part("MOTION", 5)])
    assert t.newest is not None
    t.reset()
    remembered: list[object] = [t.newest, t.status]
    assert remembered == [None, None]
    assert t.take(part("CHASSIS", 5)) is None
    samples = taken(t, [part(name, 6) for name in NAMES])
    assert [(sample.state.rear_wheel_angle_rad, sample.others_fresh) for sample in samples] == [(0.0, False)]
    assert (t.completed, t.incomplete) == (2, 0)


def test_a_sample_may_follow_at_once_after_forgetting_one_of_its_counter() -> None:
    t = assembler()
    assert len(taken(t, [part(name, 4) for name in NAMES])) == 1
    t.reset()
    assert len(taken(t, [part(name, 4) for name in NAMES])) == 1


def test_after_a_reset_every_branch_of_a_multiplexed_message_is_needed_again() -> None:
    others = {"STATUS": STATUS, "EXTRA": ("accel_mps2", "lateral_speed_mps")}
    t = assembler_of({name: FIELDS[name] for name in NAMES}, others)
    branches = [DecodedMessage("EXTRA", 0, 0, (1.0, None)), DecodedMessage("EXTRA", 0, 1, (None, 2.0))]
    before = taken(t, [status(), *branches, *(part(name, 1) for name in NAMES)])
    t.reset()
    after = taken(t, [status(), branches[0], *(part(name, 2) for name in NAMES)])
    assert [sample.others_fresh for sample in (*before, *after)] == [True, False]


def test_a_sample_does_not_need_a_value_of_another_message_that_its_sender_may_leave_out() -> None:
    t = assembler_of({name: FIELDS[name] for name in NAMES}, {"STATUS": STATUS}, omissible=("gear",))
    assert len(taken(t, [part(name, 1) for name in NAMES])) == 1


def test_the_newest_values_of_other_messages_go_into_the_samples_after_them() -> None:
    t = assembler()
    samples = taken(
        t,
        [
            *(part(name, 1) for name in NAMES),
            status(rear=0.1),
            status(rear=0.2),
            *(part(name, 2) for name in NAMES),
            *(part(name, 3) for name in NAMES),
        ],
    )
    assert [sample.state.rear_wheel_angle_rad for sample in samples] == [0.0, 0.2, 0.2]


def test_a_value_in_the_sample_itself_is_not_overridden_by_another_message() -> None:
    t = assembler()
    samples = taken(t, [DecodedMessage("EXTRA", 0, 0, (9.0,)), *(part(name, 1) for name in NAMES)])
    assert samples[0].state.accel_mps2 == 1.0


def test_another_multiplexer_branch_leaves_the_newest_value_in_force() -> None:
    t = assembler(sample=("POSE", "MOTION"))
    extra = [DecodedMessage("EXTRA", 0, 0, (2.5,)), DecodedMessage("EXTRA", 1, 1, (None,))]
    samples = taken(t, [*extra, part("POSE", 1), part("MOTION", 1)])
    assert [sample.state.accel_mps2 for sample in samples] == [2.5]


def extra(stamp_ns: int) -> DecodedMessage:
    return DecodedMessage("EXTRA", stamp_ns, 0, (1.0,))


@pytest.mark.parametrize("came", [[], [status(ms(100))], [extra(ms(100))]])
def test_a_sample_is_marked_until_every_message_outside_it_was_received(
    came: list[DecodedMessage],
) -> None:
    t = assembler()
    samples = taken(t, [*came, *(part(name, 10) for name in NAMES)])
    assert [(sample.others_fresh, sample.state.rear_wheel_angle_rad) for sample in samples] == [(False, 0.0)]
    assert (t.completed, t.incomplete) == (1, 0)


@pytest.mark.parametrize(("age_ns", "fresh"), [(-ms(5), True), (0, True), (STALE_NS, True), (STALE_NS + 1, False)])
@pytest.mark.parametrize("old", [status, extra])
def test_a_message_outside_the_sample_is_stale_to_the_nanosecond(
    old: Callable[[int], DecodedMessage], age_ns: int, fresh: bool
) -> None:
    t = assembler()
    sample_ns = ms(1000)
    newer = extra if old is status else status
    samples = taken(t, [old(sample_ns - age_ns), newer(sample_ns), *(part(name, 3, sample_ns) for name in NAMES)])
    assert [sample.others_fresh for sample in samples] == [fresh]


def test_a_vehicle_with_nothing_outside_the_sample_but_its_mode_needs_no_more_than_that() -> None:
    t = assembler_of(
        sample={"POSE": ("x_m", "y_m", "heading_rad", "speed_mps")},
        others={"MODE": ("mode",)},
        frames={0: "map"},
    )
    t.take(DecodedMessage("MODE", 5, 0, (2,)))
    sample = t.take(DecodedMessage("POSE", 8, 0, (1.0, 2.0, 3.0, 4.0)))
    assert sample is not None
    assert sample.others_fresh


def test_an_unreported_gear_is_no_gear() -> None:
    t = assembler_of(
        sample={},
        others={"MODE": ("mode",), "LEVER": ("gear",)},
        frames={0: "map"},
    )
    for lever, gear in (([], None), ([DecodedMessage("LEVER", 6, 0, (1,))], Gear.REVERSE)):
        taken(t, [*lever, DecodedMessage("MODE", 7, 0, (2,))])
        assert t.status is not None
        assert t.status.gear is gear


def test_a_sample_message_in_another_multiplexer_branch_is_no_sample() -> None:
    t = assembler()
    assert taken(t, [part("POSE", 1), part("MOTION", 1), DecodedMessage("CHASSIS", 0, 1, (1.0, None, 1.0))]) == []
    assert (t.completed, t.incomplete, t.newest) == (0, 1, None)


def test_a_message_of_the_sample_may_have_the_status_too() -> None:
    poses = {name: FIELDS[name] for name in ("POSE", "MOTION")}
    t = assembler_of({**poses, "MODE": ("mode", "gear")}, {}, counter_states=15)
    samples = taken(t, [DecodedMessage("MODE", ms(9), 1, (2, 1)), part("POSE", 1), part("MOTION", 1)])
    assert [sample.counter for sample in samples] == [1]
    assert t.status is not None
    assert (t.status.stamp_ns, t.status.mode, t.status.gear) == (ms(9), VehicleMode.AUTONOMOUS, Gear.REVERSE)


def test_a_multiplexed_message_of_the_sample_keeps_the_values_of_its_other_branch() -> None:
    sample = {"POSE": FIELDS["POSE"], "MOTION": FIELDS["MOTION"], "EXTRA": ("accel_mps2", "lateral_speed_mps")}
    t = assembler_of(sample, {"MODE": ("mode",)}, counter_states=15)
    first, second = DecodedMessage("EXTRA", ms(9), 1, (2.5, None)), DecodedMessage("EXTRA", ms(19), 2, (None, 0.25))
    samples = taken(t, [first, part("POSE", 1), part("MOTION", 1), second, part("POSE", 2), part("MOTION", 2)])
    values = [(sample.state.accel_mps2, sample.state.lateral_speed_mps) for sample in samples]
    assert values == [(2.5, 0.0), (2.5, 0.25)]


@pytest.mark.parametrize("mode", list(VehicleMode))
def test_the_status_has_the_values_of_the_message(mode: VehicleMode) -> None:
    t = assembler()
    assert t.take(status(77, mode=mode, torque=-2.5)) is None
    assert t.status is not None
    assert (t.status.stamp_ns, t.status.mode, t.status.gear) == (77, mode, Gear.DRIVE)
    assert (t.status.driver_brake, t.status.driver_throttle) == (True, False)
    assert t.status.driver_steer_torque_nm == -2.5


def test_fields_of_the_status_may_come_in_a_message_of_their_own() -> None:
    t = assembler_of(
        sample={"POSE": ("x_m", "y_m", "heading_rad", "speed_mps")},
        others={"MODE": ("mode",), "BRAKES": ("driver_brake", "gear")},
        frames={0: "map"},
    )
    t.take(DecodedMessage("BRAKES", 5, 0, (1, 3)))
    t.take(DecodedMessage("MODE", 7, 0, (2,)))
    sample = t.take(DecodedMessage("POSE", 8, 0, (1.0, 2.0, 3.0, 4.0)))
    assert sample is not None
    assert t.status is not None
    assert (t.status.stamp_ns, t.status.mode, t.status.driver_brake) == (7, VehicleMode.AUTONOMOUS, True)
    assert t.status.gear is Gear.DRIVE


def test_a_status_message_in_a_branch_without_the_mode_is_no_status() -> None:
    t = assembler()
    t.take(DecodedMessage("STATUS", 9, 0, (3, 1, None, 0, 0.0, 0.25, 0)))
    assert t.status is None


@pytest.mark.parametrize(("number", "name"), [(0, "odom"), (1, "map")])
@pytest.mark.parametrize("valid", [True, False])
def test_frame_and_validity_are_the_poses_own(number: int, name: str, valid: bool) -> None:
    t = assembler()
    pose = part("POSE", 1, frame=number, valid=valid)
    samples = taken(t, [pose, part("MOTION", 1), part("CHASSIS", 1)])
    assert [(sample.state.frame_id, sample.pose_valid) for sample in samples] == [(name, valid)]


def test_messages_that_are_not_asked_for_are_passed_over() -> None:
    t = assembler()
    assert t.take(DecodedMessage("RADIO", 0, 0, (1.0,))) is None
    assert (t.status, t.newest) == (None, None)


def test_the_reference_vehicles_assembler_puts_its_three_messages_together() -> None:
    t = build_state_assembler(reference())
    for message in reference().sample:
        values = tuple(1 if field == "pose_frame" else 0.0 for field in message.fields)
        sample = t.take(DecodedMessage(message.name, 5, 3, values))
    assert sample is not None
    assert sample.state.frame_id == "map"


@pytest.mark.parametrize(("age_ms", "is_fresh"), [(0, True), (100, True), (100.001, False)])
def test_the_reference_vehicles_status_is_stale_after_100_ms(age_ms: float, is_fresh: bool) -> None:
    t, now_ns = build_state_assembler(reference()), ms(1000)
    words = {"mode": int(VehicleMode.READY), "gear": int(Gear.PARK)}
    values = tuple(words.get(field, 0) for field in reference().status[0].fields)
    t.take(DecodedMessage(reference().status[0].name, now_ns - ms(age_ms), 3, values))
    for message in reference().sample:
        numbers = tuple(1 if field == "pose_frame" else 0.0 for field in message.fields)
        sample = t.take(DecodedMessage(message.name, now_ns, 3, numbers))
    assert sample is not None
    assert sample.others_fresh is is_fresh


@pytest.mark.parametrize("period_ms", [1, 2, 5, 10])
def test_a_fast_counter_wraps_often_and_its_cycles_are_distinguished(period_ms: int) -> None:
    profile = reference().profile
    timing = msgspec.structs.replace(profile.timing, sample_period_s=period_ms * 1e-3)
    fast = replace(reference(), profile=msgspec.structs.replace(profile, timing=timing))
    t = build_state_assembler(fast)
    samples = 0
    for cycle in range(100):
        for message in fast.sample:
            if cycle == 20 and message.name == "POSE":
                continue  # lost: what came with it waits for nobody
            values = tuple(1 if field == "pose_frame" else float(cycle) for field in message.fields)
            sample = t.take(DecodedMessage(message.name, ms(period_ms) * cycle, cycle % 15, values))
            if sample is not None:
                assert cycle_of(sample) == cycle
                samples += 1
    assert samples == 99
    assert (t.incomplete, t.repeated) == (1, 0)


def plain_assembler(**others: tuple[str, ...]) -> StateAssembler:
    """Of a vehicle that says nothing of frames and of how good its pose is."""
    return assembler_of({"POSE": ("x_m", "y_m"), "MOTION": ("heading_rad", "speed_mps")}, others, frames={1: "map"})


def pair(stamp_ns: int) -> list[DecodedMessage]:
    return [DecodedMessage(name, stamp_ns, 1, (1.0, 2.0)) for name in ("POSE", "MOTION")]


def test_driver_actions_without_a_signal_count_as_inactive() -> None:
    t = plain_assembler(STATUS=("mode",))
    t.take(DecodedMessage("STATUS", 5, 0, (1,)))
    assert t.status is not None
    assert (t.status.stamp_ns, t.status.mode, t.status.gear) == (5, VehicleMode.READY, None)
    assert (t.status.driver_brake, t.status.driver_throttle, t.status.driver_steer_torque_nm) == (False, False, 0.0)
    assert t.status.fault_code == 0


def test_a_pose_without_a_validity_signal_counts_as_valid() -> None:
    (sample,) = taken(plain_assembler(), pair(0))
    assert sample.pose_valid is True


def test_a_fault_code_belongs_to_the_status_and_not_to_the_state() -> None:
    t = plain_assembler(STATUS=("mode", "fault_code"))
    t.take(DecodedMessage("STATUS", 0, 0, (1, 7)))
    assert t.status is not None
    assert t.status.fault_code == 7
    assert len(taken(t, pair(0))) == 1


def test_after_a_reset_no_field_is_left_and_no_message_counts_as_received() -> None:
    t = plain_assembler(STATUS=("mode",), HANDS=("driver_steer_torque_nm", "gear"))
    t.take(DecodedMessage("HANDS", 0, 0, (2.5, int(Gear.DRIVE))))
    t.take(DecodedMessage("STATUS", 0, 0, (1,)))
    assert t.status is not None
    assert (t.status.driver_steer_torque_nm, t.status.gear) == (2.5, Gear.DRIVE)
    assert [sample.others_fresh for sample in taken(t, pair(ms(1)))] == [True]
    t.reset()
    assert [sample.others_fresh for sample in taken(t, pair(ms(2)))] == [False]
    t.take(DecodedMessage("STATUS", ms(2), 0, (1,)))
    assert t.status is not None
    assert (t.status.driver_steer_torque_nm, t.status.gear) == (0.0, None)


@pytest.mark.parametrize("values", [(1.0, 1.0, None, True), (1.0, 1.0, 1, None), (None, 1.0, 1, True)])
def test_a_sample_with_any_value_missing_is_incomplete(values: tuple[float | None, ...]) -> None:
    t = assembler()
    assert taken(t, [DecodedMessage("POSE", ms(10), 1, values), part("MOTION", 1), part("CHASSIS", 1)]) == []
    assert (t.completed, t.incomplete) == (0, 1)


@pytest.mark.parametrize("second_ns", [ms(10), ms(40)])
def test_a_younger_sample_in_its_window_is_kept_when_an_older_one_is_dropped(second_ns: int) -> None:
    t = assembler()
    parts = [part(name, cycle, at_ns) for cycle, at_ns in ((1, 0), (2, second_ns)) for name in ("POSE", "MOTION")]
    assert taken(t, parts) == []
    assert [cycle_of(sample) for sample in taken(t, [part("CHASSIS", 2, WINDOW_NS + ms(10))])] == [2]
    assert t.incomplete == 1


@pytest.mark.parametrize("second_ns", [ms(10), ms(40)])
def test_an_old_counter_may_be_completed_again_and_a_younger_one_in_its_window_may_not(second_ns: int) -> None:
    t = assembler()
    assert len(taken(t, [part(name, 1, 0) for name in NAMES])) == 1
    assert len(taken(t, [part(name, 2, second_ns) for name in NAMES])) == 1
    assert taken(t, [part("CHASSIS", 2, WINDOW_NS + ms(10))]) == []
    assert t.repeated == 1


FAST_NS = ms(0.7)
"""Samples that were held up come as fast as the bus carries them: two rounds of the counter within the window."""


def test_a_counter_that_comes_round_fast_is_a_new_sample() -> None:
    t = assembler(counter_states=15)
    parts = [part(name, cycle, FAST_NS * cycle) for cycle in range(60) for name in NAMES]
    assert [cycle_of(sample) for sample in taken(t, parts)] == list(range(60))
    assert (t.incomplete, t.repeated) == (0, 0)


@pytest.mark.parametrize("states", [14, 15])
@pytest.mark.parametrize("ahead", range(15))
def test_a_counter_up_to_half_a_round_ahead_of_the_newest_is_a_new_sample_and_any_other_a_repeated_one(
    ahead: int, states: int
) -> None:
    t = assembler(counter_states=states)
    for counter in (*range(1, states), 0):
        assert len(taken(t, [part(name, counter, 0) for name in NAMES])) == 1
    again = taken(t, [part(name, ahead % states, 1) for name in NAMES])
    assert len(again) == (1 <= ahead % states <= 7)
    assert t.repeated == (0 if again else 3)


@pytest.mark.parametrize("states", [14, 15])
@pytest.mark.parametrize("behind", range(1, 14))
def test_parts_four_samples_to_half_a_round_behind_are_given_up_for_a_new_sample(behind: int, states: int) -> None:
    """Those further behind are ahead."""
    t = assembler(counter_states=states)
    assert taken(t, [part(name, 0, 0) for name in NAMES[:2]]) == []
    assert taken(t, [part("POSE", behind, 1)]) == []
    is_given_up = 4 <= behind <= 7
    assert t.incomplete == is_given_up
    assert len(taken(t, [part("CHASSIS", 0, 2)])) == (not is_given_up)


def test_a_counter_that_came_round_does_not_keep_older_ones_from_coming_again() -> None:
    t = assembler(counter_states=15)
    for counter, stamp_ns in ((0, 0), (14, 0), (0, ms(40))):
        assert len(taken(t, [part(name, counter, stamp_ns) for name in NAMES])) == 1
    assert len(taken(t, [part(name, 14, WINDOW_NS + 1) for name in NAMES])) == 1
    assert t.repeated == 0


def test_a_message_that_comes_twice_is_repeated_also_where_counters_come_round_fast() -> None:
    t = assembler(counter_states=15)
    parts = [part(name, cycle, FAST_NS * cycle) for cycle in range(30) for name in (*NAMES, "POSE")]
    assert [cycle_of(sample) for sample in taken(t, parts)] == list(range(30))
    assert t.repeated == 30


@given(st.sets(st.tuples(st.integers(0, 59), st.sampled_from(NAMES)), max_size=40))
def test_parts_of_an_earlier_round_are_not_met_however_fast_the_counter_comes_round(
    lost: set[tuple[int, str]],
) -> None:
    """At most two samples in a row are incomplete: a greater step of a counter is dropped before it gets here."""
    t, kept = assembler(counter_states=15), set(lost)
    for cycle in range(60):
        if all(any(one == cycle - back for one, _ in kept) for back in range(3)):
            kept = {(one, name) for one, name in kept if one != cycle}
    parts = [part(n, cycle, FAST_NS * cycle) for cycle in range(60) for n in NAMES if (cycle, n) not in kept]
    whole = [cycle for cycle in range(60) if not any(one == cycle for one, _ in kept)]
    assert [cycle_of(sample) for sample in taken(t, parts)] == whole


def test_parts_that_are_late_by_up_to_three_samples_are_still_put_together() -> None:
    t = assembler(counter_states=15)
    early = [part(name, cycle) for cycle in range(4) for name in NAMES[:2]]
    late = [part(NAMES[2], cycle, ms(35)) for cycle in range(4)]
    assert [cycle_of(sample) for sample in taken(t, [*early, *late])] == [0, 1, 2, 3]
    assert t.incomplete == 0


def test_parts_that_are_later_are_dropped_and_counted() -> None:
    t = assembler(counter_states=15)
    early = [part(name, cycle, FAST_NS * cycle) for cycle in range(5) for name in NAMES[:2]]
    late = part(NAMES[2], 0, FAST_NS * 5)
    assert taken(t, [*early, late]) == []
    assert t.incomplete == 1
