"""Choices that depend on all fields together: the pose, the mode, and the form of the command."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from vehicle_iface.drafting.choice import choose_fields
from vehicle_iface.drafting.draft import Draft, FieldDraft, ModeFlags
from vehicle_iface.drafting.rules import GEAR_NAMES, RULE_OF, Section
from vehicle_iface.drafting.scoring import BINDING_SCORE, Candidate, fold_names
from vehicle_iface.drafting.survey import MessageFacts, SignalFacts, Survey, survey_dbc
from vehicle_iface.drafting.words import word_set
from vehicle_iface.profile.forms import FieldForm

_LOCAL, _GEOGRAPHIC = ("x_m", "y_m"), ("latitude_deg", "longitude_deg")
_ONE_SAMPLE = (*_LOCAL, *_GEOGRAPHIC, "heading_rad", "speed_mps", "pose_frame")
"""Fields whose messages are parts of the sample."""
_LONGITUDINAL = {
    "acceleration": ("accel_mps2",),
    "drive_and_brake": ("drive_mps2", "brake_mps2"),
    "speed": ("speed_mps",),
    "pedals": ("throttle", "brake"),
}
_LATERAL = {
    "wheel_angle": ("front_wheel_angle_rad",),
    "curvature": ("curvature_per_m",),
    "yaw_rate": ("yaw_rate_radps",),
}
"""Forms of the command, the one that determines most of the motion first."""
_SUBSYSTEMS = word_set("brake steering throttle accel drive pedal gear wheel speed")
_FLAG_WORDS = word_set("enable override fault report state control system actual driver mode autonomous")
_WHEEL_QUANTITIES = ("speed", "angular rate")
Fields = dict[tuple[Section, str], FieldDraft]


def draft_profile(dbc: Path) -> Draft:
    """Draft a profile for a DBC. `ConfigError` for a file that cannot be used."""
    survey = survey_dbc(dbc)
    fields = choose_fields(survey)
    _take_wheel_speeds(survey, fields)
    pose_source = _choose_pose(fields)
    _check_gear_request(fields)
    mode = fields["status", "mode"]
    has_mode = mode.value is not None or any(one.score >= BINDING_SCORE for one in mode.others)
    flags = None if has_mode else _find_flags(survey)
    if flags is not None:
        _drop_flags(fields, flags)
    longitudinal = _choose_form(fields, _LONGITUDINAL, keep=("acceleration", "speed_mps"))
    lateral = _choose_form(fields, _LATERAL, keep=("", ""))
    return Draft(
        survey=survey,
        fields={key: fields[key] for key in RULE_OF},
        pose_source=pose_source,
        sample=_choose_sample(survey, fields),
        flags=flags,
        longitudinal=longitudinal,
        lateral=lateral,
    )


def _drop(fields: Fields, section: Section, names: Sequence[str], remark: str) -> None:
    """Leave these fields unbound; their signals stay candidates."""
    for name in names:
        field = fields[section, name]
        if field.value is not None:
            others = (*field.chosen, *field.others)
            fields[section, name] = FieldDraft(rule=field.rule, value=None, others=others, remark=remark)


# --- state


def _take_wheel_speeds(survey: Survey, fields: Fields) -> None:
    """Use the mean of the rear wheels' speeds where the vehicle has no speed signal."""
    field, pair = fields["state", "speed_mps"], _find_rear_wheels(survey)
    if pair is None:
        return
    reason = ("speed of a rear wheel", f"in {pair[0].unit}" if pair[0].unit else "no unit")
    found = tuple(Candidate(signal=signal, score=0.0, reasons=reason) for signal in pair)
    if field.value is not None or field.is_question:
        fields["state", "speed_mps"] = replace(field, others=(*field.others, *found))
        return
    mean = FieldForm(mean=tuple(signal.dotted for signal in pair))
    remark = "no speed of the vehicle was found"
    fields["state", "speed_mps"] = replace(field, value=mean, chosen=found, remark=remark, is_question=False)


def _find_rear_wheels(survey: Survey) -> tuple[SignalFacts, SignalFacts] | None:
    """Find the speeds of the two rear wheels, in one message."""
    for message in survey.messages.values():
        sides = {side: [one for one in message.signals if _is_rear_wheel(one, side)] for side in ("left", "right")}
        if len(sides["left"]) == len(sides["right"]) == 1:
            return sides["left"][0], sides["right"][0]
    return None


def _is_rear_wheel(signal: SignalFacts, side: str) -> bool:
    words = {*signal.words, *signal.context}
    if signal.is_sent or signal.bits < 8 or not {"rear", side} <= set(signal.words) or "wheel" not in words:
        return False
    if signal.known_unit is None:
        return not signal.unit and "speed" in words
    return signal.known_unit.quantity in _WHEEL_QUANTITIES and not {"steering", "accel", "angle", "relative"} & words


def _choose_pose(fields: Fields) -> Literal["local", "geographic", "odometry"]:
    """Choose the pose source: metres before degrees before dead reckoning; leave unused signals unbound."""

    def has(*names: str) -> bool:
        return all(fields["state", name].value is not None for name in names)

    if has(*_LOCAL):
        _drop(fields, "state", _GEOGRAPHIC, "the position in metres is used")
        return "local"
    if has(*_GEOGRAPHIC):
        _drop(fields, "state", _LOCAL, "latitude and longitude are used")
        return "geographic"
    if has("speed_mps") and (has("yaw_rate_radps") or has("front_wheel_angle_rad")):
        names = (*_LOCAL, *_GEOGRAPHIC, "heading_rad", "pose_frame", "pose_valid")
        _drop(fields, "state", names, "without a position, the pose is reckoned from speed and yaw rate")
        return "odometry"
    return "local"


def _choose_sample(survey: Survey, fields: Fields) -> tuple[str, ...]:
    """Choose the messages of pose, speed and other state of the same rate. The position's message is the trigger;
    where commands are sent more often, it is the one that comes as often as they."""
    by_field = {
        name: dict.fromkeys(one.signal.message for one in field.chosen)
        for (section, name), field in fields.items()
        if section == "state" and field.value is not None
    }
    needed = dict.fromkeys(message for name in _ONE_SAMPLE for message in by_field.get(name, ()))
    if not needed:
        return ()
    trigger = _choose_trigger(survey, fields, tuple(needed))
    mode = {one.signal.message for one in fields["status", "mode"].chosen}
    others = {message for messages in by_field.values() for message in messages} - mode
    period = survey.messages[trigger].cycle_ms
    as_often = {name for name in others if period and survey.messages[name].cycle_ms == period}
    rest = [name for name in survey.messages if name in as_often | set(needed) and name != trigger]
    return (trigger, *rest)


def _choose_trigger(survey: Survey, fields: Fields, needed: Sequence[str]) -> str:
    """Return the first message, unless a command is due more often than it comes: each command needs a new sample."""
    commands = {
        one.signal.message for (section, _), field in fields.items() if section == "command" for one in field.chosen
    }
    period = min((survey.messages[name].cycle_ms for name in commands if survey.messages[name].cycle_ms), default=0)
    if survey.messages[needed[0]].cycle_ms <= period or not period:
        return needed[0]
    often = (name for name in needed if (cycle := survey.messages[name].cycle_ms) and period % cycle == 0)
    return next(often, needed[0])


# --- status


def _find_flags(survey: Survey) -> ModeFlags | None:
    """Find the flags of the subsystems; None with fewer than two enabled flags."""
    received = [message for message in survey.messages.values() if not message.is_sent]
    enabled = tuple(_flags_named("enable", received))
    if len(enabled) < 2:
        return None
    override, fault = _flags_named("override", received), _flags_named("fault", received)
    return ModeFlags(enabled=enabled, override=tuple(override), fault=tuple(fault))


def _flags_named(word: str, messages: Sequence[MessageFacts]) -> Iterator[SignalFacts]:
    """Find the flag with that word in each message about a subsystem, or one that names a subsystem itself."""
    for message in messages:
        for signal in message.signals:
            words = set(signal.words)
            is_known = words - signal.context <= _SUBSYSTEMS | _FLAG_WORDS
            is_subsystem = bool((words | signal.context) & _SUBSYSTEMS)
            if word == "enable" and words & {"override", "fault"}:
                continue  # an override that is active
            if word in words and is_known and is_subsystem and signal.is_flag and len(signal.names) <= 2:
                yield signal


def _drop_flags(fields: Fields, flags: ModeFlags) -> None:
    """Drop the fields of the status that the conditions already determine."""
    used = {signal.dotted for signal in (*flags.enabled, *flags.override, *flags.fault)}
    for (section, name), field in list(fields.items()):
        if section == "status" and any(one.signal.dotted in used for one in field.chosen):
            _drop(fields, "status", (name,), "in [status.when]")


# --- command


def _check_gear_request(fields: Fields) -> None:
    """Drop a gear request without a value for no request: the program only requests changes."""
    names = [name for one in fields["command", "gear_request"].chosen for name in one.signal.names.values()]
    gears = {spelling for gear, spellings in GEAR_NAMES.items() if gear != "NO_REQUEST" for spelling in spellings}
    if names and gears.issuperset(fold_names(names).values()):
        _drop(
            fields,
            "command",
            ["gear_request"],
            "none of its names means NO_REQUEST; [command.values] may send one gear",
        )


def _choose_form(fields: Fields, forms: Mapping[str, tuple[str, ...]], keep: tuple[str, str]) -> str:
    """Choose the first form whose signals were all found; `keep` is a form with an optional further signal."""
    found = (form for form, names in forms.items() if all(fields["command", name].value for name in names))
    form = next(found, next(iter(forms)))
    used = {*forms[form], *([keep[1]] if form == keep[0] else [])}
    unused = [name for names in forms.values() for name in names if name not in used]
    _drop(fields, "command", unused, f'only for another form than "{form}"')
    return form
