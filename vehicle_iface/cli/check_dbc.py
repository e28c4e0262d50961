"""`vehicle-iface check-dbc`: all faults of a DBC or profile."""

import argparse
import dataclasses
import json
from pathlib import Path

from vehicle_iface.cli.exit_status import BAD_USAGE, DONE
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec import lint
from vehicle_iface.codec.dbc_findings import ERROR


def check_dbc(options: argparse.Namespace) -> int:
    """Print all faults of a DBC or profile; return 2 if there is an error among them."""
    findings = lint.check_file(Path(options.file))
    if options.json:
        print_safely(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        for finding in findings:
            print_safely(str(finding))
    return BAD_USAGE if any(finding.severity == ERROR for finding in findings) else DONE
