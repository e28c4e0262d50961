"""What a profile and its DBC disagree about: each check is a generator of errors with file, place and remedy."""

import math
from collections.abc import Callable, Iterator, Mapping

from cantools.database import Message, Signal

from vehicle_iface import checks
from vehicle_iface.codec.binding import PERIODS, SENT_ROLES, Binding, Role, resolution, suggest, value_range
from vehicle_iface.codec.e2e import Protection
from vehicle_iface.codec.enumerations import enumeration_faults, frame_faults
from vehicle_iface.codec.layout import Layout, bits_of
from vehicle_iface.codec.usage import used_dbc_faults
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.profile.schema import EndToEnd

UNITS: Mapping[str, tuple[str, ...]] = {
    "m": ("m",),
    "rad": ("rad",),
    "mps": ("m/s",),
    "mps2": ("m/s^2", "m/s²", "m/s2", "m/s/s", "m/(s^2)"),
    "radps": ("rad/s",),
    "nm": ("N*m", "N·m", "Nm", "N.m", "N m"),
}
"""The last part of a field's name, and how a DBC may write that unit."""
_COUNTS = ("ref_spatial_index", "ref_temporal_index", "deadline_misses")
"""Fields of the report in which every number means itself."""
_ONE_SAMPLE = ("x_m", "y_m", "heading_rad", "speed_mps", "pose_frame")
"""Fields of the state that must come in messages of its sample: where the vehicle is, in which frame, how fast."""


def find_faults(binding: Binding) -> list[ConfigError]:
    """Everything that does not fit, each once."""
    faults = (fault for check in _CHECKS for fault in check(binding))
    return list({str(fault): fault for fault in faults}.values())


# --- names


def _signal_faults(binding: Binding) -> Iterator[ConfigError]:
    """Every signal of the profile exists, has one field, and is usable for it."""
    taken: dict[str, str] = {}
    for section, bindings in binding.sections.items():
        for field, signals in bindings.items():
            for dotted in signals:
                place, signal = f"$.{section}.signals.{field}", binding.find_signal(dotted)
                if signal is None:
                    yield _missing_signal(binding, dotted, place)
                elif dotted in taken:
                    yield binding.fault(place, f"{dotted} is already bound to {taken[dotted]}")
                else:
                    taken[dotted] = field
                    yield from _usage_faults(binding, place, field, dotted, signal)


def _usage_faults(binding: Binding, place: str, field: str, dotted: str, signal: Signal) -> Iterator[ConfigError]:
    """A bound signal is not multiplexed, has the unit of its field, and a range."""
    if signal.multiplexer_ids or signal.multiplexer_signal or signal.is_multiplexer:
        yield binding.fault(place, f"{dotted} is multiplexed; bound signals must not be")
        return
    unit = field.rpartition("_")[2]
    if signal.unit and unit in UNITS and signal.unit not in UNITS[unit]:
        yield binding.file.fault(dotted, f"unit {signal.unit!r}: {field} must be in {UNITS[unit][0]!r}")
    if signal.length > 1 and (signal.minimum is None or signal.maximum is None):
        yield binding.file.fault(dotted, "no range; a signal that the program uses must have [min|max]")


def _name_faults(binding: Binding) -> Iterator[ConfigError]:
    """Names that are not a field's signals exist: sample, data ids, ignored, constants."""
    profile = binding.profile
    for index, name in enumerate(profile.state.sample):
        if name not in binding.messages:
            yield _missing_message(binding, name, f"$.state.sample[{index}]")
        elif name in profile.state.sample[:index]:
            yield binding.fault(f"$.state.sample[{index}]", f"{name} is there twice")
    for name in profile.e2e.data_ids if profile.e2e else ():
        if name not in binding.messages:
            yield _missing_message(binding, name, f"$.e2e.data_ids.{name}")
    for place, names in (("$.ignored", profile.ignored), ("$.constants", tuple(profile.constants))):
        for dotted in names:
            if binding.find_signal(dotted) is None:
                if place != "$.ignored" or binding.file.find_error(dotted) is None:
                    yield _missing_signal(binding, dotted, place)
            elif dotted in binding.fields:
                yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted]}")


def _missing_message(binding: Binding, name: str, place: str) -> ConfigError:
    text = f"no message {name!r} in {binding.file.name}{suggest(name, binding.messages)}"
    return binding.file.find_error(name) or binding.fault(place, text)


def _missing_signal(binding: Binding, dotted: str, place: str) -> ConfigError:
    message_name, _, name = dotted.partition(".")
    message = binding.messages.get(message_name)
    if message is None:
        return _missing_message(binding, message_name, place)
    names = [signal.name for signal in message.signals]
    text = f"no signal {name!r} in {message_name}{suggest(name, names)}"
    return binding.file.find_error(dotted) or binding.fault(place, text)


def _sample_faults(binding: Binding) -> Iterator[ConfigError]:
    """Values that mean nothing without one another are of one sample; frames of reference have usable names."""
    state = binding.profile.state
    for field in _ONE_SAMPLE:
        dotted = getattr(state.signals, field)
        if dotted is not None and dotted.partition(".")[0] not in state.sample:
            text = f"{dotted}: must be in a message of the sample: {', '.join(state.sample)}"
            yield binding.fault(f"$.state.signals.{field}", text)
    names = {"frame_id": state.frame_id} | {f"frames.{key}": name for key, name in state.frames.items()}
    for place, name in names.items():
        try:
            checks.frame_id("frame of reference", name)
        except InvalidValueError as error:
            yield binding.fault(f"$.state.{place}", str(error))


# --- roles


def _role_faults(binding: Binding) -> Iterator[ConfigError]:
    """A sent message has one role; status is apart from the sample; body and report are one message each."""
    for name, role in binding.role_claims():
        known = binding.roles[name]
        if known is not role and (role in SENT_ROLES or known in SENT_ROLES):
            yield binding.fault(
                f"$.{role.value}", f"{name} is a message of {known.value}, too; must have only one of these roles"
            )
        elif known is not role and role is Role.STATUS:
            yield binding.fault(
                "$.status.signals.mode", f"{name} is part of the state sample; must be in another message"
            )
    for role in (Role.BODY, Role.REPORT):
        names = [name for name, known in binding.roles.items() if known is role]
        if len(names) > 1:
            yield binding.fault(
                f"$.{role.value}.signals", f"all signals must be in one message, and are in {' and '.join(names)}"
            )


def _sender_faults(binding: Binding) -> Iterator[ConfigError]:
    """No node sends both what the program receives and what it sends."""
    sent = [name for name, role in binding.roles.items() if role in SENT_ROLES]
    senders = {node for name in sent for node in binding.messages[name].senders}
    for name, role in binding.roles.items():
        both = senders.intersection(binding.messages[name].senders) if role not in SENT_ROLES else set()
        if both:
            yield binding.file.fault(name, f"is received, but its sender {min(both)} sends the commands")


def _period_faults(binding: Binding) -> Iterator[ConfigError]:
    timing = binding.profile.timing
    for name, role in binding.roles.items():
        cycle_ms = binding.messages[name].cycle_time
        if not cycle_ms:
            continue
        if role is Role.AUXILIARY and cycle_ms / 1000 >= timing.status_stale_s:
            text = f"{timing.status_stale_s} s: must be above the cycle of {name}, {cycle_ms} ms"
            yield binding.fault("$.timing.status_stale_s", text)
        elif role in PERIODS:
            period_s = getattr(timing, PERIODS[role])
            if not math.isclose(period_s, cycle_ms / 1000, rel_tol=1e-9):
                text = f"{period_s} s, but {name} has a cycle of {cycle_ms} ms in {binding.file.name}"
                yield binding.fault(f"$.timing.{PERIODS[role]}", text)


def _fd_faults(binding: Binding) -> Iterator[ConfigError]:
    """FD frames need an FD bus."""
    for name in binding.roles:
        if binding.messages[name].is_fd and not binding.profile.bus.fd:
            yield binding.fault("$.bus.fd", f"false, but {name} is an FD frame in {binding.file.name}")


# --- limits


def _limit_faults(binding: Binding) -> Iterator[ConfigError]:
    """What may be commanded lies in the range of the signal that carries it."""
    limits = binding.profile.limits
    limited: tuple[tuple[str, str, tuple[float, ...]], ...] = (
        ("front_wheel_angle_rad", "front_wheel_angle_rad", _both_signs(limits.front_wheel_angle_rad)),
        ("rear_wheel_angle_rad", "rear_wheel_angle_rad", _both_signs(limits.rear_wheel_angle_rad)),
        ("accel_max_mps2", "accel_mps2", (limits.accel_max_mps2,)),
        ("accel_min_mps2", "accel_mps2", (limits.accel_min_mps2,)),
        ("speed_max_mps", "speed_mps", _both_signs(limits.speed_max_mps)),
    )
    for key, field, values in limited:
        for dotted, signal in binding.get_signals("command", field).items():
            low, high = value_range(signal)
            if any(not low <= value <= high for value in values):
                yield binding.fault(f"$.limits.{key}", f"{values[0]}: {dotted} is in [{low:.10g}, {high:.10g}]")


def _both_signs(limit: float) -> tuple[float, float]:
    return limit, -limit


def _rate_faults(binding: Binding) -> Iterator[ConfigError]:
    """What is slower than one count of its signal from sample to sample would never move."""
    limits, period_s = binding.profile.limits, binding.profile.timing.sample_period_s
    rates = [
        ("accel_rate_mps3", "accel_mps2", limits.accel_rate_mps3),
        ("front_wheel_rate_radps", "front_wheel_angle_rad", limits.front_wheel_rate_radps),
    ]
    if limits.rear_wheel_angle_rad > 0.0:
        rates.append(("rear_wheel_rate_radps", "rear_wheel_angle_rad", limits.rear_wheel_rate_radps))
    for key, field, per_s in rates:
        for dotted, signal in sorted(binding.get_signals("command", field).items()):
            count, step = resolution(signal), per_s * period_s
            if step < count * (1.0 - 1e-6):
                text = f"{per_s}: {field} may change by {step:.4g} in {period_s} s, less than one count of {dotted}"
                yield binding.fault(f"$.limits.{key}", f"{text} ({count:.4g}): it could never change")


# --- messages


def _message_faults(binding: Binding) -> Iterator[ConfigError]:
    """Every bound message can be compiled, is protected where it must be, and is known to its last signal."""
    for name, role in binding.roles.items():
        message = binding.messages[name]
        try:
            layout = Layout.of(message)
        except ConfigError as error:
            yield binding.file.fault(name, str(error))
            continue
        yield from _value_faults(binding, layout)
        yield from _protection_faults(binding, message)
        if role is Role.SAMPLE and not binding.is_protected(name) and len(binding.profile.state.sample) > 1:
            yield binding.fault(f"$.e2e.data_ids.{name}", "missing; the parts of a sample need a counter")
        yield from _unused_faults(binding, message, role)
        for signal in message.signals:
            yield from enumeration_faults(binding, f"{name}.{signal.name}")


def _value_faults(binding: Binding, layout: Layout) -> Iterator[ConfigError]:
    for signal in layout.fields:
        dotted = f"{layout.message_name}.{signal.name}"
        if not signal.is_float and signal.allowed_raw()[0] > signal.allowed_raw()[1]:
            yield binding.file.fault(dotted, f"no value lies in its range [{signal.minimum}|{signal.maximum}]")
        named = len(signal.enumeration())
        if binding.fields.get(dotted) in _COUNTS and 0 < named <= signal.highest - signal.lowest:
            yield binding.file.fault(dotted, f"is a count, but its VAL_ table names only {named} of its numbers")


def _unused_faults(binding: Binding, message: Message, role: Role) -> Iterator[ConfigError]:
    """Every signal is bound, or protects the message, or is named as of no use."""
    profile = binding.profile
    known = {*binding.fields, *profile.constants, *profile.ignored}
    if profile.e2e is not None and binding.is_protected(message.name):
        known |= {f"{message.name}.{profile.e2e.crc_signal}", f"{message.name}.{profile.e2e.counter_signal}"}
    remedy = "bind it or give it under constants" if role in SENT_ROLES else "bind it or list it under ignored"
    for signal in message.signals:
        dotted = f"{message.name}.{signal.name}"
        if dotted not in known:
            yield binding.file.fault(dotted, f"is not used by {binding.profile_name}; {remedy}")


# --- protection


def _protection_faults(binding: Binding, message: Message) -> Iterator[ConfigError]:
    """Profile and DBC agree on checksum, counter and data id of a protected message."""
    rules = binding.profile.e2e
    if rules is None or not binding.is_protected(message.name):
        return
    place, data_id = f"$.e2e.data_ids.{message.name}", rules.data_ids[message.name]
    attributes = message.dbc.attributes if message.dbc else {}
    stated_id, stated_profile = attributes.get("E2EDataId"), attributes.get("E2EProfile")
    if stated_id is not None and isinstance(data_id, int) and stated_id.value != data_id:
        yield binding.fault(place, f"{data_id:#x}, but E2EDataId is {stated_id.value:#x} in {binding.file.name}")
    if stated_profile is not None and stated_profile.value not in (0, rules.profile):
        text = f"{rules.profile}, but E2EProfile of {message.name} is {stated_profile.value} in {binding.file.name}"
        yield binding.fault("$.e2e.profile", text)
    try:
        protection = Protection(rules.profile, data_id, message.length, rules.data_id_mode)
    except ConfigError as error:
        yield binding.fault(place, str(error))
        return
    most = protection.counter_states - 2
    if rules.max_counter_step > most:
        yield binding.fault("$.e2e.max_counter_step", f"{rules.max_counter_step}: must be at most {most}")
    yield from _header_faults(binding, rules, message, protection)
    if rules.data_id_mode == "NIBBLE":
        for signal in message.signals:
            if set(bits_of(signal)).intersection(range(12, 16)):
                yield binding.file.fault(f"{message.name}.{signal.name}", "bits 12|4 hold the data id's nibble")


def _header_faults(
    binding: Binding, rules: EndToEnd, message: Message, protection: Protection
) -> Iterator[ConfigError]:
    """Checksum and counter are where the E2E profile puts them, and are nothing else."""
    for key, name, bits in (
        ("crc_signal", rules.crc_signal, protection.crc_bits),
        ("counter_signal", rules.counter_signal, protection.counter_bits),
    ):
        place, dotted = f"$.e2e.{key}", f"{message.name}.{name}"
        signal = binding.find_signal(dotted)
        if signal is None:
            yield _missing_signal(binding, dotted, place)
        elif (_first_bit(signal), signal.length) != bits:
            wanted = f"E2E profile {rules.profile} has {bits[0]}|{bits[1]}"
            yield binding.file.fault(dotted, f"bits {signal.start}|{signal.length}, but {wanted}")
        elif dotted in binding.fields:
            yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted]}")


def _first_bit(signal: Signal) -> int:
    """Lowest bit of a signal in little-endian numbering; within one byte the byte orders agree."""
    return min(bits_of(signal)) if signal.length <= 8 else signal.start


_CHECKS: tuple[Callable[[Binding], Iterator[ConfigError]], ...] = (
    used_dbc_faults,
    _signal_faults,
    _name_faults,
    _sample_faults,
    _role_faults,
    _sender_faults,
    _period_faults,
    _limit_faults,
    _rate_faults,
    _fd_faults,
    _message_faults,
    frame_faults,
)
