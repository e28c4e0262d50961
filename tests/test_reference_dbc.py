"""The reference DBC says exactly what the bus contract says."""

from collections.abc import Iterator
from pathlib import Path

import cantools
import pytest
from cantools.database.can import Database, Signal

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, Gear, VehicleMode


def loaded() -> Database:
    database = cantools.database.load_file(Path(__file__).parents[1] / "dbc" / "reference.dbc", strict=True)
    assert isinstance(database, Database)
    return database


DBC = loaded()

MESSAGES = {
    "DRIVE_COMMAND": (0x080, "CONTROLLER", 10),
    "STEER_COMMAND": (0x081, "CONTROLLER", 10),
    "BODY_COMMAND": (0x082, "CONTROLLER", 100),
    "VEHICLE_STATUS": (0x100, "VEHICLE", 20),
    "POSE": (0x110, "VEHICLE", 10),
    "MOTION": (0x111, "VEHICLE", 10),
    "CHASSIS": (0x112, "VEHICLE", 10),
    "CONTROLLER_STATUS": (0x180, "CONTROLLER", 100),
}
# message: signal start|length, s where signed, × scale
SIGNALS = {
    "DRIVE_COMMAND": """ENABLE 12|1, SAFE_STOP 13|1, ACCEL_REQUEST 16|16 s 0.001 m/s^2,
        SPEED_REQUEST 32|16 s 0.005 m/s, REASON 48|8, GEAR_REQUEST 56|3""",
    "STEER_COMMAND": """ENABLE 12|1, FRONT_WHEEL_ANGLE_REQUEST 16|16 s 0.0001 rad,
        REAR_WHEEL_ANGLE_REQUEST 32|16 s 0.0001 rad""",
    "BODY_COMMAND": "HAZARD_LIGHTS 12|1, HEADLIGHTS 16|2, TURN_INDICATOR 18|2, HORN 20|1",
    "VEHICLE_STATUS": """GEAR 12|3, DRIVER_BRAKE 15|1, MODE 16|3, DRIVER_THROTTLE 19|1,
        DRIVER_STEER_TORQUE 24|8 s 0.1 N*m, REAR_WHEEL_ANGLE 32|16 s 0.0001 rad, FAULT_CODE 48|8""",
    "POSE": "POSE_FRAME 12|2, POSE_VALID 14|1, POS_X 16|24 s 0.005 m, POS_Y 40|24 s 0.005 m",
    "MOTION": "HEADING 16|16 s 0.0001 rad, SPEED 32|16 s 0.005 m/s, YAW_RATE 48|16 s 0.0002 rad/s",
    "CHASSIS": """ACCEL 16|16 s 0.001 m/s^2, LATERAL_SPEED 32|16 s 0.001 m/s,
        FRONT_WHEEL_ANGLE 48|16 s 0.0001 rad""",
    "CONTROLLER_STATUS": """STATE 12|4, REASON 16|8, REF_SPATIAL_INDEX 24|16, REF_TEMPORAL_INDEX 40|16,
        DEADLINE_MISSES 56|8""",
}
GEARS = {0: "PARK", 1: "REVERSE", 2: "NEUTRAL", 3: "DRIVE"}
ENUMERATIONS = {
    "VEHICLE_STATUS.GEAR": GEARS,
    "DRIVE_COMMAND.GEAR_REQUEST": {**GEARS, 7: "NO_REQUEST"},
    "VEHICLE_STATUS.MODE": {int(mode): mode.name for mode in VehicleMode},
    "POSE.POSE_FRAME": {0: "ODOM", 1: "MAP"},
    "BODY_COMMAND.HEADLIGHTS": {0: "OFF", 1: "LOW", 2: "HIGH"},
    "BODY_COMMAND.TURN_INDICATOR": {0: "OFF", 1: "LEFT", 2: "RIGHT"},
    "CONTROLLER_STATUS.STATE": {int(state): state.name for state in ControllerState},
    "CONTROLLER_STATUS.REASON": {int(reason): reason.name for reason in Reason},
    "DRIVE_COMMAND.REASON": {int(reason): reason.name for reason in Reason},
}
PHYSICALLY_POSSIBLE = {
    "MOTION.HEADING": (-3.1416, 3.1416),
    "MOTION.SPEED": (-60.0, 60.0),
    "MOTION.YAW_RATE": (-6.0, 6.0),
    "CHASSIS.ACCEL": (-15.0, 15.0),
    "CHASSIS.LATERAL_SPEED": (-20.0, 20.0),
    "CHASSIS.FRONT_WHEEL_ANGLE": (-0.9, 0.9),
    "POSE.POS_X": (-41943.04, 41943.035),
    "VEHICLE_STATUS.DRIVER_STEER_TORQUE": (-12.8, 12.7),
    "VEHICLE_STATUS.FAULT_CODE": (0, 255),
}


def signal(dotted: str) -> Signal:
    message, _, name = dotted.partition(".")
    return DBC.get_message_by_name(message).get_signal_by_name(name)


def rows() -> Iterator[tuple[str, ...]]:
    for message, text in SIGNALS.items():
        for row in ("CRC 0|8, COUNTER 8|4, " + text).split(","):
            yield message, *row.split(maxsplit=2)


def test_there_are_these_messages_and_no_others() -> None:
    assert {m.name: (m.frame_id, *m.senders, m.cycle_time) for m in DBC.messages} == MESSAGES
    assert all(m.length == 8 and not m.is_extended_frame and not m.is_fd for m in DBC.messages)


def test_controller_and_vehicle_receive_each_other() -> None:
    for message in DBC.messages:
        (sender,) = message.senders
        assert message.receivers == {"CONTROLLER", "VEHICLE"} - {sender}


def test_each_message_has_these_signals_and_no_others() -> None:
    expected: dict[str, set[str]] = {}
    for message, name, *_ in rows():
        expected.setdefault(message, set()).add(name)
    assert {message.name: {s.name for s in message.signals} for message in DBC.messages} == expected


@pytest.mark.parametrize("row", list(rows()), ids=lambda row: ".".join(row[:2]))
def test_a_signal_lies_at_the_contracts_place(row: tuple[str, ...]) -> None:
    message, name, bits, *rest = row
    signed, scale, unit = rest[0].split() if rest else ("", "1", None)
    found = signal(f"{message}.{name}")
    assert f"{found.start}|{found.length}" == bits
    assert (found.is_signed, found.scale, found.offset) == (signed == "s", float(scale), 0)
    assert found.byte_order == "little_endian"
    assert found.unit == unit
    assert not found.is_float


def test_every_signal_has_a_range_that_its_bits_can_hold() -> None:
    for message in DBC.messages:
        for found in message.signals:
            low = -(1 << found.length - 1) if found.is_signed else 0
            high = (1 << found.length - found.is_signed) - 1
            assert found.minimum is not None
            assert found.maximum is not None
            assert low * found.scale - 1e-9 <= found.minimum < found.maximum <= high * found.scale + 1e-9


@pytest.mark.parametrize("dotted", PHYSICALLY_POSSIBLE)
def test_a_range_leaves_room_for_what_a_vehicle_can_do(dotted: str) -> None:
    low, high = PHYSICALLY_POSSIBLE[dotted]
    found = signal(dotted)
    assert found.minimum is not None
    assert found.minimum <= low
    assert found.maximum is not None
    assert found.maximum >= high


def test_the_enumerations_are_the_contracts() -> None:
    found = {
        f"{message.name}.{s.name}": {int(k): str(v) for k, v in s.choices.items()}
        for message in DBC.messages
        for s in message.signals
        if s.choices
    }
    assert found == ENUMERATIONS
    assert ENUMERATIONS["DRIVE_COMMAND.GEAR_REQUEST"] == {int(gear): gear.name for gear in Gear}


def test_every_message_states_its_protection() -> None:
    for message in DBC.messages:
        assert message.dbc is not None
        assert message.dbc.attributes["E2EDataId"].value == message.frame_id
        assert message.dbc.attributes["E2EProfile"].value == 1
