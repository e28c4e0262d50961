"""The simulated vehicle's signals are understood as they were meant: whatever is written is read back."""

import itertools
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vehicles.files import load_text, load_vehicle
from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.database import VehicleDatabase, build_database
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.expressions import Place
from vehicle_iface.errors import ConfigError
from vehicle_iface.pose import Locator
from vehicle_iface.profile import Profile
from vehicle_iface.profile.forms import Condition, ConditionTable
from vehicle_iface.profile.signals import ModeConditions
from vehicle_iface.row import Row
from vehicle_iface.sim.condition_solver import Goal, holds, solve
from vehicle_iface.sim.report import VehicleReport
from vehicle_iface.sim.report_writer import ReportWriter
from vehicle_iface.status import Gear, VehicleMode

FLAGS_DBC = """
BO_ 272 POSE: 8 CAR
 SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC
 SG_ Y : 16|16@1- (0.01,0) [-327|327] "m" PC
 SG_ YAW : 32|16@1- (0.0001,0) [-3.2|3.2] "rad" PC
 SG_ V : 48|16@1- (0.01,0) [-50|50] "m/s" PC

BO_ 512 RPT: 4 CAR
 SG_ A : 0|1@1+ (1,0) [0|1] "" PC
 SG_ B : 1|1@1+ (1,0) [0|1] "" PC
 SG_ N : 2|3@1+ (1,0) [0|7] "" PC
 SG_ P : 5|3@1+ (1,0) [0|7] "" PC
 SG_ T : 8|8@1- (0.1,0) [-12|12] "N*m" PC
 SG_ CODE : 16|8@1+ (1,0) [0|255] "" PC

VAL_ 512 P 1 "LOW" 4 "HIGH" 6 "OFF" ;
"""
FLAGS = """
[signals."RPT.A"]
[state]
sample = ["POSE"]
[state.signals]
x_m = "POSE.X"
y_m = "POSE.Y"
heading_rad = "POSE.YAW"
speed_mps = "POSE.V"
[status.when]
"""
AUTONOMOUS = 'autonomous = { all = ["RPT.A", "RPT.B", "RPT.N", "RPT.P", "RPT.T"] }\n'
NAMES = ("RPT.A", "RPT.B", "RPT.N", "RPT.P", "RPT.T")
VALUES: dict[str, tuple[float, ...]] = {"RPT.A": (0, 1), "RPT.B": (0, 1), "RPT.N": tuple(range(8)), "RPT.P": (1, 4, 6)}
VALUES["RPT.T"] = tuple(raw * 0.1 for raw in (0, 1, 10, 11, 30, 31, 60, 61, -1, -10, -30, -31, -61))
LEAVES = st.one_of(
    st.sampled_from(NAMES),
    st.builds(ConditionTable, signal=st.just("RPT.N"), among=st.lists(st.integers(0, 7), max_size=3).map(tuple)),
    st.builds(ConditionTable, signal=st.just("RPT.P"), equals=st.sampled_from(["LOW", "HIGH", 6])),
    st.builds(ConditionTable, signal=st.sampled_from(["RPT.N", "RPT.T"]), above=st.sampled_from([1.0, 3.0, 6.0])),
    st.builds(ConditionTable, signal=st.just("RPT.T"), below=st.sampled_from([-3.0, 1.0]), magnitude=st.booleans()),
)
CONDITIONS: st.SearchStrategy[Condition] = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(ConditionTable, all=st.lists(inner, max_size=3).map(tuple)),
        st.builds(ConditionTable, any=st.lists(inner, max_size=3).map(tuple)),
        st.builds(ConditionTable, negated=inner),
    ),
    max_leaves=5,
)


def report(**values: Any) -> VehicleReport:
    """Of a vehicle that stands in MANUAL."""
    still = dict.fromkeys(("x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps"), 0.0)
    still |= dict.fromkeys(("lateral_speed_mps", "front_wheel_angle_rad", "rear_wheel_angle_rad"), 0.0)
    other = {"pose_frame": 0, "pose_valid": True, "mode": VehicleMode.MANUAL, "gear": Gear.DRIVE, "fault_code": 0}
    driver = {"driver_brake": False, "driver_throttle": False, "driver_steer_torque_nm": 0.0}
    return VehicleReport(**still | other | driver | values)


def row_of(database: VehicleDatabase, writer: ReportWriter, sent: VehicleReport, times: int = 1) -> Row:
    """What the other end has received when each message was sent so many times."""
    encoder, decoder = Encoder(database.received), Decoder(database.received)
    row: Row = list(database.row.empty)
    for message in [*database.received] * times:
        frame = encoder.encode_values(message.name, writer.values_of(message.name, sent))
        encoder.commit((frame,))
        received = decoder.decode(frame)
        assert received is not None, decoder.drops
        where = database.row.places[message.name]
        row[where] = [old if new is None else new for old, new in zip(row[where], received.values, strict=True)]
    return row


def writer_of(database: VehicleDatabase) -> ReportWriter:
    return ReportWriter(database, {}, override_torque_nm=3.0)


@cache
def flags(folder: Path) -> Profile:
    return load_text(f"{FLAGS}{AUTONOMOUS}", FLAGS_DBC, folder).profile


def with_modes(profile: Profile, when: ModeConditions) -> VehicleDatabase:
    status = msgspec.structs.replace(profile.status, when=when)
    file = read_dbc(Path(profile.dbc))
    return build_database(Binding(msgspec.structs.replace(profile, status=status), file))


def brute_force(goals: Sequence[Goal]) -> bool:
    """Whether any values at all meet the goals."""
    return any(
        all(holds(goal.condition, dict(zip(NAMES, values, strict=True)), place_of) is goal.wanted for goal in goals)
        for values in itertools.product(*(VALUES[name] for name in NAMES))
    )


def place_of(dotted: str) -> Place:
    return Place(0, {1: "LOW", 4: "HIGH", 6: "OFF"} if dotted == "RPT.P" else {})


@given(conditions=st.lists(st.builds(Goal, CONDITIONS, st.booleans()), min_size=1, max_size=4))
@settings(max_examples=150, deadline=None)
def test_values_are_found_exactly_where_there_are_some(conditions: list[Goal]) -> None:
    found = solve(conditions, VALUES, place_of)
    if found is None:
        assert not brute_force(conditions)
    else:
        values = {name: left[0] for name, left in found.items()}
        assert all(holds(goal.condition, values, place_of) is goal.wanted for goal in conditions)


@given(conditions=st.lists(st.one_of(st.none(), st.none(), CONDITIONS), min_size=5, max_size=5))
@settings(max_examples=80, deadline=None)
def test_each_mode_that_has_a_condition_is_read_as_itself(
    conditions: list[Condition | None], tmp_path_factory: pytest.TempPathFactory
) -> None:
    when = ModeConditions(**dict(zip(ModeConditions.__struct_fields__, conditions, strict=True)))
    database = with_modes(flags(tmp_path_factory.getbasetemp()), when)
    stated = {name: getattr(when, name) for name in when.__struct_fields__ if getattr(when, name) is not None}
    goals = {name: [Goal(one, other == name) for other, one in stated.items()] for name in stated}
    goals = {name: every[: list(stated).index(name) + 1] for name, every in goals.items()}
    impossible = {name for name, needed in goals.items() if not brute_force(needed)}
    try:
        writer = writer_of(database)
    except ConfigError as refused:
        named = {line.partition("$.status.when.")[2].partition(":")[0] for line in str(refused).splitlines()}
        assert named == impossible
        return
    assert not impossible
    for name in stated:
        mode = VehicleMode[name.upper()]
        row = row_of(database, writer, report(mode=mode))
        assert database.row.read_status(0, row).mode is mode


def test_a_mode_that_no_values_express_is_rejected_by_name(tmp_path: Path) -> None:
    text = f'{FLAGS}manual = "RPT.A"\nautonomous = {{ all = ["RPT.A", "RPT.B"] }}\n[status.driver]\n'
    database = load_text(
        f'{text}brake = {{ all = [{{ signal = "RPT.N", above = 5 }}, {{ signal = "RPT.N", below = 3 }}] }}\n',
        FLAGS_DBC,
        tmp_path,
    )
    with pytest.raises(ConfigError) as refused:
        writer_of(database)
    assert str(refused.value).splitlines() == [
        "v.toml: $.status.when.autonomous: no values of its signals make it true and those before it false",
        "v.toml: $.status.driver.brake: no values of its signals make it true",
    ]


STATE = {
    "x_m": st.floats(-300, 300),
    "y_m": st.floats(-300, 300),
    "heading_rad": st.floats(-math.pi, math.pi),
    "speed_mps": st.floats(0, 40),
    "yaw_rate_radps": st.floats(-3, 3),
    "front_wheel_angle_rad": st.floats(-0.6, 0.6),
}
NEAR = {"x_m": 0.012, "y_m": 0.012, "heading_rad": 2e-4, "speed_mps": 0.0101, "yaw_rate_radps": 1.01e-4}


@pytest.mark.parametrize("name", ["forms", "units", "wheels_and_fix", "multiplexed", "gears"])
def test_a_state_is_read_within_the_resolution_of_its_signals(name: str, tmp_path: Path) -> None:
    database = load_vehicle(name, tmp_path)
    writer, bound = writer_of(database), database.profile.state.signals

    @given(values=st.fixed_dictionaries(STATE))
    @settings(max_examples=50, deadline=None)
    def check(values: dict[str, float]) -> None:
        row = row_of(database, writer, report(**values), times=2)
        measured = database.row.read_state(0, row, Locator(database.profile).locate)
        assert measured is not None
        assert measured.pose_valid
        for field, near in NEAR.items():
            if field in ("x_m", "y_m", "heading_rad") or getattr(bound, field) is not None:
                error = getattr(measured.state, field) - values[field]
                error = math.remainder(error, math.tau) if field == "heading_rad" else error
                assert abs(error) < near, field
        if bound.front_wheel_angle_rad is not None:
            error = measured.state.front_wheel_angle_rad - values["front_wheel_angle_rad"]
            assert abs(error) <= math.radians(0.0501)

    check()


def test_modes_without_a_name_of_their_own_are_reported_by_the_nearest_one(tmp_path: Path) -> None:
    database = load_vehicle("forms", tmp_path)
    writer, read = writer_of(database), {}
    for mode in VehicleMode:
        row = row_of(database, writer, report(mode=mode, driver_brake=True))
        status = database.row.read_status(0, row)
        assert status.driver_brake
        read[mode] = status.mode
    assert read == {mode: mode for mode in VehicleMode} | {VehicleMode.EMERGENCY_STOP: VehicleMode.FAULT}


def test_a_fault_without_a_code_gets_one_where_no_other_signal_reports_it(tmp_path: Path) -> None:
    database = load_vehicle("fault_code", tmp_path)
    for mode, code, read in ((VehicleMode.FAULT, 0, 1), (VehicleMode.EMERGENCY_STOP, 300, 255)):
        row = row_of(database, writer_of(database), report(mode=mode, fault_code=code))
        status = database.row.read_status(0, row)
        assert (status.mode, status.fault_code) == (VehicleMode.FAULT, read)


def test_the_driver_comes_before_the_mode(tmp_path: Path) -> None:
    database = load_vehicle("flags", tmp_path)
    writer = writer_of(database)
    for driver in ({"driver_brake": True}, {"driver_steer_torque_nm": -4.0}):
        status = database.row.read_status(0, row_of(database, writer, report(mode=VehicleMode.READY, **driver)))
        assert (status.driver_brake, status.driver_steers) == ("driver_brake" in driver, "driver_brake" not in driver)
    assert status.mode is VehicleMode.READY
