"""`vehicle-iface rerun`: runs a recorded drive through the code of today and reports each command that differs."""

import argparse
import logging
from pathlib import Path

import msgspec

from vehicle_iface.cli.exit_status import DIFFERENT, DONE
from vehicle_iface.cli.files import check_writable, write_text
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.rerun.case import save_case
from vehicle_iface.rerun.drive import rerun


def run_again(options: argparse.Namespace) -> int:
    """Run the drive again; with `--save`, write it as a case first."""
    if options.json:
        check_writable(options.json, "--json")
    if options.plot:
        check_writable(options.plot, "--plot")
    folder = Path(options.recording)
    if options.save:
        folder = save_case(folder, Path(options.save), until_s=options.until)
    if not options.verbose:
        logging.getLogger("vehicle_iface").setLevel(logging.CRITICAL)  # the loop logs the recorded drive again
    plot = Path(options.plot) if options.plot else None
    report = rerun(folder, profile=options.profile, controller=options.controller, plot=plot)
    if options.json:
        write_text(options.json, msgspec.json.format(msgspec.json.encode(report)).decode() + "\n", "--json")
    print_safely(report.text)
    if options.plot:
        print_safely(f"{options.plot}: opens in any browser")
    return DIFFERENT if report.count or report.gap else DONE
