"""Findings about a DBC: one for each fault or oddity, with the messages and signals that it concerns."""

from collections.abc import Iterator

from vehicle_iface.value import Value

ERROR, WARNING = "error", "warning"


class DbcFinding(Value, frozen=True, kw_only=True):
    """One fault or oddity in a DBC."""

    line: int
    """The line, from 1; 0 if the finding has no line of its own."""
    severity: str
    """`error`: the message or signal cannot be used. `warning`: it can be used, but should be checked."""
    about: tuple[str, ...]
    """The MESSAGE or MESSAGE.SIGNAL names that it concerns; empty if none can be named."""
    text: str
    kind: str
    """A text that all findings of the same kind share, so that many can be summarised."""

    @property
    def message(self) -> str:
        """The first message that the finding concerns; "" if none can be named."""
        return self.about[0].partition(".")[0] if self.about else ""


class DbcFindings:
    """Collects the findings of one file."""

    def __init__(self) -> None:
        self._found: list[DbcFinding] = []

    def __iter__(self) -> Iterator[DbcFinding]:
        return iter(sorted(self._found, key=lambda finding: finding.line))

    def add_error(self, line: int, about: str | tuple[str, ...], text: str, kind: str = "") -> None:
        self._add(ERROR, line, about, text, kind)

    def add_warning(self, line: int, about: str | tuple[str, ...], text: str, kind: str = "") -> None:
        self._add(WARNING, line, about, text, kind)

    def _add(self, severity: str, line: int, about: str | tuple[str, ...], text: str, kind: str) -> None:
        """Add a finding; its text begins with the first name in `about`."""
        places = tuple(filter(None, (about,) if isinstance(about, str) else about))
        text = f"{places[0]}: {text}" if places else text
        self._found.append(DbcFinding(line=line, severity=severity, about=places, text=text, kind=kind or text))
