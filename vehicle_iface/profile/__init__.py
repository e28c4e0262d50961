"""A vehicle's profile: what the signals of its DBC mean to the program, and what the vehicle can do.

`load_profile("reference")` reads `dbc/reference.toml` of this package; a path ending in `.toml` reads that file. Every
key is checked, and a `ConfigError` names all faults, each with file and place: `reference.toml: $.limits.speed_max_mps:
Expected float, got str`. Units are in the keys. `codec.database` checks the profile against its DBC.
"""

from vehicle_iface.profile.load import inspect_profile, load_profile, profile_names
from vehicle_iface.profile.placeholders import FaultyPlaces
from vehicle_iface.profile.schema import (
    Behavior,
    Bus,
    Deviation,
    Handover,
    Limits,
    Plausibility,
    Profile,
    Recovery,
    Timing,
)

__all__ = [
    "Behavior",
    "Bus",
    "Deviation",
    "FaultyPlaces",
    "Handover",
    "Limits",
    "Plausibility",
    "Profile",
    "Recovery",
    "Timing",
    "inspect_profile",
    "load_profile",
    "profile_names",
]
