"""Dead reckoning: the pose by integration of speed and yaw rate from sample to sample."""

import math

from vehicle_iface.pose.data import Pose, PoseInputs
from vehicle_iface.units import NS_PER_S, ns_from_s, wrapped_rad


class Odometry:
    """The pose in the frame `odom`, which begins at 0, 0, 0 with the first sample.

    Between two samples, speed and yaw rate are the means of both, and the way is the arc that they make. The speed is
    along the body; where the rear axle moves sideways as well, by its measured lateral speed or by steered rear wheels,
    so does the pose. Without a measured yaw rate it is that of a bicycle without slip, by speed and wheel angles.

    The error grows with the distance driven, `driven_m`, without limit. After a gap between two samples of more than
    `max_gap_s` it is unknown how far the vehicle came, and there is no pose until `reset`.
    """

    def __init__(self, *, wheelbase_m: float, max_gap_s: float, has_yaw_rate: bool) -> None:
        """`has_yaw_rate`: whether the yaw rate is measured; otherwise it is computed from the front wheel angle."""
        self._wheelbase_m, self._has_yaw_rate = wheelbase_m, has_yaw_rate
        self._max_gap_ns = ns_from_s(max_gap_s)
        self.reset()

    def reset(self) -> None:
        """Restart at 0, 0, 0 with the next sample, and the distance driven at 0."""
        self.driven_m = 0.0
        self.invalid_because = ""
        self._pose = Pose(x_m=0.0, y_m=0.0, heading_rad=0.0)
        self._stamp_ns: int | None = None
        self._speed_mps = self._lateral_mps = self._yaw_radps = 0.0

    def resolve(self, stamp_ns: int, values: PoseInputs) -> Pose | None:
        """Return the pose at `stamp_ns`.

        A sample without the required values, or older than the one before it, has no pose and is ignored.
        """
        speed_mps, yaw_radps = values.speed_mps, self._yaw_rate_radps(values)
        lateral_mps = _lateral_speed_mps(values)
        if speed_mps is None or yaw_radps is None or not math.isfinite(speed_mps + yaw_radps + lateral_mps):
            self.invalid_because = "speed, yaw rate or wheel angle without a value"
            return None
        before_ns = self._stamp_ns if self._stamp_ns is not None else stamp_ns
        if stamp_ns < before_ns:
            self.invalid_because = "sample older than the one before it"
            return None
        if stamp_ns - before_ns > self._max_gap_ns:  # and so is every later sample: `_stamp_ns` stays
            self.invalid_because = "dead reckoning interrupted by missing samples"
            return None
        self._move((stamp_ns - before_ns) / NS_PER_S, speed_mps, lateral_mps, yaw_radps)
        self._stamp_ns, self._speed_mps, self._lateral_mps, self._yaw_radps = (
            stamp_ns,
            speed_mps,
            lateral_mps,
            yaw_radps,
        )
        self.invalid_because = ""
        return self._pose

    def _move(self, dt_s: float, speed_mps: float, lateral_mps: float, yaw_radps: float) -> None:
        """Move along the arc of the mean speeds: its chord has the direction of the mean heading."""
        if speed_mps == 0.0 == self._speed_mps:  # the bias of a gyroscope does not turn a vehicle that stands
            return
        forward_m = 0.5 * dt_s * (self._speed_mps + speed_mps)
        left_m = 0.5 * dt_s * (self._lateral_mps + lateral_mps)
        half_turn_rad = 0.25 * dt_s * (self._yaw_radps + yaw_radps)
        chord = math.sin(half_turn_rad) / half_turn_rad if half_turn_rad else 1.0
        middle_rad = self._pose.heading_rad + half_turn_rad
        cos, sin = chord * math.cos(middle_rad), chord * math.sin(middle_rad)
        self._pose = Pose(
            x_m=self._pose.x_m + forward_m * cos - left_m * sin,
            y_m=self._pose.y_m + forward_m * sin + left_m * cos,
            heading_rad=wrapped_rad(middle_rad + half_turn_rad),
        )
        self.driven_m += math.hypot(forward_m, left_m)

    def _yaw_rate_radps(self, values: PoseInputs) -> float | None:
        if self._has_yaw_rate:
            return values.yaw_rate_radps
        if values.speed_mps is None or values.front_wheel_angle_rad is None:
            return None
        turn = _tangent(values.front_wheel_angle_rad) - _tangent(values.rear_wheel_angle_rad or 0.0)
        return values.speed_mps * turn / self._wheelbase_m


def _lateral_speed_mps(values: PoseInputs) -> float:
    """Return the lateral speed of the rear axle; 0 where it is neither measured nor steered."""
    if values.lateral_speed_mps is not None:
        return values.lateral_speed_mps
    return (values.speed_mps or 0.0) * _tangent(values.rear_wheel_angle_rad or 0.0)


def _tangent(angle_rad: float) -> float:
    """Return the tangent; NaN for an infinite angle, where `math.tan` raises."""
    return math.tan(angle_rad) if math.isfinite(angle_rad) else math.nan
