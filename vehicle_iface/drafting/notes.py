"""Facts that the user must add for bound signals and messages: units, ratios, signs, periods, protection."""

from collections.abc import Iterator

from vehicle_iface.codec.quantities import unit_of_field
from vehicle_iface.drafting.draft import Draft, FieldDraft
from vehicle_iface.drafting.field_lines import align, name_some
from vehicle_iface.drafting.rules import Kind
from vehicle_iface.drafting.survey import MessageFacts, SignalFacts

_SPELLINGS = {
    "angle": '"rad" or "deg"',
    "angular rate": '"rad/s" or "deg/s"',
    "speed": '"m/s", "km/h" or "mph"',
    "acceleration": '"m/s^2" or "g"',
    "length": '"m"',
    "torque": '"N*m"',
    "curvature": '"1/m"',
}
_WHEEL_ANGLES = frozenset({"front_wheel_angle_rad", "rear_wheel_angle_rad"})
_LARGEST_ROAD_WHEEL_ANGLE_RAD = 1.3
_FULL_TURN_RAD = 6.2
_MOST_WORDS = 3
"""Maximum number of words in the name of a checksum or counter; longer names mean something else."""
_SCALE = 'scale = "TODO"'
"""Text in place of a number, so that `check-dbc` rejects the profile until it is set."""


def write_signal_notes(draft: Draft) -> Iterator[str]:
    """Write `[signals."M.S"]`: questions as comments, or as a text for a number where a wrong answer is dangerous."""
    for field in draft.fields.values():
        for one in field.chosen if field.value is not None else ():
            lines = list(_ask(field, one.signal))
            if lines:
                is_active = any(not line.startswith("#") for line in lines)
                yield f'{"" if is_active else "# "}[signals."{one.signal.dotted}"]'
                yield from lines
                yield ""


def _ask(field: FieldDraft, signal: SignalFacts) -> Iterator[str]:
    if field.rule.kind is Kind.FLAG and signal.bits == 2 and not signal.names and not signal.is_sent:
        yield align("# not_available = [3]", "TODO in J1939, 2 is an error and 3 no value; both would count as 1")
    wanted = unit_of_field(field.rule.field)
    if field.rule.kind is not Kind.NUMBER or wanted is None:
        return
    if signal.known_unit is None:
        stated = f"{signal.unit!r} is not known" if signal.unit else "the DBC has none"
        range_text = "" if signal.low is None else f"; its range is {signal.low:g} … {signal.high:g}"
        spellings = _SPELLINGS.get(wanted.unit.quantity, wanted.name)
        yield align("# unit = …", f"TODO {spellings}: {stated}{range_text}")
    elif signal.known_unit.quantity != wanted.unit.quantity:
        yield align(_SCALE, f"the wheel's radius in m: its speed is in {signal.unit}")
    if field.rule.field in _WHEEL_ANGLES and _is_hand_wheel(signal):
        yield align(_SCALE, "1 / steering ratio: by name or range it is the steering wheel")
    if field.rule.field == "heading_rad" and _may_be_compass(signal):
        yield align(_SCALE, "-1.0 if it counts clockwise from north, 1.0 if counter-clockwise")
        yield align("# offset = 1.5707963", "TODO beside -1.0, so that 0 is east")


def _is_hand_wheel(signal: SignalFacts) -> bool:
    largest = signal.largest_si
    if largest is not None and largest > _LARGEST_ROAD_WHEEL_ANGLE_RAD:
        return True
    return {"steering", "wheel"} <= set(signal.words) and not {"front", "road"} & set(signal.words)


def _may_be_compass(signal: SignalFacts) -> bool:
    """Return whether a heading may be a compass heading: a range of one positive turn, or a comment on north."""
    largest, comment = signal.largest_si, signal.comment.lower()
    is_turn = signal.low == 0.0 and largest is not None and largest > _FULL_TURN_RAD
    is_left = "counter" in comment or "east" in comment
    return is_turn or (("clockwise" in comment or "north" in comment) and not is_left)


def write_message_notes(draft: Draft) -> Iterator[str]:
    """Write `[messages.M]`: the sender, where the DBC's sender sends in both directions; and missing periods."""
    received, sent = draft.bound_messages("state", "status"), draft.bound_messages("command", "body", "report")
    both = {message.sender for message in received} & {message.sender for message in sent}
    if len({message.sender for message in (*received, *sent)}) > 1:
        for message in (*received, *sent):
            if message.sender in both:
                sender = "controller" if message.is_sent else "vehicle"
                yield f"[messages.{message.name}]"
                yield align(f'sender = "{sender}"', f"by its name; {message.sender!r} sends in both directions")
                yield ""
    silent = [message.name for message in (*received, *sent) if not message.cycle_ms]
    if silent:
        yield f"# [messages.{silent[0]}]"
        yield align("# cycle_ms = …", f"TODO measure; no period in the DBC: {name_some(silent)}")
        yield ""


def find_e2e(draft: Draft) -> list[MessageFacts]:
    """Find bound messages for which the DBC's attributes state one common E2E profile."""
    bound = draft.bound_messages("state", "status", "command", "body", "report")
    stated = [message for message in bound if message.e2e_profile and _find(message, "checksum")]
    return [message for message in stated if message.e2e_profile == stated[0].e2e_profile]


def write_protection(draft: Draft) -> Iterator[str]:
    """Write `[e2e]` by the DBC's attributes; otherwise checksums and counters by their names, as comments."""
    stated = find_e2e(draft)
    if stated:
        crc, counter = _find(stated[0], "checksum"), _find(stated[0], "counter")
        yield align("[e2e]", "AUTOSAR end-to-end protection, as the DBC's attributes say")
        yield f"profile = {stated[0].e2e_profile}"
        yield f'crc_signal = "{crc}"'
        yield f'counter_signal = "{counter}"'
        yield ""
        yield "[e2e.data_ids]"
        yield from (f"{message.name} = {message.e2e_data_id:#05x}" for message in stated)
        yield ""
    rules: dict[tuple[str, str], list[str]] = {}
    for message in draft.bound_messages("state", "status", "command", "body", "report"):
        found = (_find(message, "checksum"), _find(message, "counter"))
        if message not in stated and any(found):
            rules.setdefault(found, []).append(message.name)
    for number, ((crc, counter), names) in enumerate(rules.items(), start=1):
        if number == 1:
            yield align("# [protection.rule]", "TODO ask the maker how they are computed; found by name")
            if crc:
                yield align(f'# checksum = {{ signal = "{crc}", kind = … }}', '"sum", "xor", "crc8", "autosar-1", …')
            if counter:
                yield f'# counter = {{ signal = "{counter}" }}'
            yield "# [protection.messages]"
            yield from (f'# {name} = "rule"' for name in names)
        else:
            yield f"# likewise {' and '.join(filter(None, (crc, counter)))} of {name_some(names)}"
    if rules:
        yield ""


def _find(message: MessageFacts, word: str) -> str:
    """Find the signal with that word, not of a wheel or another part; empty without one."""
    found = [
        signal
        for signal in message.signals
        if word in signal.words and not signal.unit and len({*signal.words} - signal.context) <= _MOST_WORDS
    ]
    return min(found, key=lambda signal: len(signal.words)).name if found else ""
