"""Options of the commands that read files: a DBC, a log, a recorded drive."""

import argparse

from vehicle_iface.cli.option_types import (
    add_channels,
    add_log_channels,
    add_profile,
    add_verbose,
    interface,
    number_above_0,
)


def add_check_dbc(parser: argparse.ArgumentParser) -> None:
    """Options of `check-dbc`."""
    parser.add_argument("file", metavar="FILE", help="a .dbc by itself, or a .toml profile with its DBC")
    parser.add_argument("--json", action="store_true", help="for programs: a list of file, line, severity, text")


def add_new_profile(parser: argparse.ArgumentParser) -> None:
    """Options of `new-profile`."""
    parser.add_argument("dbc", metavar="FILE.dbc", help="the vehicle's DBC, as its maker ships it")
    parser.add_argument("--out", metavar="FILE.toml", help="write the draft to this file (default: print it)")
    parser.add_argument("--force", action="store_true", help="overwrite the file of --out")


def add_decode(parser: argparse.ArgumentParser) -> None:
    """Options of `decode`."""
    parser.add_argument(
        "log",
        metavar="LOG",
        help="candump (with or without -L and -t), .asc, .trc, .blf, .csv of SavvyCAN or python-can, or the folder of "
        "`run --record`; its stamps become MESSAGE:stamp_ns, nanoseconds",
    )
    add_log_channels(parser)
    which = parser.add_mutually_exclusive_group()
    add_profile(which)
    which.add_argument(
        "--dbc", metavar="FILE", help="decode the messages of this DBC instead; MESSAGE.SIGNAL is in the DBC's unit"
    )
    parser.add_argument("--out", required=True, metavar="FILE.npz", help="the arrays; numpy.load reads them")
    parser.add_argument(
        "--message", action="append", default=[], metavar="NAME", help="decode only this message; may be repeated"
    )


def add_export(parser: argparse.ArgumentParser) -> None:
    """Options of `export`."""
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`")
    parser.add_argument(
        "--html", metavar="FILE", help="write one page that plays the drive in any browser, without a server"
    )
    parser.add_argument("--csv", metavar="FILE", help="write one row for each snapshot: SI units, states as names")
    parser.add_argument(
        "--mcap",
        metavar="FILE",
        help="write snapshots, events, counters and trajectories with JSON schemas; needs pip install "
        "'vehicle-iface[mcap]'",
    )
    parser.add_argument(
        "--from",
        type=number_above_0("seconds"),
        default=0.0,
        metavar="S",
        help="begin S seconds after the first snapshot",
    )
    parser.add_argument(
        "--to",
        type=number_above_0("seconds"),
        metavar="S",
        help="end S seconds after the first snapshot (default: at the end)",
    )
    parser.epilog = (
        "Overwrites existing files. Exit status: 0 done, 2 bad usage, no recording or a file that cannot be written."
    )


def add_compare(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("first", metavar="DIR", help="the folder of `run --record`")
    parser.add_argument("second", metavar="DIR", help="that of the other drive")
    parser.add_argument(
        "--html",
        metavar="FILE",
        help="write one page with errors, commands and events of both, aligned by time or by way along the path",
    )
    parser.epilog = (
        "Overwrites an existing file. Exit status: 0 done, 2 bad usage, no recording or a file that cannot be written."
    )


def add_replay(parser: argparse.ArgumentParser) -> None:
    """Options of `replay`."""
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`")
    add_channels(parser)
    parser.add_argument(
        "--interface", type=interface, default="socketcan", help="socketcan, or the name of a python-can interface"
    )
    parser.add_argument(
        "--with-commands",
        action="store_true",
        help="also send the frames that the controller had sent: command, lights, report and [[send]] of the recorded "
        "profile (default: only frames of all other nodes)",
    )
    parser.add_argument(
        "--real-bus", action="store_true", help="allow a bus that may be real: its nodes take the frames for true"
    )
    parser.epilog = (
        "A pause of more than 60 s is shortened to 60 s. Exit status: 0 done, 2 bad usage or no recording, 3 the bus "
        "cannot be used."
    )


def add_rerun(parser: argparse.ArgumentParser) -> None:
    """Options of `rerun`."""
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`, or a case of --save")
    parser.add_argument("--profile", help="profile to use instead of the recorded one: its name, or a .toml file")
    parser.add_argument("--controller", metavar="NAME", help="controller to use instead of the recorded one")
    parser.add_argument("--json", metavar="FILE", help="write all differences to this file")
    parser.add_argument(
        "--plot", metavar="FILE", help="write one HTML page: each signal that differs, recorded and today, over time"
    )
    parser.add_argument(
        "--save", metavar="CASE", help="write what a rerun needs into the new folder CASE, and run that again"
    )
    parser.add_argument(
        "--until",
        type=number_above_0("seconds"),
        metavar="S",
        help="only with --save: keep the first S seconds (default: all)",
    )
    add_verbose(parser, "show the log of the loop")
    parser.epilog = (
        "Frames and times are fed to the loop as they were recorded, pass by pass. On the same machine and version no "
        "command differs; a controller of your own must not depend on anything else. Exit status: 0 no difference, 1 a "
        "command differs or inputs are missing, 2 bad usage, no recording or no inputs in it."
    )


def add_review(parser: argparse.ArgumentParser) -> None:
    """Options of `review`."""
    parser.add_argument(
        "log",
        metavar="LOG",
        help="the log of a drive with turns and stops, of any kind that decode reads, or the folder of `run --record`",
    )
    parser.add_argument("--profile", required=True, help="profile of the vehicle: its name, or a .toml file")
    add_log_channels(parser)
    parser.add_argument("--html", metavar="FILE", help="write one page with plots to this file")
    parser.add_argument("--json", metavar="FILE", help="write all numbers and verdicts to this file")
    parser.epilog = "Exit status: 0 when nothing contradicts the profile, 1 when something does, 2 bad usage or file."
