"""Maps enumerated fields to the DBC: the names that the program knows, and their numbers in the VAL_ tables."""

from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum

from vehicle_iface.codec.binding import SENT_ROLES, Binding, suggest
from vehicle_iface.errors import ConfigError
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, Gear, VehicleMode


def _numbers(kind: type[IntEnum]) -> dict[str, int]:
    return {member.name: int(member) for member in kind}


UNKNOWN_GEAR = -1
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
"""Maps each field to the program's names with their numbers, and to the names that a DBC must have."""


_REMEDIES = {
    "mode": "; [status.modes] may give other names that meaning",
    "gear": "; [status.gears] may give other names that meaning",
    "gear_request": "; [status.gears] may give other names that meaning. A vehicle that cannot be asked for no gear "
    "has no gear_request: [command.values] sends it one gear",
}
"""The hint at the end of the error about a missing name, for each field."""
_OPEN = {"mode": int(VehicleMode.FAULT), "gear": UNKNOWN_GEAR, "gear_request": UNKNOWN_GEAR}
"""Fields whose signals may have unknown names, and the number that stands for them."""


def translate_from_wire(binding: Binding, dotted: str) -> dict[int, int] | None:
    """Map the DBC's numbers of a signal to the program's; None if they are the same or the signal is not enumerated."""
    field = binding.fields.get(dotted, "")
    if field not in _VOCABULARIES:
        return None
    known, names = _VOCABULARIES[field][0], _program_names(binding, dotted)
    numbers = {number: known.get(name, _OPEN.get(field, 0)) for number, name in names.items()}
    return None if all(wire == ours for wire, ours in numbers.items()) else numbers


def translate_to_wire(binding: Binding, dotted: str) -> dict[int, int] | None:
    """Map the program's numbers to the DBC's, to the first of several; None where `translate_from_wire` is None."""
    table = translate_from_wire(binding, dotted)
    return None if table is None else {ours: wire for wire, ours in reversed(table.items())}


def frames_of_reference(binding: Binding) -> dict[int, str]:
    """Map numbers of `pose_frame` on the wire to frames of reference."""
    dotted, frames = binding.profile.state.signals.pose_frame, binding.profile.state.frames
    table = {} if dotted is None else _names(binding, dotted)
    return {number: frames[name] for number, name in table.items()}


def enumeration_faults(binding: Binding, dotted: str) -> Iterator[ConfigError]:
    """Yield what is wrong with the VAL_ table of a bound signal; nothing if its field is not enumerated."""
    field = binding.fields.get(dotted, "")
    if field not in _VOCABULARIES:
        return
    known, needed = _VOCABULARIES[field]
    if not binding.view(dotted).names:
        yield _missing_table(binding, dotted)
        return
    found: set[str] = set()
    for number, name in _program_names(binding, dotted).items():
        if field in _OPEN:
            pass
        elif name not in known:
            yield binding.file.fault(dotted, f"{number} {name!r} is unknown; must be one of: {', '.join(known)}")
        elif name in found:
            yield binding.file.fault(dotted, f"{number} {name!r}: another number means {name}, too")
        found.add(name)
    missing = [name for name in needed if name not in found]
    if missing:
        yield binding.file.fault(dotted, f"VAL_ table without {', '.join(missing)}{_REMEDIES.get(field, '')}")
    if binding.roles.get(dotted.partition(".")[0]) in SENT_ROLES:
        yield from _range_faults(binding, dotted, needed)


def _range_faults(binding: Binding, dotted: str, needed: Iterable[str]) -> Iterator[ConfigError]:
    """Yield errors for names of a sent signal whose numbers are outside its range and cannot be encoded."""
    view = binding.view(dotted)
    numbers = {name: number for number, name in reversed(list(_program_names(binding, dotted).items()))}
    for name in needed:
        number = numbers.get(name)
        if number is not None and not view.low <= number <= view.high:
            text = f"{number} means {name}, and the range is [{view.low:g}, {view.high:g}]"
            yield binding.file.fault(dotted, f"{text}; give a range below [signals.…] in the profile")


def name_map_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield what is wrong with the profile's names of modes and gears."""
    status, command = binding.profile.status, binding.profile.command
    for key, field, table, kind in (
        ("modes", status.signals.mode, status.modes, VehicleMode),
        ("gears", status.signals.gear, status.gears, Gear),
    ):
        requests = command.signals.gear_request or () if key == "gears" else ()
        signals = [name for name in (field, *((requests,) if isinstance(requests, str) else requests)) if name]
        names = {name for dotted in signals if binding.find_signal(dotted) for name in _names(binding, dotted).values()}
        for name, ours in table.items():
            place = f"$.status.{key}.{name}"
            if names and name not in names:
                yield binding.fault(place, f"not in {' or '.join(signals)}{suggest(name, names)}")
            if ours not in kind.__members__:
                yield binding.fault(place, f"{ours!r}: must be one of: {', '.join(kind.__members__)}")


def describe_unknown_names(binding: Binding) -> Iterator[tuple[str, str]]:
    """Yield MESSAGE.SIGNAL and a warning for each name of a mode or gear that the program does not know."""
    for dotted, field in binding.fields.items():
        if field not in _OPEN:
            continue
        known = _VOCABULARIES[field][0]
        unknown = [name for name in _program_names(binding, dotted).values() if name not in known]
        meaning = "a fault" if field == "mode" else "an unknown gear"
        if unknown and field != "gear_request":
            yield dotted, f"{', '.join(unknown)}: taken for {meaning}; [status.{field}s] may say what it means"


def frame_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield errors for frames of reference that only the profile or only the VAL_ table of `pose_frame` has."""
    dotted, frames = binding.profile.state.signals.pose_frame, binding.profile.state.frames
    if dotted is None or binding.find_signal(dotted) is None:
        return
    table = _names(binding, dotted)
    if not table:
        yield _missing_table(binding, dotted)
        return
    for name in frames:
        if name not in table.values():
            yield binding.fault(f"$.state.frames.{name}", f"not in {dotted}{suggest(name, table.values())}")
    for number, name in table.items():
        if name not in frames:
            yield binding.fault("$.state.frames", f"{dotted} = {number} {name!r} has no frame")


def _names(binding: Binding, dotted: str) -> Mapping[int, str]:
    return binding.view(dotted).names


def _missing_table(binding: Binding, dotted: str) -> ConfigError:
    return binding.file.fault(dotted, "no VAL_ table; give its names in the DBC, or below [signals.…] in the profile")


def _program_names(binding: Binding, dotted: str) -> dict[int, str]:
    field = binding.fields[dotted]
    return {number: _renamed(binding, field, name) for number, name in _names(binding, dotted).items()}


def _renamed(binding: Binding, field: str, name: str) -> str:
    """Return the program's name for a name of the DBC, by the profile's table."""
    status = binding.profile.status
    names: Mapping[str, str] = {"mode": status.modes, "gear": status.gears, "gear_request": status.gears}.get(field, {})
    return names.get(name, name)
