"""Warnings about DBC messages that are usable but incomplete: ranges, units, cycle times."""

from collections.abc import Iterator

from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.dbc_file import DbcFile
from vehicle_iface.codec.dbc_findings import ERROR, WARNING, DbcFinding
from vehicle_iface.codec.layout import Layout
from vehicle_iface.codec.quantities import find_unit
from vehicle_iface.errors import ConfigError


def find_range_doubts(file: DbcFile) -> Iterator[DbcFinding]:
    """Yield warnings about ranges whose ends the bits cannot express."""
    for message in file.messages.values():
        for signal in message.signals:
            text = _range_beyond_bits(signal)
            if text:
                yield signal_finding(file, message, signal, WARNING, text, "range beyond what the bits express")


def find_doubts(file: DbcFile) -> Iterator[DbcFinding]:
    """Yield warnings that matter only for signals that a profile uses."""
    for message in file.messages.values():
        yield from find_cycle_doubts(file, message)
        yield from _impossible_ranges(file, message)
        for signal in message.signals:
            if signal.length > 1 and not signal.choices and (signal.minimum is None or signal.maximum is None):
                yield signal_finding(file, message, signal, WARNING, "no range", "no range")
            yield from _unit_doubts(file, message, signal)


def find_cycle_doubts(file: DbcFile, message: Message, cycle_ms: float | None = None) -> Iterator[DbcFinding]:
    if not message.cycle_time and cycle_ms is None:
        yield message_finding(file, message.name, WARNING, "no cycle time", "no cycle time")


def message_finding(file: DbcFile, name: str, severity: str, text: str, kind: str) -> DbcFinding:
    line = file.lines.get(name, 0)
    return DbcFinding(line=line, severity=severity, about=(name,), text=f"{name}: {text}", kind=kind)


def signal_finding(file: DbcFile, message: Message, signal: Signal, severity: str, text: str, kind: str) -> DbcFinding:
    return message_finding(file, f"{message.name}.{signal.name}", severity, text, kind)


def _range_beyond_bits(signal: Signal) -> str:
    """Describe what is wrong with the range; empty if the bits can express both ends."""
    if signal.is_float or signal.minimum is None or signal.maximum is None:
        return ""
    least = -(1 << signal.length - 1) if signal.is_signed else 0
    most = (1 << signal.length - bool(signal.is_signed)) - 1
    low, high = sorted(raw * signal.scale + signal.offset for raw in (least, most))
    step = abs(signal.scale) * 1e-6
    if low - step <= signal.minimum and signal.maximum <= high + step:
        return ""
    return f"range [{signal.minimum}|{signal.maximum}]: {signal.length} bits express [{low:.10g}|{high:.10g}]"


def _impossible_ranges(file: DbcFile, message: Message) -> Iterator[DbcFinding]:
    """Yield warnings about ranges without a value, and messages that cannot be compiled."""
    try:
        fields = Layout.of(message).fields
    except ConfigError as error:
        text = str(error).removeprefix(f"{message.name}: ")
        yield message_finding(file, message.name, ERROR, text, "messages that cannot be compiled")
        return
    for field, signal in zip(fields, message.signals, strict=True):
        if field.minimum is None or field.maximum is None or field.is_float or field.minimum > field.maximum:
            continue
        low, high = sorted((field.scaled(field.raw_minimum), field.scaled(field.raw_maximum)))
        if min(high, field.maximum) - max(low, field.minimum) >= abs(field.scale):
            continue  # wide enough for one; only a narrow one has to be searched
        if field.allowed_raw()[0] > field.allowed_raw()[1]:
            text = f"no value lies in its range [{field.minimum}|{field.maximum}]"
            yield signal_finding(file, message, signal, ERROR, text, "ranges without a value")


def _unit_doubts(file: DbcFile, message: Message, signal: Signal) -> Iterator[DbcFinding]:
    """Yield warnings about unknown units, and about scaled numbers without a unit."""
    if signal.unit and find_unit(signal.unit) is None:
        yield signal_finding(
            file, message, signal, WARNING, f"unit {signal.unit!r} is not known", "unit that is not known"
        )
    elif not signal.unit and (signal.scale != 1 or signal.is_float):
        text = "a scaled number without a unit"
        yield signal_finding(file, message, signal, WARNING, text, text)
