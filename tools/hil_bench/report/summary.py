"""Tables about a whole run: which faults its cases cover, and where its time went."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from hil_bench.report.formatting import Group
from hil_bench.result import FaultRow, Run, Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Covering:
    """A case that injects a fault, and its verdict in this run; None: it was not part of it."""

    name: str
    address: str
    verdict: Verdict | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredRow:
    """A row of the catalogue of faults."""

    row: FaultRow
    cases: list[Covering]

    @property
    def has_passed(self) -> bool:
        """Whether at least one of its cases passed, and none failed."""
        verdicts = {one.verdict for one in self.cases}
        return Verdict.PASS in verdicts and Verdict.FAIL not in verdicts


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Part of the time of all cases."""

    name: str
    spent_s: float
    share: float


def cover(run: Run, groups: Sequence[Group]) -> list[CoveredRow]:
    """The rows in the catalogue's order, with the cases of the whole catalogue."""
    found = {group.name: (f"case-{number}", group.verdict) for number, group in enumerate(groups, 1)}
    return [
        CoveredRow(
            row=row,
            cases=[
                Covering(name=name, address=found.get(name, ("", None))[0], verdict=found.get(name, ("", None))[1])
                for name in row.cases
            ],
        )
        for row in run.faults
    ]


def sum_stages(run: Run) -> list[Stage]:
    """Where the time of all cases went, the longest first."""
    total: Counter[str] = Counter()
    for case in run.cases:
        total.update({name: spent for name, spent in case.spent_s.items() if spent > 0.0})
    whole = total.total()
    return [Stage(name=name, spent_s=spent, share=spent / whole) for name, spent in total.most_common()]
