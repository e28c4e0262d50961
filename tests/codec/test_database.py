"""A DBC and its profile are bound: each signal to its field, each message to its role."""

import math

import msgspec

from vehicle_iface.codec.binding import Role
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.state import VehicleState

from .conftest import Variant


def test_the_reference_vehicle_is_bound(database: VehicleDatabase) -> None:
    assert [message.name for message in database.sample] == ["POSE", "MOTION", "CHASSIS"]
    assert [message.name for message in database.status] == ["VEHICLE_STATUS"]
    assert database.auxiliary == ()
    assert [message.name for message in database.commands] == ["DRIVE_COMMAND", "STEER_COMMAND"]
    assert database.body is not None
    assert database.report is not None
    assert (database.body.name, database.report.name) == ("BODY_COMMAND", "CONTROLLER_STATUS")
    assert [message.role for message in database.sent] == [Role.COMMAND, Role.COMMAND, Role.BODY, Role.REPORT]
    assert database.frames == {0: "odom", 1: "map"}


def test_every_number_of_the_state_has_a_signal(database: VehicleDatabase) -> None:
    bound = {field for message in database.received for field in message.fields}
    wanted = set(VehicleState.__dataclass_fields__) - {"stamp_ns", "frame_id"}
    assert wanted | {"pose_frame", "pose_valid"} <= bound


def test_fields_stand_at_their_values_and_nothing_else_is_decoded(database: VehicleDatabase) -> None:
    motion = database.sample[1]
    assert motion.codec.names == ("HEADING", "SPEED", "YAW_RATE")
    assert motion.fields == ("heading_rad", "speed_mps", "yaw_rate_radps")


def test_the_resolution_is_the_commands_step_on_the_wire(database: VehicleDatabase) -> None:
    assert database.resolutions["accel_mps2"] == 0.001
    assert database.resolutions["front_wheel_angle_rad"] == 0.0001
    assert database.resolutions["enable"] == 1
    assert "torque_nm" not in database.resolutions


def test_a_vehicle_without_optional_parts_is_bound(variant: Variant) -> None:
    database = variant(
        toml=(
            ('rear_wheel_angle_rad = "STEER_COMMAND.REAR_WHEEL_ANGLE_REQUEST"\n', ""),
            ('lateral_speed_mps = "CHASSIS.LATERAL_SPEED"\n', ""),
            ('fault_code = "VEHICLE_STATUS.FAULT_CODE"\n', ""),
            ("ignored = []", 'ignored = ["CHASSIS.LATERAL_SPEED", "VEHICLE_STATUS.FAULT_CODE"]'),
            ("constants = {}", 'constants = {"STEER_COMMAND.REAR_WHEEL_ANGLE_REQUEST" = 0.0}'),
            ('name = "reference"', 'name = "small"'),
        )
    )
    assert "rear_wheel_angle_rad" not in database.resolutions
    assert database.profile.name == "small"


def test_state_fields_may_come_from_a_message_of_their_own(variant: Variant) -> None:
    database = variant(
        dbc=(
            ("BO_ 384 CONTROLLER_STATUS", 'BO_ 259 REAR: 8 VEHICLE\n SG_ CRC : 0|8@1+ (1,0) [0|255] "" CONTROLLER\n'
             ' SG_ COUNTER : 8|4@1+ (1,0) [0|14] "" CONTROLLER\n'
             ' SG_ ANGLE : 16|16@1- (0.0001,0) [-1|1] "rad" CONTROLLER\n\nBO_ 384 CONTROLLER_STATUS'),
        ),
        toml=(
            ("VEHICLE_STATUS.REAR_WHEEL_ANGLE", "REAR.ANGLE"),
            ("ignored = []", 'ignored = ["VEHICLE_STATUS.REAR_WHEEL_ANGLE"]'),
            ("CHASSIS = 0x112", "CHASSIS = 0x112\nREAR = 0x103"),
        ),
    )  # fmt: skip
    assert [message.name for message in database.auxiliary] == ["REAR"]
    assert database.auxiliary[0].fields == ("rear_wheel_angle_rad",)


def test_the_limits_are_finite_and_within_the_range_of_the_signal(database: VehicleDatabase) -> None:
    limits = database.profile.limits
    numbers = [number for number in msgspec.structs.astuple(limits) if isinstance(number, float)]
    assert len(numbers) >= 13
    assert all(map(math.isfinite, numbers))
