"""Parameters of the simulated vehicle on its bus, and of its driver."""

from vehicle_iface import checks
from vehicle_iface.units import NS_PER_MS
from vehicle_iface.value import Value

TORQUE_LIMIT_NM = 12.7
"""Maximum torque that the status message can express, to either side."""


class SimulationParameters(Value, frozen=True, kw_only=True):
    """Behaviour of the vehicle on its bus. Raises `InvalidValueError` for a value that is not positive."""

    shortest_period_ns: int = 10 * NS_PER_MS
    """Shortest period of its messages."""
    longest_step_ns: int = 100 * NS_PER_MS
    """Longest time that the vehicle moves in one step, however long the pause was."""
    gear_change_speed_mps: float = 0.5
    """Speed above which a gear change is rejected."""
    override_torque_nm: float = 3.0
    fault_deceleration_mps2: float = 3.0
    emergency_deceleration_mps2: float = 6.0
    driver_deceleration_mps2: float = 4.0
    driver_acceleration_mps2: float = 1.5
    driver_steering_rad_per_nm: float = 0.02
    """Road-wheel angle that a driver's torque holds; let go, the wheels straighten."""
    fault_code_commands_lost: int = 1

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            checks.positive(name, getattr(self, name))


class Driver(Value, frozen=True, kw_only=True):
    """Actions of the person in the vehicle."""

    brake: bool = False
    throttle: bool = False
    steer_torque_nm: float = 0.0
    """Positive to the left, in steps of 0.1 N·m as on the bus."""
