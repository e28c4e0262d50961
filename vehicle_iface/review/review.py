"""The whole review of one drive."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vehicle_iface.review.bindings import FieldNotes, find_missing, read_notes, units_of
from vehicle_iface.review.bus import MessageTiming, review_bus
from vehicle_iface.review.delays import find_delays, lags_of
from vehicle_iface.review.explanations import Explanation, combine, explain, is_as_expected, refine
from vehicle_iface.review.findings import BindingVerdict, Finding, Level
from vehicle_iface.review.headings import HeadingOffset, find_directions, measure_heading_offset
from vehicle_iface.review.kinematics import COMMANDED, HANDEDNESS, Kinematics
from vehicle_iface.review.relations import Outcome, Relation, measure_relations
from vehicle_iface.review.series import POSITION, RecordedDrive
from vehicle_iface.review.verdicts import Words, describe_alternatives, describe_unexplained
from vehicle_iface.trajectory import FloatArray

_SAME_COST = 0.05
"""Maximum difference in cost between explanations that count as equally good on the drive."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Review:
    """Results of a drive for a profile."""

    drive: RecordedDrive
    motion: Kinematics
    relations: Sequence[Relation]
    heading_offset: HeadingOffset | None
    findings: Sequence[Finding]
    """Findings, the worst first."""
    bindings: Sequence[BindingVerdict]
    messages: Sequence[MessageTiming]

    @property
    def contradictions(self) -> list[Finding]:
        """Findings that must be corrected before the vehicle is armed."""
        return [finding for finding in self.findings if finding.level is Level.CONTRADICTION]


def review_drive(drive: RecordedDrive) -> Review:
    """Measure, explain, correct, measure again, and put into words."""
    motion, notes = Kinematics(drive), read_notes(drive)
    relations = list(measure_relations(motion))
    directions = find_directions(motion)
    signed = relations if directions is None else list(measure_relations(Kinematics(drive, directions=directions)))
    corrections = _correct(drive, signed, notes, directions)
    judge = _Judge(drive, notes, relations, corrections)
    if directions is not None:
        judge.add_missing_sign()
    messages, of_bus = review_bus(drive)
    order = list(Level)
    return Review(
        drive=drive,
        motion=motion,
        relations=relations,
        heading_offset=corrections[0].heading_offset if corrections else None,
        findings=sorted([*judge.findings, *of_bus], key=lambda finding: order.index(finding.level)),
        bindings=[*judge.words.judge_bindings(judge.corrected, judge.wrong), *find_missing(drive)],
        messages=messages,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Correction:
    """An explanation, and the drive corrected by it."""

    explanation: Explanation
    relations: Sequence[Relation]
    heading_offset: HeadingOffset | None


def _correct(
    drive: RecordedDrive,
    relations: Sequence[Relation],
    notes: Mapping[str, FieldNotes],
    directions: FloatArray | None,
) -> list[_Correction]:
    """Return the best explanations, each tried on the drive; empty where there is none."""
    found = []
    for first in explain(relations, units_of(notes)):
        explanation, corrected = first, Kinematics(drive, first.gains, directions=directions)
        again = list(measure_relations(corrected))
        rest = explain(again, {}) if first.causes else []
        if rest and rest[0].causes:
            explanation = combine(first, rest[0])
            corrected = Kinematics(drive, explanation.gains, directions=directions)
            again = list(measure_relations(corrected))
        explanation = refine(explanation, again)
        offset = measure_heading_offset(corrected)
        if offset is not None and offset.is_wrong:
            corrected = Kinematics(drive, explanation.gains, offset.offset_rad, directions)
            again = list(measure_relations(corrected))
            offset = measure_heading_offset(corrected, offset.offset_rad)
        found.append(_Correction(explanation=explanation, relations=again, heading_offset=offset))
    least = min((one.explanation.cost for one in found), default=0.0)
    return [one for one in found if one.explanation.cost <= least + _SAME_COST]


class _Judge:
    """Turns the relations of the motion into findings."""

    def __init__(
        self,
        drive: RecordedDrive,
        notes: Mapping[str, FieldNotes],
        relations: Sequence[Relation],
        corrections: Sequence[_Correction],
    ) -> None:
        self.words = Words(drive.database.profile, notes)
        self.findings: list[Finding] = []
        self.wrong: dict[str, list[str]] = {}
        """Texts on each contradicted field."""
        self.corrected = corrections[0].relations if corrections else relations
        if corrections:
            self._add_causes(corrections, notes)
        else:
            self._add_unexplained(relations)
        self._add_delays(corrections[0].heading_offset if corrections else None, notes)
        for finding in self.words.describe_unrelated(self.corrected):
            self._add(finding, self._fields_of(finding, notes))
        self._add_responses(relations)

    def add_missing_sign(self) -> None:
        """Add a finding when the speed has no sign while the vehicle reverses."""
        label = self.words.label("speed_mps")
        text = f"{label} has no sign: it is positive while the vehicle drives backwards"
        self._add(Finding(level=Level.CONTRADICTION, about=label, text=text), ["speed_mps"])

    def _add_causes(self, corrections: Sequence[_Correction], notes: Mapping[str, FieldNotes]) -> None:
        described = [list(self.words.describe_causes(one.explanation, one.heading_offset)) for one in corrections]
        if len(described) == 1:
            for finding in described[0]:
                self._add(finding, self._fields_of(finding, notes))
        else:
            fields = [cause.field for one in corrections for cause in one.explanation.causes]
            self._add(describe_alternatives(described), fields)

    def _add_unexplained(self, relations: Sequence[Relation]) -> None:
        for relation in relations:
            if relation.outcome is Outcome.MEASURED and not is_as_expected(relation):
                self._add(describe_unexplained(relation), relation.fields)

    def _add_delays(self, offset: HeadingOffset | None, notes: Mapping[str, FieldNotes]) -> None:
        angular = [offset.lag] if offset is not None and offset.is_known else []
        messages = {name: one.series.message for name, one in notes.items()}
        lags = lags_of(self.corrected, angular)
        explanations = find_delays(lags, messages)
        described = [[self.words.describe_delay(delay) for delay in delays] for delays in explanations]
        if len(described) == 1:
            for delay, finding in zip(explanations[0], described[0], strict=True):
                of_message = [name for name, message in messages.items() if message == delay.message]
                self._add(finding, [delay.field] if delay.field else of_message)
        elif described:
            self._add(describe_alternatives(described), [])
        else:
            worst = max(lags, key=lambda lag: abs(lag.lag_s))
            late, early = (worst.y, worst.x) if worst.lag_s > 0.0 else (worst.x, worst.y)
            text = f"{self.words.label(late)} comes {abs(worst.lag_s) * 1000:.0f} ms after {self.words.label(early)}"
            self._add(Finding(level=Level.CONTRADICTION, about=self.words.label(late), text=text), [late])

    def _add_responses(self, relations: Sequence[Relation]) -> None:
        for relation in relations:
            if not relation.x.startswith(COMMANDED) or relation.fit is None or relation.outcome is not Outcome.MEASURED:
                continue
            if relation.fit.lag_s > 0.0:
                text = f"{relation.y_text} follows the command after {relation.fit.lag_s:.2f} s"
                self._add(Finding(level=Level.NOTE, about=self.words.label(relation.y), text=text), [])

    def _fields_of(self, finding: Finding, notes: Mapping[str, FieldNotes]) -> list[str]:
        return [name for name in notes if self.words.label(name) == finding.about]

    def _add(self, finding: Finding, fields: Sequence[str]) -> None:
        self.findings.append(finding)
        for field in fields:
            name = POSITION if field == HANDEDNESS else field
            self.wrong.setdefault(name, []).append(finding.text)
