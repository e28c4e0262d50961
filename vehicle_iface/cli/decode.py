"""`vehicle-iface decode`: converts a bus log to arrays."""

import argparse
import sys
from pathlib import Path

from vehicle_iface.cli.channels import find_log_channels
from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.files import find_log
from vehicle_iface.cli.progress import show_progress
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.bus_files import read_dbcs
from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.columns import DecodedLog, decode_buses, decode_log, save, summarize
from vehicle_iface.profile import Profile, load_profile

MAX_REFUSED_SHOWN = 20
"""Largest number of rejected lines of a log that are listed."""
MAX_NAMES_SHOWN = 8
MAX_FAULTS_SHOWN = 5
"""Largest number of faults of the DBC that are listed."""


def decode(options: argparse.Namespace) -> int:
    """Write the arrays and print a summary; list rejected lines of the log on standard error."""
    profile = None if options.dbc else load_profile(options.profile)
    file = read_dbcs(profile) if profile is not None else read_dbc(Path(options.dbc))
    dbcs = options.dbc if profile is None else " and ".join(bus.dbc for bus in profile.all_buses.values())
    log = _decode(options, file, profile)
    for refused in log.refused[:MAX_REFUSED_SHOWN]:
        print(f"{options.log}:{refused.line}: {refused.why}", file=sys.stderr)
    if len(log.refused) > MAX_REFUSED_SHOWN:
        print(f"… and {len(log.refused) - MAX_REFUSED_SHOWN} more lines", file=sys.stderr)
    if not log.decoded:
        raise ConfigError(_explain_empty(log, options.log, dbcs))
    try:
        with open(options.out, "wb") as out:
            save(log, out)
    except OSError as error:
        raise ConfigError(f"--out {options.out}: cannot be written: {error.strerror}") from None
    for line in summarize(log):
        print_safely(line)
    return DONE


def _decode(options: argparse.Namespace, file: DbcFile, profile: Profile | None) -> DecodedLog:
    """Decode the messages on the chosen channel, or on the channel of each bus."""
    path, selected = find_log(options.log), file.select_messages(options.message)
    _show_faults(file)
    if profile is None:
        if len(options.channels) > 1:
            raise ConfigError(f"--channel: {len(options.channels)} were given, and --dbc is for one; give one of them")
        channel = options.channels[0] if options.channels else None
        return decode_log(path, selected, checked=True, channel=channel, progress=show_progress)
    channels = find_log_channels(options.channels, profile, command=f"decode {options.log}")
    if len(channels) == 1:
        (channel,) = channels.values()
        return decode_log(path, selected, checked=True, channel=channel, progress=show_progress)
    by_channel = {
        channel: [message for message in selected if file.part_of(message.name) is file.parts[bus]]
        for bus, channel in channels.items()
        if channel is not None
    }
    return decode_buses(path, by_channel, checked=True, progress=show_progress)


def _explain_empty(log: DecodedLog, path: str, dbc: str) -> str:
    """Explain why no frame was decoded."""
    names = list(log.messages)
    wanted = ", ".join(names[:MAX_NAMES_SHOWN]) + (", …" if len(names) > MAX_NAMES_SHOWN else "")
    *_, counts = summarize(log)
    return f"{path}: no values of {wanted} of {dbc} ({counts}): choose another --profile, --dbc, --message or --channel"


def _show_faults(file: DbcFile) -> None:
    for error in file.errors[:MAX_FAULTS_SHOWN]:
        print(error, file=sys.stderr)
    if len(file.errors) > MAX_FAULTS_SHOWN:
        print(f"… and {len(file.errors) - MAX_FAULTS_SHOWN} more faults; see vehicle-iface check-dbc", file=sys.stderr)
