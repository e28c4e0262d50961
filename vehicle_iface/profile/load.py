"""Find, read and convert profiles; every fault is collected with its place."""

import logging
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.profile.check import check_document, check_profile, check_tables
from vehicle_iface.profile.check_buses import needed_keys
from vehicle_iface.profile.placeholders import FaultyPlaces
from vehicle_iface.profile.protection import gather_rules, place_rule_in_file
from vehicle_iface.profile.renamed import rename_old_keys
from vehicle_iface.profile.schema import Profile
from vehicle_iface.profile.state_pose import name_odometry_frame

log = logging.getLogger("vehicle_iface")

MAX_DEPTH = 20
"""Maximum nesting of tables and lists; a profile without nested conditions has five levels."""


class Inspection(NamedTuple):
    """A profile and its faults; each text begins with its place."""

    profile: Profile | None
    """The profile with stand-ins for missing and faulty values, only to be checked; None where no DBC is named."""
    faults: list[str]
    warnings: list[str]
    """Warnings about old names of keys."""
    faulty: FaultyPlaces
    """Places where a value is missing or faulty: other faults there follow from that."""


def load_profile(name_or_path: str | Path) -> Profile:
    """Load the profile of that name, or of that file when it ends in `.toml`; its warnings are logged.

    Raises `ConfigError` with every fault, one a line, each with file and place.
    """
    path = _find(name_or_path)
    profile, faults, warnings, _ = inspect_profile(path)
    for warning in warnings:
        log.warning("%s: %s", path.name, warning)
    if faults or profile is None:
        raise ConfigError("\n".join(f"{path.name}: {fault}" for fault in faults))
    return profile


def inspect_profile(path: Path) -> Inspection:
    """Find every fault of a profile's file. Raises `ConfigError` when it cannot be read or is not TOML."""
    document = _read(path)
    renamed = rename_old_keys(document)
    faults = [*renamed.faults, *check_document(document)]
    gather_rules(document)
    sound, more = check_tables(document, Profile, needed=needed_keys(document))
    known = {fault.partition(": ")[0] for fault in faults}
    faults += (fault for fault in more if fault.partition(": ")[0] not in known)
    name_odometry_frame(sound)
    if "bus" not in sound and "buses" not in document:
        sound["bus"] = {"bitrate": 1}
    profile, faulty = _convert(sound, path), FaultyPlaces(faults)
    follow_ups = check_profile(profile) if profile is not None else ()
    faults += (fault for fault in follow_ups if not faulty.explain(fault))
    told = [place_rule_in_file(renamed.place_in_file(fault)) for fault in faults]
    return Inspection(profile, told, renamed.warnings, faulty)


def _convert(sound: dict[str, object], path: Path) -> Profile | None:
    try:
        profile = msgspec.convert(sound, Profile)
        if not profile.all_buses or not all(bus.dbc for bus in profile.all_buses.values()):
            return None
        dbc = str((path.parent / profile.dbc).resolve()) if profile.bus is not None else ""
        buses = {
            name: msgspec.structs.replace(bus, dbc=str((path.parent / bus.dbc).resolve()))
            for name, bus in profile.buses.items()
        }
    except (msgspec.ValidationError, ValueError):  # a key is missing; a NUL in the path
        return None
    return msgspec.structs.replace(profile, dbc=dbc, buses=buses, file=str(path.resolve()))


def profile_names() -> tuple[str, ...]:
    """Return the profiles that can be loaded by name, sorted."""
    return tuple(sorted(path.stem for folder in _folders() for path in folder.glob("*.toml")))


def is_packaged(path: Path) -> bool:
    """Return whether the file is one of the profiles that are loaded by name."""
    return any(path.resolve().parent == folder.resolve() for folder in _folders())


def _folders() -> Iterator[Path]:
    """Return the folders of profiles: inside the installed package, or beside it in a source checkout."""
    package = Path(__file__).resolve().parents[1]
    return (folder for folder in (package / "dbc", package.parent / "dbc") if folder.is_dir())


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text.lower().endswith(".toml"):
        return Path(text).resolve()
    for folder in _folders():
        path = folder / f"{text}.toml"
        if text in profile_names() and path.is_file():
            return path
    known = ", ".join(profile_names()) or "none"
    raise ConfigError(f"profile {text!r}: must be a path ending in .toml or one of: {known}")


def _read(path: Path) -> dict[str, object]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path.name}: byte {error.start}: must be UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path.name}: not TOML: {error}") from None
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits, tables in tables in tables
        raise ConfigError(f"{path.name}: not a profile: {error}") from None
    if _is_deeper_than(document, MAX_DEPTH):
        raise ConfigError(f"{path.name}: not a profile: tables more than {MAX_DEPTH} deep")
    return document


def _is_deeper_than(value: object, levels: int) -> bool:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return bool(inner) and (levels == 0 or any(_is_deeper_than(one, levels - 1) for one in inner))
