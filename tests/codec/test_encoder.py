"""What goes out: the fields in their bits, counters that step once a frame, checksums; or an error and no step."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cantools
import pytest
from cantools.database.can import Database
from cantools.typechecking import SignalDictType
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.command import SafeCommand
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.profile import load_profile
from vehicle_iface.reason import Reason
from vehicle_iface.status import BodyRequest, ControllerReport, ControllerState, Gear, VehicleMode

from .conftest import DBC_FOLDER, Variant

DATABASE = load_database(load_profile("reference"))
COMMAND = SafeCommand(
    stamp_ns=1,
    enable=True,
    safe_stop=False,
    accel_mps2=1.5,
    front_wheel_angle_rad=-0.1,
    rear_wheel_angle_rad=0.0,
    speed_mps=3.0,
    reason=Reason.NOMINAL,
    gear_request=Gear.NO_REQUEST,
)


@dataclass
class Vehicle:
    """What a vehicle at the other end says, in the program's words."""

    x_m: float = 12.345
    y_m: float = -6.785
    heading_rad: float = 3.1415
    speed_mps: float = -2.5
    accel_mps2: float = 0.25
    yaw_rate_radps: float = -0.0642
    lateral_speed_mps: float = 0.125
    front_wheel_angle_rad: float = 0.3
    rear_wheel_angle_rad: float = 0.0
    pose_frame: int = 1
    pose_valid: bool = True
    mode: VehicleMode = VehicleMode.AUTONOMOUS
    gear: Gear = Gear.REVERSE
    driver_brake: bool = False
    driver_throttle: bool = True
    driver_steer_torque_nm: float = -2.9
    fault_code: int = 77


@pytest.fixture
def encoder() -> Encoder:
    return Encoder(DATABASE.sent)


@cache
def contract() -> Database:
    database = cantools.database.load_file(DBC_FOLDER / "reference.dbc")
    assert isinstance(database, Database)
    return database


def decoded(frame: CanFrame) -> SignalDictType:
    signals = contract().decode_message(frame.can_id, frame.data, decode_choices=False)
    assert isinstance(signals, dict)
    return signals


def test_a_command_is_one_frame_of_each_kind_as_the_contract_has_them(encoder: Encoder) -> None:
    drive, steer = encoder.encode_command(COMMAND)
    assert (drive.can_id, steer.can_id) == (0x80, 0x81)
    assert {k: v for k, v in decoded(drive).items() if k != "CRC"} == {
        "COUNTER": 0,
        "ENABLE": 1,
        "SAFE_STOP": 0,
        "ACCEL_REQUEST": 1.5,
        "SPEED_REQUEST": 3.0,
        "REASON": 0,
        "GEAR_REQUEST": 7,
    }
    assert decoded(steer)["ENABLE"] == 1
    assert decoded(steer)["FRONT_WHEEL_ANGLE_REQUEST"] == pytest.approx(-0.1)


def test_counters_start_at_zero_and_step_once_a_frame(encoder: Encoder) -> None:
    pairs = []
    for _ in range(17):
        pairs.append(encoder.encode_command(COMMAND))
        encoder.commit(pairs[-1])
    assert [drive.data[1] & 15 for drive, _ in pairs] == [*range(15), 0, 1]
    assert [steer.data[1] & 15 for _, steer in pairs] == [*range(15), 0, 1]
    assert encoder.encode("BODY_COMMAND", BodyRequest()).data[1] & 15 == 0


@pytest.mark.parametrize(
    ("field", "value", "signal"),
    [
        ("accel_mps2", float("nan"), "ACCEL_REQUEST"),
        ("accel_mps2", 20.1, "ACCEL_REQUEST"),
        ("speed_mps", float("inf"), "SPEED_REQUEST"),
        ("front_wheel_angle_rad", -1.1, "FRONT_WHEEL_ANGLE_REQUEST"),
        ("front_wheel_angle_rad", None, "FRONT_WHEEL_ANGLE_REQUEST"),
        ("reason", 18, "REASON"),
        ("gear_request", 5, "GEAR_REQUEST"),
    ],
)
def test_a_value_that_cannot_be_sent_raises_and_no_counter_steps(
    encoder: Encoder, field: str, value: Any, signal: str
) -> None:
    for _ in range(3):
        with pytest.raises(SignalError, match=rf"_COMMAND\.{signal}"):
            encoder.encode_command(replace(COMMAND, **{field: value}))
    assert [frame.data[1] & 15 for frame in encoder.encode_command(COMMAND)] == [0, 0]


def test_a_report_saturates_nothing_by_itself(encoder: Encoder) -> None:
    report = ControllerReport(
        state=ControllerState.SHADOW,
        reason=Reason.NOT_ENGAGED,
        ref_spatial_index=65535,
        ref_temporal_index=0,
        deadline_misses=255,
    )
    values = decoded(encoder.encode("CONTROLLER_STATUS", report))
    assert (values["STATE"], values["REASON"], values["REF_SPATIAL_INDEX"]) == (6, 17, 65535)
    with pytest.raises(SignalError, match=r"DEADLINE_MISSES = 256: must be in \[0, 255\]"):
        encoder.encode("CONTROLLER_STATUS", replace(report, deadline_misses=256))


def test_an_unknown_message_is_refused_with_the_known_ones(encoder: Encoder) -> None:
    with pytest.raises(ConfigError, match=r"no message 'HORN': must be one of DRIVE_COMMAND"):
        encoder.encode("HORN", BodyRequest())


def test_the_other_end_encodes_with_the_same_messages() -> None:
    encoder, decoder = Encoder(DATABASE.received), Decoder(DATABASE.received)
    vehicle = Vehicle()
    seen: dict[str, object] = {}
    for message in DATABASE.received:
        received = decoder.decode(encoder.encode(message.name, vehicle))
        assert received is not None
        seen |= dict(zip(message.fields, received.values, strict=True))
    for field, value in vars(vehicle).items():
        assert seen[field] == pytest.approx(float(value), abs=1e-9), field


def test_the_programs_numbers_become_the_vehicles_other_ones(variant: Variant) -> None:
    database = variant(
        dbc=(('0 "PARK" 1 "REVERSE" 2 "NEUTRAL" 3 "DRIVE" 7 "NO_REQUEST"', '1 "R" 2 "PARK" 3 "D" 0 "NO_REQUEST"'),),
        toml=(("[status.gears]", '[status.gears]\nD = "DRIVE"\nR = "REVERSE"'),),
    )
    encoder = Encoder(database.sent)
    for ours, on_bus in ((Gear.NO_REQUEST, 0), (Gear.DRIVE, 3), (Gear.REVERSE, 1), (Gear.PARK, 2)):
        drive, _ = encoder.encode_command(replace(COMMAND, gear_request=ours))
        assert drive.data[7] & 7 == on_bus
    with pytest.raises(SignalError, match="no number in the DBC's VAL_ table"):
        encoder.encode_command(replace(COMMAND, gear_request=Gear.NEUTRAL))


def test_unbound_signals_are_sent_as_their_constants(variant: Variant) -> None:
    database = variant(
        toml=(('horn = "BODY_COMMAND.HORN"\n', ""), ("constants = {}", 'constants = {"BODY_COMMAND.HORN" = 1}'))
    )
    frame = Encoder(database.sent).encode("BODY_COMMAND", BodyRequest(horn=False))
    assert decoded(frame)["HORN"] == 1


@given(
    accel=st.floats(-20, 20),
    angle=st.floats(-1, 1),
    speed=st.floats(-100, 100),
    reason=st.sampled_from(Reason),
    gear=st.sampled_from(Gear),
    enable=st.booleans(),
)
def test_a_command_arrives_within_half_a_step(
    accel: float, angle: float, speed: float, reason: Reason, gear: Gear, enable: bool
) -> None:
    command = replace(
        COMMAND,
        accel_mps2=accel,
        front_wheel_angle_rad=angle,
        speed_mps=speed,
        reason=reason,
        gear_request=gear,
        enable=enable,
    )
    decoder = Decoder(DATABASE.sent)
    seen: dict[str, Any] = {}
    for frame, message in zip(Encoder(DATABASE.sent).encode_command(command), DATABASE.commands, strict=True):
        received = decoder.decode(frame)
        assert received is not None
        seen |= dict(zip(message.fields, received.values, strict=True))
    for field in ("accel_mps2", "front_wheel_angle_rad", "speed_mps"):
        assert abs(seen[field] - getattr(command, field)) <= DATABASE.resolutions[field] * 0.5001
    assert (seen["reason"], seen["gear_request"], seen["enable"]) == (reason, gear, enable)


def test_it_lists_the_fields_that_a_frame_carries(database: VehicleDatabase) -> None:
    encoder = Encoder(database.sent)
    drive, steer = encoder.encode_command(COMMAND)
    assert encoder.fields_of(()) == set()
    assert {"accel_mps2", "enable", "reason"} <= encoder.fields_of([drive])
    assert "front_wheel_angle_rad" in encoder.fields_of([steer]) - encoder.fields_of([drive])
    assert encoder.fields_of([drive, steer]) == encoder.fields_of([drive]) | encoder.fields_of([steer])
    assert "" not in encoder.fields_of([drive, steer])


def test_a_frame_that_was_not_sent_steps_nothing(database: VehicleDatabase) -> None:
    encoder = Encoder(database.sent)
    drive, steer = encoder.encode_command(COMMAND)
    assert set(encoder.sent.values()) == {0}
    encoder.commit([drive])
    assert encoder.sent[FrameKey(0x80)] == 1
    assert encoder.sent[FrameKey(0x81)] == 0
    assert [frame.data[1] & 15 for frame in encoder.encode_command(COMMAND)] == [1, 0]
    assert encoder.encode_command(COMMAND)[1] == steer
