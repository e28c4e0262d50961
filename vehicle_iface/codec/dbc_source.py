"""The messages and signals of a DBC as written, before they are checked or repaired."""

import math
import re
from collections.abc import Iterable, Mapping

import msgspec

from vehicle_iface.codec.dbc_findings import DbcFindings
from vehicle_iface.codec.dbc_text import STRING, Statement, cut_short
from vehicle_iface.value import Value

NUMBER = r"[-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d{1,4})?"
_UNASSIGNED = "VECTOR__INDEPENDENT_SIG_MSG"
"""The pseudo-message in which editors keep signals that belong to no message."""
_MESSAGE = re.compile(r"(?P<number>\d{1,10})\s+(?P<name>\w+)\s*:\s*(?P<length>\d{1,5})\s*(?P<sender>\w*)")
_SIGNAL = re.compile(
    r"(?P<name>\w+)(?:\s++(?P<marker>M|m\d{1,10}M?))?\s*+:\s*(?P<start>\d{1,5})\s*\|\s*"
    rf"(?P<length>\d{{1,5}})\s*@\s*(?P<order>[01])\s*(?P<sign>[-+])\s*\(\s*(?P<scale>{NUMBER})\s*,\s*(?P<offset>{NUMBER})\s*\)\s*"
    rf"\[\s*(?P<minimum>{NUMBER})\s*\|\s*(?P<maximum>{NUMBER})\s*\]\s*(?P<unit>{STRING})\s*(?P<receivers>[\w\s,]*)"
)
_UNKNOWN_KEYWORD = re.compile(r"[A-Z][A-Z0-9_]*_(?!\S)")
_LAYOUT = re.compile(r"\d\s*\|\s*\d+\s*@")
"""The bits of a signal. A statement with them is a damaged signal, whatever its keyword."""
_LONG_NAME = re.compile(
    r'"System(?:Message|Signal)LongSymbol"\s+(?:BO_\s+(\d{1,10})|SG_\s+(\d{1,10})\s+(\w+))\s*"(\w+)"',
)


class SignalText(Value, frozen=True, kw_only=True):
    """One signal as written in the file."""

    name: str
    """The long name if the file has one, otherwise the written name."""
    written: str
    """The name in the signal's line; other statements refer to the signal by it."""
    line: int
    marker: str
    """`M`, `m5`, `m5M`, or empty for a signal without multiplexing."""
    start: int
    length: int
    is_big: bool
    is_signed: bool
    scale: float
    """This and the next three are integers where the file has integers."""
    offset: float
    minimum: float
    maximum: float
    written_range: str
    """The range as written: `[0|3.5]`."""
    unit: str
    receivers: tuple[str, ...]

    @property
    def has_range(self) -> bool:
        """Whether the range says anything: editors write [0|0] where there is none."""
        return not self.minimum == self.maximum == 0

    @property
    def is_multiplexer(self) -> bool:
        return self.marker.endswith("M")

    @property
    def is_multiplexed(self) -> bool:
        return self.marker.startswith("m")

    @property
    def first_bit(self) -> int:
        """The number of the first bit, counted in the direction of the byte order."""
        return 8 * (self.start // 8) + 7 - self.start % 8 if self.is_big else self.start


class MessageText(msgspec.Struct, kw_only=True):
    """One message as written in the file. Repairs remove signals from it."""

    name: str
    number: int
    """The identifier as in the file, extended ones with their flag; other statements refer to the message by it."""
    line: int
    length: int
    sender: str
    signals: list[SignalText] = msgspec.field(default_factory=list)
    places: dict[str, str] = msgspec.field(default_factory=dict)
    """Maps the written name to MESSAGE.SIGNAL for all signals, removed ones included."""

    def remove(self, signal: SignalText) -> None:
        self.signals = [one for one in self.signals if one is not signal]


def collect_messages(file_name: str, statements: Iterable[Statement], findings: DbcFindings) -> list[MessageText]:
    """Return all messages whose line can be read, each with its readable signals.

    Raises `ConfigError` if the file is cut short.
    """
    statements = list(statements)
    long_names = _collect_long_names(statements)
    messages: list[MessageText] = []
    message: MessageText | None = None
    is_signal_expected, before = False, ""
    for statement in statements:
        if statement.keyword == "BO_":
            message = _parse_message(statement, long_names)
            is_signal_expected = True
            if message is not None:
                messages.append(message)
            elif statement.may_be_cut:
                raise cut_short(file_name, statement.line)
            else:
                _report_damage(statement, _guess_name(statement.body, r"\d+\s+(\w+)"), findings)
        elif statement.keyword == "SG_":
            if message is not None:
                _add_signal(file_name, message, statement, long_names, findings)
            elif not is_signal_expected:
                _report_damage(statement, "", findings)
        elif not statement.keyword:
            if before in ("BU_", "BS_") and re.fullmatch(r"[\w\s,:]*", statement.body):
                pass  # names of nodes on lines of their own
            elif keyword := _find_unknown_keyword(statement):
                text = f"keyword {keyword} is not known; its statement is not used: {shorten(statement.body)}"
                findings.add_warning(statement.line, "", text, "keywords that are not known")
            else:
                belongs = message is not None and before in ("BO_", "SG_")
                _report_damage(statement, message.name if message and belongs else "", findings)
        else:
            message, is_signal_expected = None, False
        before = statement.keyword
    return [one for one in messages if one.name != _UNASSIGNED]


def _find_unknown_keyword(statement: Statement) -> str:
    """Return the word that looks like a keyword; "" for a damaged signal, and for what may be cut short."""
    found = _UNKNOWN_KEYWORD.match(statement.body)
    may_be_cut = statement.may_be_cut and not statement.body.endswith(";")
    return "" if found is None or may_be_cut or _LAYOUT.search(statement.body) else found[0]


def _collect_long_names(statements: Iterable[Statement]) -> dict[tuple[int, str], str]:
    """Map (number, written name of the signal or "") to the long name."""
    found = (_LONG_NAME.match(one.body) for one in statements if one.keyword == "BA_" and "LongSymbol" in one.body)
    return {(int(match[1] or match[2]), match[3] or ""): match[4] for match in found if match}


def _parse_message(statement: Statement, long_names: Mapping[tuple[int, str], str]) -> MessageText | None:
    found = _MESSAGE.fullmatch(statement.body)
    if found is None:
        return None
    number = int(found["number"])
    return MessageText(
        name=long_names.get((number, ""), found["name"]),
        number=number,
        line=statement.line,
        length=int(found["length"]),
        sender=found["sender"],
    )


def _add_signal(
    file_name: str,
    message: MessageText,
    statement: Statement,
    long_names: Mapping[tuple[int, str], str],
    findings: DbcFindings,
) -> None:
    found = _SIGNAL.fullmatch(statement.body)
    written = found["name"] if found else _guess_name(statement.body, r"(\w+)")
    name = long_names.get((message.number, written), written)
    dotted = f"{message.name}.{name}" if written else message.name
    if found is None:
        if statement.may_be_cut:
            raise cut_short(file_name, statement.line)
        message.places.setdefault(written, dotted)
        _report_damage(statement, dotted, findings)
        return
    numbers = tuple(parse_number(found[key]) for key in ("scale", "offset", "minimum", "maximum"))
    if not all(map(math.isfinite, numbers)):
        findings.add_error(statement.line, dotted, "a number that is not finite", "numbers that are not finite")
        return
    message.places.setdefault(written, dotted)
    message.signals.append(
        SignalText(
            name=name,
            written=written,
            line=statement.line,
            marker=found["marker"] or "",
            start=int(found["start"]),
            length=int(found["length"]),
            is_big=found["order"] == "0",
            is_signed=found["sign"] == "-",
            scale=numbers[0],
            offset=numbers[1],
            minimum=numbers[2],
            maximum=numbers[3],
            written_range=f"[{found['minimum']}|{found['maximum']}]",
            unit=unquote(found["unit"]),
            receivers=tuple(re.findall(r"\w+", found["receivers"])),
        )
    )


def parse_number(text: str) -> float:
    """Return the number that is written, an integer where one is written; infinite beyond the range of floats."""
    value = float(text)
    return int(text) if value.is_integer() and text.lstrip("+-").isdigit() else value


def unquote(literal: str) -> str:
    """Return the text of a string literal."""
    return literal[1:-1].replace('\\"', '"')


def shorten(body: str) -> str:
    """Return the beginning of a statement, for the text of a finding."""
    words = " ".join(body.split())
    return repr(words if len(words) <= 60 else f"{words[:60]}…")


def _guess_name(body: str, pattern: str) -> str:
    found = re.match(pattern, body)
    return found[1] if found else ""


def _report_damage(statement: Statement, about: str, findings: DbcFindings) -> None:
    shown = shorten(f"{statement.keyword} {statement.body}".strip())
    findings.add_error(statement.line, about, f"was not understood: {shown}", "not understood")
