"""Sensor faults: wrong values in signals of the state."""

import math
from collections import deque
from collections.abc import Callable

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.units import wrapped_rad

LONGEST_DELAY_SAMPLES = 1000
SignalFault = Callable[[float], float]
"""True value of a signal → faulty value. Called once a sample."""
FIELDS = BicycleState.__struct_fields__
"""Signals that can have a fault, by the names of the profile."""


def frozen() -> SignalFault:
    """Make a fault that repeats the value of its first call."""
    held: list[float] = []

    def fault(value: float) -> float:
        held.append(value) if not held else None
        return held[0]

    return fault


def scaled(factor: float) -> SignalFault:
    """Make a fault that multiplies by `factor`."""
    checks.finite("factor", factor)
    return lambda value: value * factor


def offset(amount: float) -> SignalFault:
    """Make a fault that adds `amount`, in the signal's unit."""
    checks.finite("amount", amount)
    return lambda value: value + amount


def delayed(samples: int) -> SignalFault:
    """Make a fault that delays by this number of samples; it starts with the value of the first call."""
    if not 1 <= checks.integer("samples", samples) <= LONGEST_DELAY_SAMPLES:
        raise InvalidValueError(f"samples = {samples}: must be 1..{LONGEST_DELAY_SAMPLES}")
    held: deque[float] = deque(maxlen=samples + 1)

    def fault(value: float) -> float:
        held.append(value)
        return held[0]

    return fault


def apply_faults(state: BicycleState, faults: dict[str, SignalFault]) -> BicycleState:
    """Return the measurements of `state` by sensors with these faults, by field."""
    values = {name: getattr(state, name) for name in FIELDS}
    for name, fault in faults.items():
        values[name] = fault(values[name])
    values["heading_rad"] = wrapped_rad(math.remainder(values["heading_rad"], math.tau))
    return BicycleState(**values)
