"""The frame of reference that a command line names."""

from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.errors import ConfigError


def check_frame(frame_id: str, database: VehicleDatabase) -> str:
    """`frame_id`; raises `ConfigError` when the vehicle's pose is never in it."""
    known = list(database.frames.values()) or [database.profile.state.frame_id]
    if frame_id not in known:
        raise ConfigError(f"--frame {frame_id}: must be one of: {', '.join(known)}")
    return frame_id
