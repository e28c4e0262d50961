"""The options of every command. This module imports nothing that only one command needs, so that `--help` is fast."""

import argparse
import math
import os
from collections.abc import Callable, Sequence

from vehicle_iface.command_line import ArgumentParser, HelpFormatter
from vehicle_iface.route_names import ROUTE_NAMES

MAX_NUMBER = 1e9
"""Largest number of any option: 1e9 s, about 30 years, still fit into the nanoseconds of the telemetry."""
MAX_PORT = 0xFFFF
DEFAULT_TELEMETRY = "default"
EMBEDDED = "embedded"
"""The interface that needs nothing outside the process."""


def build_parser() -> argparse.ArgumentParser:
    """Build the parser of all commands; `command` is the name of the chosen one."""
    parser = ArgumentParser(
        prog="vehicle-iface",
        description="A CAN-bus vehicle interface: state frames in, checked commands out, watched in the browser.",
    )
    parser.add_argument("--version", action=_ShowVersion, help="show the version and exit")
    parser.set_defaults(verbose=False)
    commands = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    _add_demo(_command(commands, "demo", "run simulated vehicle, loop and viewer together"))
    _add_run(_command(commands, "run", "the loop: receive the vehicle's state and command it"))
    _add_sim(_command(commands, "sim", "run the simulated vehicle as a node on a bus"))
    _add_driver(_command(commands, "driver", "operate a simulated vehicle: pedals, gear, faults, sensors"))
    _add_doctor(_command(commands, "doctor", "check this machine; each problem comes with the command that fixes it"))
    _add_check_dbc(
        _command(commands, "check-dbc", "check a DBC or profile for use in control; each fault comes with its line")
    )
    _add_new_profile(
        _command(commands, "new-profile", "draft a profile from a DBC; each binding comes with its reason")
    )
    _add_decode(_command(commands, "decode", "decode a log of a bus into one NumPy array for each signal"))
    _add_export(_command(commands, "export", "write a recorded drive as CSV, or as MCAP for Foxglove and PlotJuggler"))
    _add_replay(_command(commands, "replay", "put the frames of a recorded drive back on a bus, with their timing"))
    _add_rerun(
        _command(commands, "rerun", "run a recorded drive through the code of today; report each command that differs")
    )
    _add_review(_command(commands, "review", "check a profile against a recorded drive: signs, units, delays"))
    _add_commission(_command(commands, "commission", "check a profile on the live bus: a guided walk that never sends"))
    commands.add_parser("view", add_help=False, help="the browser viewer (vehicle-iface view --help)")
    return parser


class _ShowVersion(argparse.Action):
    """Reads the version only on request, because importing `importlib.metadata` is slow."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str | None = None) -> None:  # noqa: A002
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print(f"{parser.prog} {version('vehicle-iface')}")
        parser.exit()


def command_names() -> set[str]:
    """Return the names of all commands."""
    actions = build_parser()._subparsers
    assert actions is not None
    return {name for action in actions._group_actions for name in action.choices or ()}


def _command(commands: "argparse._SubParsersAction[ArgumentParser]", name: str, text: str) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", formatter_class=HelpFormatter
    )
    parser.register("type", None, _text)  # of every option that names no other
    return parser


def _add_run(parser: argparse.ArgumentParser) -> None:
    _add_bus(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--trajectory", metavar="FILE.csv", help="drive this file once; its time 0 is the instant of engagement"
    )
    what.add_argument(
        "--route", choices=sorted(ROUTE_NAMES), help="drive along this route; it begins at the origin, along +x"
    )
    what.add_argument(
        "--trajectory-mailbox",
        metavar="FILE",
        help="drive the trajectory that another process publishes to this file, and each new one",
    )
    parser.add_argument(
        "--controller", default="pure_pursuit", metavar="NAME", help="pure_pursuit, or your own FILE.py:CLASS"
    )
    arming = parser.add_mutually_exclusive_group()
    arming.add_argument(
        "--arm", action="store_true", help="engage once when the vehicle is READY; without this option no frame is sent"
    )
    parser.add_argument(
        "--speed-cap",
        type=_above_0("m/s"),
        metavar="M/S",
        help="maximum speed (the profile's limit still applies); required with --arm on a real bus",
    )
    arming.add_argument(
        "--shadow",
        action="store_true",
        help="never send, but compute and compare with the active commander: the default",
    )
    parser.add_argument(
        "--duration",
        type=_above_0("seconds"),
        metavar="S",
        help="stop the vehicle and exit after S seconds (default: run until SIGINT)",
    )
    parser.add_argument(
        "--wait",
        nargs="?",
        type=_above_0("seconds"),
        const=math.inf,
        metavar="S",
        help="wait for the interface to come up, for at most S seconds",
    )
    parser.add_argument(
        "--telemetry", default=DEFAULT_TELEMETRY, metavar="ADDRESS", help="name, or path, that `view` connects to"
    )
    parser.add_argument("--record", metavar="DIR", help="record frames and telemetry into DIR, which must not exist")
    black_box = parser.add_mutually_exclusive_group()
    black_box.add_argument(
        "--black-box",
        metavar="DIR",
        help="keep the 30 s before and 5 s after each stop in this folder, at most 100 MB, then the oldest are removed "
        "(default: DIR/events of --record; of an armed drive on a real bus ~/.local/state/vehicle-iface/black-box)",
    )
    black_box.add_argument("--no-black-box", action="store_true", help="keep no stops")
    parser.add_argument("--summary", metavar="FILE.json", help="write counts and latencies of the run to this file")
    parser.add_argument("--cpu", type=_processor, metavar="N", help="run on this CPU only, counted from 0")
    parser.add_argument(
        "--frame", help="frame of reference of the route (default: the vehicle's; map if it has several)"
    )
    parser.add_argument("--verbose", action="store_true", help="log more")
    parser.epilog = (
        "Exit status: 0 done, 2 bad usage, configuration or file (also a summary that cannot be written after a drive "
        "without fault), 3 the bus cannot be used, 4 ended in a latched fault. SIGINT or SIGTERM stops the vehicle and "
        "ends, a second one releases it at once; SIGUSR1 arms again."
    )


def _add_sim(parser: argparse.ArgumentParser) -> None:
    _add_bus(parser)
    parser.add_argument("--start", default="0,0,0", metavar="X,Y,HEADING", help="start pose in m, m, rad")
    parser.add_argument("--frame", help="frame of reference of the reported pose (default: the vehicle's, else map)")
    parser.add_argument("--duration", type=_above_0("seconds"), metavar="S", help="exit after S seconds")
    parser.add_argument(
        "--driver-socket",
        metavar="PATH",
        help="socket for `vehicle-iface driver` (default: in the user's runtime directory, else in /tmp)",
    )
    parser.add_argument("--verbose", action="store_true", help="log more")


def _add_driver(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("path", help="the socket that `sim` names at its start")
    parser.add_argument("line", nargs="+", help="a command: brake 1, steer 4.0, ready, reset, status, help, …")


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--profile", default="reference", help="profile of the vehicle: its name, or a .toml file")
    parser.add_argument("--route", default="figure8", choices=sorted(ROUTE_NAMES), help="what to drive")
    parser.add_argument("--port", type=_port, default=8080, help="TCP port of the page on 127.0.0.1")
    parser.add_argument("--duration", type=_above_0("seconds"), metavar="S", help="exit after S seconds")
    parser.add_argument("--summary", metavar="FILE.json", help="write counts and latencies of the run to this file")
    parser.add_argument("--record", metavar="DIR", help="record frames and telemetry into DIR, which must not exist")
    parser.add_argument("--no-viewer", action="store_true", help="do not start the viewer")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")


def _add_doctor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--channel",
        dest="channels",
        action="append",
        default=[],
        metavar="[BUS=]NAME",
        help="the SocketCAN interface to look at: vcan0 (default), can0, …; of several buses each: ins=can1",
    )
    parser.add_argument(
        "--profile", default="reference", help="the profile whose bit rate and frames the interface must carry"
    )
    parser.add_argument(
        "--json", action="store_true", help="for programs: findings with subject, verdict, text and fix (a command)"
    )
    parser.epilog = "Exit status: 0 when nothing needed is missing, 2 otherwise. Needs no rights and changes nothing."


def _add_check_dbc(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a .dbc by itself, or a .toml profile with its DBC")
    parser.add_argument("--json", action="store_true", help="for programs: a list of file, line, severity, text")


def _add_new_profile(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dbc", metavar="FILE.dbc", help="the vehicle's DBC, as its maker ships it")
    parser.add_argument("--out", metavar="FILE.toml", help="write the draft to this file (default: print it)")
    parser.add_argument("--force", action="store_true", help="overwrite the file of --out")


def _add_decode(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log",
        metavar="LOG",
        help="candump (with or without -L and -t), .asc, .trc, .blf, .csv of SavvyCAN or python-can, or the folder of "
        "`run --record`; its stamps become MESSAGE:stamp_ns, nanoseconds",
    )
    _add_log_channels(parser)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--profile", default="reference", help="profile of the vehicle: its name, or a .toml file")
    which.add_argument(
        "--dbc", metavar="FILE", help="decode the messages of this DBC instead; MESSAGE.SIGNAL is in the DBC's unit"
    )
    parser.add_argument("--out", required=True, metavar="FILE.npz", help="the arrays; numpy.load reads them")
    parser.add_argument(
        "--message", action="append", default=[], metavar="NAME", help="decode only this message; may be repeated"
    )


def _add_export(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`")
    parser.add_argument("--csv", metavar="FILE", help="write one row for each snapshot: SI units, states as names")
    parser.add_argument(
        "--mcap",
        metavar="FILE",
        help="write snapshots, events, counters and trajectories with JSON schemas; needs pip install "
        "'vehicle-iface[mcap]'",
    )
    parser.add_argument(
        "--from", type=_above_0("seconds"), default=0.0, metavar="S", help="begin S seconds after the first snapshot"
    )
    parser.add_argument(
        "--to",
        type=_above_0("seconds"),
        metavar="S",
        help="end S seconds after the first snapshot (default: at the end)",
    )
    parser.epilog = (
        "Overwrites existing files. Exit status: 0 done, 2 bad usage, no recording or a file that cannot be written."
    )


def _add_replay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`")
    _add_channels(parser)
    parser.add_argument(
        "--interface", type=_interface, default="socketcan", help="socketcan, or the name of a python-can interface"
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


def _add_rerun(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", metavar="DIR", help="the folder of `run --record`, or a case of --save")
    parser.add_argument("--profile", help="profile to use instead of the recorded one: its name, or a .toml file")
    parser.add_argument("--controller", metavar="NAME", help="controller to use instead of the recorded one")
    parser.add_argument("--json", metavar="FILE", help="write all differences to this file")
    parser.add_argument(
        "--save", metavar="CASE", help="write what a rerun needs into the new folder CASE, and run that again"
    )
    parser.add_argument(
        "--until",
        type=_above_0("seconds"),
        metavar="S",
        help="only with --save: keep the first S seconds (default: all)",
    )
    parser.add_argument("--verbose", action="store_true", help="show the log of the loop")
    parser.epilog = (
        "Frames and times are fed to the loop as they were recorded, pass by pass. On the same machine and version no "
        "command differs; a controller of your own must not depend on anything else. Exit status: 0 no difference, 1 a "
        "command differs or inputs are missing, 2 bad usage, no recording or no inputs in it."
    )


def _add_review(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log",
        metavar="LOG",
        help="the log of a drive with turns and stops, of any kind that decode reads, or the folder of `run --record`",
    )
    parser.add_argument("--profile", required=True, help="profile of the vehicle: its name, or a .toml file")
    _add_log_channels(parser)
    parser.add_argument("--html", metavar="FILE", help="write one page with plots to this file")
    parser.add_argument("--json", metavar="FILE", help="write all numbers and verdicts to this file")
    parser.epilog = "Exit status: 0 when nothing contradicts the profile, 1 when something does, 2 bad usage or file."


def _add_commission(parser: argparse.ArgumentParser) -> None:
    _add_bus(parser)
    parser.add_argument("--out", metavar="REPORT.html", help="write one page with the walk and the review of its log")
    parser.add_argument("--json", metavar="FILE", help="write all verdicts and numbers to this file")
    parser.add_argument(
        "--record", metavar="LOG", help="record the frames to this new file (default: PROFILE-walk-DATE-TIME.log)"
    )
    parser.add_argument(
        "--step-timeout",
        type=_above_0("seconds"),
        default=60.0,
        metavar="S",
        help="skip a step after S seconds; Enter on a terminal skips it at once",
    )
    parser.add_argument(
        "--write",
        action="store_true",
        help="if every step succeeds, write reviewed = true and the record into the profile without asking",
    )
    parser.add_argument("--verbose", action="store_true", help="log more")
    parser.epilog = (
        "No frame is ever sent. Exit status: 0 when everything was seen and nothing contradicts the profile, 1 when "
        "something contradicts it, 2 bad usage, profile or file, 3 the bus cannot be used, 5 when something was not "
        "seen. SIGINT ends the walk with its report."
    )


def _add_log_channels(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--channel",
        dest="channels",
        action="append",
        default=[],
        metavar="[BUS=]NAME",
        help="only this channel, as the log calls it; required if there are several. Of a profile with several buses "
        "that of each: --channel vehicle=can0 --channel ins=can1 (default: channels with the names of the buses)",
    )


def _add_bus(parser: argparse.ArgumentParser) -> None:
    _add_channels(parser)
    parser.add_argument(
        "--interface",
        type=_interface,
        default="socketcan",
        help="socketcan, embedded, or the name of a python-can interface",
    )
    parser.add_argument("--profile", default="reference", help="profile of the vehicle: its name, or a .toml file")


def _add_channels(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--channel",
        dest="channels",
        action="append",
        default=[],
        metavar="[BUS=]NAME",
        help="the bus: vcan0 (default), can0, or what the interface calls it; of a profile with several buses each, by "
        "its name there: --channel vehicle=can0 --channel ins=can1",
    )


def _above_0(unit: str) -> Callable[[str], float]:
    """Build the type of an option that takes a positive number of that unit."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value <= MAX_NUMBER:
            raise argparse.ArgumentTypeError(f"{text!r}: must be a number of {unit} above 0, at most {MAX_NUMBER:g}")
        return value

    return number


def _text(text: str) -> str:
    """Reject empty strings (usually an unset shell variable) and text that is not UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be UTF-8") from None
    if not text:
        raise argparse.ArgumentTypeError("'': must not be empty")
    return text


def _interface(text: str) -> str:
    if text not in ("socketcan", EMBEDDED):
        from vehicle_iface.bus.python_can import INTERFACES  # 0.2 s, only for those who use python-can

        if text not in INTERFACES:
            known = ", ".join(sorted(INTERFACES))
            raise argparse.ArgumentTypeError(f"{text!r}: must be socketcan, embedded or one of python-can's: {known}")
    return text


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r}: must be within 0 … {MAX_PORT}")
    return int(text)


def _processor(text: str) -> int:
    allowed = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    if text not in map(str, allowed):
        raise argparse.ArgumentTypeError(
            f"{text!r}: not a CPU for this process: must be one of {', '.join(map(str, allowed))}"
        )
    return int(text)
