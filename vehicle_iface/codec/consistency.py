"""Finds contradictions between a profile and its DBC. Each check yields errors with file, place and remedy."""

import math
from collections.abc import Callable, Iterator, Sequence

from vehicle_iface import checks
from vehicle_iface.codec.binding import CONDITIONS, PERIODS, SENT_ROLES, Binding, Role
from vehicle_iface.codec.cantools_classes import Signal
from vehicle_iface.codec.command_faults import command_faults
from vehicle_iface.codec.condition_faults import condition_faults
from vehicle_iface.codec.constants import constant_faults
from vehicle_iface.codec.enumerations import enumeration_faults, frame_faults, name_map_faults
from vehicle_iface.codec.layout import Layout
from vehicle_iface.codec.protection_faults import protection_faults, rule_faults
from vehicle_iface.codec.send_faults import send_faults
from vehicle_iface.codec.signal_view import note_faults, unit_faults
from vehicle_iface.codec.usage import used_dbc_faults
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.profile.check import check_profile
from vehicle_iface.profile.forms import signals_of, value_of
from vehicle_iface.profile.signals import ModeConditions, StatusSignals

_COUNTS = ("ref_spatial_index", "ref_temporal_index", "deadline_misses")
"""Fields of the report that are plain numbers and need no VAL_ table."""
_ONE_SAMPLE = ("x_m", "y_m", "heading_rad", "latitude_deg", "longitude_deg", "speed_mps", "pose_frame")
"""Fields of the state that must be in the messages of the sample: position, frame of reference and speed."""


def find_faults(binding: Binding) -> list[ConfigError]:
    """Return all contradictions, each once."""
    faults = (fault for check in _CHECKS for fault in check(binding))
    return list({str(fault): fault for fault in faults}.values())


# --- names


def _bus_faults(binding: Binding) -> Iterator[ConfigError]:
    """Each name states its bus, and the profile is still valid with the names of the joined DBCs."""
    faults = binding.name_faults or (check_profile(binding.profile) if binding.file.parts else ())
    yield from (binding.fault(*fault.split(": ", 1)) for fault in faults)


def _signal_faults(binding: Binding) -> Iterator[ConfigError]:
    """Every signal of the profile exists, has one field, and is usable for it."""
    taken: dict[str, str] = {}
    for section, bindings in binding.sections.items():
        for field, signals in bindings.items():
            for dotted in signals:
                place, signal = f"$.{section}.signals.{field}", binding.find_signal(dotted)
                if field == "valid":
                    place = "$.state.pose.valid"
                if section == "status" and field not in StatusSignals.__struct_fields__:
                    place = f"$.status.{'when' if field in ModeConditions.__struct_fields__ else 'driver'}.{field}"
                if signal is None:
                    yield binding.missing_signal(dotted, place)
                elif field in CONDITIONS and section != "command":
                    continue  # a condition may look at what is bound to a field as well
                elif dotted in taken and taken[dotted] != field:
                    yield binding.fault(place, f"{dotted} is already bound to {taken[dotted]}")
                else:
                    taken[dotted] = field
                    yield from _usage_faults(binding, place, field, dotted, signal)


def _usage_faults(binding: Binding, place: str, field: str, dotted: str, signal: Signal) -> Iterator[ConfigError]:
    """A bound signal fits its field. In a received message it may be in a branch of a multiplexer."""
    for text in unit_faults(signal, binding.notes_of(dotted), field):
        yield binding.file.fault(dotted, text)
    if signal.is_multiplexer and binding.roles.get(dotted.partition(".")[0]) in SENT_ROLES:
        yield binding.fault(place, f"{dotted} is a multiplexer; give its value in [command.values]")


def _name_faults(binding: Binding) -> Iterator[ConfigError]:
    """Names that are not bound to a field exist: sample, ignored messages, constants."""
    profile = binding.profile
    for index, name in enumerate(profile.state.sample):
        if name not in binding.messages:
            yield binding.missing_message(name, f"$.state.sample[{index}]")
        elif name in profile.state.sample[:index]:
            yield binding.fault(f"$.state.sample[{index}]", f"{name} is listed twice")
    for name in profile.messages:
        if name not in binding.messages:
            yield binding.missing_message(name, f"$.messages.{name}")
        elif profile.messages[name].j1939 is not None and not binding.messages[name].is_extended_frame:
            text = f"{name} has an identifier of 11 bits; those of J1939 have 29"
            yield binding.fault(f"$.messages.{name}.j1939", text)
    for dotted, notes in profile.signals.items():
        if (signal := binding.find_signal(dotted)) is None:
            yield binding.missing_signal(dotted, f"$.signals.{dotted}")
        else:
            for text in note_faults(signal, notes):
                yield binding.fault(*f"$.signals.{dotted}{text}".split(": ", 1))
    for place, names in (("$.ignored", profile.ignored), ("$.constants", tuple(profile.constants))):
        for dotted in names:
            if binding.find_signal(dotted) is None:
                if place != "$.ignored" or binding.file.find_error(dotted) is None:
                    yield binding.missing_signal(dotted, place)
            elif dotted in binding.fields:
                yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted] or 'an echo'}")


def _sample_faults(binding: Binding) -> Iterator[ConfigError]:
    """Values that have a meaning only together are in one sample, and the frames of reference have usable names."""
    state = binding.profile.state
    for field in _ONE_SAMPLE:
        for dotted in signals_of(value_of(getattr(state.signals, field))):
            if dotted.partition(".")[0] not in state.sample:
                text = f"{dotted}: must be in a message of the sample: {', '.join(state.sample)}"
                yield binding.fault(f"$.state.signals.{field}", text)
    if state.trigger is not None and state.trigger not in state.sample:
        text = f"{state.trigger!r}: must be one of: {', '.join(state.sample)}"
        yield binding.fault("$.state.trigger", text)
    for name in state.max_age_s if isinstance(state.max_age_s, dict) else ():
        if name not in state.sample:
            yield binding.fault(f"$.state.max_age_s.{name}", f"must be one of: {', '.join(state.sample)}")
    protected = binding.profile.e2e.data_ids if binding.profile.e2e is not None else {}
    if state.assemble is None and any(name in protected for name in state.sample):
        for name in state.sample:
            if name in binding.messages and name not in protected:
                text = 'missing; the other parts of the sample have one; or give $.state.assemble = "newest"'
                yield binding.fault(f"$.{_protection_table(binding)}.{name}", text)
    if state.assemble == "counter":
        for key in ("trigger", "max_age_s"):
            if getattr(state, key) is not None:
                yield binding.fault(f"$.state.{key}", 'has an effect only with assemble = "newest"')
        for name in state.sample:
            if name in binding.messages and len(state.sample) > 1 and not binding.has_counter(name):
                text = 'missing; the parts of a sample need a counter, or assemble = "newest"'
                yield binding.fault(f"$.{_protection_table(binding)}.{name}", text)
    names = {"frame_id": state.frame_id} | {f"frames.{key}": name for key, name in state.frames.items()}
    for place, name in names.items():
        try:
            checks.frame_id("frame of reference", name)
        except InvalidValueError as error:
            yield binding.fault(f"$.state.{place}", str(error))


def _protection_table(binding: Binding) -> str:
    return "protection.messages" if binding.profile.protection else "e2e.data_ids"


# --- roles


def _role_faults(binding: Binding) -> Iterator[ConfigError]:
    """A sent message has one role; body and report are one message each."""
    for name, role in binding.role_claims():
        known = binding.roles[name]
        if known is not role and (role in SENT_ROLES or known in SENT_ROLES):
            yield binding.fault(
                f"$.{role.value}", f"{name} is a message of {known.value}, too; must have only one of these roles"
            )
    for role in (Role.BODY, Role.REPORT):
        names = [name for name, known in binding.roles.items() if known is role]
        if len(names) > 1:
            yield binding.fault(
                f"$.{role.value}.signals", f"all signals must be in one message, and are in {' and '.join(names)}"
            )


def _sender_faults(binding: Binding) -> Iterator[ConfigError]:
    """No node sends both messages that the program receives and messages that the program sends, unless the DBC names
    one node as the sender of everything."""
    for name, notes in binding.profile.messages.items():
        if name in binding.roles and notes.sender is not None:
            sender = "controller" if binding.roles[name] in SENT_ROLES else "vehicle"
            if notes.sender != sender:
                text = f"{notes.sender!r}, but the profile uses {name} as one that the {sender} sends"
                yield binding.fault(f"$.messages.{name}.sender", text)
    for bus in range(len(binding.profile.all_buses)):
        yield from _sender_faults_of([name for name in binding.roles if binding.find_bus(name) == bus], binding)


def _sender_faults_of(names: Sequence[str], binding: Binding) -> Iterator[ConfigError]:
    """Check the senders of the messages of one bus."""
    unstated = [name for name in names if binding.message_notes(name).sender is None]
    if len({tuple(binding.messages[name].senders) for name in names}) == 1:
        return
    senders = {
        node for name in unstated if binding.roles[name] in SENT_ROLES for node in binding.messages[name].senders
    }
    for name in unstated:
        both = senders.intersection(binding.messages[name].senders) if binding.roles[name] not in SENT_ROLES else set()
        if both:
            text = (
                f"is received, but its sender {min(both)} sends the commands; [messages.{name}] sender may correct it"
            )
            yield binding.file.fault(name, text)


def _period_faults(binding: Binding) -> Iterator[ConfigError]:
    """The profile's periods are those of the messages. Parts of a sample that is assembled by time may have others."""
    timing, state = binding.profile.timing, binding.profile.state
    trigger = state.trigger or state.sample[0]
    for name, role in binding.roles.items():
        cycle_ms = binding.cycle_ms(name)
        if not cycle_ms:
            continue
        is_other_part = role is Role.SAMPLE and name != trigger and not binding.is_counted
        is_one_of_several = role is Role.STATUS and len(binding.status_messages) > 1
        if is_other_part:
            longest_s = state.max_age_s if state.max_age_s is not None else timing.state_stale_s
            longest_s = longest_s.get(name, timing.state_stale_s) if isinstance(longest_s, dict) else longest_s
            if cycle_ms / 1000 > longest_s:
                text = f"{longest_s} s: must be at least the cycle of {name}, {cycle_ms:g} ms"
                yield binding.fault("$.state.max_age_s", text)
        elif role is Role.AUXILIARY or is_one_of_several:
            if cycle_ms / 1000 >= timing.status_stale_s:
                text = f"{timing.status_stale_s} s: must be above the cycle of {name}, {cycle_ms:g} ms"
                yield binding.fault("$.timing.status_stale_s", text)
        elif role in PERIODS:
            place = f"$.timing.{PERIODS[role]}"
            period_s = getattr(timing, PERIODS[role])
            if role is Role.COMMAND and name in binding.profile.command.periods:
                place, period_s = f"$.command.periods.{name}", binding.profile.command.periods[name]
            if not math.isclose(period_s, cycle_ms / 1000, rel_tol=1e-9):
                file = binding.file.part_of(name)
                where = f"below [messages.{name}]" if binding.message_notes(name).cycle_ms else f"in {file.name}"
                text = f"{period_s} s, but {name} has a cycle of {cycle_ms:g} ms {where}"
                yield binding.fault(place, text)


def _fd_faults(binding: Binding) -> Iterator[ConfigError]:
    """FD frames need an FD bus."""
    for number, (bus_name, bus) in enumerate(binding.profile.all_buses.items()):
        place = f"$.buses.{bus_name}.fd" if bus_name else "$.bus.fd"
        for name in binding.roles:
            if binding.messages[name].is_fd and not bus.fd and binding.find_bus(name) == number:
                yield binding.fault(place, f"false, but {name} is an FD frame in {binding.file.part_of(name).name}")


# --- messages


def _message_faults(binding: Binding) -> Iterator[ConfigError]:
    """Every bound message can be compiled, and is protected as the profile says."""
    for name, role in binding.roles.items():
        message, used = binding.messages[name], binding.signals_used(name)
        rules = {signal: binding.view(f"{name}.{signal}").rules for signal in used}
        try:
            layout = Layout.of(message, used, rules, is_flat=role in SENT_ROLES)
        except ConfigError as error:
            yield binding.file.fault(name, str(error))
            continue
        yield from _value_faults(binding, layout)
        yield from protection_faults(binding, message)
        for signal in message.signals:
            yield from enumeration_faults(binding, f"{name}.{signal.name}")


def _value_faults(binding: Binding, layout: Layout) -> Iterator[ConfigError]:
    for signal in layout.fields:
        dotted = f"{layout.message_name}.{signal.name}"
        if not signal.is_float and signal.allowed_raw()[0] > signal.allowed_raw()[1]:
            yield binding.file.fault(dotted, f"no value lies in its range [{signal.minimum}|{signal.maximum}]")
        if signal.missing and signal.is_float:
            yield binding.fault(f"$.signals.{dotted}.not_available", "a float has no raw numbers; give its range")
        named = len(signal.enumeration())
        if binding.fields.get(dotted) in _COUNTS and 0 < named <= signal.highest - signal.lowest:
            yield binding.file.fault(dotted, f"is a count, but its VAL_ table names only {named} of its numbers")


_CHECKS: tuple[Callable[[Binding], Iterator[ConfigError]], ...] = (
    _bus_faults,
    used_dbc_faults,
    _signal_faults,
    condition_faults,
    _name_faults,
    rule_faults,
    _sample_faults,
    _role_faults,
    _sender_faults,
    _period_faults,
    command_faults,
    _fd_faults,
    _message_faults,
    constant_faults,
    send_faults,
    frame_faults,
    name_map_faults,
)
