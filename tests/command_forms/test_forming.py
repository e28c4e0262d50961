"""Laws of what is sent for a permitted command: finite, in range, within the limits, never both pedals."""

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.harness import reference
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.command import SafeCommand, WireCommand
from vehicle_iface.command_forms import CommandFormer, CommandReader, MeasuredMotion, build_former
from vehicle_iface.command_forms.speed_target import HORIZON_S
from vehicle_iface.reason import Reason
from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_MS, NS_PER_S

from .vehicles import CURVATURE, DRIVE_AND_BRAKE, PEDALS, ROVER, TWIST, load_vehicle

STEP_NS = 20 * NS_PER_MS
FEEDBACK = ("[4.0, 60.0]]", "[4.0, 60.0]]\nfeedback = { kp = 2.0, ki = 5.0 }")
MEASURED = ('speed_mps = "POSE.V"', 'speed_mps = "POSE.V"\naccel_mps2 = "POSE.X"')
KINDS = {"speed": ROVER, "pedals": PEDALS, "drive": DRIVE_AND_BRAKE, "curvature": CURVATURE, "yaw_rate": TWIST}


@pytest.fixture(scope="module")
def databases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, VehicleDatabase]:
    folder = tmp_path_factory.mktemp("forms")
    unit = ('"POSE.X"\ny_m', '"POSE.X2"\ny_m')
    position = (' SG_ X : 0|16@1- (0.01,0) [-327|327] "m" PC', ' SG_ X2 : 0|12@1- (0.1,0) [-200|200] "m" PC\n'
                ' SG_ X : 12|4@1- (1,0) [-8|7] "m/s^2" PC')  # fmt: skip
    found = {name: load_vehicle(folder, kind) for name, kind in KINDS.items()}
    found["feedback"] = load_vehicle(folder, PEDALS, (unit, MEASURED, FEEDBACK), (position,))
    return found


def former_of(database: VehicleDatabase) -> CommandFormer:
    former = build_former(database.profile, database.command_ranges)
    assert former is not None
    return former


def permitted(
    accel_mps2: float = 0.0, *, stop: bool = False, angle_rad: float = 0.0, gear: Gear = Gear.NO_REQUEST
) -> SafeCommand:
    return SafeCommand(
        stamp_ns=0,
        enable=True,
        safe_stop=stop,
        accel_mps2=accel_mps2,
        front_wheel_angle_rad=angle_rad,
        rear_wheel_angle_rad=0.0,
        speed_mps=0.0,
        reason=Reason.STATE_STALE if stop else Reason.NOMINAL,
        gear_request=gear,
    )


def released() -> SafeCommand:
    return replace(permitted(), enable=False)


def moving(
    speed_mps: float, accel_mps2: float = 0.0, *, reversing: bool | None = None, engaging: bool = False
) -> MeasuredMotion:
    return MeasuredMotion(speed_mps, accel_mps2, speed_mps < 0.0 if reversing is None else reversing, engaging)


class Step(NamedTuple):
    accel_mps2: float
    angle_rad: float
    speed_mps: float
    measured_mps2: float
    stop: bool
    engaging: bool
    gear: Gear
    later_ms: int
    sent: bool


steps = st.lists(
    st.builds(
        Step,
        st.floats(-3.5, 3.5),
        st.floats(-0.5, 0.5),
        st.floats(-6.0, 6.0),
        st.floats(-20.0, 20.0),
        st.booleans(),
        st.booleans(),
        st.sampled_from([Gear.NO_REQUEST, Gear.DRIVE, Gear.REVERSE]),
        st.sampled_from([0, 1, 20, 5000]),
        st.booleans(),
    ),
    max_size=20,
)


@pytest.mark.parametrize("name", [*KINDS, "feedback"])
@given(steps=steps)
def test_every_permitted_command_can_be_encoded(
    databases: dict[str, VehicleDatabase], name: str, steps: list[Step]
) -> None:
    database = databases[name]
    former, limits, now_ns = former_of(database), database.profile.limits, 0
    for step in steps:
        now_ns += step.later_ms * NS_PER_MS
        command = permitted(step.accel_mps2, stop=step.stop, angle_rad=step.angle_rad, gear=step.gear)
        wire = former.form(command, moving(step.speed_mps, step.measured_mps2, engaging=step.engaging), now_ns)
        if step.sent:
            former.commit()
        assert all(math.isfinite(value) for value in wire)
        for field, (low, high, _) in database.command_ranges.items():
            assert low <= float(getattr(wire, field)) <= high, field
        assert min(wire.throttle, wire.brake) == 0.0
        assert min(wire.drive_mps2, wire.brake_mps2) == 0.0
        assert wire.drive_mps2 <= limits.accel_max_mps2
        assert abs(wire.speed_mps) <= limits.speed_max_mps
        assert wire.speed_mps * step.speed_mps >= 0.0
        if step.stop:
            assert wire.throttle == wire.drive_mps2 == 0.0
            assert abs(wire.speed_mps) <= abs(step.speed_mps)


@pytest.mark.parametrize("reversing", [False, True])
def test_pedals_follow_their_tables_and_rise_with_the_acceleration(
    databases: dict[str, VehicleDatabase], reversing: bool
) -> None:
    former, sign = former_of(databases["curvature"]), -1.0 if reversing else 1.0
    sizes = [index / 100 for index in range(-350, 201)]
    wires = [former.form(permitted(sign * size), moving(sign * 2.0), 0) for size in sizes]
    assert [wire.drive_mps2 - wire.brake_mps2 for wire in wires] == pytest.approx(sizes)
    if not reversing:
        former = former_of(databases["pedals"])
        pedals = [former.form(permitted(size), moving(2.0), 0) for size in sizes]
        differences = [wire.throttle - wire.brake for wire in pedals]
        assert all(before < after for before, after in itertools.pairwise(differences))
        assert former.form(permitted(1.5), moving(2.0), 0).throttle == pytest.approx(27.5)
        assert former.form(permitted(-2.0), moving(2.0), 0).brake == pytest.approx(30.0)


def test_nothing_drives_before_the_requested_gear_is_in(databases: dict[str, VehicleDatabase]) -> None:
    former = former_of(databases["curvature"])
    waiting = former.form(permitted(-1.0, gear=Gear.REVERSE), moving(0.0, reversing=True), 0)
    assert (waiting.drive_mps2, waiting.brake_mps2) == (0.0, 1.0)
    shifted = former.form(permitted(-1.0), moving(0.0, reversing=True), NS_PER_S)
    assert (shifted.drive_mps2, shifted.brake_mps2) == (1.0, 0.0)


def test_drive_rises_from_zero_at_the_profiles_rate_after_a_gear_change(
    databases: dict[str, VehicleDatabase],
) -> None:
    former = former_of(databases["curvature"])
    rate_mps3 = databases["curvature"].profile.limits.accel_rate_mps3
    former.form(permitted(1.0, gear=Gear.DRIVE), moving(0.0), 0)
    former.commit()
    sent = [
        former.form(permitted(1.0), moving(0.0), now_ns).drive_mps2 for now_ns in (STEP_NS, 2 * STEP_NS, 50 * STEP_NS)
    ]
    step_mps2 = rate_mps3 * STEP_NS / NS_PER_S
    assert sent == pytest.approx([min(1.0, step_mps2), min(1.0, 2 * step_mps2), 1.0])
    assert sent[0] < 1.0


def test_a_vehicle_that_rolls_back_is_braked_before_it_is_driven(databases: dict[str, VehicleDatabase]) -> None:
    pedals = former_of(databases["pedals"])
    assert pedals.form(permitted(1.0), moving(-0.3), 0).throttle == 0.0
    assert pedals.form(permitted(1.0), moving(-0.3), 0).brake == pytest.approx(15.0)
    speed = former_of(databases["speed"])
    speed.form(permitted(1.0), moving(0.1), 0)
    speed.commit()
    assert speed.form(permitted(1.0), moving(-0.3), STEP_NS).speed_mps == 0.0


class Driving:
    """One former in virtual time."""

    def __init__(self, database: VehicleDatabase) -> None:
        self.former = former_of(database)
        self.now_ns = 0

    def drive_s(
        self, seconds: float, accel_mps2: float, speed_mps: float, *, stop: bool = False, engaging: bool = False
    ) -> float:
        """The last speed after so long of one permission and one measured speed."""
        command, motion = permitted(accel_mps2, stop=stop), moving(speed_mps, engaging=engaging)
        for _ in range(round(seconds * 1e9) // STEP_NS):
            self.now_ns += STEP_NS
            wire = self.former.form(command, motion, self.now_ns)
            self.former.commit()
        return wire.speed_mps


def test_a_speed_is_integrated_from_the_measured_one(databases: dict[str, VehicleDatabase]) -> None:
    driving = Driving(databases["speed"])
    assert driving.drive_s(0.02, 1.0, 2.0) == 2.0
    assert driving.drive_s(0.3, 1.0, 2.0) == pytest.approx(2.3)
    assert driving.drive_s(0.3, 0.0, 2.0) == pytest.approx(2.3)


def test_a_speed_does_not_run_away_from_a_vehicle_that_does_not_follow(databases: dict[str, VehicleDatabase]) -> None:
    driving, limits = Driving(databases["speed"]), databases["speed"].profile.limits
    assert driving.drive_s(10.0, 1.0, 2.0) == pytest.approx(2.0 + limits.accel_max_mps2 * HORIZON_S)
    assert driving.drive_s(10.0, -1.0, 3.0) == pytest.approx(3.0 + limits.accel_min_mps2 * HORIZON_S)
    assert driving.drive_s(10.0, 1.0, 4.4) == limits.speed_max_mps


def test_a_braked_vehicle_that_becomes_faster_does_not_raise_its_commanded_speed(
    databases: dict[str, VehicleDatabase],
) -> None:
    driving = Driving(databases["speed"])
    sent = [driving.drive_s(0.02, -0.5, speed_mps) for speed_mps in (2.0, 3.0, 4.0, 5.0, 6.0)]
    assert sent == sorted(sent, reverse=True)
    assert driving.drive_s(0.02, 0.5, 6.0) == pytest.approx(sent[-1] + 0.02 * 0.5)


def test_a_stop_ramps_the_speed_to_zero_though_the_measured_one_is_old(databases: dict[str, VehicleDatabase]) -> None:
    driving = Driving(databases["speed"])
    assert driving.drive_s(1.0, 1.0, 3.0) > 3.5
    assert driving.drive_s(0.02, -3.0, 3.0, stop=True) == pytest.approx(3.0 - 0.02 * 3.0)
    assert driving.drive_s(0.5, -3.0, 3.0, stop=True) == pytest.approx(3.0 - 0.52 * 3.0)
    assert driving.drive_s(0.5, -3.0, 3.0, stop=True) == 0.0
    assert driving.drive_s(5.0, -0.5, 3.0, stop=True) == 0.0


def test_a_vehicle_that_does_not_obey_yet_is_sent_its_own_speed(databases: dict[str, VehicleDatabase]) -> None:
    driving = Driving(databases["speed"])
    driving.drive_s(1.0, 1.0, 3.0)
    assert driving.drive_s(1.0, 1.0, 1.0, engaging=True) == 1.0
    assert driving.drive_s(0.1, 1.0, 1.0) == pytest.approx(1.1)


def test_a_released_vehicle_is_asked_for_nothing_and_then_taken_over_as_it_is(
    databases: dict[str, VehicleDatabase],
) -> None:
    driving = Driving(databases["speed"])
    driving.drive_s(1.0, 1.0, 3.0)
    assert driving.former.form(released(), moving(3.0), driving.now_ns).speed_mps == 0.0
    driving.former.commit()
    assert driving.drive_s(0.02, 1.0, 1.5) == 1.5
    for name in ("pedals", "drive"):
        wire = former_of(databases[name]).form(released(), moving(3.0), 0)
        assert (wire.throttle, wire.brake, wire.drive_mps2, wire.brake_mps2) == (0.0, 0.0, 0.0, 0.0)


def test_the_speed_turns_over_only_at_standstill(databases: dict[str, VehicleDatabase]) -> None:
    former = former_of(databases["speed"])
    speeds_mps = []
    for step, (measured_mps, reversing) in enumerate(((0.3, False), (0.1, False), (0.0, True), (-0.02, True))):
        wire = former.form(permitted(-3.0), moving(measured_mps, reversing=reversing), step * 5 * STEP_NS)
        former.commit()
        speeds_mps.append(wire.speed_mps)
    assert speeds_mps == pytest.approx([0.3, 0.0, -0.3, -0.6])


def test_rates_are_not_limited_from_a_command_that_was_not_sent(databases: dict[str, VehicleDatabase]) -> None:
    former = former_of(databases["speed"])
    former.form(permitted(1.0), moving(2.0), 0)
    former.commit()
    for now_ns in range(STEP_NS, 6 * STEP_NS, STEP_NS):
        wire = former.form(permitted(1.0), moving(2.0), now_ns)
    assert wire.speed_mps == pytest.approx(2.0 + 5 * 0.02)
    assert former.commit_fields({"front_wheel_angle_rad"}) == {"front_wheel_angle_rad"}
    assert former.form(permitted(0.0), moving(2.0), 5 * STEP_NS).speed_mps == 2.0
    former.form(permitted(1.0), moving(2.0), 5 * STEP_NS)
    assert former.commit_fields({"speed_mps"}) == {"speed_mps", "accel_mps2"}
    assert former.form(permitted(0.0), moving(2.0), 5 * STEP_NS).speed_mps == pytest.approx(2.1)


def test_both_pedals_carry_an_acceleration_together(databases: dict[str, VehicleDatabase]) -> None:
    former = former_of(databases["pedals"])
    assert "accel_mps2" not in former.commit_fields({"throttle", "front_wheel_angle_rad"})
    assert "accel_mps2" in former.commit_fields({"throttle", "brake"})


def test_feedback_is_bounded_and_starts_again_after_a_stop(databases: dict[str, VehicleDatabase]) -> None:
    former = former_of(databases["feedback"])

    def pedals(accel_mps2: float, measured_mps2: float, now_s: float, *, stop: bool = False) -> WireCommand:
        wire = former.form(permitted(accel_mps2, stop=stop), moving(2.0, measured_mps2), round(now_s * 1e9))
        former.commit()
        return wire

    assert pedals(0.5, 0.5, 0.0).throttle == pytest.approx(7.5)
    for index in range(1, 50):
        most = pedals(0.5, -5.0, 0.1 * index).throttle
    assert most == pytest.approx(15.0 + 0.1 * 25.0)  # of 0.5 m/s² and 0.3 times the limit of 2 m/s²
    assert pedals(0.5, 0.5, 5.1).throttle == pytest.approx(17.5)
    assert pedals(-3.0, 0.5, 5.2, stop=True).brake == pytest.approx(45.0)
    assert pedals(0.5, 0.5, 5.3).throttle == pytest.approx(7.5)


@pytest.mark.parametrize("speed_mps", [-2.0, 0.0, 3.0])
@pytest.mark.parametrize("angle_rad", [-0.5, 0.0, 0.2])
def test_curvature_and_yaw_rate_are_those_of_the_wheels(
    databases: dict[str, VehicleDatabase], speed_mps: float, angle_rad: float
) -> None:
    command, wheelbase_m = permitted(angle_rad=angle_rad), 2.7
    bent = former_of(databases["curvature"]).form(command, moving(speed_mps), 0)
    assert bent.curvature_per_m == pytest.approx(math.tan(angle_rad) / wheelbase_m)
    turned = former_of(databases["yaw_rate"]).form(command, moving(speed_mps), 0)
    assert turned.yaw_rate_radps == pytest.approx(speed_mps * math.tan(angle_rad) / wheelbase_m)


@pytest.mark.parametrize("name", ["pedals", "drive", "curvature", "yaw_rate"])
@pytest.mark.parametrize("accel_mps2", [-2.5, -0.1, 0.0, 0.4, 1.9])
def test_a_reader_finds_what_was_permitted(databases: dict[str, VehicleDatabase], name: str, accel_mps2: float) -> None:
    database = databases[name]
    command = permitted(accel_mps2, angle_rad=0.3)
    wire = former_of(database).form(command, moving(2.0), 0)
    fields = {field: getattr(wire, field) for field in database.command_ranges}
    read = CommandReader(database.profile).read(fields, speed_mps=2.0, direction=1.0)
    assert read.front_wheel_angle_rad == pytest.approx(0.3)
    assert read.accel_mps2 == (None if name == "yaw_rate" else pytest.approx(accel_mps2))


def test_acceleration_and_wheel_angle_take_no_further_step() -> None:
    assert build_former(reference().profile, reference().command_ranges) is None
