"""The `vehicle-iface` command.

What only one command needs is imported by that command: the control process carries nothing that it does not use.
"""

import argparse
import dataclasses
import json
import logging
import logging.handlers
import math
import os
import queue
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from vehicle_iface import clock, compose
from vehicle_iface.bus.base import Bus
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.errors import BusError, ConfigError, InvalidValueError, TrajectoryFileError, VehicleIfaceError
from vehicle_iface.first_use import guarded
from vehicle_iface.process import python_module
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.runtime.summary import check_writable, save_summary, table
from vehicle_iface.runtime.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.runtime.waiting import can_be_opened
from vehicle_iface.runtime.watchdog import Watchdog
from vehicle_iface.trajectories.mailbox import PostedTrajectories
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import ROUTES
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import ns_from_s

if TYPE_CHECKING:
    from vehicle_iface.recorder.child import Recording
    from vehicle_iface.sim.model import BicycleState

log = logging.getLogger("vehicle_iface")

DONE, BAD_USAGE, NO_BUS, LATCHED_FAULT = 0, 2, 3, 4
LAST_WORDS_S = 1.0
MOST = 1e9
"""Of any option's number: 1e9 s, some 30 years, still fit into the nanoseconds of the telemetry."""
MAX_PORT = 0xFFFF
REFUSED_SHOWN = 20
"""Lines of a log that are named one by one."""
EMBEDDED = "embedded"
"""The interface that needs nothing outside the process."""
EMBEDDED_HINT = "for a real bus: vehicle-iface run --channel can0, or tools/vcan for a virtual one"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 done, 2 bad usage, configuration or file, 3 no bus, 4 ended in a latched fault."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["view"]:  # the viewer is another process and knows its own options
        command_line, environment = python_module("viewer")
        os.execve(sys.executable, [*command_line, *given[1:]], environment)
    options = _parser().parse_args(given)
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        with _logging(options.verbose):
            return command(options)
    except BusError as error:
        print(f"vehicle-iface: {error}", file=sys.stderr)
        return NO_BUS
    except (ConfigError, TrajectoryFileError) as error:
        print(f"vehicle-iface: {error}", file=sys.stderr)
        return BAD_USAGE
    except VehicleIfaceError as error:
        print(f"vehicle-iface: {type(error).__name__}: {error}", file=sys.stderr)
        return BAD_USAGE


def run(options: argparse.Namespace) -> int:
    """The loop."""
    end = _EarlyEnd()
    _on_end_signals(end.set)
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # nothing is there yet to be armed
    if options.summary:
        check_writable(options.summary)
    profile = load_profile(options.profile)
    if options.arm:
        profile = guarded(
            profile, interface=options.interface, channel=options.channel, speed_cap_mps=options.speed_cap
        )
    database = load_database(profile)
    source = _source(options, database)
    controller = compose.build_controller(options.controller, database.profile)
    open_bus = _bus_opener(options, database)
    if options.wait is not None and not _is_there(open_bus, options.wait, end):
        return _ended_early()
    with _telemetry(options, database) as telemetry, _recording(options, database) as recording:
        with Watchdog() as watchdog:
            loop = compose.build_loop(
                database=database,
                open_bus=open_bus,
                controller=controller,
                source=source,
                telemetry=telemetry,
                armed=options.arm,
                live=watchdog.live,
            )
            signal.signal(signal.SIGUSR1, lambda *_: loop.request_arming())
            _on_end_signals(loop.request_end)
            if end.is_set:  # before the loop's own handlers were there, or it would have been told
                loop.link.close()
                return _ended_early()
            log.info("%s, %s: %s", loop.link.description, _arming(options), _wanted(options))
            for lack in realtime.claim(cpu=options.cpu):
                log.warning("%s", lack)
            _run_for(loop, options.duration)
            loop.link.close()
        _on_end_signals(None)  # the vehicle is let go: neither terminal nor disk that hangs must keep the program
        summary = loop.summary()
        if recording is not None:
            summary["recorder"] = recording.end()
            recording.save_summary(summary)
    is_saved = not options.summary or _is_saved(options.summary, summary)
    _say(table(summary))
    return LATCHED_FAULT if loop.ended_in_fault else DONE if is_saved else BAD_USAGE


def sim(options: argparse.Namespace) -> int:
    """The simulated vehicle."""
    from vehicle_iface.sim.node import run_vehicle
    from vehicle_iface.sim.pedals import PedalSocket, default_path
    from vehicle_iface.sim.wire import simulated_vehicle

    database = load_database(load_profile(options.profile))
    if options.interface == EMBEDDED:
        raise ConfigError("--interface embedded: that bus has its vehicle in `run`; sim needs one of its own")
    frame_id = _frame(options, database)
    try:
        vehicle = simulated_vehicle(
            database, start_ns=clock.monotonic_ns(), start=_start(options.start), frame_id=frame_id
        )
    except InvalidValueError as error:
        raise ConfigError(f"--start {options.start}: {error}") from None
    end = _Flag()
    _on_end_signals(end.set)
    deadline_ns = clock.monotonic_ns() + ns_from_s(options.duration) if options.duration else None
    path = options.pedals or default_path(options.channel)

    def over() -> bool:
        return end.is_set or (deadline_ns is not None and clock.monotonic_ns() >= deadline_ns)

    def opened() -> Bus:
        return compose.open_bus(options.interface, options.channel, database.profile, hears=database.sent)

    with closing(PedalSocket(path)) as pedals:
        bus = opened()
        log.info("simulated vehicle on %s, pedals at %s", bus.description, path)
        for lack in realtime.claim():
            log.warning("%s", lack)
        run_vehicle(vehicle, bus, pedals, clock.monotonic_ns, over, reopen=opened)
    counters = ", ".join(f"{name} {count}" for name, count in sorted(vehicle.counters.items()) if count)
    _on_end_signals(None)
    _say(f"  vehicle ended {vehicle.mode.name} at {vehicle.state.speed_mps:.2f} m/s: {counters}")
    return DONE


def press_pedal(options: argparse.Namespace) -> int:
    """One line to the simulated vehicle's pedals."""
    from vehicle_iface.sim.pedals import press

    answer = press(options.path, " ".join(options.line))
    print(answer)
    return BAD_USAGE if answer.startswith("error") else DONE


def run_demo(options: argparse.Namespace) -> int:
    """Simulated vehicle, loop and viewer together."""
    from vehicle_iface import demo

    return demo.run(
        route=options.route,
        port=options.port,
        duration_s=options.duration,
        summary=options.summary,
        record=options.record,
        viewer=not options.no_viewer,
        open_page=options.open,
    )


def check_dbc(options: argparse.Namespace) -> int:
    """All faults of a DBC or profile."""
    from vehicle_iface.codec import lint

    findings = lint.check_file(Path(options.file))
    if options.json:
        _say(json.dumps([dataclasses.asdict(finding) for finding in findings], indent=2))
    else:
        for finding in findings:
            _say(str(finding))
    return BAD_USAGE if any(finding.severity == lint.ERROR for finding in findings) else DONE


def decode(options: argparse.Namespace) -> int:
    """A candump log to columns."""
    from vehicle_iface.codec import bulk

    dbc = Path(options.dbc or load_profile(options.profile).dbc)
    messages = {message.name: message for message in read_dbc(dbc).database.messages}
    for name in options.message:
        if name not in messages:
            raise ConfigError(f"--message {name}: must be one of: {', '.join(messages)}")
    wanted = [messages[name] for name in dict.fromkeys(options.message) or messages]
    recording = bulk.decode_log(Path(options.log), wanted, checked=True, progress=_show_progress)
    for refused in recording.refused[:REFUSED_SHOWN]:
        print(f"{options.log}:{refused.line}: {refused.why}", file=sys.stderr)
    if len(recording.refused) > REFUSED_SHOWN:
        print(f"… and {len(recording.refused) - REFUSED_SHOWN} more lines", file=sys.stderr)
    try:
        with open(options.out, "wb") as out:
            bulk.save(recording, out)
    except OSError as error:
        raise ConfigError(f"--out {options.out}: cannot be written: {error.strerror}") from None
    for line in bulk.summary(recording):
        _say(line)
    return DONE


def _show_progress(done_bytes: int, total_bytes: int) -> None:
    """In place on a terminal, elsewhere only when all is done."""
    is_over = done_bytes == total_bytes
    if is_over or sys.stderr.isatty():
        text = f"\r{100 * done_bytes // total_bytes:3d} % of {total_bytes / 1e6:.1f} MB"
        print(text, end="\n" if is_over else "", file=sys.stderr, flush=True)


def examine(options: argparse.Namespace) -> int:
    """What this machine lacks."""
    from vehicle_iface import doctor

    findings = doctor.examine(options.channel, load_profile(options.profile).bus)
    _say(doctor.as_json(findings) if options.json else doctor.as_text(findings))
    return DONE if doctor.is_ready(findings) else BAD_USAGE


class _Flag:
    """Set by a signal handler."""

    def __init__(self) -> None:
        self.is_set = False

    def set(self) -> None:
        self.is_set = True


class _EarlyEnd(_Flag):
    """Set before there is a loop; told again, the program ends as usual, wherever somebody's code may hang."""

    def set(self) -> None:
        super().set()
        _on_end_signals(None)


def _is_there(open_bus: Callable[[], Bus], limit_s: float, end: _EarlyEnd) -> bool:
    """Whether the bus is there by now; False when `end` was set before."""
    return can_be_opened(
        open_bus,
        limit_s=limit_s,
        is_over=lambda: end.is_set,
        now_ns=clock.monotonic_ns,
        sleep_until=clock.sleep_until,
    )


def _ended_early() -> int:
    log.info("told to end before the loop had begun")
    return DONE


def _is_saved(path: str, summary: dict[str, Any]) -> bool:
    """Whether the summary is in its file; why not is said."""
    try:
        save_summary(path, summary)
    except ConfigError as error:
        log.error("%s", error)
        return False
    return True


def _run_for(loop: Loop, duration_s: float | None) -> None:
    """Pass after pass; the end of the duration is a request to end like any other."""
    if duration_s is None:
        loop.run()
        return
    deadline_ns = clock.monotonic_ns() + ns_from_s(duration_s)
    loop.plan_end(deadline_ns)
    while not loop.done and clock.monotonic_ns() < deadline_ns:
        loop.step()
    loop.end_as_planned()
    loop.run()


def _on_end_signals(end: Callable[[], None] | None) -> None:
    """Have SIGINT and SIGTERM call `end`; with None they end the program as usual."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        if end is not None:
            end()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle if end is not None else signal.SIG_DFL)


def _say(text: str) -> None:
    """Print, unless nobody reads: that changes neither summary nor exit status."""
    try:
        print(text, flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # the interpreter flushes it at its end


def _source(options: argparse.Namespace, database: VehicleDatabase) -> TrajectorySource:
    if options.trajectory:
        return FixedTrajectory(compose.load_trajectory(options.trajectory, database.profile))
    if options.trajectory_post:
        if Path(options.trajectory_post).is_dir():
            raise ConfigError(f"--trajectory-post {options.trajectory_post}: is a folder, must be a file in one")
        return PostedTrajectories(options.trajectory_post)
    return RecedingRoute(compose.build_route(options.route, database.profile), frame_id=_frame(options, database))


def _frame(options: argparse.Namespace, database: VehicleDatabase) -> str:
    """The frame of reference that was asked for; `ConfigError` when the vehicle's pose is never in it."""
    known = list(database.frames.values()) or [database.profile.state.frame_id]
    if options.frame not in known:
        raise ConfigError(f"--frame {options.frame}: must be one of: {', '.join(known)}")
    return str(options.frame)


def _bus_opener(options: argparse.Namespace, database: VehicleDatabase) -> Callable[[], Bus]:
    if options.interface != EMBEDDED:
        return lambda: compose.open_bus(
            options.interface,
            options.channel,
            database.profile,
            hears=(*database.received, *database.sent),  # the sent ones too, to notice another commander
            sends=database.sent,
            patience_ns=ns_from_s(database.profile.timing.command_period_s),
        )
    from vehicle_iface.sim.embedded import EmbeddedBus
    from vehicle_iface.sim.wire import simulated_vehicle

    vehicle = simulated_vehicle(database, start_ns=clock.monotonic_ns(), frame_id=_frame(options, database))
    return lambda: EmbeddedBus(vehicle, clock.monotonic_ns, clock.sleep_until)


@contextmanager
def _telemetry(options: argparse.Namespace, database: VehicleDatabase) -> Iterator[TelemetryWriter]:
    embedded = options.interface == EMBEDDED
    bus = f"{options.interface} {options.channel}"
    info = SessionInfo(
        channel=options.channel,
        bus="embedded bus (no SocketCAN used)" if embedded else bus.replace("socketcan", "SocketCAN"),
        bus_hint=EMBEDDED_HINT if embedded else "",
        profile=database.profile.name,
        route=_wanted(options),
        arming=_arming(options),
        period_s=database.profile.timing.sample_period_s,
        recording=str(Path(options.record).absolute()) if options.record else "",
        shape=compose.vehicle_shape(database.profile),
    )
    with TelemetryWriter(options.telemetry, info) as writer:
        yield writer


@contextmanager
def _recording(options: argparse.Namespace, database: VehicleDatabase) -> "Iterator[Recording | None]":
    """A recorder at work where one is wanted; it is the last thing that may be refused before the bus is opened."""
    if not options.record:
        yield None
        return
    from vehicle_iface.recorder.child import Recording
    from vehicle_iface.recorder.folder import Order

    order = Order(
        folder=options.record,
        telemetry=options.telemetry,
        channel=options.channel if options.interface == "socketcan" else None,
        profile=database.profile.file,
        dbc=database.profile.dbc,
        command_line=[argument.encode(errors="replace").decode() for argument in sys.argv],
    )
    with Recording(order) as recording:
        log.info("recording to %s", options.record)
        yield recording


def _arming(options: argparse.Namespace) -> str:
    return "armed" if options.arm else "shadow" if options.shadow else "listen-only"


def _wanted(options: argparse.Namespace) -> str:
    return str(options.trajectory or options.trajectory_post or options.route)


def _start(text: str) -> "BicycleState":
    from vehicle_iface.sim.model import BicycleState

    try:
        x_m, y_m, heading_rad = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--start {text!r}: must be X,Y,HEADING in metres and radians, like 0,0,1.57") from None
    return BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)


class _Listener(logging.handlers.QueueListener):
    """Writes the log from a thread; at the end it is given a moment, not for ever."""

    def stop(self) -> None:
        if self._thread is not None:
            self.enqueue_sentinel()
            self._thread.join(LAST_WORDS_S)
            self._thread = None


@contextmanager
def _logging(verbose: bool) -> Iterator[None]:
    """Log to the terminal from a thread of its own: a terminal that hangs must not hold up the loop."""
    terminal = logging.StreamHandler()
    terminal.setFormatter(logging.Formatter("%(asctime)s.%(msecs)03d %(levelname)-7s %(message)s", "%H:%M:%S"))
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    listener = _Listener(lines, terminal)
    handler = logging.handlers.QueueHandler(lines)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG if verbose else logging.INFO)
    listener.start()
    try:
        yield
    finally:
        log.removeHandler(handler)
        listener.stop()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="vehicle-iface",
        description="A CAN-bus vehicle interface: state frames in, checked commands out, watched in the browser.",
    )
    parser.set_defaults(verbose=False)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_demo(_command(commands, "demo", "simulated vehicle, loop and viewer, with one command"))
    _add_run(_command(commands, "run", "the loop: reads the vehicle's state and commands it"))
    _add_sim(_command(commands, "sim", "the simulated vehicle, as a node on a bus"))
    _add_pedals(_command(commands, "pedals", "press a simulated vehicle's pedals"))
    _add_doctor(_command(commands, "doctor", "what this machine lacks, each with the command that mends it"))
    _add_check_dbc(_command(commands, "check-dbc", "faults of a DBC or profile for control use, each with its line"))
    _add_decode(_command(commands, "decode", "a candump log (candump -L) to columns, one NumPy array for each signal"))
    commands.add_parser("view", add_help=False, help="the browser viewer (vehicle-iface view --help)")
    return parser


def command_names() -> set[str]:
    """Every command that there is."""
    actions = _parser()._subparsers
    assert actions is not None
    return {name for action in actions._group_actions for name in action.choices or ()}


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Says the defaults that there are."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return super()._get_help_string(action) if action.default else action.help


def _command(
    commands: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, text: str
) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", formatter_class=_HelpFormatter
    )
    parser.register("type", None, _text)  # of every option that names no other
    return parser


def _add_run(parser: argparse.ArgumentParser) -> None:
    _add_bus(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--trajectory", metavar="FILE.csv", help="drive this once; its time 0 is the instant of engagement"
    )
    what.add_argument("--route", choices=sorted(ROUTES), help="drive along this; it begins at the origin, along +x")
    what.add_argument("--trajectory-post", metavar="FILE", help="drive what another process posts to this file")
    parser.add_argument(
        "--controller", default="pure_pursuit", metavar="NAME", help="pure_pursuit, or your own FILE.py:CLASS"
    )
    arming = parser.add_mutually_exclusive_group()
    arming.add_argument(
        "--arm", action="store_true", help="engage once, when the vehicle is READY; without it not one frame leaves"
    )
    parser.add_argument(
        "--speed-cap",
        type=_above_0("m/s"),
        metavar="M/S",
        help="drive no faster than this, nor than the profile allows; a must with --arm on a real bus",
    )
    arming.add_argument(
        "--shadow", action="store_true", help="listen and compute only, by intent; another commander is compared with"
    )
    parser.add_argument(
        "--duration",
        type=_above_0("seconds"),
        metavar="S",
        help="stop the vehicle and end after so many seconds; without it when told to",
    )
    parser.add_argument(
        "--wait",
        nargs="?",
        type=_above_0("seconds"),
        const=math.inf,
        metavar="S",
        help="wait for a bus that is absent or down, and say so; for so many seconds at most",
    )
    parser.add_argument(
        "--telemetry", default="default", metavar="ADDRESS", help="name, or path, that `view` connects to"
    )
    parser.add_argument("--record", metavar="DIR", help="write frames and telemetry down in this new folder")
    parser.add_argument("--summary", metavar="FILE.json", help="write the run's counts and latencies there")
    parser.add_argument("--cpu", type=_processor, metavar="N", help="run on this processor only, counted from 0")
    parser.add_argument("--frame", default="map", help="frame of reference of the route")
    parser.add_argument("--verbose", action="store_true", help="say more")
    parser.epilog = (
        "Exit status: 0 done, 2 bad usage, configuration or file (also a summary that cannot be written after a drive "
        "without fault), 3 the bus cannot be used, 4 ended in a latched fault. SIGINT or SIGTERM stops the vehicle and "
        "ends, a second one lets it go at once; SIGUSR1 arms again."
    )
    parser.set_defaults(command=run)


def _add_sim(parser: argparse.ArgumentParser) -> None:
    _add_bus(parser)
    parser.add_argument("--start", default="0,0,0", metavar="X,Y,HEADING", help="start pose in m, m, rad")
    parser.add_argument("--frame", default="map", help="frame of reference of its pose")
    parser.add_argument("--duration", type=_above_0("seconds"), metavar="S", help="end after so many seconds")
    parser.add_argument(
        "--pedals", metavar="PATH", help="its pedals' socket; in the user's runtime directory, else /tmp"
    )
    parser.add_argument("--verbose", action="store_true", help="say more")
    parser.set_defaults(command=sim)


def _add_pedals(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("path", help="the socket that `sim` names at its start")
    parser.add_argument("line", nargs="+", help="what to do: brake 1, steer 4.0, ready, reset, status, help, …")
    parser.set_defaults(command=press_pedal)


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--route", default="figure8", choices=sorted(ROUTES), help="what to drive")
    parser.add_argument("--port", type=_port, default=8080, help="TCP port of the page on 127.0.0.1")
    parser.add_argument("--duration", type=_above_0("seconds"), metavar="S", help="end after so many seconds")
    parser.add_argument("--summary", metavar="FILE.json", help="write the run's counts and latencies there")
    parser.add_argument("--record", metavar="DIR", help="write frames and telemetry down in this new folder")
    parser.add_argument("--no-viewer", action="store_true", help="without the page")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")
    parser.set_defaults(command=run_demo)


def _add_doctor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--channel", default="vcan0", help="the SocketCAN interface to look at: vcan0, can0, …")
    parser.add_argument("--profile", default="reference", help="whose bit rate and frames it shall carry")
    parser.add_argument("--json", action="store_true", help="for a program: findings with verdict, text and mend")
    parser.epilog = "Exit status: 0 when nothing needed is missing, 2 otherwise. Needs no rights and changes nothing."
    parser.set_defaults(command=examine)


def _add_check_dbc(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a .dbc by itself, or a .toml profile with its DBC")
    parser.add_argument("--json", action="store_true", help="for programs: a list of file, line, severity, text")
    parser.set_defaults(command=check_dbc)


def _add_decode(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="the log; its stamps become MESSAGE:stamp_ns, nanoseconds")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--profile", default="reference", help="the vehicle: a profile's name, or a .toml file")
    which.add_argument("--dbc", metavar="FILE", help="its messages instead; MESSAGE.SIGNAL is in the DBC's unit")
    parser.add_argument("--out", required=True, metavar="FILE.npz", help="the arrays; numpy.load reads them")
    parser.add_argument("--message", action="append", default=[], metavar="NAME", help="only this; may be repeated")
    parser.set_defaults(command=decode)


def _add_bus(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--channel", default="vcan0", help="the bus: vcan0, can0, or what the interface calls it")
    parser.add_argument(
        "--interface",
        type=_interface,
        default="socketcan",
        help="socketcan, embedded, or the name of a python-can interface",
    )
    parser.add_argument("--profile", default="reference", help="the vehicle: a profile's name, or a .toml file")


def _above_0(unit: str) -> Callable[[str], float]:
    """The type of an option that is a number of that unit."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value <= MOST:
            raise argparse.ArgumentTypeError(f"{text!r}: must be a number of {unit} above 0, at most {MOST:g}")
        return value

    return number


def _text(text: str) -> str:
    """An empty one is a variable that somebody's script has not set; other than UTF-8 nothing can be told to a page."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be UTF-8") from None
    if not text:
        raise argparse.ArgumentTypeError("'': must not be empty")
    return text


def _interface(text: str) -> str:
    if text not in ("socketcan", EMBEDDED):
        from vehicle_iface.bus.python_can import INTERFACES  # 0.2 s, and whoever comes here needs it anyway

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
        raise argparse.ArgumentTypeError(f"{text!r}: must be one of this program's: {', '.join(map(str, allowed))}")
    return int(text)
