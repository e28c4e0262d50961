"""`vehicle-iface compare`: two recorded drives side by side, as a table and as one HTML page."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.files import check_writable
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.export.figures import FigureRow, tabulate
from vehicle_iface.export.page.drive import load_drive
from vehicle_iface.export.page.render import render_comparison, write_page
from vehicle_iface.export.recording import RecordedDrive


def compare(options: argparse.Namespace) -> int:
    """Print the figures of both drives; with `--html`, write the page."""
    if options.html:
        check_writable(options.html, "--html")
    drives = [load_drive(RecordedDrive(Path(folder))) for folder in (options.first, options.second)]
    print_safely(_format_table([options.first, options.second], tabulate([drive.figures for drive in drives])))
    for drive in drives:
        if drive.damaged:
            print_safely(f"{drive.folder}: {drive.damaged:,} damaged lines were left out")
    if options.html:
        html = render_comparison(drives)
        write_page(html, Path(options.html), "--html")
        print_safely(f"{options.html}: {len(html) / 1e3:,.0f} kB, opens in any browser")
    return DONE


def _format_table(heads: Sequence[str], rows: Sequence[FigureRow]) -> str:
    cells = [["", *heads], *([row.name, *row.values] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in cells)
