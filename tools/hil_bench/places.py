"""Where the bench's files are: in a source checkout, or beside the installed package."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
CHECKOUT = PACKAGE.parents[1] if (PACKAGE.parents[1] / "dbc").is_dir() else None
"""The root of the repository; None in an installed package."""
PROFILES = CHECKOUT / "dbc" if CHECKOUT else PACKAGE.parent / "vehicle_iface" / "dbc"
"""TOML and DBC files of the profiles that are known by name."""
