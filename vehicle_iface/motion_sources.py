"""The sources of motion that a profile binds, and which wrong sensors can therefore not be detected.

The loop compares position, speed, acceleration, heading, yaw rate and wheels with one another (`safety.motion`). What a
vehicle does not send is not compared. A position in a frame named `odom` counts as made of the speed signal itself.
"""

from collections.abc import Iterator

import msgspec

from vehicle_iface.profile import Profile
from vehicle_iface.profile.state_pose import ODOMETRY_FRAME
from vehicle_iface.value import Value


class MotionSources(Value, frozen=True, kw_only=True):
    """Which fields of the state the vehicle sends."""

    accel: bool = True
    yaw_rate: bool = True
    lateral_speed: bool = True
    front_wheels: bool = True


def sources_of(profile: Profile) -> MotionSources:
    """What the profile binds."""
    signals = profile.state.signals
    return MotionSources(
        accel=signals.accel_mps2 is not None,
        yaw_rate=signals.yaw_rate_radps is not None,
        lateral_speed=signals.lateral_speed_mps is not None,
        front_wheels=signals.front_wheel_angle_rad is not None,
    )


def has_second_speed(profile: Profile) -> bool:
    """Whether a wrong speed signal contradicts anything else that the vehicle sends."""
    frames = set(profile.state.frames.values()) or {profile.state.frame_id}
    return sources_of(profile).accel or frames != {ODOMETRY_FRAME}


def cap_unconfirmed_speed(profile: Profile) -> Profile:
    """The profile, driven at `limits.unconfirmed_speed_max_mps` at most where nothing confirms the speed signal."""
    limits = profile.limits
    if has_second_speed(profile) or limits.speed_max_mps <= limits.unconfirmed_speed_max_mps:
        return profile
    capped = msgspec.structs.replace(limits, speed_max_mps=limits.unconfirmed_speed_max_mps)
    return msgspec.structs.replace(profile, limits=capped)


def describe_missing(profile: Profile) -> Iterator[str]:
    """What cannot be compared, as `$.place: text` for people."""
    sources, place = sources_of(profile), "$.state.signals"
    if not has_second_speed(profile):
        yield (
            f"{place}: nothing confirms the speed signal: accel_mps2 is not bound and the position is odometry; "
            f"the vehicle is driven at {profile.limits.unconfirmed_speed_max_mps} m/s at most "
            "(limits.unconfirmed_speed_max_mps)"
        )
    elif not sources.accel:
        yield f"{place}: accel_mps2 is not bound: only the position reveals a wrong speed"
    if not sources.yaw_rate and not sources.front_wheels:
        text = "neither yaw_rate_radps nor front_wheel_angle_rad is bound: only the position reveals a wrong heading"
        yield f"{place}: {text}"
