"""What a vehicle's bus has, and which cases therefore do not apply to it."""

from enum import StrEnum

from vehicle_bus_contract.reference import GREATEST_STEP

from hil_bench.wire import Wire

SPARE_MODE = 7
"""The number of a mode that no vehicle should have a name for."""
LONG_COUNTER = 12
PERIODS_UNTIL_STALE = 2.5


class Part(StrEnum):
    """Something of a vehicle that a case is about."""

    POSITION = "a position on its bus"
    POSE_VALID = "a signal by which its pose is valid"
    POSE_FRAME = "a frame of reference on its bus"
    CHECKSUM = "a checksum in every message of its samples"
    IDENTITY = "a checksum that also covers which message it is"
    COUNTER = "a counter in every message of its samples"
    SKIPS = "a counter that may skip two values"
    LONG_COUNTER = "a counter of at least twelve values"
    SHARED_COUNTER = "samples of several messages with one counter"
    STATUS = "a status message beside its samples"
    BRAKE = "a signal for the driver's brake"
    THROTTLE = "a signal for the driver's accelerator"
    STEERING = "a signal for the driver's steering"
    TORQUE = "a signal for the driver's steering torque"
    MANUAL = "a way to report MANUAL"
    FAULT = "a way to report a fault"
    EMERGENCY_STOP = "a way to report its emergency stop"
    SPARE_MODE = f"a mode signal with an unused number {SPARE_MODE}"
    GEAR = "a gear on its bus"
    SPEED_RANGE = "a speed signal whose bits can exceed its range"
    ACCEL = "a measured acceleration"
    YAW_RATE = "a measured yaw rate"
    WHEELS = "a measured front wheel angle"
    REASON = "a reason with each command"
    REVERSE = "a command to drive backwards, and a measured speed with a sign"
    BACKWARDS = "a measured speed with a sign"
    SHORT_ID = "identifiers of 11 bits"
    FURTHER_STATE = "a part of its state on the second bus"
    PATIENCE = "a limit for old state of more than two periods"


def parts_of(wire: Wire) -> frozenset[Part]:
    """Everything of `Part` that the vehicle has."""
    has = wire.has
    protections = [wire.protection_of(name) for name in wire.sample]
    counted = all(one.counters for one in protections)
    timing = wire.profile["timing"]
    found = {
        Part.POSITION: has("POS_X"),
        Part.POSE_VALID: has("POSE_VALID"),
        Part.POSE_FRAME: has("POSE_FRAME"),
        Part.CHECKSUM: all(one.has_checksum for one in protections),
        Part.IDENTITY: all(one.has_checksum and one.covers_identity for one in protections),
        Part.COUNTER: counted,
        Part.SKIPS: counted and all(one.max_step >= GREATEST_STEP for one in protections),
        Part.LONG_COUNTER: counted and all(one.counters >= LONG_COUNTER for one in protections),
        Part.SHARED_COUNTER: counted and wire.is_counted and len(wire.sample) > 1,
        Part.STATUS: bool(wire.status),
        Part.BRAKE: has("DRIVER_BRAKE"),
        Part.THROTTLE: has("DRIVER_THROTTLE"),
        Part.STEERING: has("DRIVER_STEER_TORQUE"),
        Part.TORQUE: "driver_steer_torque_nm" in wire.profile.get("status", {}).get("signals", {}),
        Part.MANUAL: wire.can_report("MANUAL"),
        Part.FAULT: wire.can_report("FAULT"),
        Part.EMERGENCY_STOP: wire.can_report("EMERGENCY_STOP"),
        Part.SPARE_MODE: wire.has_spare("MODE", SPARE_MODE),
        Part.GEAR: has("GEAR"),
        Part.SPEED_RANGE: wire.greatest("SPEED")[1] > wire.greatest("SPEED")[0],
        Part.ACCEL: has("ACCEL"),
        Part.YAW_RATE: has("YAW_RATE"),
        Part.WHEELS: has("FRONT_WHEEL_ANGLE"),
        Part.REASON: wire.tells_reasons,
        Part.REVERSE: wire.can_reverse,
        Part.BACKWARDS: wire.measures_backwards,
        Part.SHORT_ID: all(wire.ids[name] <= 0x7FF for name in wire.sample),
        Part.FURTHER_STATE: any(wire.bus_of(name) == 1 for name in wire.sample),
        Part.PATIENCE: timing["state_stale_s"] >= PERIODS_UNTIL_STALE * wire.period_s,
    }
    return frozenset(part for part, is_there in found.items() if is_there)
