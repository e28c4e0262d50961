"""Score how well a signal fits a field, with reasons."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from vehicle_iface.codec.quantities import unit_of_field
from vehicle_iface.drafting.rules import FOREIGN_OBJECTS, SENT_SECTIONS, SUBSYSTEMS, FieldRule, Kind
from vehicle_iface.drafting.survey import SignalFacts
from vehicle_iface.drafting.words import common_beginning

BINDING_SCORE = 3.3
"""Minimum score of a signal to be bound; one below it is only mentioned."""
TIE = 0.5
"""Minimum difference in score between two candidates for a choice."""
_LEAST_BITS = 4
"""Minimum bits of a number: one with fewer is a flag or an enumeration."""
_CONTEXT_SHARE = 0.7
"""Weight of a phrase that needs words of the message's name."""
_DOUBT = 0.5
"""Deduction for a number without a unit, and for names without a table."""
_MANY_NAMES = 3
"""A number with a table of more names than this is an enumeration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A candidate signal for a field."""

    signal: SignalFacts
    score: float
    reasons: tuple[str, ...]


def find_candidates(rule: FieldRule, signals: Iterable[SignalFacts]) -> list[Candidate]:
    """Find all signals that may fit the field, the best first; equal ones in the order of the DBC."""
    found = (score_signal(rule, signal) for signal in signals)
    return sorted((one for one in found if one is not None), key=lambda one: (-one.score, one.signal.line))


def score_signal(rule: FieldRule, signal: SignalFacts) -> Candidate | None:
    """Score the signal as a candidate; None where it is ruled out."""
    if signal.is_multiplexer or signal.is_sent != (rule.section in SENT_SECTIONS):
        return None
    words = set(signal.words)
    if rule.excluded & (words | signal.context & _subjects(rule)):
        return None
    named = _match_words(rule, signal)
    if named is None:
        return None
    valued = _match_values(rule, signal)
    if valued is None:
        return None
    return Candidate(signal=signal, score=round(named.score + valued.score, 2), reasons=named.reasons + valued.reasons)


@dataclass(frozen=True, slots=True)
class _Match:
    score: float
    reasons: tuple[str, ...]


def _subjects(rule: FieldRule) -> frozenset[str]:
    """Words of a message's name that say what all of its signals of this kind are about."""
    return FOREIGN_OBJECTS if rule.kind in (Kind.NUMBER, Kind.SHARE) else FOREIGN_OBJECTS | SUBSYSTEMS


def _match_words(rule: FieldRule, signal: SignalFacts) -> _Match | None:
    """Score by the name; words that are not in the rule count against the signal."""
    words, context = frozenset(signal.words), signal.context
    best: tuple[float, str, frozenset[str]] | None = None
    for phrase in rule.phrases:
        if phrase.words <= words:
            found = (phrase.weight, f'named "{phrase.text}"', phrase.words)
        elif phrase.words <= words | context and (phrase.words & words or _is_share(rule, signal)):
            found = (_CONTEXT_SHARE * phrase.weight, f'named "{phrase.text}" with its message', phrase.words)
        else:
            continue
        if best is None or found[0] > best[0]:
            best = found
    if best is None:
        return None
    weight, reason, used = best
    unknown = [word for word in words - used - rule.neutral - context if not word.isdigit()]
    return _Match(weight - len(unknown), (reason,))


def _is_share(rule: FieldRule, signal: SignalFacts) -> bool:
    """Return whether the unit alone indicates a pedal: then the message's name determines which."""
    unit = signal.known_unit
    return rule.kind is Kind.SHARE and unit is not None and unit.quantity == "ratio"


def _match_values(rule: FieldRule, signal: SignalFacts) -> _Match | None:
    """Score by unit, range, bits and table."""
    if rule.kind is Kind.NUMBER:
        return _match_number(rule, signal)
    if rule.kind is Kind.SHARE:
        is_number = signal.bits >= _LEAST_BITS and len(signal.names) <= _MANY_NAMES and not signal.is_flag
        reason = f"in {signal.unit}" if signal.unit else "no unit"
        return _Match(2.0 if _is_share(rule, signal) else 1.0, (reason,)) if is_number else None
    if rule.kind is Kind.FLAG:
        return _Match(1.0, (f"{signal.bits} bit{'s' * (signal.bits > 1)}",)) if signal.is_flag else None
    if signal.unit:
        return None
    if rule.kind is Kind.NAMES:
        return _match_names(rule, signal)
    return _Match(0.5 if signal.bits > 1 else 0.0, (f"{signal.bits} bit{'s' * (signal.bits > 1)}",))


def _match_number(rule: FieldRule, signal: SignalFacts) -> _Match | None:
    wanted = unit_of_field(rule.field)
    if signal.bits < _LEAST_BITS or len(signal.names) > _MANY_NAMES or signal.is_flag:
        return None
    if not signal.unit:
        return _Match(-_DOUBT, ("no unit",))
    if signal.known_unit is None:
        return _Match(-_DOUBT, (f"in {signal.unit!r}, which is not known",))
    if wanted is None or signal.known_unit.quantity != wanted.unit.quantity:
        return None
    score, reasons = 3.0, [f"in {signal.unit}"]
    largest, (least, most) = signal.largest_si, rule.typical
    if largest and most:
        fits = least <= largest <= most
        score += 0.5 if fits else -1.0
        reasons.append(f"{signal.low:g} … {signal.high:g}{'' if fits else ', an unusual range'}")
    return _Match(score, tuple(reasons))


def _match_names(rule: FieldRule, signal: SignalFacts) -> _Match | None:
    names = {*signal.names.values()} if rule.is_exact else {*fold_names(signal.names.values()).values()}
    hits = [min(names & group) for group in rule.vocabulary if names & group]
    if rule.is_vocabulary_needed and len(hits) < len(rule.vocabulary):
        return None
    if not names:
        return _Match(-_DOUBT, ("no VAL_ table",)) if 1 < signal.bits <= 8 else None
    if len(hits) < len(rule.vocabulary):
        shown = ", ".join(name[:20] for name in sorted(names)[:3])
        return _Match(-2.0, (f"its table has other names: {shown}",))
    return _Match(3.0, (f"its table has {', '.join(hits[:3])}",))


def fold_names(names: Iterable[str]) -> dict[str, str]:
    """Return names of a table as the rules write them: without the beginning that all share, and `Hand-driven Mode` as
    HAND_DRIVEN."""
    words = {name: tuple(name.upper().replace("-", " ").replace("_", " ").split()) for name in names}
    start = len(common_beginning([*words.values()]))
    return {name: re.sub(r"_(MODE|STATE)$", "", "_".join(text[start:])) for name, text in words.items()}
