"""Sensor faults: wrong values in signals of the state."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import fields

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.units import wrapped_rad

LONGEST_DELAY_SAMPLES = 1000
SignalFault = Callable[[float], float]
"""From the value that a signal should have now to the one that it has. Called once a sample."""
FIELDS = tuple(field.name for field in fields(BicycleState))
"""Signals that can be wrong, under the names of the profile."""


def frozen() -> SignalFault:
    """The value at the first call, for ever."""
    held: list[float] = []

    def fault(value: float) -> float:
        held.append(value) if not held else None
        return held[0]

    return fault


def scaled(factor: float) -> SignalFault:
    """The value times `factor`."""
    checks.finite("factor", factor)
    return lambda value: value * factor


def offset(amount: float) -> SignalFault:
    """The value plus `amount`, in the signal's unit."""
    checks.finite("amount", amount)
    return lambda value: value + amount


def delayed(samples: int) -> SignalFault:
    """The value of so many samples ago; until there is one, that of the first call."""
    if not 1 <= checks.integer("samples", samples) <= LONGEST_DELAY_SAMPLES:
        raise InvalidValueError(f"samples = {samples}: must be 1..{LONGEST_DELAY_SAMPLES}")
    held: deque[float] = deque(maxlen=samples + 1)

    def fault(value: float) -> float:
        held.append(value)
        return held[0]

    return fault


def apply_faults(state: BicycleState, faults: dict[str, SignalFault]) -> BicycleState:
    """What sensors with these faults say of `state`, by field."""
    values = {name: getattr(state, name) for name in FIELDS}
    for name, fault in faults.items():
        values[name] = fault(values[name])
    values["heading_rad"] = wrapped_rad(math.remainder(values["heading_rad"], math.tau))
    return BicycleState(**values)
