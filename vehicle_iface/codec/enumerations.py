"""Enumerated fields: the names that the program knows, and their numbers in a DBC's VAL_ tables."""

from collections.abc import Iterator, Mapping
from enum import IntEnum

from vehicle_iface.codec.binding import Binding, suggest
from vehicle_iface.errors import ConfigError
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, Gear, VehicleMode


def _numbers(kind: type[IntEnum]) -> dict[str, int]:
    return {member.name: int(member) for member in kind}


_LIGHTS = {"OFF": 0, "LOW": 1, "HIGH": 2}
_TURNS = {"OFF": 0, "LEFT": 1, "RIGHT": 2}
_VOCABULARIES: dict[str, tuple[dict[str, int], tuple[str, ...]]] = {
    "mode": (_numbers(VehicleMode), ("READY", "AUTONOMOUS")),
    "gear": (_numbers(Gear), ("REVERSE", "DRIVE")),
    "gear_request": (_numbers(Gear), ("REVERSE", "DRIVE", "NO_REQUEST")),
    "reason": (_numbers(Reason), tuple(_numbers(Reason))),
    "state": (_numbers(ControllerState), tuple(_numbers(ControllerState))),
    "headlights": (_LIGHTS, ("OFF", "LOW")),
    "turn_indicator": (_TURNS, tuple(_TURNS)),
}
"""Field → the program's names and numbers, and the names that a DBC must have."""


def translate_from_wire(binding: Binding, dotted: str) -> dict[int, int] | None:
    """The DBC's number → the program's number of a signal; None where they are the same, or it is no enumeration."""
    field = binding.fields.get(dotted, "")
    if field not in _VOCABULARIES:
        return None
    numbers = {number: _VOCABULARIES[field][0][name] for number, name in _program_names(binding, dotted).items()}
    return None if all(wire == ours for wire, ours in numbers.items()) else numbers


def enumerated_signals(binding: Binding, message_name: str) -> frozenset[str]:
    """The signals of a message in which the program knows no number without a name."""
    dotted = {place for place, field in binding.fields.items() if field in _VOCABULARIES or field == "pose_frame"}
    return frozenset(place.partition(".")[2] for place in dotted if place.partition(".")[0] == message_name)


def frames_of_reference(binding: Binding) -> dict[int, str]:
    """Number of `pose_frame` on the wire → frame of reference."""
    dotted, frames = binding.profile.state.signals.pose_frame, binding.profile.state.frames
    table = {} if dotted is None else _value_table(binding, dotted)
    return {number: frames[name] for number, name in table.items()}


def enumeration_faults(binding: Binding, dotted: str) -> Iterator[ConfigError]:
    """What is wrong with the VAL_ table of a bound signal; nothing where its field is no enumeration."""
    field = binding.fields.get(dotted, "")
    if field not in _VOCABULARIES:
        return
    known, needed = _VOCABULARIES[field]
    if not _value_table(binding, dotted):
        yield _missing_table(binding, dotted)
        return
    found: set[str] = set()
    for number, name in _value_table(binding, dotted).items():
        ours = _renamed(binding, field, name)
        if ours not in known:
            text = f"{number} {name!r} is unknown; must be one of: {', '.join(known)}"
            yield binding.file.fault(dotted, text)
        elif ours in found:
            yield binding.file.fault(dotted, f"{number} {name!r}: another number means {ours}, too")
        found.add(ours)
    missing = [name for name in needed if name not in found]
    if missing:
        yield binding.file.fault(dotted, f"VAL_ table without {', '.join(missing)}")


def frame_faults(binding: Binding) -> Iterator[ConfigError]:
    """Frames of reference that are only in the profile, or only in the VAL_ table of `pose_frame`."""
    dotted, frames = binding.profile.state.signals.pose_frame, binding.profile.state.frames
    if dotted is None or binding.find_signal(dotted) is None:
        return
    table = _value_table(binding, dotted)
    if not table:
        yield _missing_table(binding, dotted)
        return
    for name in frames:
        if name not in table.values():
            yield binding.fault(f"$.state.frames.{name}", f"not in {dotted}{suggest(name, table.values())}")
    for number, name in table.items():
        if name not in frames:
            yield binding.fault("$.state.frames", f"{dotted} = {number} {name!r} has no frame")


def _value_table(binding: Binding, dotted: str) -> dict[int, str]:
    signal = binding.find_signal(dotted)
    choices = signal.choices if signal is not None else None
    return {int(number): str(name) for number, name in (choices or {}).items()}


def _missing_table(binding: Binding, dotted: str) -> ConfigError:
    return binding.file.fault(dotted, "no VAL_ table; the program needs its names")


def _program_names(binding: Binding, dotted: str) -> dict[int, str]:
    field = binding.fields[dotted]
    return {number: _renamed(binding, field, name) for number, name in _value_table(binding, dotted).items()}


def _renamed(binding: Binding, field: str, name: str) -> str:
    """The program's name for a name of the DBC, by the profile's table."""
    status = binding.profile.status
    names: Mapping[str, str] = {"mode": status.modes, "gear": status.gears, "gear_request": status.gears}.get(field, {})
    return names.get(name, name)
