"""Which commands are stops, where no signal says so: those that take the speed away at least half as hard as a stop."""

import math
from collections import deque
from collections.abc import Mapping

from vehicle_bus_contract.reference import MS, S

from hil_bench.peer.wire import PeerWire

WINDOW_NS = 100 * MS
SHARE = 0.4
"""Of the safe deceleration; what brakes less may be the route's own."""
SLOW_S = 0.2
STANDS_MPS = 0.05


class InferredStop:
    """Fed with each command in the order of time."""

    def __init__(self, wire: PeerWire) -> None:
        self._has_signal = wire.has_stop_signal
        self._is_speed = wire.reader.longitudinal == "speed"
        self._least_mps2 = SHARE * float(wire.profile["behavior"]["safe_deceleration_mps2"])
        self._slow_mps = SLOW_S * float(wire.profile["behavior"]["safe_deceleration_mps2"])
        """Below this speed the brake may be released."""
        self._count = max(1e-6, wire.reader.count("speed_mps"))
        self._stops = False
        """The last command was a stop; it goes on until nothing brakes any more."""
        self._lately: deque[tuple[int, float]] = deque()

    def is_stop(self, asked: Mapping[str, float], *, speed_mps: float, direction: float, at_ns: int) -> bool:
        """Whether this command stops the vehicle, or holds it at standstill. `direction`: 1 forwards, −1 backwards."""
        if self._has_signal:
            return bool(asked["SAFE_STOP"])
        if self._is_speed:
            self._stops = self._is_slower(asked["SPEED_REQUEST"], at_ns)
        else:
            self._stops = self._is_braked(asked["ACCEL_REQUEST"], speed_mps, direction)
        return self._stops

    def slope_mps2(self) -> float:
        """How fast the commanded speed changes, over the last 0.1 s."""
        (first_ns, first), (last_ns, last) = self._lately[0], self._lately[-1]
        return (abs(last) - abs(first)) / (last_ns - first_ns) * S if last_ns > first_ns else 0.0

    def _is_braked(self, accel_mps2: float, speed_mps: float, direction: float) -> bool:
        if abs(speed_mps) < STANDS_MPS:
            return accel_mps2 * direction <= 0.0
        brake_mps2 = -math.copysign(1.0, speed_mps) * accel_mps2
        goes_on = self._stops or abs(speed_mps) < self._slow_mps
        return brake_mps2 >= self._least_mps2 or (goes_on and brake_mps2 > 0.0)

    def _is_slower(self, commanded_mps: float, at_ns: int) -> bool:
        self._lately.append((at_ns, commanded_mps))
        while len(self._lately) > 2 and self._lately[1][0] <= at_ns - WINDOW_NS:
            self._lately.popleft()
        if abs(commanded_mps) < self._count / 2.0:
            return True
        slope_mps2 = self.slope_mps2()
        goes_on = self._stops or abs(commanded_mps) < self._slow_mps
        return slope_mps2 <= -self._least_mps2 or (goes_on and slope_mps2 < 0.0)
