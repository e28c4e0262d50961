"""`vehicle-iface decode`: the log of a bus as arrays."""

import argparse
import sys
from pathlib import Path

from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.progress import show_progress
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.columns import DecodedLog, decode_log, save, summarize
from vehicle_iface.profile import load_profile

MAX_REFUSED_SHOWN = 20
"""Lines of a log that are named one by one."""
MAX_NAMES_SHOWN = 8
MAX_FAULTS_SHOWN = 5
"""Faults of the DBC that are named one by one."""


def decode(options: argparse.Namespace) -> int:
    """Write the arrays and print a summary; rejected lines of the log are named on standard error."""
    dbc = Path(options.dbc or load_profile(options.profile).dbc)
    file = read_dbc(dbc)
    selected = file.select_messages(options.message)
    _show_faults(file)
    log = decode_log(Path(options.log), selected, checked=True, channel=options.channel, progress=show_progress)
    for refused in log.refused[:MAX_REFUSED_SHOWN]:
        print(f"{options.log}:{refused.line}: {refused.why}", file=sys.stderr)
    if len(log.refused) > MAX_REFUSED_SHOWN:
        print(f"… and {len(log.refused) - MAX_REFUSED_SHOWN} more lines", file=sys.stderr)
    if not log.decoded:
        raise ConfigError(_explain_empty(log, options.log, dbc))
    try:
        with open(options.out, "wb") as out:
            save(log, out)
    except OSError as error:
        raise ConfigError(f"--out {options.out}: cannot be written: {error.strerror}") from None
    for line in summarize(log):
        print_safely(line)
    return DONE


def _explain_empty(log: DecodedLog, path: str, dbc: Path) -> str:
    """Why none of the frames became values."""
    names = list(log.messages)
    wanted = ", ".join(names[:MAX_NAMES_SHOWN]) + (", …" if len(names) > MAX_NAMES_SHOWN else "")
    *_, counts = summarize(log)
    return f"{path}: no values of {wanted} of {dbc} ({counts}): choose another --profile, --dbc, --message or --channel"


def _show_faults(file: DbcFile) -> None:
    for error in file.errors[:MAX_FAULTS_SHOWN]:
        print(error, file=sys.stderr)
    if len(file.errors) > MAX_FAULTS_SHOWN:
        print(f"… and {len(file.errors) - MAX_FAULTS_SHOWN} more faults; see vehicle-iface check-dbc", file=sys.stderr)
