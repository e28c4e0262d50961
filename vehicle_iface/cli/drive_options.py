"""Options of the commands that use a bus."""

import argparse
import math

from vehicle_iface.cli.option_types import (
    add_bus,
    add_duration,
    add_profile,
    add_record,
    add_summary,
    add_verbose,
    number_above_0,
    port,
    processor,
)
from vehicle_iface.route_names import ROUTE_NAMES

DEFAULT_TELEMETRY = "default"


def add_run(parser: argparse.ArgumentParser) -> None:
    """Options of `run`."""
    add_bus(parser)
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
        type=number_above_0("m/s"),
        metavar="M/S",
        help="maximum speed (the profile's limit still applies); required with --arm on a real bus",
    )
    arming.add_argument(
        "--shadow",
        action="store_true",
        help="never send, but compute and compare with the active commander: the default",
    )
    add_duration(parser, "stop the vehicle and exit after S seconds (default: run until SIGINT)")
    parser.add_argument(
        "--wait",
        nargs="?",
        type=number_above_0("seconds"),
        const=math.inf,
        metavar="S",
        help="wait for the interface to come up, for at most S seconds",
    )
    parser.add_argument(
        "--telemetry", default=DEFAULT_TELEMETRY, metavar="ADDRESS", help="name, or path, that `view` connects to"
    )
    add_record(parser)
    black_box = parser.add_mutually_exclusive_group()
    black_box.add_argument(
        "--black-box",
        metavar="DIR",
        help="keep the 30 s before and 5 s after each stop in this folder, at most 100 MB, then the oldest are removed "
        "(default: DIR/events of --record; of an armed drive on a real bus ~/.local/state/vehicle-iface/black-box)",
    )
    black_box.add_argument("--no-black-box", action="store_true", help="keep no stops")
    add_summary(parser)
    parser.add_argument("--cpu", type=processor, metavar="N", help="run on this CPU only, counted from 0")
    parser.add_argument(
        "--frame", help="frame of reference of the route (default: the vehicle's; map if it has several)"
    )
    add_verbose(parser)
    parser.epilog = (
        "Exit status: 0 done, 2 bad usage, configuration or file (also a summary that cannot be written after a drive "
        "without fault), 3 the bus cannot be used, 4 ended in a latched fault. SIGINT or SIGTERM stops the vehicle and "
        "ends, a second one releases it at once; SIGUSR1 arms again."
    )


def add_sim(parser: argparse.ArgumentParser) -> None:
    """Options of `sim`."""
    add_bus(parser)
    parser.add_argument("--start", default="0,0,0", metavar="X,Y,HEADING", help="start pose in m, m, rad")
    parser.add_argument("--frame", help="frame of reference of the reported pose (default: the vehicle's, else map)")
    add_duration(parser)
    parser.add_argument(
        "--driver-socket",
        metavar="PATH",
        help="socket for `vehicle-iface driver` (default: in the user's runtime directory, else in /tmp)",
    )
    add_verbose(parser)


def add_driver(parser: argparse.ArgumentParser) -> None:
    """Options of `driver`."""
    parser.add_argument("path", help="the socket that `sim` names at its start")
    parser.add_argument("line", nargs="+", help="a command: brake 1, steer 4.0, ready, reset, status, help, …")


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Options of `demo`."""
    add_profile(parser)
    parser.add_argument("--route", default="figure8", choices=sorted(ROUTE_NAMES), help="what to drive")
    parser.add_argument("--port", type=port, default=8080, help="TCP port of the page on 127.0.0.1")
    add_duration(parser)
    add_summary(parser)
    add_record(parser)
    parser.add_argument("--no-viewer", action="store_true", help="do not start the viewer")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")


def add_doctor(parser: argparse.ArgumentParser) -> None:
    """Options of `doctor`."""
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


def add_commission(parser: argparse.ArgumentParser) -> None:
    """Options of `commission`."""
    add_bus(parser)
    parser.add_argument("--out", metavar="REPORT.html", help="write one page with the walk and the review of its log")
    parser.add_argument("--json", metavar="FILE", help="write all verdicts and numbers to this file")
    parser.add_argument(
        "--record", metavar="LOG", help="record the frames to this new file (default: PROFILE-walk-DATE-TIME.log)"
    )
    parser.add_argument(
        "--step-timeout",
        type=number_above_0("seconds"),
        default=60.0,
        metavar="S",
        help="skip a step after S seconds; Enter on a terminal skips it at once",
    )
    parser.add_argument(
        "--write",
        action="store_true",
        help="if every step succeeds, write reviewed = true and the record into the profile without asking",
    )
    add_verbose(parser)
    parser.epilog = (
        "No frame is ever sent. Exit status: 0 when everything was seen and nothing contradicts the profile, 1 when "
        "something contradicts it, 2 bad usage, profile or file, 3 the bus cannot be used, 5 when something was not "
        "seen. SIGINT ends the walk with its report."
    )
