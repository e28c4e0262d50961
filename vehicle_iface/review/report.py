"""A review as text for the terminal and as JSON for programs."""

import json
from collections.abc import Iterator, Mapping

from vehicle_iface.review.findings import Judgement
from vehicle_iface.review.relations import Relation
from vehicle_iface.review.review import Review

_DIGITS = 6


def summarize(review: Review) -> Iterator[str]:
    """Return lines for a person: what contradicts the profile first."""
    profile = review.drive.database.profile
    yield f"{profile.name}: {review.drive.duration_s:.1f} s of driving"
    for finding in review.findings:
        yield f"{finding.level.value}: {finding.text}"
        yield from (f"    {line}" for line in finding.fix.splitlines())
    for verdict in review.bindings:
        if verdict.judgement is Judgement.UNKNOWN and verdict.relations:
            yield f"cannot tell: {verdict.signal} ({verdict.field}): {verdict.text}"
    yield describe_result(review)


def describe_result(review: Review) -> str:
    """Return the result in one sentence."""
    count = len(review.contradictions)
    if count:
        return (
            "1 contradiction between profile and drive"
            if count == 1
            else f"{count} contradictions between profile and drive"
        )
    agrees = sum(verdict.judgement is Judgement.AGREES for verdict in review.bindings)
    return f"nothing contradicts the profile; {agrees} of {len(review.bindings)} bindings are confirmed"


def to_json(review: Review) -> str:
    """Return all numbers and verdicts; lengths in m, times in s, angles in rad."""
    return dump_json(list_numbers(review))


def dump_json(document: Mapping[str, object]) -> str:
    """Serialize a document as JSON."""
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def list_numbers(review: Review) -> dict[str, object]:
    """Return all numbers and verdicts by name, for JSON."""
    return {
        "profile": review.drive.database.profile.name,
        "duration_s": round(review.drive.duration_s, 3),
        "contradictions": len(review.contradictions),
        "findings": [
            {"level": one.level.value, "about": one.about, "text": one.text, "fix": one.fix} for one in review.findings
        ],
        "bindings": [
            {
                "field": one.field,
                "signal": one.signal,
                "verdict": one.judgement.value,
                "text": one.text,
                "relations": list(one.relations),
            }
            for one in review.bindings
        ],
        "relations": [_relation_to_json(one) for one in review.relations],
        "heading_offset_rad": _offset(review),
        "messages": [
            {
                "name": one.name,
                "role": one.role,
                "count": one.count,
                "stated_ms": one.stated_ms,
                "period_ms": _rounded(one.period_ms),
                "jitter_ms": _rounded(one.jitter_ms),
                "longest_gap_ms": _rounded(one.longest_gap_ms),
                "gaps": one.gaps,
                "out_of_range": one.out_of_range,
                "protection": one.protection,
            }
            for one in review.messages
        ],
    }


def _relation_to_json(relation: Relation) -> dict[str, object]:
    numbers = relation.fit
    return {
        "key": relation.key,
        "title": relation.title,
        "y": relation.y,
        "x": relation.x,
        "outcome": relation.outcome.value,
        "why": relation.why,
        "slope": _rounded(numbers.slope if numbers else None),
        "slope_error": _rounded(numbers.slope_error if numbers else None),
        "offset": _rounded(numbers.offset if numbers else None),
        "correlation": _rounded(numbers.correlation if numbers else None),
        "lag_s": _rounded(numbers.lag_s if numbers and numbers.lag_error_s < 1.0 else None),
        "used_s": _rounded(numbers.used_s if numbers else None),
    }


def _offset(review: Review) -> float | None:
    offset = review.heading_offset
    return _rounded(offset.offset_rad) if offset is not None and offset.is_known else None


def _rounded(value: float | None) -> float | None:
    return round(value, _DIGITS) if value is not None and abs(value) < 1e15 else None
