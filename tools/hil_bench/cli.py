"""The bench's command line."""

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

import msgspec

from hil_bench import bench, listen, resume
from hil_bench import result as results
from hil_bench.applicable import find_inapplicable, scale_for
from hil_bench.buses import describe_channels, read_channels
from hil_bench.cases import CATALOGUE, catalogue_of
from hil_bench.device import OWN, OWN_RECORDING, OWN_VIEWER, Commands, find_template_error
from hil_bench.journal import JournalError
from hil_bench.parts import parts_of
from hil_bench.peer.build import open_wire
from hil_bench.profile import ProfileError
from hil_bench.report import compare, html, junit
from hil_bench.report.terminal import Progress
from hil_bench.result import Run, Verdict
from hil_bench.run_case import BenchConfig
from hil_bench.wire import Wire

PASSED, FAILED, BAD_USAGE, NOTHING_DONE, INTERRUPTED = 0, 1, 2, 3, 130
STATUS = {
    Verdict.PASS: PASSED,
    Verdict.FAIL: FAILED,
    Verdict.NOT_EXECUTED: NOTHING_DONE,
    Verdict.NOT_APPLICABLE: NOTHING_DONE,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        if options.schema:
            print(results.schema())
            return PASSED
        if options.resume:
            options = resume.restore_options(parser, options)
        else:
            options.arguments = list(sys.argv[1:] if arguments is None else arguments)
        if options.write_routes:
            return _write_routes(Path(options.write_routes), open_wire(options.profile))
        if options.list:
            return _list(open_wire(options.profile), as_json=options.json)
        return _bench(options)
    except (bench.BenchError, ProfileError, JournalError) as error:
        print(f"hil-bench: {error}", file=sys.stderr)
        return BAD_USAGE
    except KeyboardInterrupt:
        print(
            "hil-bench: interrupted before the first result; links, clock, cables and disks are restored",
            file=sys.stderr,
        )
        return INTERRUPTED
    except OSError as error:
        tried = " ".join(f"--channel {text.rpartition('=')[2]}" for text in options.channel)
        where = error.filename or f"{' '.join(options.channel)} (try: vehicle-iface doctor {tried})"
        print(f"hil-bench: {where}: {error.strerror or error}", file=sys.stderr)
        return NOTHING_DONE


def _turn_signals_into_interrupt() -> None:
    """Turn SIGINT, SIGTERM and SIGHUP into one `KeyboardInterrupt`; ignore later ones during the clean-up."""
    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def interrupted(_number: int, _frame: object) -> None:
        for number in ends:
            signal.signal(number, lambda *_: None)
        raise KeyboardInterrupt

    for number in ends:
        signal.signal(number, interrupted)


def _bench(options: argparse.Namespace) -> int:
    if not any(options.channel) or not options.out:
        raise bench.BenchError("--channel and --out are required (or --list)")
    is_own = options.device == Commands().start
    for option, own in (("listen_device", OWN), ("recording_device", OWN_RECORDING), ("viewer", OWN_VIEWER)):
        if getattr(options, option) is None:
            setattr(options, option, own if is_own else "")
    if not options.device and not (options.route and options.rearm):
        raise bench.BenchError("--device '' (already running) requires --route and --rearm")
    folder = Path(options.out)
    if not options.resume:
        resume.check_folder(folder)
    for option in ("device", "listen_device", "recording_device", "viewer", "stop", "rearm"):
        wrong = find_template_error(getattr(options, option))
        if wrong:
            raise bench.BenchError(f"--{option.replace('_', '-')}: {wrong}")
    old = _read_old_run(options.compare)
    wire = open_wire(options.profile)
    commands = Commands(
        start=options.device,
        listen=options.listen_device,
        record=options.recording_device,
        view=options.viewer,
        stop=options.stop,
        rearm=options.rearm,
        is_here=not options.elsewhere,
    )
    channels = read_channels(options.channel, wire)
    catalogue = catalogue_of(len(wire.buses))
    cases = bench.select_cases(options.case, options.tag, quick=options.quick, catalogue=catalogue)
    _turn_signals_into_interrupt()
    found = bench.observe_traffic(channels, wire, is_device_running=not options.device)
    if options.beside and (len(wire.buses) > 1 or not options.device):
        raise bench.BenchError("--beside is for vehicles on one bus, and for a device that --device starts")
    for channel in options.beside:
        found += bench.observe_traffic((channel,), wire)
    if options.real_vehicle or (found and not _is_confirmed(options, wire, channels, found)):
        run = listen.run(wire, channels, folder, options.duration, found, real_vehicle=options.real_vehicle)
    else:
        config = BenchConfig(
            wire=wire,
            channel=channels[0],
            further_channels=channels[1:],
            commands=commands,
            folder=folder / "cases",
            profile=options.profile,
            seed=options.seed,
        )
        plan = bench.Plan(
            config=config,
            cases=cases,
            repeat=options.repeat,
            route=options.route,
            catalogue=catalogue,
            until_failure=options.until_failure,
            beside=options.beside,
            journal=resume.open_journal(options, config),
        )
        run = bench.run(plan, Progress(to_error=options.json))
    return _write_reports(run, folder, old, options)


def _write_reports(run: Run, folder: Path, old: Run | None, options: argparse.Namespace) -> int:
    results.write(run, folder / "results.json")
    junit.write(run, folder / "junit.xml")
    html.write(run, folder, compared_with=old)
    if options.json:
        sys.stdout.write((folder / "results.json").read_text())
    else:
        if old is not None:
            print(compare.text(compare.differences(old, run)))
        print(f"Report: {folder / 'index.html'}")
    if run.interrupted:
        print(f"hil-bench: {resume.describe_interruption(run.interrupted, folder)}", file=sys.stderr)
        return INTERRUPTED
    not_executed = any(case.verdict is Verdict.NOT_EXECUTED for case in run.cases)
    return FAILED if options.strict and not_executed else STATUS[run.verdict]


def _is_confirmed(options: argparse.Namespace, wire: Wire, channels: Sequence[str], found: Sequence[str]) -> bool:
    """Whether the user confirms, by an option and by the profile's name, to play a vehicle on a bus with traffic."""
    print(f"{describe_channels(channels, wire)} has traffic of other nodes: {'; '.join(found[:6])}", file=sys.stderr)
    if not options.despite_traffic:
        print("The bench only listens. To play a vehicle here anyway: --despite-traffic", file=sys.stderr)
        return False
    typed = options.type_profile
    if not typed and sys.stdin.isatty():
        print(
            f"Is nobody in danger, and is it certain that no vehicle can move? Type the profile's name ({wire.name}):",
            end=" ",
            flush=True,
            file=sys.stderr,
        )
        typed = sys.stdin.readline()
    if typed.strip() != wire.name:
        print(f"The profile's name ({wire.name}) was not typed: the bench only listens.", file=sys.stderr)
        return False
    return True


def _read_old_run(path: str) -> Run | None:
    if not path:
        return None
    try:
        return results.read(Path(path))
    except (OSError, msgspec.MsgspecError) as error:
        raise bench.BenchError(f"--compare {path}: {error}") from None


def _list(wire: Wire, *, as_json: bool) -> int:
    parts = parts_of(wire)
    rows = [
        {"name": case.name, "fault": case.fault, "tags": list(case.tags), "proves": case.proves}
        | ({"not_applicable": why} if (why := find_inapplicable(case, wire, parts)) else {})
        for case in catalogue_of(len(wire.buses))
    ]
    if as_json:
        print(json.dumps(rows, indent=1, ensure_ascii=False))
        return PASSED
    for row in rows:
        print(f"{row['name']:32} {row['fault']:9} {','.join(row['tags'])}\n    {row['proves']}")
        if "not_applicable" in row:
            print(f"    {Verdict.NOT_APPLICABLE} to {wire.name}: {row['not_applicable']}")
    left_out = sum("not_applicable" in row for row in rows)
    print(f"{len(rows)} cases" + (f", {left_out} of them not applicable to {wire.name}" if left_out else ""))
    return PASSED


def _write_routes(folder: Path, wire: Wire) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    for route in {case.route().name: case.route() for case in CATALOGUE if case.breaks is None}.values():
        print(scale_for(route, wire).write(folder / f"{route.name}.csv", wire.frame_id))
    return PASSED


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


def _parser() -> argparse.ArgumentParser:
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
    add("--quick", action="store_true", help="execute only the ten quick cases, in two minutes")
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
