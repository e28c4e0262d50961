"""The best signal for each field, if one fits clearly best."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from vehicle_iface.drafting.draft import FieldDraft
from vehicle_iface.drafting.rules import RULES, SENT_SECTIONS, FieldRule, Section
from vehicle_iface.drafting.scoring import BINDING_SCORE, TIE, Candidate, find_candidates
from vehicle_iface.drafting.survey import SignalFacts, Survey

_BESIDE_BONUS = 0.4
"""Bonus of a signal whose message also carries other fields of its section."""
_FURTHER_ENABLE = 4.0
"""Minimum score of a further enable: it must be named as one."""
_MOST_OTHERS = 2
Candidates = Mapping[FieldRule, list[Candidate]]


def choose_fields(survey: Survey) -> dict[tuple[Section, str], FieldDraft]:
    """Choose a signal, or none, for each field; a signal is bound once."""
    allowed = _signals_by_section(survey)
    chosen: dict[tuple[Section, str], FieldDraft] = {}
    for section, signals in allowed.items():
        rules = [rule for rule in RULES if rule.section == section]
        found = _prefer_neighbours({rule: find_candidates(rule, signals) for rule in rules})
        for rule, field in _assign(found).items():
            chosen[section, rule.field] = field
        if section == "command":
            enable = next(rule for rule in rules if rule.field == "enable")
            chosen[section, "enable"] = _collect_enables(chosen[section, "enable"], found[enable], chosen)
    return chosen


def _signals_by_section(survey: Survey) -> dict[Section, list[SignalFacts]]:
    """State and status may share messages; each sent message is for one thing, body and report are one message each."""
    received = [signal for signal in survey.signals if not signal.is_sent]
    by_section: dict[Section, list[SignalFacts]] = {"state": received, "status": received}
    scores: dict[Section, dict[str, float]] = {
        section: {name: _score_message(survey, name, section) for name in survey.messages} for section in SENT_SECTIONS
    }
    role: dict[str, Section] = {
        name: max(SENT_SECTIONS, key=lambda section: (scores[section][name], section == "command"))
        for name in survey.messages
    }
    for section in SENT_SECTIONS:
        names = [name for name in survey.messages if role[name] == section]
        if section != "command":
            names = sorted(names, key=lambda name: -scores[section][name])[:1]
        by_section[section] = [signal for name in names for signal in survey.messages[name].signals]
    return by_section


def _score_message(survey: Survey, name: str, section: Section) -> float:
    signals = survey.messages[name].signals
    found = (find_candidates(rule, signals) for rule in RULES if rule.section == section)
    return sum(candidates[0].score for candidates in found if candidates)


def _prefer_neighbours(found: Candidates) -> Candidates:
    """Prefer a signal beside others of its section to the same name in another message."""
    tops = {rule: candidates[0].signal for rule, candidates in found.items() if candidates}

    def raised(rule: FieldRule, one: Candidate) -> Candidate:
        has_neighbour = any(other != rule and top.message == one.signal.message for other, top in tops.items())
        return replace(one, score=round(one.score + _BESIDE_BONUS, 2)) if has_neighbour else one

    return {
        rule: sorted((raised(rule, one) for one in candidates), key=lambda one: (-one.score, one.signal.line))
        for rule, candidates in found.items()
    }


def _assign(found: Candidates) -> dict[FieldRule, FieldDraft]:
    """Assign the best pairs of field and signal first; a tie of two candidates stays open."""
    order = list(found)
    pairs = sorted(
        ((rule, one) for rule, candidates in found.items() for one in candidates if one.score >= BINDING_SCORE),
        key=lambda pair: (-pair[1].score, order.index(pair[0]), pair[1].signal.line),
    )
    taken: dict[str, FieldRule] = {}
    done: dict[FieldRule, FieldDraft] = {}
    for rule, one in pairs:
        if rule in done or one.signal.dotted in taken:
            continue
        others = [other for other in found[rule] if other is not one and other.signal.dotted not in taken]
        equal = [other for other in others if one.score - other.score < TIE]
        if equal and rule.field != "enable":
            text = f"{len(equal) + 1} signals fit equally well; choose one"
            several = (one, *others)[: _MOST_OTHERS + 1]
            done[rule] = FieldDraft(rule=rule, value=None, others=several, remark=text, is_question=True)
            continue
        taken[one.signal.dotted] = rule
        done[rule] = FieldDraft(rule=rule, value=one.signal.dotted, chosen=(one,), others=tuple(others[:_MOST_OTHERS]))
    return {rule: done.get(rule) or _leave_open(rule, found[rule], taken) for rule in order}


def _leave_open(rule: FieldRule, candidates: Iterable[Candidate], taken: Mapping[str, FieldRule]) -> FieldDraft:
    free = [one for one in candidates if one.signal.dotted not in taken]
    remark = "no signal is named clearly enough" if free else ""
    return FieldDraft(rule=rule, value=None, others=tuple(free[:_MOST_OTHERS]), remark=remark, is_question=bool(free))


def _collect_enables(
    field: FieldDraft, candidates: Iterable[Candidate], chosen: Mapping[tuple[Section, str], FieldDraft]
) -> FieldDraft:
    """Collect one enable of each message that carries a command; without any, the best match."""
    if field.value is None:
        return field
    commands = [other for (section, name), other in chosen.items() if section == "command" and name != "enable"]
    bound = [one.signal for other in commands if other.value is not None for one in other.chosen]
    carrying = {signal.message for signal in bound}
    free = [one for one in candidates if one.score >= BINDING_SCORE and one.signal not in bound]
    best: dict[str, Candidate] = {}
    for one in free:
        if one.score >= _FURTHER_ENABLE and one.signal.message in carrying:
            best.setdefault(one.signal.message, one)
    if not best and len(free) > 1 and free[0].score - free[1].score < TIE:
        text = "several signals fit equally well; choose one"
        return FieldDraft(
            rule=field.rule, value=None, others=tuple(free[: _MOST_OTHERS + 1]), remark=text, is_question=True
        )
    found = tuple(sorted(best.values(), key=lambda one: one.signal.line)) or field.chosen
    names = tuple(one.signal.dotted for one in found)
    others = tuple(one for one in (*field.chosen, *field.others) if one not in found)
    return replace(field, value=names if len(names) > 1 else names[0], chosen=found, others=others)
