"""Writes pages: one drive, or two drives side by side."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from html import escape
from pathlib import Path

import msgspec

from vehicle_iface.errors import ConfigError
from vehicle_iface.export.figures import FigureRow, tabulate
from vehicle_iface.export.page.drive import LETTERS, LoadedDrive, describe_drive, describe_plots
from vehicle_iface.export.page.model import Page
from vehicle_iface.export.page.reduction import MAX_ROWS, Reduction
from vehicle_iface.export.way import offset_m
from vehicle_iface.units import NS_PER_S

SCRIPTS = (
    "data.js",
    "view.js",
    "plot.js",
    "select.js",
    "now.js",
    "strip.js",
    "map.js",
    "scene.js",
    "events.js",
    "player.js",
    "csv.js",
    "main.js",
)
COLORS = ("drive-a", "drive-b")


def render_drive(drive: LoadedDrive) -> str:
    """Return the page of one drive; its times count from the first snapshot of the recording."""
    name = drive.folder.resolve().name
    page = Page(
        name=name,
        drives=[describe_drive(drive, label=name, color="drive-a", zero_ns=drive.first_ns)],
        plots=describe_plots([drive]),
        has_way=False,
    )
    return render_page(name, page, _head(name, [drive]), _table(tabulate([drive.figures]), []))


def render_comparison(drives: Sequence[LoadedDrive]) -> str:
    """Return the page of two drives, which can be aligned by time, from the beginning of driving, or by way."""
    first, second = drives
    offset = offset_m(first.rows, first.way_m, second.rows, second.way_m)
    names = [drive.folder.resolve().name for drive in drives]
    labels = [f"{letter}: {name}" for letter, name in zip(LETTERS, names, strict=True)]
    page = Page(
        name=" and ".join(names),
        drives=[
            describe_drive(drive, label=label, color=color, zero_ns=_zero_ns(drives, drive), way_offset_m=way_m)
            for drive, label, color, way_m in zip(drives, labels, COLORS, (0.0, offset or 0.0), strict=True)
        ],
        plots=describe_plots(drives, COLORS),
        has_way=True,
    )
    title = f"{names[0]} and {names[1]} compared"
    notes = [_describe_zero(drives)]
    if offset is None:
        notes.append("Neither drive begins on the other one's path: by way, each counts from its own beginning.")
    table = _table(tabulate([drive.figures for drive in drives]), labels)
    return render_page(title, page, _head(title, drives, labels, notes), table)


def render_page(title: str, page: Page, head: str, figures: str = "") -> str:
    """Return the whole file. `head` and `figures` are HTML."""
    data = msgspec.json.encode(page).decode().replace("<", "\\u003c")  # no tag of any text ends the script
    parts = {
        "title": escape(title),
        "style": _read("page.css"),
        "head": head,
        "figures": figures,
        "data": data,
        "script": "\n".join(_read(name) for name in SCRIPTS),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _read("page.html"))


def write_page(html: str, path: Path, option: str) -> None:
    """Write the file; `ConfigError` when it cannot be written."""
    try:
        path.write_text(html, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None


@cache
def _read(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _zero_ns(drives: Sequence[LoadedDrive], drive: LoadedDrive) -> int:
    """Time 0 of a drive that is compared: the beginning of driving, if all have driven."""
    if any(one.engaged_ns is None for one in drives) or drive.engaged_ns is None:
        return drive.first_ns
    return drive.engaged_ns


def _describe_zero(drives: Sequence[LoadedDrive]) -> str:
    if any(drive.engaged_ns is None for drive in drives):
        return "Times count from each drive's first snapshot: not both have driven."
    return "Times count from the moment at which each began to drive."


def _head(title: str, drives: Sequence[LoadedDrive], labels: Sequence[str] = (), notes: Sequence[str] = ()) -> str:
    lines = [f"<h1>{escape(title)}</h1>"]
    for number, drive in enumerate(drives):
        swatch = f'<i class="swatch" style="background: var(--{COLORS[number]})"></i>' if labels else ""
        label = f"<b>{escape(labels[number])}</b> · " if labels else ""
        lines.append(f'<p class="quiet">{swatch}{label}{escape(_describe(drive))}</p>')
        if drive.damaged:
            lines.append(f'<p class="note">{drive.damaged:,} damaged lines of the recording were left out.</p>')
        if len(drive.rows) > MAX_ROWS:
            group = Reduction.of(len(drive.rows)).group
            lines.append(
                f'<p class="note">{len(drive.rows):,} snapshots: of each {group} the extremes are drawn. '
                "Export a shorter part with --from and --to for all of them.</p>"
            )
    lines += [f'<p class="quiet">{escape(note)}</p>' for note in notes]
    return "".join(lines)


def _describe(drive: LoadedDrive) -> str:
    meta, session = drive.meta, drive.meta.session
    begin_ns = int(drive.rows["published_ns"][0])
    when = datetime.fromtimestamp((begin_ns - meta.monotonic_ns + meta.wall_ns) / NS_PER_S, UTC)
    parts = [
        f"{when:%Y-%m-%d %H:%M:%S} UTC",
        f"profile {session.profile}" if session.profile else "",
        f"route {session.route}" if session.route else "",
        session.arming,
        session.bus,
        f"{drive.figures.duration_s:.1f} s",
    ]
    return " · ".join(part for part in parts if part)


def _table(rows: Sequence[FigureRow], heads: Sequence[str]) -> str:
    head = "".join(f"<th>{escape(text)}" for text in ("", *heads)) if heads else ""
    body = "".join(
        f"<tr><th>{escape(row.name)}{''.join(f'<td>{escape(value)}' for value in row.values)}" for row in rows
    )
    thead = f"<thead><tr>{head}</thead>" if head else ""
    return f'<h2>Figures</h2><div class="scroll"><table>{thead}<tbody>{body}</tbody></table></div>'
