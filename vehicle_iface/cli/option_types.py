"""Types of options, and the options that several commands share."""

import argparse
import math
import os
from collections.abc import Callable

MAX_NUMBER = 1e9
"""Largest number of any option: 1e9 s, about 30 years, still fit into the nanoseconds of the telemetry."""
MAX_PORT = 0xFFFF
EMBEDDED = "embedded"
"""The interface that needs nothing outside the process."""


def number_above_0(unit: str) -> Callable[[str], float]:
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


def plain_text(text: str) -> str:
    """Reject empty strings (usually an unset shell variable) and text that is not UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be UTF-8") from None
    if not text:
        raise argparse.ArgumentTypeError("'': must not be empty")
    return text


def interface(text: str) -> str:
    """Accept the names of python-can's interfaces, socketcan and embedded."""
    if text not in ("socketcan", EMBEDDED):
        from vehicle_iface.bus.python_can import INTERFACES  # 0.2 s, only for those who use python-can

        if text not in INTERFACES:
            known = ", ".join(sorted(INTERFACES))
            raise argparse.ArgumentTypeError(f"{text!r}: must be socketcan, embedded or one of python-can's: {known}")
    return text


def port(text: str) -> int:
    """A TCP port."""
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r}: must be within 0 … {MAX_PORT}")
    return int(text)


def processor(text: str) -> int:
    """The number of a CPU that this process may use."""
    allowed = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    if text not in map(str, allowed):
        raise argparse.ArgumentTypeError(
            f"{text!r}: not a CPU for this process: must be one of {', '.join(map(str, allowed))}"
        )
    return int(text)


def add_log_channels(parser: argparse.ArgumentParser) -> None:
    """--channel, of the buses in a log."""
    parser.add_argument(
        "--channel",
        dest="channels",
        action="append",
        default=[],
        metavar="[BUS=]NAME",
        help="only this channel, as the log calls it; required if there are several. Of a profile with several buses "
        "that of each: --channel vehicle=can0 --channel ins=can1 (default: channels with the names of the buses)",
    )


def add_bus(parser: argparse.ArgumentParser) -> None:
    """--channel, --interface and --profile, of a live bus."""
    add_channels(parser)
    parser.add_argument(
        "--interface",
        type=interface,
        default="socketcan",
        help="socketcan, embedded, or the name of a python-can interface",
    )
    add_profile(parser)


def add_channels(parser: argparse.ArgumentParser) -> None:
    """--channel, of the buses to open."""
    parser.add_argument(
        "--channel",
        dest="channels",
        action="append",
        default=[],
        metavar="[BUS=]NAME",
        help="the bus: vcan0 (default), can0, or what the interface calls it; of a profile with several buses each, by "
        "its name there: --channel vehicle=can0 --channel ins=can1",
    )


def add_profile(parser: "argparse._ActionsContainer") -> None:
    """--profile, of the vehicle to use."""
    parser.add_argument("--profile", default="reference", help="profile of the vehicle: its name, or a .toml file")


def add_duration(parser: argparse.ArgumentParser, end: str = "exit after S seconds") -> None:
    """--duration."""
    parser.add_argument("--duration", type=number_above_0("seconds"), metavar="S", help=end)


def add_summary(parser: argparse.ArgumentParser) -> None:
    """--summary, of a run."""
    parser.add_argument("--summary", metavar="FILE.json", help="write counts and latencies of the run to this file")


def add_record(parser: argparse.ArgumentParser) -> None:
    """--record, of a run."""
    parser.add_argument("--record", metavar="DIR", help="record frames and telemetry into DIR, which must not exist")


def add_verbose(parser: argparse.ArgumentParser, what: str = "log more") -> None:
    """--verbose."""
    parser.add_argument("--verbose", action="store_true", help=what)
