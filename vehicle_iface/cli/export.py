"""`vehicle-iface export`: writes a recording as CSV, as MCAP or as one HTML page."""

import argparse
from pathlib import Path

from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.files import check_writable
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.errors import ConfigError
from vehicle_iface.export.csv_file import write_csv
from vehicle_iface.export.mcap_file import require_mcap, write_mcap
from vehicle_iface.export.page.drive import load_drive
from vehicle_iface.export.page.render import render_drive, write_page
from vehicle_iface.export.recording import RecordedDrive


def export(options: argparse.Namespace) -> int:
    """Write the files that were asked for."""
    if not (options.csv or options.mcap or options.html):
        raise ConfigError("export: name what to write: --html FILE, --csv FILE or --mcap FILE")
    if options.to is not None and options.to <= getattr(options, "from"):
        raise ConfigError(f"--to {options.to:g}: must be greater than --from {getattr(options, 'from'):g}")
    if options.mcap:
        require_mcap()
    drive = RecordedDrive(Path(options.recording), begin_s=getattr(options, "from"), end_s=options.to)
    if options.csv:
        check_writable(options.csv, "--csv")
        try:
            print_safely(f"{options.csv}: {write_csv(drive, Path(options.csv)):,} snapshots")
        except OSError as error:
            raise ConfigError(f"--csv {options.csv}: cannot be written: {error.strerror}") from None
    if options.mcap:
        check_writable(options.mcap, "--mcap")
        try:
            counts = write_mcap(drive, Path(options.mcap))
        except OSError as error:
            raise ConfigError(f"--mcap {options.mcap}: cannot be written: {error.strerror}") from None
        print_safely(f"{options.mcap}: " + ", ".join(f"/{topic} {count:,}" for topic, count in counts.items()))
    if options.html:
        check_writable(options.html, "--html")
        drive.damaged = 0
        html = render_drive(load_drive(drive))
        write_page(html, Path(options.html), "--html")
        print_safely(f"{options.html}: {len(html) / 1e3:,.0f} kB, opens in any browser")
    if drive.damaged:
        print_safely(f"{options.recording}: {drive.damaged:,} damaged lines were left out")
    return DONE
