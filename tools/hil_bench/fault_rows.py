"""The catalogue of faults, FAILURES.md, and which cases inject each of its rows."""

from collections.abc import Iterator, Sequence

from hil_bench.case import Case
from hil_bench.places import CHECKOUT, PACKAGE
from hil_bench.result import FaultRow

FAILURES = (CHECKOUT or PACKAGE.parent) / "vehicle_iface" / "FAILURES.md"
HEADER = ["#", "failure"]
NO_CASE = (["#", "why"], ["#", "why the bench has no case"])
"""Of rows that are injected on no bus, and of rows that only a device's own code, its page or a real bus can show."""


def list_fault_rows(catalogue: Sequence[Case], text: str | None = None) -> list[FaultRow]:
    """Every row of the page, in its order, with the cases of a catalogue; none where there is no page."""
    if text is None:
        try:
            text = FAILURES.read_text(encoding="utf-8")
        except OSError:
            return []
    why = {cells[0]: _plain(cells[1]) for header in NO_CASE for cells in _tables(text, header)}
    return [
        FaultRow(
            row=row,
            text=_plain(failure),
            cases=[case.name for case in catalogue if row in case.fault.split()],
            why_none=why.get(row, ""),
        )
        for row, failure, *_ in _tables(text, HEADER)
    ]


def _tables(text: str, header: list[str]) -> Iterator[list[str]]:
    """The rows of all tables whose first columns have these titles."""
    is_inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if cells[: len(header)] == header:
            is_inside = True
        elif cells[:1] == header[:1] or len(cells) < len(header):
            is_inside = False
        elif is_inside and not set(line) <= set("|- "):
            yield cells


def _plain(text: str) -> str:
    return text.replace("`", "").replace("**", "")
