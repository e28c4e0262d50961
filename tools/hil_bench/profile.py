"""A profile's TOML and DBC as the bench reads them, and the limits that commands are judged by."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cantools
from cantools.database.can import Database
from cantools.database.errors import Error as CantoolsError
from vehicle_bus_contract.reference import Limits

from hil_bench.messages import Messages
from hil_bench.places import PROFILES

JUDGED_BY = {
    "limits": (
        "front_wheel_angle_rad",
        "front_wheel_rate_radps",
        "front_wheel_deviation_rad",
        "lateral_accel_mps2",
        "lateral_jerk_mps3",
        "accel_min_mps2",
        "accel_max_mps2",
        "accel_rate_mps3",
        "speed_max_mps",
        "gear_change_speed_mps",
    ),
    "limits.while_engaging": ("front_wheel_rate_radps", "accel_max_mps2"),
    "behavior": ("safe_deceleration_mps2", "stop_jerk_mps3"),
    "geometry": ("wheelbase_m",),
}
"""The keys of a profile that commands are judged by."""
OLD_KEYS = (("limits", "engaging", "while_engaging"), ("timing", "answer_age_s", "max_command_age_s"))
"""Table, name in version 0.1, name: profiles may have either."""


class ProfileError(Exception):
    """The profile cannot be used by the bench, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileFiles:
    """A profile and its DBCs, as they were read."""

    path: Path
    profile: dict[str, Any]
    """With names of messages as `messages` has them. Of several buses, `bus` is the first."""
    dbcs: tuple[Path, ...]
    """Of each bus."""
    buses: tuple[str, ...]
    """Their names; of the only bus of a short form it is empty."""
    checksum_files: tuple[Path, ...]
    """The Python files that the profile names for checksums."""
    database: Database
    """Of the first bus."""
    messages: Messages
    hash: str
    """SHA-256 of all files."""

    @property
    def dbc(self) -> Path:
        """Of the first bus."""
        return self.dbcs[0]

    @property
    def further_files(self) -> tuple[Path, ...]:
        """All that the profile names besides its first DBC."""
        return (*self.dbcs[1:], *self.checksum_files)


def read_files(profile: str, *, strict: bool = True) -> ProfileFiles:
    """By name or path. Raises `ProfileError`; a DBC with faults is one, if `strict`."""
    path = Path(profile).resolve() if profile.endswith(".toml") else PROFILES / f"{profile}.toml"
    try:
        text = path.read_bytes()
        tables: dict[str, Any] = tomllib.loads(text.decode())
        for table, old, new in OLD_KEYS:
            if old in tables.get(table, {}):
                tables[table].setdefault(new, tables[table][old])
        if "buses" in tables:
            tables["bus"] = next(iter(tables["buses"].values()), {})
        buses: dict[str, dict[str, Any]] = tables.get("buses") or {"": tables}
        dbcs = tuple(path.parent / bus["dbc"] for bus in buses.values())
        databases = {name: _load(dbc, strict=strict) for name, dbc in zip(buses, dbcs, strict=True)}
        messages = Messages(databases)
        checksum_files = _find_checksum_files(path, tables)
        contents = b"".join(file.read_bytes() for file in (*dbcs, *checksum_files))
        tables = messages.rename(tables)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, CantoolsError) as error:
        raise ProfileError(f"{path}: {error}") from error
    return ProfileFiles(
        path=path,
        profile=tables,
        dbcs=dbcs,
        buses=tuple(buses),
        checksum_files=checksum_files,
        database=next(iter(databases.values())),
        messages=messages,
        hash=hashlib.sha256(text + contents).hexdigest(),
    )


def _find_checksum_files(path: Path, tables: Mapping[str, Any]) -> tuple[Path, ...]:
    """Return the files of `function = "FILE.py:NAME"` in the rules of `[protection]`."""
    rules = [rule for name, rule in tables.get("protection", {}).items() if name != "messages"]
    functions = [rule.get("checksum", {}).get("function", "") for rule in rules]
    return tuple(path.parent / name for name in sorted({function.partition(":")[0] for function in functions} - {""}))


def _load(dbc: Path, *, strict: bool) -> Database:
    database = cantools.database.load_file(dbc, strict=strict)
    if not isinstance(database, Database):
        raise ProfileError(f"{dbc}: is no CAN database")
    return database


def read_limits(profile: Mapping[str, Any], path: Path) -> Limits:
    """The limits of commands. Raises `ProfileError` for one that is missing."""
    own = profile["limits"]
    for table, keys in JUDGED_BY.items():
        numbers = profile
        for part in table.split("."):
            numbers = numbers[part]
        for key in keys:
            if key not in numbers:
                raise ProfileError(f"{path}: [{table}] {key} is missing: commands cannot be judged without it")
    return Limits(
        steer_rad=own["front_wheel_angle_rad"],
        steer_rate_radps=own["front_wheel_rate_radps"],
        accel_range_mps2=(own["accel_min_mps2"], own["accel_max_mps2"]),
        gear_change_mps=own["gear_change_speed_mps"],
    )
