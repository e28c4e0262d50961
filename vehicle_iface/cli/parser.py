"""The parser of all commands. It imports nothing that only one command needs, so that `--help` is fast."""

import argparse
from collections.abc import Callable, Sequence
from typing import NamedTuple

from vehicle_iface.cli import drive_options, file_options
from vehicle_iface.cli.option_types import plain_text
from vehicle_iface.command_line import ArgumentParser, HelpFormatter


class _Command(NamedTuple):
    name: str
    text: str
    add_options: Callable[[argparse.ArgumentParser], None]


_COMMANDS = (
    _Command("demo", "run simulated vehicle, loop and viewer together", drive_options.add_demo),
    _Command("run", "the loop: receive the vehicle's state and command it", drive_options.add_run),
    _Command("sim", "run the simulated vehicle as a node on a bus", drive_options.add_sim),
    _Command("driver", "operate a simulated vehicle: pedals, gear, faults, sensors", drive_options.add_driver),
    _Command(
        "doctor", "check this machine; each problem comes with the command that fixes it", drive_options.add_doctor
    ),
    _Command(
        "check-dbc",
        "check a DBC or profile for use in control; each fault comes with its line",
        file_options.add_check_dbc,
    ),
    _Command(
        "new-profile", "draft a profile from a DBC; each binding comes with its reason", file_options.add_new_profile
    ),
    _Command("decode", "decode a log of a bus into one NumPy array for each signal", file_options.add_decode),
    _Command(
        "export",
        "write a recorded drive as one HTML page, as CSV, or as MCAP for Foxglove and PlotJuggler",
        file_options.add_export,
    ),
    _Command("compare", "show two recorded drives side by side: a table, and one HTML page", file_options.add_compare),
    _Command("replay", "put the frames of a recorded drive back on a bus, with their timing", file_options.add_replay),
    _Command(
        "rerun",
        "run a recorded drive through the code of today; report each command that differs",
        file_options.add_rerun,
    ),
    _Command("review", "check a profile against a recorded drive: signs, units, delays", file_options.add_review),
    _Command(
        "commission", "check a profile on the live bus: a guided walk that never sends", drive_options.add_commission
    ),
)
_VIEW = "view"
"""It has a parser of its own."""


def build_parser(command: str = "") -> argparse.ArgumentParser:
    """Build the parser of all commands; `command` of its result is the name of the chosen one.

    If it is known before, only this command's options are added, which takes a fifth of the time.
    """
    parser = ArgumentParser(
        prog="vehicle-iface",
        description="A CAN-bus vehicle interface: state frames in, checked commands out, watched in the browser.",
    )
    parser.add_argument("--version", action=_ShowVersion, help="show the version and exit")
    parser.set_defaults(verbose=False)
    commands = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    for one in [one for one in _COMMANDS if one.name == command] or _COMMANDS:
        one.add_options(_add_command(commands, one))
    commands.add_parser(_VIEW, add_help=False, help="the browser viewer (vehicle-iface view --help)")
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
    return {*(one.name for one in _COMMANDS), _VIEW}


def _add_command(commands: "argparse._SubParsersAction[ArgumentParser]", command: _Command) -> argparse.ArgumentParser:
    description = f"{command.text[0].upper()}{command.text[1:]}."
    parser = commands.add_parser(
        command.name, help=command.text, description=description, formatter_class=HelpFormatter
    )
    parser.register("type", None, plain_text)  # of every option that names no other
    return parser
