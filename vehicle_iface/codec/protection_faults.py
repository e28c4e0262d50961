"""Finds faults in the protection that a profile states: in the rules alone, then in each message with its rule."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from vehicle_iface.codec.binding import Binding, suggest
from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.e2e import autosar_protection, header_bits
from vehicle_iface.codec.layout import bits_of
from vehicle_iface.codec.protection_rules import (
    CRC_BITS,
    DEFAULT_STEP,
    MessageRule,
    count_states,
    find_places,
    find_rule,
)
from vehicle_iface.codec.user_checksum import check_function, load_function
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile.protection import Checksum, ProtectedMessage, ProtectionRule

_FORMULA = ("over", "init", "xor_out", "table")
_CRC = (*_FORMULA, "poly", "reflect")
_KEYS: Mapping[str, tuple[str, ...]] = {
    "autosar-1": ("data_id_mode",),
    "autosar-2": ("table",),
    "autosar-5": (),
    "autosar-11": ("data_id_mode",),
    "sum": _FORMULA,
    "xor": _FORMULA,
    "crc8": _CRC,
    "crc16": _CRC,
    "python": ("function",),
}
"""The keys that each kind of checksum has in addition to `signal` and `kind`."""
_NEEDED = {"crc8": "poly", "crc16": "poly", "python": "function"}
_LEAST_STATES = 3
"""The smallest number of counter values: a repeated, a next and a wrong counter must differ."""


def rule_faults(binding: Binding) -> Iterator[ConfigError]:
    """The protected messages exist, each has one rule, and the rules are complete."""
    profile = binding.profile
    data_ids = profile.e2e.data_ids if profile.e2e else {}
    for name in data_ids:
        if name not in binding.messages:
            yield binding.missing_message(name, f"$.e2e.data_ids.{name}")
    if profile.protection is None:
        return
    rules = profile.protection.rules
    for name, rule in rules.items():
        yield from _single_rule_faults(binding, f"$.protection.{name}", rule)
    for name, stated in profile.protection.messages.items():
        place = f"$.protection.messages.{name}"
        used = stated.use if isinstance(stated, ProtectedMessage) else stated
        if name not in binding.messages:
            yield binding.missing_message(name, place)
        if name in data_ids:
            yield binding.fault(place, f"{name} is in $.e2e.data_ids as well; must have one protection")
        if used not in rules:
            yield binding.fault(place, f"no rule [protection.{used}]{suggest(used, rules)}")


def _single_rule_faults(binding: Binding, place: str, rule: ProtectionRule) -> Iterator[ConfigError]:
    """A rule has a checksum or a counter, and the keys of its checksum's kind."""
    checksum, counter = rule.checksum, rule.counter
    if checksum is None:
        if counter is None:
            yield binding.fault(place, "must have a checksum or a counter")
        return
    place = f"{place}.checksum"
    needed, known = _NEEDED.get(checksum.kind), _KEYS[checksum.kind]
    if needed is not None and getattr(checksum, needed) is None:
        yield binding.fault(place, f"{needed} is missing; kind {checksum.kind!r} needs it")
    defaults = Checksum(signal=checksum.signal, kind=checksum.kind)
    for key in Checksum.__struct_fields__:
        if key not in known and getattr(checksum, key) != getattr(defaults, key):
            has = f"has {', '.join(known)} only" if known else "has no further keys"
            yield binding.fault(f"{place}.{key}", f"is not a key of kind {checksum.kind!r}, which {has}")
    if len(set(checksum.over)) < len(checksum.over):
        yield binding.fault(f"{place}.over", f"{list(checksum.over)}: each part at most once")
    if counter is None and (checksum.kind.startswith("autosar-") or "counter" in checksum.over):
        yield binding.fault(place, "there is no counter; name its signal under counter")
    if counter is not None and counter.signal == checksum.signal:
        yield binding.fault(f"{place}.signal", f"{checksum.signal} is the counter as well")
    bits = CRC_BITS.get(checksum.kind)
    for key in ("poly", "init", "xor_out") if bits else ():
        yield from _width_faults(binding, f"{place}.{key}", getattr(checksum, key) or 0, bits or 0, checksum.kind)
    if checksum.kind == "python" and checksum.function is not None:
        try:
            load_function(checksum.function, Path(binding.profile.file).parent)
        except ConfigError as error:
            yield binding.fault(f"{place}.function", str(error))


def _width_faults(binding: Binding, place: str, value: int, bits: int, owner: str) -> Iterator[ConfigError]:
    if value >> bits:
        yield binding.fault(place, f"{value:#x}: must be at most {(1 << bits) - 1:#x}, {owner} has {bits} bits")


def protection_faults(binding: Binding, message: Message) -> Iterator[ConfigError]:
    """Profile and DBC agree on checksum, counter and data id of a protected message."""
    rule = find_rule(binding.profile, message.name)
    if rule is None:
        return
    if rule.autosar_profile is not None:
        yield from _autosar_faults(binding, message, rule, rule.autosar_profile)
    else:
        yield from _part_faults(binding, message, rule)


# --- AUTOSAR


def _autosar_faults(binding: Binding, message: Message, rule: MessageRule, profile: int) -> Iterator[ConfigError]:
    place, data_id = rule.data_id_place, rule.data_id
    file, stated = binding.file.part_of(message.name), binding.file.e2e.get(message.name)
    if stated and stated.data_id is not None and isinstance(data_id, int) and stated.data_id != data_id:
        yield binding.fault(place, f"{data_id:#x}, but E2EDataId is {stated.data_id:#x} in {file.name}")
    if stated and stated.profile not in (None, 0, profile):
        text = f"{profile}, but E2EProfile of {message.name} is {stated.profile} in {file.name}"
        yield binding.fault(rule.kind_place, text)
    if data_id is None:
        yield binding.fault(place, f"no data_id; E2E profile {profile} needs one")
        return
    mode = (rule.checksum.data_id_mode if rule.checksum else None) or "BOTH"
    try:
        protection = autosar_protection(profile, data_id, message.length, mode)
    except ConfigError as error:
        yield binding.fault(place, str(error))
        return
    yield from _step_faults(binding, rule, protection.counter_states)
    yield from _header_faults(binding, rule, message, profile)
    if mode == "NIBBLE":
        for signal in message.signals:
            if set(bits_of(signal)).intersection(range(12, 16)):
                yield binding.file.fault(f"{message.name}.{signal.name}", "bits 12|4 hold the data id's nibble")


def _header_faults(binding: Binding, rule: MessageRule, message: Message, profile: int) -> Iterator[ConfigError]:
    """Checksum and counter are where the E2E profile puts them, and are not bound to anything else."""
    header = header_bits(profile)
    for place, part, bits in (
        (rule.checksum_place, rule.checksum, header.checksum),
        (rule.counter_place, rule.counter, header.counter),
    ):
        if part is None:
            continue
        dotted = f"{message.name}.{part.signal}"
        signal = binding.find_signal(dotted)
        if signal is None:
            yield binding.missing_signal(f"{message.name}.{part.signal}", place)
        elif (_first_bit(signal), signal.length) != bits:
            wanted = f"E2E profile {profile} has {bits[0]}|{bits[1]}"
            yield binding.file.fault(dotted, f"bits {signal.start}|{signal.length}, but {wanted}")
        elif dotted in binding.fields:
            yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted] or 'an echo'}")


def _first_bit(signal: Signal) -> int:
    """Return the lowest bit of a signal in little-endian numbering; within one byte the byte orders agree."""
    return min(bits_of(signal)) if signal.length <= 8 else signal.start


# --- parts


def _part_faults(binding: Binding, message: Message, rule: MessageRule) -> Iterator[ConfigError]:
    """Checksum and counter are integers of the message with enough bits, and are not bound to anything else."""
    if rule.counter is not None:
        yield from _signal_faults(binding, message, rule.counter.signal, rule.counter_place)
        counter = binding.find_signal(f"{message.name}.{rule.counter.signal}")
        if counter is not None and not counter.is_float:
            yield from _counter_faults(binding, message, rule, counter)
    if rule.checksum is not None:
        yield from _signal_faults(binding, message, rule.checksum.signal, rule.checksum_place)
        checksum = binding.find_signal(f"{message.name}.{rule.checksum.signal}")
        if checksum is not None and not checksum.is_float:
            yield from _checksum_faults(binding, message, rule, rule.checksum, checksum)
    yield from _data_id_faults(binding, message, rule)


def _signal_faults(binding: Binding, message: Message, name: str, place: str) -> Iterator[ConfigError]:
    dotted = f"{message.name}.{name}"
    signal = binding.find_signal(dotted)
    if signal is None:
        yield binding.missing_signal(f"{message.name}.{name}", place)
    elif signal.is_float:
        yield binding.file.fault(dotted, f"is a float; {place} needs an integer")
    elif signal.multiplexer_ids or signal.is_multiplexer:
        yield binding.file.fault(dotted, f"is multiplexed; {place} needs a signal of every frame")
    elif dotted in binding.fields:
        yield binding.fault(place, f"{dotted} is bound to {binding.fields[dotted] or 'an echo'}")


def _counter_faults(binding: Binding, message: Message, rule: MessageRule, signal: Signal) -> Iterator[ConfigError]:
    dotted, states = f"{message.name}.{signal.name}", count_states(signal)
    if not signal.is_signed and signal.minimum is not None and signal.minimum > signal.offset:
        yield binding.file.fault(dotted, f"range from {signal.minimum}: a counter must begin at {signal.offset}")
    elif states < _LEAST_STATES:
        text = f"{states} values: a counter needs {_LEAST_STATES} at least"
        yield binding.file.fault(dotted, f"{text}; leave {rule.counter_place.removesuffix('.signal')} out")
    else:
        yield from _step_faults(binding, rule, states)


def _step_faults(binding: Binding, rule: MessageRule, states: int) -> Iterator[ConfigError]:
    step = (rule.counter.max_step if rule.counter else None) or min(DEFAULT_STEP, states - 2)
    if step > states - 2:
        yield binding.fault(rule.max_step_place, f"{step}: must be at most {states - 2}")


def _checksum_faults(
    binding: Binding, message: Message, rule: MessageRule, checksum: Checksum, signal: Signal
) -> Iterator[ConfigError]:
    dotted, place = f"{message.name}.{signal.name}", rule.checksum_place.removesuffix(".signal")
    bits = CRC_BITS.get(checksum.kind, 1)
    if signal.length < bits:
        yield binding.file.fault(dotted, f"{signal.length} bits; kind {checksum.kind!r} needs {bits}")
    for key in ("init", "xor_out") if checksum.kind in ("sum", "xor") else ():
        yield from _width_faults(binding, f"{place}.{key}", getattr(checksum, key), signal.length, dotted)
    if checksum.kind == "python" and checksum.function is not None:
        try:
            function = load_function(checksum.function, Path(binding.profile.file).parent)
        except ConfigError:
            return  # reported with the rule
        fault = check_function(function, message.frame_id, message.length, find_places(message)[signal.name])
        if fault:
            yield binding.fault(f"{place}.function", f"{checksum.function!r} for {message.name}: {fault}")


def _data_id_faults(binding: Binding, message: Message, rule: MessageRule) -> Iterator[ConfigError]:
    """A data id is stated if the checksum covers one, and a list has a byte for each value of the counter."""
    place, data_id = rule.data_id_place, rule.data_id
    if rule.checksum is None or rule.checksum.kind == "python":
        if data_id is not None:
            yield binding.fault(place, f"data_id: no checksum of {message.name} covers it")
    elif data_id is None and "data_id" in rule.over:
        yield binding.fault(place, "no data_id; the checksum covers one")
    elif isinstance(data_id, tuple) and len(data_id) != 1:
        signal = binding.find_signal(f"{message.name}.{rule.counter.signal}") if rule.counter else None
        states = count_states(signal) if signal is not None and not signal.is_float else 1
        if len(data_id) != states:
            allowed = f"1 or {states}, one for each value of the counter" if states > 1 else "1, without a counter"
            yield binding.fault(place, f"data id of {len(data_id)} bytes; must be {allowed}")


# --- what is allowed, but matters for control


def describe_gap(binding: Binding, message_name: str) -> str:
    """Describe what the protection of a message cannot detect; empty if it has checksum and counter."""
    rule = find_rule(binding.profile, message_name)
    if rule is None:
        return "no counter and no checksum: repeated and damaged frames are not detected"
    if rule.counter is None:
        return "a checksum but no counter: repeated and lost frames are not detected"
    if rule.checksum is None:
        return "a counter but no checksum: damaged frames are not detected"
    return ""
