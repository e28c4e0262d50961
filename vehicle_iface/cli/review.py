"""`vehicle-iface review`: checks a profile against a recorded drive."""

import argparse

from vehicle_iface.cli.channels import find_log_channels
from vehicle_iface.cli.exit_status import CONTRADICTED, DONE
from vehicle_iface.cli.files import find_log, write_text
from vehicle_iface.cli.progress import show_progress
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.profile import load_profile
from vehicle_iface.review.page import render_page
from vehicle_iface.review.report import summarize, to_json
from vehicle_iface.review.review import review_drive
from vehicle_iface.review.series import read_drive


def review(options: argparse.Namespace) -> int:
    """Print the findings and write the page; return 1 if something contradicts the profile."""
    log = find_log(options.log)
    profile = load_profile(options.profile)
    channels = find_log_channels(options.channels, profile, command=f"review {options.log}")
    drive = read_drive(log, profile, channels=channels, progress=show_progress)
    found = review_drive(drive)
    if options.html:
        write_text(options.html, render_page(found, log.name), "--html")
    if options.json:
        write_text(options.json, to_json(found), "--json")
    for line in summarize(found):
        print_safely(line)
    return CONTRADICTED if found.contradictions else DONE
