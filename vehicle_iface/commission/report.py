"""The result of a walk: as text, as a page, and as JSON for programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from vehicle_iface.commission.walk import StepResult
from vehicle_iface.review.findings import Judgement
from vehicle_iface.review.page import TABLE_END, draw_chip, draw_header, draw_review, draw_table_head, wrap_page
from vehicle_iface.review.report import describe_result, dump_json, list_numbers
from vehicle_iface.review.review import Review

WORDS = {Judgement.AGREES: "seen", Judgement.CONTRADICTED: "contradicted", Judgement.UNKNOWN: "not seen"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Commissioning:
    """A walk, and the review of its log."""

    profile_name: str
    log_name: str
    log_sha256: str
    """Hash of the log; empty, as `log_name` is, where no frame was received."""
    steps: Sequence[StepResult]
    review: Review | None
    """Review of the log; None where no frame was received."""

    @property
    def contradictions(self) -> list[str]:
        """Contradictions of the profile by the walk and the log, in words."""
        of_walk = [one.text for step in self.steps for one in step.results if one.judgement is Judgement.CONTRADICTED]
        return of_walk + [one.text for one in (self.review.contradictions if self.review is not None else ())]

    @property
    def unseen(self) -> list[StepResult]:
        """Steps in which a signal was not observed."""
        return [step for step in self.steps if any(one.judgement is Judgement.UNKNOWN for one in step.results)]

    @property
    def is_sound(self) -> bool:
        """Whether everything was observed, and nothing contradicts the profile."""
        return self.review is not None and not self.contradictions and not self.unseen


def describe(found: Commissioning) -> str:
    """Return the result in one sentence."""
    contradictions, unseen = len(found.contradictions), len(found.unseen)
    if contradictions:
        return f"{contradictions} contradiction{'s' if contradictions > 1 else ''} between profile and vehicle"
    if found.review is None:
        return "no frame of the profile's messages came: nothing was seen"
    if unseen:
        return f"{unseen} of {len(found.steps)} steps not seen; nothing contradicts the profile"
    return f"all {len(found.steps)} steps were seen, and nothing contradicts the profile"


def summarize(found: Commissioning) -> Iterator[str]:
    """Return lines for a person: contradictions of the profile, missing observations, the result."""
    yield from (f"contradiction: {text}" for text in found.contradictions)
    if found.review is not None:
        for finding in found.review.contradictions:
            yield from (f"    {line}" for line in finding.fix.splitlines())
    for step in found.unseen:
        texts = [one.text for one in step.results if one.judgement is Judgement.UNKNOWN]
        yield f"not seen: {step.ask}: {'; '.join(texts)}{' (skipped)' if step.was_skipped else ''}"
    yield describe(found)


def render_page(found: Commissioning) -> str:
    """Return a self-contained HTML page."""
    log = f", log <b>{escape(found.log_name)}</b>, SHA-256 <code>{found.log_sha256}</code>" if found.log_name else ""
    subject = f"Profile <b>{escape(found.profile_name)}</b> against the vehicle{log}"
    return wrap_page(f"Commissioning of {found.profile_name}", _parts(found, subject))


def _parts(found: Commissioning, subject: str) -> Iterator[str]:
    yield draw_header(found.is_sound, describe(found), subject)
    yield "<h2>Walk</h2>" + draw_table_head("Asked", "Verdict", "Seen")
    for step in found.steps:
        texts = "<br>".join(escape(one.text) for one in step.results)
        skipped = " (skipped)" if step.was_skipped else ""
        yield f"<tr><td>{escape(step.ask)}<td>{draw_chip(step.judgement, WORDS[step.judgement])}<td>{texts}{skipped}"
    yield TABLE_END
    if found.review is not None:
        yield f"<h2>The log of the walk: {escape(describe_result(found.review))}</h2>"
        yield from draw_review(found.review)


def to_json(found: Commissioning, *, is_written: bool) -> str:
    """Return all verdicts, and the numbers of the review; `is_written` says whether the profile has the record now."""
    return dump_json(
        {
            "profile": found.profile_name,
            "result": describe(found),
            "is_sound": found.is_sound,
            "is_written": is_written,
            "log": found.log_name,
            "log_sha256": found.log_sha256,
            "steps": [
                {
                    "asked": step.ask,
                    "verdict": WORDS[step.judgement],
                    "skipped": step.was_skipped,
                    "results": [
                        {"about": one.about, "verdict": WORDS[one.judgement], "text": one.text} for one in step.results
                    ],
                }
                for step in found.steps
            ],
            "review": list_numbers(found.review) if found.review is not None else None,
        }
    )
