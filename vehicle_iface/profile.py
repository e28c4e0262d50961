"""A vehicle's profile: what its DBC's signals mean to the program, and what the vehicle can do.

`load_profile("reference")` reads `dbc/reference.toml` of this package; a path ending in `.toml`
reads that file. Every key is checked: an unknown one, a wrong type, a number that is not finite or
of the wrong sign is a `ConfigError` with the file and the place in it, like `reference.toml:
$.limits.speed_max_mps: Expected float`. Units are in the keys. Whether the profile fits its DBC is
checked by `codec.database`.
"""

import itertools
import math
import re
import tomllib
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from vehicle_iface.errors import ConfigError

DEEPEST = 10
"""Tables and lists in one another; a profile has four."""
_SIGNAL_NAME = re.compile(r"[A-Za-z_]\w*\.[A-Za-z_]\w*")

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Negative = Annotated[float, msgspec.Meta(lt=0.0)]
SignalName = str
"""MESSAGE.SIGNAL. Checked here: msgspec 0.22 corrupts memory over a pattern inside a union."""
SignalNames = str | tuple[str, ...]
"""One signal, or several that carry the same value."""


class Geometry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The vehicle's dimensions; the reference point is the rear axle's centre."""

    wheelbase_m: Positive
    length_m: Positive
    width_m: Positive
    height_m: Positive
    rear_overhang_m: NonNegative
    """From the rear axle to the rear end."""
    track_m: Positive
    wheel_radius_m: Positive


SpeedTable = Annotated[tuple[tuple[NonNegative, Positive], ...], msgspec.Meta(min_length=1)]
"""Rows of speed in m/s (rising, of either direction) and value; linear between rows, constant beyond them."""


class EngagingLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What may be commanded besides, until the vehicle says that it is autonomous."""

    front_wheel_rate_radps: Positive
    accel_max_mps2: Positive


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What may be commanded."""

    front_wheel_angle_rad: Positive
    """To either side."""
    front_wheel_angle_by_speed: SpeedTable
    """The same in rad, by the measured speed."""
    front_wheel_rate_radps: Positive
    front_wheel_deviation_rad: Positive
    """How far the command may be from the measured angle, to either side."""
    lateral_accel_mps2: Positive
    """At the measured speed, to either side."""
    lateral_jerk_mps3: Positive
    """The change of that per second."""
    rear_wheel_angle_rad: NonNegative
    """To either side; 0 where the rear wheels do not steer."""
    rear_wheel_rate_radps: NonNegative
    accel_max_mps2: Positive
    accel_max_by_speed: SpeedTable
    """The same in m/s², by the measured speed."""
    accel_min_mps2: Negative
    accel_rate_mps3: Positive
    speed_max_mps: Positive
    """Forwards and backwards."""
    gear_change_speed_mps: Positive
    """Above it the vehicle refuses another gear."""
    driver_steer_torque_nm: Positive
    """From here on the driver steers."""
    engaging: EngagingLimits


class Deviation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far the vehicle may be from what it is told."""

    lateral_warn_m: Positive
    """To either side of the path: counted and shown."""
    lateral_stop_m: Positive
    """To either side of the path: stop."""
    heading_stop_rad: Positive
    """Against the path's heading: stop."""
    overspeed_mps: NonNegative
    """Above the greatest speed of the limits: stop."""
    rollback_mps: Positive
    """Against the direction of travel that is wanted: stop."""


class Plausibility(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What can be true of this vehicle; a sample that cannot is dropped, and several in a row are a stop."""

    speed_mps: Positive
    accel_mps2: Positive
    """Either way; between two samples the speed changes by no more than this times the time between them …"""
    speed_apart_mps: NonNegative
    """… and this much."""
    position_apart_m: Positive
    """Between two samples the vehicle moves by speed times time and this much."""
    yaw_rate_radps: Positive
    heading_apart_rad: Positive
    """Between two samples it turns by yaw rate times time and this much."""
    yaw_rate_apart_radps: Positive
    """Between the measured yaw rate and the one that speed and front wheels make."""
    frozen_m: Positive
    """A position that stands still while the speed makes this way is frozen …"""
    frozen_s: Positive
    """… and so is one that stands still for so long …"""
    frozen_above_mps: Positive
    """… at more than this speed."""


class Timing(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Periods of the messages and what counts as late."""

    sample_period_s: Positive
    status_period_s: Positive
    command_period_s: Positive
    body_period_s: Positive
    report_period_s: Positive
    state_stale_s: Positive
    """Without a complete sample for so long: stop."""
    state_silent_s: Positive
    """Without a complete sample for so long: send nothing."""
    answer_age_s: Positive
    """An older sample is never answered."""
    status_stale_s: Positive
    """Without a message that is outside the sample for so long: stop."""
    engage_fresh_s: Positive
    """Samples must have been fresh for so long before engaging."""
    engage_give_up_s: Positive
    shutdown_s: Positive
    """Longest time to brake to standstill at the end of a run."""
    controller_budget_s: Positive
    """A controller that takes longer for a command: stop."""


class Behavior(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the vehicle is stopped."""

    safe_deceleration_mps2: Positive
    time_step_s: Positive
    stop_jerk_mps3: Positive
    """Of the brake; what drives, or brakes harder than a stop, is dropped at once."""
    stop_ease_s: Positive
    """Speed over deceleration when the vehicle is about to stand: the brake is let up with the speed."""
    hold_deceleration_mps2: NonNegative
    """Asked for at standstill, against the gear; 0 where SAFE_STOP alone holds the vehicle."""
    stop_steering: Literal["straight", "hold", "track"] = "straight"
    """`control.StopSteering`: where the wheels go meanwhile."""


class Handover(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How control is given back at a planned end."""

    warning_s: NonNegative
    """The person is told so long before."""
    holds: bool = False
    """Whether the vehicle is held at standstill until that is over; otherwise it is let go when it stands."""


class Bus(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bus that the vehicle is on."""

    bitrate: Annotated[int, msgspec.Meta(gt=0)]
    """Bits per second; of the arbitration phase on CAN FD."""
    fd: bool = False
    data_bitrate: Annotated[int, msgspec.Meta(gt=0)] | None = None
    """Bits per second of the data phase on CAN FD; left out, that of the arbitration phase."""


class EndToEnd(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """AUTOSAR end-to-end protection of the messages in `data_ids`."""

    profile: Literal[1, 2, 5, 11]
    data_id_mode: Literal["BOTH", "ALT", "LOW", "NIBBLE"] = "BOTH"
    """Profiles 1 and 11 (BOTH or NIBBLE); the others have one way only."""
    crc_signal: str = "CRC"
    counter_signal: str = "COUNTER"
    max_counter_step: Annotated[int, msgspec.Meta(ge=1)] = 3
    """A greater step of the counter is a wrong sequence."""
    data_ids: dict[
        str,
        Annotated[int, msgspec.Meta(ge=0, le=0xFFFF)] | tuple[Annotated[int, msgspec.Meta(ge=0, le=255)], ...],
    ]
    """Of each protected message; 16 bytes each in profile 2."""


class StateSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the numbers of a `VehicleState` come from; what is left out is 0."""

    x_m: SignalName
    y_m: SignalName
    heading_rad: SignalName
    speed_mps: SignalName
    accel_mps2: SignalName | None = None
    yaw_rate_radps: SignalName | None = None
    lateral_speed_mps: SignalName | None = None
    front_wheel_angle_rad: SignalName | None = None
    rear_wheel_angle_rad: SignalName | None = None
    pose_frame: SignalName | None = None
    """The enumeration that `frames` translates."""
    pose_valid: SignalName | None = None
    """0: the pose is not to be driven by."""


class State(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The messages that together are one sample of the vehicle's state."""

    sample: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    signals: StateSignals
    frames: dict[str, str] = {}
    """Name in the VAL_ table of `pose_frame` = frame of reference."""
    frame_id: str = "map"
    """The frame of reference where there is no `pose_frame`."""


class StatusSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a `VehicleStatus` comes from."""

    mode: SignalName
    gear: SignalName | None = None
    driver_brake: SignalName | None = None
    driver_throttle: SignalName | None = None
    driver_steer_torque_nm: SignalName | None = None
    fault_code: SignalName | None = None


class Status(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the vehicle says about itself besides its motion."""

    signals: StatusSignals
    modes: dict[str, str] = {}
    """Name in the DBC = name of `VehicleMode`; what is left out has the same name."""
    gears: dict[str, str] = {}
    """Name in the DBC = name of `Gear`; what is left out has the same name."""


class CommandSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the fields of a `SafeCommand` go."""

    enable: SignalNames
    accel_mps2: SignalNames
    front_wheel_angle_rad: SignalNames
    safe_stop: SignalNames | None = None
    speed_mps: SignalNames | None = None
    rear_wheel_angle_rad: SignalNames | None = None
    reason: SignalNames | None = None
    gear_request: SignalNames | None = None


class Command(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the program commands."""

    signals: CommandSignals


class BodySignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the fields of a `BodyRequest` go."""

    hazard_lights: SignalNames | None = None
    headlights: SignalNames | None = None
    turn_indicator: SignalNames | None = None
    horn: SignalNames | None = None


class Body(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Lights and horn."""

    signals: BodySignals


class ReportSignals(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the fields of a `ControllerReport` go."""

    state: SignalNames | None = None
    reason: SignalNames | None = None
    ref_spatial_index: SignalNames | None = None
    ref_temporal_index: SignalNames | None = None
    deadline_misses: SignalNames | None = None
    handover: SignalNames | None = None
    """1: control is about to be given back."""


class Report(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the program says about itself."""

    signals: ReportSignals


class Profile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One vehicle: its DBC, what the signals mean, and its limits."""

    name: str
    description: str = ""
    dbc: str
    """The DBC file; in the profile relative to it, here an absolute path."""
    file: str = ""
    """The file that this was read from; not a key of it."""
    reviewed: bool = False
    """Whether somebody has checked limits and signs against the real vehicle."""
    ignored: tuple[SignalName, ...] = ()
    """Signals of bound messages that the program has no use for."""
    constants: dict[SignalName, float] = {}
    """Signals of sent messages that always have one value, in the DBC's units."""
    geometry: Geometry
    limits: Limits
    timing: Timing
    behavior: Behavior
    handover: Handover = Handover(warning_s=0.0)
    deviation: Deviation
    plausibility: Plausibility
    bus: Bus
    e2e: EndToEnd | None = None
    state: State
    status: Status
    command: Command
    body: Body | None = None
    report: Report | None = None


def load_profile(name_or_path: str | Path) -> Profile:
    """The profile of that name, or in that file when it ends in `.toml`; `ConfigError` with file
    and place."""
    path = _find(name_or_path)
    document = _read(path)
    for fault in _document_faults(document):
        raise ConfigError(f"{path.name}: {fault}")
    try:
        profile = msgspec.convert(document, Profile)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path.name}: {_placed(str(error))}") from None
    for fault in _profile_faults(profile):
        raise ConfigError(f"{path.name}: {fault}")
    return _located(profile, path)


def inspect_profile(path: Path) -> tuple[Profile | None, list[str]]:
    """All faults of a profile's file, each with its place, and what is left of the profile without them; None when
    something is missing that it cannot be without. `ConfigError` when the file cannot be read or is no TOML."""
    document = _read(path)
    faults = list(_document_faults(document))
    document.pop("file", None)
    good = _without_faults(document, Profile, "$", faults)
    try:
        profile = msgspec.convert(good, Profile)
    except msgspec.ValidationError:
        return None, faults
    return _located(profile, path.resolve()), [*faults, *_profile_faults(profile)]


def _without_faults(document: object, kind: type[msgspec.Struct], place: str, faults: list[str]) -> dict[str, object]:
    """The part of a table that its type allows; what it does not is added to `faults`."""
    if not isinstance(document, dict):
        faults.append(f"{place}: Expected a table, got {type(document).__name__}")
        return {}
    fields = {field.name: field for field in msgspec.structs.fields(kind)}
    for key in document.keys() - fields.keys():
        faults.append(f"{place}.{key}: unknown key; must be one of: {', '.join(fields)}")
    good: dict[str, object] = {}
    for name, field in fields.items():
        inner = _table_type(field.type)
        if name not in document:
            if field.required:
                faults.append(f"{place}: {name} is missing")
        elif inner is not None:
            good[name] = _without_faults(document[name], inner, f"{place}.{name}", faults)
        else:
            try:
                msgspec.convert(document[name], field.type)
                good[name] = document[name]
            except msgspec.ValidationError as error:
                faults.append(_placed(str(error)).replace("$", f"{place}.{name}", 1))
    return good


def _table_type(kind: object) -> type[msgspec.Struct] | None:
    """The table that a field is, or may be."""
    kinds = (kind, *typing.get_args(kind))
    return next((one for one in kinds if isinstance(one, type) and issubclass(one, msgspec.Struct)), None)


def _located(profile: Profile, path: Path) -> Profile:
    if "\0" in profile.dbc:
        raise ConfigError(f"{path.name}: $.dbc: {profile.dbc!r}: must be a file's name")
    dbc = (path.parent / profile.dbc).resolve()
    return msgspec.structs.replace(profile, dbc=str(dbc), file=str(path))


def profile_names() -> tuple[str, ...]:
    """The profiles that can be loaded by name, sorted."""
    return tuple(sorted(path.stem for folder in _folders() for path in folder.glob("*.toml")))


def _folders() -> Iterator[Path]:
    """Where profiles are: inside the installed package, or beside it in a source checkout."""
    package = Path(__file__).resolve().parent
    return (folder for folder in (package / "dbc", package.parent / "dbc") if folder.is_dir())


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text.endswith(".toml"):
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
    if _is_deeper_than(document, DEEPEST):
        raise ConfigError(f"{path.name}: not a profile: tables more than {DEEPEST} deep")
    return document


def _is_deeper_than(value: object, levels: int) -> bool:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return bool(inner) and (levels == 0 or any(_is_deeper_than(one, levels - 1) for one in inner))


def _numbers(value: object, place: str) -> Iterator[tuple[str, float]]:
    """Every float in a TOML document with its place."""
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _numbers(inner, f"{place}.{key}")
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _numbers(inner, f"{place}[{index}]")


def _placed(message: str) -> str:
    """msgspec's message with the place in front."""
    plain = message.replace("`", "").replace("-0.0", "0.0")
    text, _, place = plain.rpartition(" - at ")
    return f"{place}: {text}" if text else f"$: {plain}"


def _document_faults(document: dict[str, object]) -> Iterator[str]:
    """What the types do not say."""
    for place, number in _numbers(document, "$"):
        if not math.isfinite(number):
            yield f"{place}: {number}: must be finite"
    if "file" in document:
        yield "$.file: unknown key"


def _profile_faults(profile: Profile) -> Iterator[str]:
    """What no single value says."""
    yield from _name_faults(profile)
    yield from _order_faults(profile)


def _name_faults(profile: Profile) -> Iterator[str]:
    """Signals must be written MESSAGE.SIGNAL."""
    sections = {
        "state": profile.state,
        "status": profile.status,
        "command": profile.command,
        "body": profile.body,
        "report": profile.report,
    }
    named: dict[str, object] = {"$.ignored": profile.ignored or None, "$.constants": tuple(profile.constants) or None}
    for section, table in sections.items():
        for field in table.signals.__struct_fields__ if table is not None else ():
            named[f"$.{section}.signals.{field}"] = getattr(table.signals, field) if table is not None else None
    for place, names in named.items():
        if names == ():
            yield f"{place}: must name at least one signal"
        for name in (names,) if isinstance(names, str) else names if isinstance(names, tuple) else ():
            if not _SIGNAL_NAME.fullmatch(name):
                yield f"{place}: {name!r}: must be MESSAGE.SIGNAL"


def _order_faults(profile: Profile) -> Iterator[str]:
    """Numbers that must follow one another."""
    timing = profile.timing
    for smaller, greater in (
        ("sample_period_s", "state_stale_s"),
        ("state_stale_s", "state_silent_s"),
        ("status_period_s", "status_stale_s"),
    ):
        low, high = getattr(timing, smaller), getattr(timing, greater)
        if not low < high:
            yield f"$.timing.{greater}: {high}: must be above {smaller} = {low}"
    warning_s = profile.handover.warning_s
    if not warning_s < timing.shutdown_s:
        yield f"$.handover.warning_s: {warning_s}: must be below $.timing.shutdown_s = {timing.shutdown_s}"
    geometry = profile.geometry
    shortest_m = geometry.wheelbase_m + geometry.rear_overhang_m
    if geometry.length_m < shortest_m:
        text = f"{geometry.length_m}: must be at least wheelbase_m + rear_overhang_m = {shortest_m}"
        yield f"$.geometry.length_m: {text}"
    warn_m, stop_m = profile.deviation.lateral_warn_m, profile.deviation.lateral_stop_m
    if not warn_m < stop_m:
        yield f"$.deviation.lateral_stop_m: {stop_m}: must be above lateral_warn_m = {warn_m}"
    for key in ("front_wheel_angle_by_speed", "accel_max_by_speed"):
        speeds = [speed_mps for speed_mps, _ in getattr(profile.limits, key)]
        for row, (slower, faster) in enumerate(itertools.pairwise(speeds), start=1):
            if not slower < faster:
                yield f"$.limits.{key}[{row}][0]: {faster}: must be above the row before it, {slower}"
    safe_mps2, most_mps2 = profile.behavior.safe_deceleration_mps2, -profile.limits.accel_min_mps2
    if safe_mps2 > most_mps2:
        text = f"{safe_mps2}: must be at most {most_mps2}, what $.limits.accel_min_mps2 allows"
        yield f"$.behavior.safe_deceleration_mps2: {text}"
    jerk_mps3, least_mps3 = profile.behavior.stop_jerk_mps3, safe_mps2 / profile.behavior.stop_ease_s
    if jerk_mps3 < least_mps3 * (1.0 - 1e-9):
        text = f"{jerk_mps3}: must be at least safe_deceleration_mps2 / stop_ease_s = {least_mps3}"
        yield f"$.behavior.stop_jerk_mps3: {text}"
