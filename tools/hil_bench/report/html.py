"""One self-contained page: the verdict, its evidence, every case, and the environment of the run.

The page needs no network and no other file; the raw recordings that lie in its folder are linked. Its only script
opens, filters and searches, and is named by its hash in the page's own security policy, so that nothing else can run.
"""

import base64
import hashlib
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from hil_bench.report import compare, drawing, formatting, over_time, summary
from hil_bench.result import CaseResult, Check, EventKind, Run, Verdict

FULL_REPETITIONS = 5
"""At most this many failed repetitions of a case are shown in full, or else the one closest to a limit."""

_FOLDER = Path(__file__).parent


def write(run: Run, folder: Path, compared_with: Run | None = None) -> Path:
    """Write `folder`/index.html; with an older run also what has changed since."""
    script = _read_files("page.js", "over_time.js")
    page = _environment(folder).get_template("page.html")
    groups = formatting.groups(run)
    text = page.render(
        run=run,
        groups=groups,
        coverage_rows=summary.cover(run, groups),
        stages=summary.sum_stages(run),
        tags=sorted({tag for case in run.cases for tag in case.tags}),
        differences=compare.differences(compared_with, run) if compared_with else None,
        style=_read_files("page.css", "over_time.css", "print.css"),
        script=script,
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    target = folder / "index.html"
    target.write_text(text, encoding="utf-8")
    return target


def _environment(folder: Path) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "Verdict": Verdict,
        "EventKind": EventKind,
        "formatting": formatting,
        "drawing": drawing,
        "draw_over_time": over_time.draw_case,
        "time_width": over_time.WIDTH,
        "time_height": over_time.HEIGHT,
        "factor": compare.factor,
        "shown_in_full": shown_in_full,
        "share_of_bar": share_of_bar,
        "link": lambda name: link(folder, name),
    }
    environment.filters |= {
        "slug": _slug,
        "moment": _moment,
        "percent": _percent,
        "exact": _exact,
        "clean": formatting.clean,
    }
    return environment


def shown_in_full(group: formatting.Group) -> list[CaseResult]:
    """The repetitions to show in full."""
    failed = [case for case in group.cases if case.verdict is Verdict.FAIL]
    return failed[:FULL_REPETITIONS] or [group.worst]


def share_of_bar(check: Check | None) -> float | None:
    """Filled share of a check's bar, 0 to 1; None where the limit is 0 and kept."""
    share = formatting.used(check) if check else None
    return None if share is None or (share == 0.0 and check and check.limit == 0.0) else min(share, 1.0)


def link(folder: Path, name: str) -> str:
    """Relative address of a file in the report's folder; empty for anything else."""
    try:
        inside = (folder / name).resolve().relative_to(folder.resolve())
        is_there = (folder / inside).is_file()
    except (OSError, ValueError):  # elsewhere, too long, with a NUL, a loop of links
        return ""
    return f"./{quote(inside.as_posix())}" if is_there else ""


def _read_files(*names: str) -> Markup:
    """Files of this folder, one after the other, as they are."""
    return Markup("\n").join(Markup((_FOLDER / name).read_text(encoding="utf-8")) for name in names)


def _shown(value: object) -> object:
    """Every expression of the template goes through here, before it is escaped."""
    if isinstance(value, Markup):
        return value
    if isinstance(value, float):
        return formatting.number(value)
    return formatting.clean(value) if isinstance(value, str) else value


def _slug(text: str) -> str:
    return text.lower().replace(" ", "-")


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f}".rstrip("0").rstrip(".")


def _exact(value: float) -> str:
    """For programs: a plain number."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def _moment(text: str) -> str:
    """ISO 8601 as people write it; anything else as it is."""
    try:
        return datetime.fromisoformat(text).strftime("%d %B %Y, %H:%M:%S %Z").lstrip("0")
    except ValueError:
        return text
