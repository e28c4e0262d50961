"""Facts of a DBC about its messages and signals that indicate their purpose."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.codec.dbc_text import read_text, split_statements
from vehicle_iface.codec.quantities import Unit, find_unit
from vehicle_iface.drafting.directions import MessageSource, find_sent_messages
from vehicle_iface.drafting.words import common_beginning, split_words

_BIT_RATE = re.compile(r'"Baudrate"\s+(\d+)')
_NO_UNIT = frozenset({"", "-", "1", "none", "n/a", "na", "bool", "enum", "unitless"})
_LARGEST_FLAG = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalFacts:
    """Facts about one signal."""

    message: str
    name: str
    line: int
    words: tuple[str, ...]
    context: frozenset[str]
    """The words of the message's name, and those with which all of its signals begin."""
    unit: str
    """Unit as in the DBC; empty where it is none."""
    known_unit: Unit | None
    low: float | None
    """Lower end of the DBC's range, in the DBC's unit; None where it states none."""
    high: float | None
    bits: int
    names: Mapping[int, str]
    comment: str
    is_sent: bool
    """Whether the program sends it; otherwise the vehicle does."""
    is_multiplexer: bool
    multiplexer: str
    """Multiplexer that determines whether this signal is present; empty where it always is."""

    @property
    def dotted(self) -> str:
        """MESSAGE.SIGNAL."""
        return f"{self.message}.{self.name}"

    @property
    def is_flag(self) -> bool:
        """Whether the signal is a flag, by its bits, range or table."""
        if self.unit or len(self.names) > 4:
            return False
        return self.bits <= 2 or (self.high == _LARGEST_FLAG and self.low == 0)

    @property
    def largest_si(self) -> float | None:
        """The greatest magnitude of its range, in SI; None where range or unit is not known."""
        if self.low is None or self.high is None or self.known_unit is None:
            return None
        return max(abs(self.low), abs(self.high)) * self.known_unit.factor


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageFacts:
    """One message with its signals."""

    name: str
    line: int
    sender: str
    is_sent: bool
    is_fd: bool
    cycle_ms: int
    """Cycle time; 0 where the DBC states none."""
    e2e_profile: int
    """E2E profile by the attributes E2EProfile and E2EDataId; 0 where the DBC has none."""
    e2e_data_id: int
    signals: tuple[SignalFacts, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """Facts about a DBC."""

    path: Path
    messages: Mapping[str, MessageFacts]
    bit_rate: int | None
    """Bit rate by the attribute Baudrate."""
    unusable: int
    """Faults that caused messages or signals to be left out."""

    @property
    def signals(self) -> Iterator[SignalFacts]:
        return (signal for message in self.messages.values() for signal in message.signals)


def survey_dbc(path: Path) -> Survey:
    """Read a DBC and describe what is in it. `ConfigError` for a file that cannot be used."""
    file = read_dbc(path)
    sent = find_sent_messages(
        [
            MessageSource(
                name=message.name,
                senders=tuple(message.senders),
                receivers=frozenset(node for signal in message.signals for node in signal.receivers),
                signal_words=tuple(split_words(signal.name) for signal in message.signals),
            )
            for message in file.messages.values()
        ]
    )
    return Survey(
        path=path,
        messages={name: _describe_message(file, name, name in sent) for name in _message_names(file)},
        bit_rate=_find_bit_rate(path),
        unusable=len(file.errors),
    )


def _message_names(file: DbcFile) -> Iterator[str]:
    return iter(file.messages)


def _describe_message(file: DbcFile, name: str, is_sent: bool) -> MessageFacts:
    message = file.messages[name]
    stated = file.e2e.get(name)
    context = frozenset((*split_words(name), *common_beginning([split_words(one.name) for one in message.signals])))
    return MessageFacts(
        name=name,
        line=file.lines.get(name, 0),
        sender=", ".join(message.senders),
        is_sent=is_sent,
        is_fd=message.is_fd,
        cycle_ms=message.cycle_time or 0,
        e2e_profile=(stated.profile if stated else None) or 0,
        e2e_data_id=(stated.data_id if stated else None) or 0,
        signals=tuple(_describe_signal(file, name, signal.name, context, is_sent) for signal in message.signals),
    )


def _describe_signal(file: DbcFile, message: str, name: str, context: frozenset[str], is_sent: bool) -> SignalFacts:
    signal = file.messages[message].get_signal_by_name(name)
    unit = (signal.unit or "").strip()
    low, high = signal.minimum, signal.maximum
    return SignalFacts(
        message=message,
        name=name,
        line=file.lines.get(f"{message}.{name}", 0),
        words=split_words(name),
        context=context,
        unit="" if unit.lower() in _NO_UNIT else unit,
        known_unit=None if unit.lower() in _NO_UNIT else find_unit(unit),
        low=None if low is None else float(low),
        high=None if high is None else float(high),
        bits=signal.length,
        names={int(number): str(value) for number, value in (signal.choices or {}).items()},
        comment=signal.comment or "",
        is_sent=is_sent,
        is_multiplexer=bool(signal.is_multiplexer),
        multiplexer=signal.multiplexer_signal or "",
    )


def _find_bit_rate(path: Path) -> int | None:
    for statement in split_statements(path.name, read_text(path)):
        if statement.keyword == "BA_" and (found := _BIT_RATE.fullmatch(statement.body)):
            return int(found[1]) or None
    return None
