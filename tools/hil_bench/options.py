"""The options of the bench's command line."""

import argparse
from difflib import get_close_matches
from typing import NoReturn

from hil_bench.device import OWN_EXPORT, Commands

BAD_USAGE = 2
"""Exit status, as any program that uses argparse has it."""


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the default of each option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        has_default = action.default or type(action.default) in (int, float)  # 0 is one, False and [] are none
        return super()._get_help_string(action) if has_default else action.help


class _Parser(argparse.ArgumentParser):
    """Reports a mistake in one line, with the option that was probably meant."""

    def error(self, message: str) -> NoReturn:
        wrong = next((word for word in message.split() if word.startswith("--")), "")
        near = get_close_matches(wrong, self._option_string_actions, n=1) if "unrecognized" in message else []
        hint = f"did you mean {near[0]}?" if near else f"see {self.prog} --help"
        self.exit(BAD_USAGE, f"{self.prog}: {message}; {hint}\n")


def build_parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="hil-bench",
        description="Test a controller on a CAN bus: play the vehicle, inject faults, and judge from outside.",
        epilog="Exit status: 0 every executed case passed, 1 a case failed, 2 bad usage, 3 nothing was executed, "
        "130 interrupted.",
        formatter_class=_HelpFormatter,
    )
    add = parser.add_argument
    add(
        "--channel",
        action="append",
        default=[],
        help="SocketCAN interface: can0, vcan0, …; of a vehicle with several buses NAME=can0 for each",
    )
    add(
        "--out",
        default="",
        metavar="DIR",
        help="new folder for the report: index.html, junit.xml, results.json, cases/",
    )
    add(
        "--resume",
        default="",
        metavar="DIR",
        help="continue the interrupted run in DIR with its options: executed cases are kept, the rest is executed",
    )
    add(
        "--beside",
        action="append",
        default=[],
        metavar="IF",
        help="further interface on which cases are executed at the same time; may be repeated, as processors allow",
    )
    add("--schema", action="store_true", help="print the JSON schema of results.json, and exit")
    add("--case", action="append", default=[], metavar="NAME", help="execute only this case; may be repeated")
    add("--tag", action="append", default=[], metavar="TAG", help="execute only cases with this tag; may be repeated")
    add("--quick", action="store_true", help="execute only the quick cases, in some three minutes")
    add("--list", action="store_true", help="list all cases and what each proves, and exit")
    add("--repeat", type=_positive_int, default=1, metavar="N", help="execute each case N times")
    add("--seed", type=int, default=0, help="seed of everything random; repetition n uses seed + n − 1")
    add("--compare", default="", metavar="OLD.json", help="results.json of an earlier run: report what changed")
    add(
        "--json", action="store_true", help="print the results (or the list) as JSON; progress goes to the error output"
    )
    add("--until-failure", action="store_true", help="end after the first case that fails")
    add("--strict", action="store_true", help="count a case that was not executed as a failure")
    add("--profile", default="reference", help="vehicle to play: a profile's name or a .toml file")
    commands = Commands()
    add(
        "--device",
        default=commands.start,
        metavar="COMMAND",
        help="starts the device, with {channels} {channel} {profile} {trajectory} {route}; '' if it is already running",
    )
    add(
        "--listen-device",
        default=None,
        metavar="COMMAND",
        help="starts the device without arming it (default: vehicle-iface run, if --device is that)",
    )
    add(
        "--recording-device",
        default=None,
        metavar="COMMAND",
        help="starts the device so that it records its drive in the folder {record} (default: likewise)",
    )
    add(
        "--export",
        nargs="?",
        default="",
        const=OWN_EXPORT,
        metavar="COMMAND",
        help="record the drive of each manoeuvre, and link a page of it: COMMAND writes the file {page} from the "
        "folder {record} (default: vehicle-iface export)",
    )
    add(
        "--viewer",
        default=None,
        metavar="COMMAND",
        help="starts a viewer that serves {port} of this computer (default: vehicle-iface view, likewise)",
    )
    add(
        "--device-version",
        default=None,
        metavar="COMMAND",
        help="prints the device's version, for the report (default: vehicle-iface --version, likewise)",
    )
    add("--stop", default="", metavar="COMMAND", help="ends the device; '' sends SIGINT to what --device started")
    add(
        "--rearm",
        default="",
        metavar="COMMAND",
        help="arms the device again; '' sends SIGUSR1 to what --device started",
    )
    add("--route", default="", metavar="NAME", help="route of a device that is already running")
    add("--write-routes", default="", metavar="DIR", help="write every trajectory of the catalogue to DIR, and exit")
    add(
        "--elsewhere", action="store_true", help="--device is a remote shell (ssh): the device runs on another computer"
    )
    add("--duration", type=float, default=10.0, metavar="S", help="time to listen on a bus with other traffic, s")
    add(
        "--despite-traffic",
        action="store_true",
        help="play a vehicle on a bus with other traffic; asks for the profile's name",
    )
    add("--type-profile", default="", metavar="NAME", help="the profile's name again, to confirm --despite-traffic")
    add(
        "--real-vehicle",
        action="store_true",
        help="a real vehicle is on the bus: only listen, and report the evidence as such",
    )
    return parser


def _positive_int(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a number above 0")
    return int(text)
