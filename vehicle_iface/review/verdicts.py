"""Relations, explanations and delays in words: findings, and a verdict on each binding."""

import math
from collections.abc import Iterator, Mapping, Sequence

from vehicle_iface.profile import Profile
from vehicle_iface.review.bindings import FieldNotes, write_fix
from vehicle_iface.review.delays import Delay
from vehicle_iface.review.explanations import Cause, Explanation, Kind, is_as_expected
from vehicle_iface.review.findings import BindingVerdict, Finding, Judgement, Level
from vehicle_iface.review.headings import HeadingOffset
from vehicle_iface.review.kinematics import COMMANDED, HANDEDNESS, WHEELBASE
from vehicle_iface.review.relations import Outcome, Relation
from vehicle_iface.review.series import POSITION

_RIGHT_ANGLE_RAD = math.radians(15.0)
"""Maximum difference of an offset from a multiple of 90° that counts as one."""


class Words:
    """Names and notes of a profile, for its findings."""

    def __init__(self, profile: Profile, notes: Mapping[str, FieldNotes]) -> None:
        self._profile, self._notes = profile, notes

    def label(self, name: str) -> str:
        """Return the signal of a field, or the name of another gain."""
        field = POSITION if name == HANDEDNESS else name
        if name == WHEELBASE:
            return "geometry.wheelbase_m"
        return self._notes[field].series.label if field in self._notes else field

    def describe_causes(self, explanation: Explanation, offset: HeadingOffset | None) -> Iterator[Finding]:
        """Write one finding for each field that is wrong."""
        fields = list(dict.fromkeys(cause.field for cause in explanation.causes))
        if offset is not None and offset.is_wrong and "heading_rad" not in fields and HANDEDNESS not in fields:
            fields.append("heading_rad")
        for field in fields:
            causes = [cause for cause in explanation.causes if cause.field == field]
            is_shifted = field == "heading_rad" and offset is not None and offset.is_wrong
            turn_rad = offset.offset_rad if is_shifted and offset is not None and HANDEDNESS not in fields else 0.0
            yield Finding(
                level=Level.CONTRADICTION,
                about=self.label(field),
                text=self._describe(field, causes, offset),
                fix=self._fix(field, causes, turn_rad, offset),
            )

    def _describe(self, field: str, causes: Sequence[Cause], offset: HeadingOffset | None) -> str:
        known = offset if offset is not None and offset.is_known else None
        if field == HANDEDNESS:
            return _describe_axes(self.label(POSITION), known)
        if field == WHEELBASE:
            return self._describe_wheelbase(causes[0])
        parts = [
            self._describe_cause(cause) for cause in causes if not (field == "heading_rad" and cause.kind is Kind.SIGN)
        ]
        if field == "heading_rad":
            is_clockwise = any(cause.kind is Kind.SIGN for cause in causes)
            parts += _describe_heading(self.label(field), is_clockwise, known)
        return ", and ".join(parts)

    def _describe_cause(self, cause: Cause) -> str:
        label = self.label(cause.field)
        if cause.kind is Kind.SIGN:
            return f"sign of {label} is reversed"
        notes = self._notes[cause.field]
        if cause.kind is Kind.UNIT:
            return f"{label} is in {cause.unit}, not in {notes.unit}"
        if cause.kind is Kind.RATIO:
            ratio, stated = abs(cause.gain / notes.scale), abs(1.0 / notes.scale)
            said = f"; the profile says {stated:.1f}" if stated != 1.0 else ""
            return f"steering ratio is about {ratio:.1f} ({label} is the angle of the steering wheel{said})"
        return f"{label} reads {_describe_factor(cause.gain)}"

    def _describe_wheelbase(self, cause: Cause) -> str:
        stated_m = self._profile.geometry.wheelbase_m
        true_m = stated_m / cause.gain
        angle = self.label("front_wheel_angle_rad")
        return (
            f"wheelbase should be about {true_m:.2g} m, not {stated_m:g} m "
            f"(or else {angle} reads {_describe_factor(cause.gain)})"
        )

    def _fix(self, field: str, causes: Sequence[Cause], offset_rad: float, offset: HeadingOffset | None) -> str:
        if field == WHEELBASE:
            return f"[geometry]\nwheelbase_m = {self._profile.geometry.wheelbase_m / causes[0].gain:.2f}"
        if field == HANDEDNESS:
            return _write_axes(self._notes[POSITION], offset)
        return write_fix(self._notes[field], causes, offset_rad)

    def describe_delay(self, delay: Delay) -> Finding:
        """Write a finding for a late message or field."""
        about = self.label(delay.field) if delay.field else delay.message
        text = f"{about} is {_describe_ms(delay.delay_s)} late against the other signals"
        return Finding(level=Level.CONTRADICTION, about=about, text=text)

    def describe_unrelated(self, relations: Sequence[Relation]) -> Iterator[Finding]:
        """Write findings for uncorrelated signals, by the field that they share."""
        unrelated = [one for one in relations if one.outcome is Outcome.UNRELATED]
        trusted = {field for one in relations if one.outcome is Outcome.MEASURED for field in one.fields}
        suspects = [
            field
            for field in dict.fromkeys(field for one in unrelated for field in one.fields)
            if field not in (WHEELBASE, HANDEDNESS) and field not in trusted
        ]
        for relation in unrelated:
            is_command = relation.x.startswith(COMMANDED)
            own = [field for field in suspects if field in relation.powers]
            names = own or [field for field in relation.fields if field not in (WHEELBASE, HANDEDNESS)]
            about = " or ".join(self.label(field) for field in names)
            yield Finding(
                level=Level.DOUBT if is_command else Level.CONTRADICTION,
                about=about,
                text=f"{relation.why}: {about} is another quantity, or does not work",
            )

    def judge_bindings(
        self, relations: Sequence[Relation], wrong: Mapping[str, Sequence[str]]
    ) -> Iterator[BindingVerdict]:
        """Return a verdict on each field; `wrong` has the texts on contradicted fields."""
        for name, notes in self._notes.items():
            if name == COMMANDED + "enable":
                continue
            about = [one for one in relations if name in one.powers]
            about += [one for one in relations if name == POSITION and HANDEDNESS in one.powers and one not in about]
            measured = [one for one in about if one.outcome is Outcome.MEASURED]
            judgement = Judgement.AGREES if any(is_as_expected(one) for one in measured) else Judgement.UNKNOWN
            if name in wrong:
                judgement, text = Judgement.CONTRADICTED, "; ".join(wrong[name])
            elif measured:
                judgement = Judgement.AGREES
                text = f"by {', '.join(_short_title(one) for one in measured)}"
            elif about:
                text = "; ".join(dict.fromkeys(one.why for one in about))
            else:
                text = "no law here to check it by"
            keys = tuple(one.key for one in about)
            yield BindingVerdict(field=name, signal=notes.series.label, judgement=judgement, text=text, relations=keys)


def describe_alternatives(explanations: Sequence[Sequence[Finding]]) -> Finding:
    """Write one finding for explanations that are equally good."""
    texts = dict.fromkeys(" and ".join(finding.text for finding in findings) for findings in explanations)
    about = dict.fromkeys(finding.about for findings in explanations for finding in findings)
    ways = ", or ".join(texts)
    return Finding(
        level=Level.CONTRADICTION,
        about=", ".join(about),
        text=f"either {ways}: this drive does not tell which",
    )


def describe_unexplained(relation: Relation) -> Finding:
    """Write a finding for a slope that no cause explains."""
    assert relation.fit is not None
    text = f"{relation.title}: slope {relation.fit.slope:.3g} instead of 1, which no single cause explains"
    return Finding(level=Level.CONTRADICTION, about=relation.key, text=text)


def _describe_heading(label: str, is_clockwise: bool, offset: HeadingOffset | None) -> Iterator[str]:
    turn_rad = offset.offset_rad if offset is not None and offset.is_wrong else 0.0
    quarter = round(turn_rad / (math.pi / 2.0))
    is_quarter = abs(turn_rad - quarter * math.pi / 2.0) < _RIGHT_ANGLE_RAD and quarter != 0
    if is_clockwise:
        if is_quarter and quarter == 1:
            yield f"{label} is clockwise from north (a compass), not counter-clockwise from the x axis"
            return
        yield f"{label} is clockwise"
    if is_quarter:
        yield f"zero of {label} is {90 * quarter:+d}° off" + (" (counter-clockwise from north)" if quarter == 1 else "")
    elif turn_rad:
        yield f"zero of {label} is {math.degrees(turn_rad):+.0f}° off"


_AXES = {0: "its y axis is reversed", 3: "x and y are swapped", 2: "its x axis is reversed"}
"""(quarter turns from the heading to the course, y negated) → fault of the axes."""
_OTHER_AXES = "x and y are swapped, or one is reversed"


def _quarter_turns(offset: HeadingOffset | None) -> int | None:
    return round(offset.offset_rad / (math.pi / 2.0)) % 4 if offset is not None and offset.is_known else None


def _describe_axes(label: str, offset: HeadingOffset | None) -> str:
    quarter = _quarter_turns(offset)
    how = _AXES.get(quarter, "x and y are swapped and both reversed") if quarter is not None else _OTHER_AXES
    return f"{label} is mirrored: {how}"


def _write_axes(notes: FieldNotes, offset: HeadingOffset | None) -> str:
    """Write the lines that correct the axes, where each is a separate signal."""
    quarter, signals = _quarter_turns(offset), notes.series.signals
    if len(signals) != 2 or notes.scale != 1.0:
        return ""
    if quarter in (0, 2):
        return f'[signals."{signals[1 if quarter == 0 else 0]}"]\nscale = -1.0'
    return f'[state.signals]\nx_m = "{signals[1]}"\ny_m = "{signals[0]}"' if quarter == 3 else ""


def _describe_factor(gain: float) -> str:
    if 0.5 < gain < 2.0:
        return f"{abs(gain - 1.0) * 100:.0f} % too {'much' if gain > 1.0 else 'little'}"
    return f"{gain:.3g} times too much" if gain > 1.0 else f"{1.0 / gain:.3g} times too little"


def _describe_ms(delay_s: float) -> str:
    return f"{round(delay_s * 1000 / 5) * 5:d} ms"


def _short_title(relation: Relation) -> str:
    return f"{relation.y_text} against {relation.x_text}"
