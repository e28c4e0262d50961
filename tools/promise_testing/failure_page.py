"""Reads the tables of `vehicle_iface/FAILURES.md`."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

HEADER = ["#", "failure", "detected by", "reaction and time limit", "reason"]
TESTS = ["#", "tests"]
"""Below each table of failures: one row for each of its rows, in the same order."""
_DETAIL = re.compile(r"^\* \*\*([A-Z]\d+(?:, [A-Z]\d+)*)\*\*: ((?:.|\n(?=  ))+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Row:
    """One failure, and what the page promises for it."""

    number: str
    failure: str
    detected_by: str
    reaction: str
    reason: str
    tests: tuple[str, ...]
    """As pytest names them, without parameters."""
    detail: str = ""
    """What the list below the table adds; with the first row of the number."""

    @property
    def text(self) -> str:
        """What the page says of it to people."""
        return f"{self.failure} | {self.detected_by} | {self.reaction} | {self.reason} | {self.detail}"


def tables(page: str, header: list[str]) -> Iterator[list[str]]:
    """The rows of all tables with this header, cell by cell."""
    is_inside = False
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if cells == header:
            is_inside = True
        elif not cells:
            is_inside = False
        elif is_inside and not set(line) <= set("|- "):
            yield cells


def rows(page: str) -> list[Row]:
    """The failures in the page's order. Raises `ValueError` for a row that has too few or too many cells, or no row of
    tests at its place."""
    details = _details(page)
    tests = list(tables(page, TESTS))
    found = []
    for place, cells in enumerate(tables(page, HEADER)):
        if len(cells) != len(HEADER):
            raise ValueError(f"{cells[0]}: {len(cells)} cells instead of {len(HEADER)}")
        number, failure, detected_by, reaction, reason = cells
        if place >= len(tests) or tests[place][0] != number or len(tests[place]) != len(TESTS):
            raise ValueError(f"{number}: its row of tests is missing")
        names = tuple(re.findall(r"`([^`]+)`", tests[place][1]))
        found.append(Row(number, failure, detected_by, reaction, reason, names, details.pop(number, "")))
    if details:
        raise ValueError(f"details of no row: {', '.join(details)}")
    if len(tests) > len(found):
        raise ValueError(f"{tests[len(found)][0]}: tests of no row")
    return found


def _details(page: str) -> dict[str, str]:
    """By number."""
    found: dict[str, str] = {}
    for match in _DETAIL.finditer(page):
        for number in match[1].split(", "):
            found[number] = " ".join([*found.get(number, "").split(), *match[2].split()])
    return found
