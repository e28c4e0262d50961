"""A review as one self-contained HTML page."""

from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path

import numpy as np

from vehicle_iface.review.drawing import Curve, draw_curves, draw_path, draw_scatter
from vehicle_iface.review.findings import Finding, Judgement, Level
from vehicle_iface.review.relations import Outcome, Relation
from vehicle_iface.review.report import describe_result
from vehicle_iface.review.review import Review
from vehicle_iface.review.series import POSITION

_CLASSES = {
    Level.CONTRADICTION: "bad",
    Level.DOUBT: "doubt",
    Level.NOTE: "note",
    Judgement.CONTRADICTED: "bad",
    Judgement.UNKNOWN: "doubt",
    Judgement.AGREES: "good",
}
TABLE_END = "</tbody></table></div>"


def render_page(review: Review, log_name: str) -> str:
    """Render the page of a review."""
    profile = review.drive.database.profile
    subject = f"Profile <b>{escape(profile.name)}</b> against <b>{escape(log_name)}</b>"
    head = draw_header(
        not review.contradictions, describe_result(review), f"{subject}, {review.drive.duration_s:.1f} s"
    )
    return wrap_page(f"Review of {profile.name}", [head, *draw_review(review)])


def wrap_page(title: str, parts: Iterable[str]) -> str:
    """Assemble a page from parts in HTML."""
    style = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>\n{style}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def draw_header(is_good: bool, result: str, subject: str) -> str:
    """Draw the result and its subject; `subject` is HTML."""
    kind = "good" if is_good else "bad"
    return f'<header class="{kind}"><h1>{escape(_capitalized(result))}</h1><p>{subject}</p></header>'


def draw_review(review: Review) -> Iterator[str]:
    """Draw the sections of a review."""
    yield "<h2>Findings</h2>"
    yield from _findings(review)
    yield "<h2>Bindings</h2>" + draw_table_head("Field", "Signal", "Verdict", "Why")
    for one in review.bindings:
        yield (
            f"<tr><td><code>{escape(one.field)}</code><td><code>{escape(one.signal)}</code>"
            f"<td>{draw_chip(one.judgement)}<td>{escape(one.text)}"
        )
    yield TABLE_END
    yield "<h2>Relations</h2>"
    yield (
        '<p class="quiet">Each law is y = x by kinematics alone, both as means over '
        f"{review.motion.window_s:g} s. Dashed: expected; solid: fitted.</p>"
    )
    yield draw_table_head("Law", "#Slope", "#Correlation", "#Lag", "#Used", "Outcome")
    for relation in review.relations:
        yield _relation_row(relation)
    yield TABLE_END
    yield '<div class="plots">'
    yield from _path_plot(review)
    for relation in review.relations:
        yield _relation_plots(relation)
    yield "</div>"
    yield from _messages(review)


def _findings(review: Review) -> Iterator[str]:
    if not review.findings:
        yield '<p class="quiet">None.</p>'
        return
    yield '<ul class="findings">'
    for finding in review.findings:
        text = escape(_capitalized(finding.text))
        yield f'<li class="{_CLASSES[finding.level]}">{draw_chip(finding.level)} {text}{_fix(finding)}'
    yield "</ul>"


def draw_table_head(*columns: str) -> str:
    """Draw the head of a table; columns that begin with # contain numbers."""
    cells = (f'<th class="n">{name[1:]}' if name.startswith("#") else f"<th>{name}" for name in columns)
    return f'<div class="scroll"><table><thead><tr>{"".join(cells)}</thead><tbody>'


def _fix(finding: Finding) -> str:
    return f"<pre>{escape(finding.fix)}</pre>" if finding.fix else ""


def draw_chip(verdict: Level | Judgement, word: str = "") -> str:
    """Draw a verdict as one word, by default its own."""
    return f'<span class="chip {_CLASSES[verdict]}">{escape(word or verdict.value)}</span>'


def _relation_row(relation: Relation) -> str:
    numbers = relation.fit
    lag = "–"
    if numbers is not None and numbers.lag_error_s < 0.1:
        lag = f"{1000.0 * numbers.lag_s:+.0f} ms"
    slope = f"{numbers.slope:#.3g}" if numbers is not None else "–"
    error = (
        f' <span class="quiet">±{100 * numbers.slope_error:.1f} %</span>'
        if numbers is not None and numbers.slope_error < 1.0
        else ""
    )
    outcome = relation.outcome.value if relation.outcome is Outcome.MEASURED else relation.why
    return (
        f'<tr><td><a href="#{relation.key}">{escape(relation.title)}</a><td class="n">{slope}{error}'
        f'<td class="n">{f"{numbers.correlation:.3f}" if numbers is not None else "–"}<td class="n">{lag}'
        f'<td class="n">{f"{numbers.used_s:.0f} s" if numbers is not None else "–"}<td>{escape(outcome)}'
    )


def _relation_plots(relation: Relation) -> str:
    times = relation.times_s
    curves = [
        Curve(name=relation.x_text, style="of-x", x=times, y=relation.x_values),
        Curve(name=relation.y_text, style="of-y", x=times, y=relation.y_values),
    ]
    title = relation.title
    scatter = ""
    if relation.fit is not None:
        scatter = draw_scatter(
            relation.x_values,
            relation.y_values,
            relation.fit.slope,
            relation.fit.offset,
            title,
            f"{relation.x_text}, {relation.unit}",
            f"{relation.y_text}, {relation.unit}",
        )
    legend = "".join(f'<li><i class="{curve.style}"></i>{escape(curve.name)}' for curve in curves)
    return (
        f'<figure id="{relation.key}"><figcaption>{escape(title)}</figcaption>'
        f'<div class="pair">{draw_curves(curves, title, relation.unit)}{scatter}</div>'
        f'<ul class="legend">{legend}</ul></figure>'
    )


def _path_plot(review: Review) -> Iterator[str]:
    motion = review.motion
    if motion.has(POSITION):
        x, y = motion.value(POSITION).T
        speed = (
            [Curve(name="speed", style="of-y", x=motion.grid.times_s, y=motion.mean("speed_mps"))]
            if motion.has("speed_mps")
            else []
        )
        plot = draw_curves(speed, "Speed", "speed, m/s", height=340) if speed else ""
        yield (
            "<figure><figcaption>Path and speed, as the profile reads them "
            '<span class="quiet">(dot: start)</span></figcaption>'
            f'<div class="pair path">{draw_path(np.asarray(x), np.asarray(y), "Path")}{plot}</div></figure>'
        )


def _messages(review: Review) -> Iterator[str]:
    numbers = ("#Frames", "#Stated", "#Period", "#Jitter", "#Longest pause", "#Out of range")
    yield "<h2>Messages</h2>" + draw_table_head("Message", "Role", *numbers, "Protection")
    for one in review.messages:
        cells = "".join(
            f'<td class="n">{f"{value:.3g} ms" if value is not None else "–"}'
            for value in (one.stated_ms, one.period_ms, one.jitter_ms, one.longest_gap_ms)
        )
        yield (
            f'<tr><td><code>{escape(one.name)}</code><td>{escape(one.role)}<td class="n">{one.count}{cells}'
            f'<td class="n">{one.out_of_range}<td>{escape(one.protection)}'
        )
    yield TABLE_END


def _capitalized(text: str) -> str:
    """Capitalize a sentence; names of signals are capitals already."""
    return text[0].upper() + text[1:]
