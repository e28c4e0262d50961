"""Checks the frame of reference that an option names."""

from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.errors import ConfigError


def check_frame(frame_id: str | None, database: VehicleDatabase) -> str:
    """Return `frame_id`; if it is None, return "map" or, for a vehicle without it, the first frame of the vehicle.

    Raises `ConfigError` if the vehicle never reports its pose in `frame_id`.
    """
    known = list(database.frames.values()) or [database.profile.state.frame_id]
    if frame_id is None:
        return "map" if "map" in known else known[0]
    if frame_id not in known:
        raise ConfigError(f"--frame {frame_id}: must be one of: {', '.join(known)}")
    return frame_id
