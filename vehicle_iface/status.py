"""The vehicle's status besides its motion: mode, gear, driver, faults."""

from enum import IntEnum

from vehicle_iface.value import Value


class VehicleMode(IntEnum):
    """The vehicle's mode: who drives. The numbers are those of the reference vehicle's signal MODE."""

    MANUAL = 0
    READY = 1
    AUTONOMOUS = 2
    FAULT = 3
    EMERGENCY_STOP = 4


class Gear(IntEnum):
    """The gear. The numbers are those of the reference vehicle's signals GEAR and GEAR_REQUEST."""

    PARK = 0
    REVERSE = 1
    NEUTRAL = 2
    DRIVE = 3
    NO_REQUEST = 7
    """Only in requests: leave the gear as it is."""


class ControllerState(IntEnum):
    """The controller's state. The numbers are those of the reference vehicle's signal STATE."""

    STARTING = 0
    STANDBY = 1
    ENGAGING = 2
    ENGAGED = 3
    STOPPING = 4
    FAULT = 5
    SHADOW = 6


class VehicleStatus(Value, frozen=True, kw_only=True):
    """One status report of the vehicle."""

    stamp_ns: int
    """Kernel receive time, nanoseconds of the monotonic clock."""
    mode: VehicleMode
    gear: Gear | None
    """None: the vehicle does not say."""
    driver_brake: bool = False
    driver_throttle: bool = False
    driver_steer_torque_nm: float = 0.0
    """The driver's torque on the steering wheel, positive to the left."""
    driver_steers: bool = False
    """Whether the vehicle itself reports that the driver steers."""
    fault_code: int = 0


class BodyRequest(Value, frozen=True, kw_only=True):
    """Lights and horn, sent at the body period."""

    hazard_lights: bool = False
    headlights: int = 0
    turn_indicator: int = 0
    horn: bool = False


class ControllerReport(Value, frozen=True, kw_only=True):
    """The controller's own state, sent at the report period."""

    state: ControllerState
    reason: int
    ref_spatial_index: int
    """Saturated at the signal's greatest value."""
    ref_temporal_index: int
    """Saturated at the signal's greatest value."""
    deadline_misses: int
    """Saturated at the signal's greatest value."""
    handover: bool = False
    """Whether control is about to be given back."""
