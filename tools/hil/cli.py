"""The bench's command line."""

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from hil import bench, listen
from hil import result as results
from hil.cases import CATALOGUE
from hil.device import OWN, OWN_RECORDING, OWN_VIEWER, Commands, misspelt
from hil.report import compare, html, junit
from hil.report.terminal import Progress
from hil.result import Run, Verdict
from hil.run_case import Bench
from hil.wire import ProfileError, Wire

PASSED, FAILED, BAD_USAGE, NOTHING_DONE, INTERRUPTED = 0, 1, 2, 3, 130
STATUS = {Verdict.PASS: PASSED, Verdict.FAIL: FAILED, Verdict.NOT_EXECUTED: NOTHING_DONE}


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        if options.write_routes:
            return _write_routes(Path(options.write_routes))
        if options.list:
            return _list(as_json=options.json)
        return _bench(options)
    except (bench.BenchError, ProfileError) as error:
        print(f"hil_bench: {error}", file=sys.stderr)
        return BAD_USAGE
    except KeyboardInterrupt:
        print("hil_bench: interrupted before there was anything to report; everything is put back", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        where = error.filename or f"{options.channel} (try: vehicle-iface doctor --channel {options.channel})"
        print(f"hil_bench: {where}: {error.strerror or error}", file=sys.stderr)
        return NOTHING_DONE


def _be_interruptible() -> None:
    """However it is told to end, it ends the device and puts back what it changed; to be told twice hastens nothing."""
    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def interrupted(_number: int, _frame: object) -> None:
        for number in ends:
            signal.signal(number, lambda *_: None)
        raise KeyboardInterrupt

    for number in ends:
        signal.signal(number, interrupted)


def _bench(options: argparse.Namespace) -> int:
    if not options.channel or not options.out:
        raise bench.BenchError("--channel and --out are needed, or --list")
    is_own = options.device == Commands().start
    for option, own in (("listen_device", OWN), ("recording_device", OWN_RECORDING), ("viewer", OWN_VIEWER)):
        if getattr(options, option) is None:
            setattr(options, option, own if is_own else "")
    if not options.device and not (options.route and options.rearm):
        raise bench.BenchError("--device '' (it is there already) needs --route, what it drives, and --rearm")
    folder = Path(options.out)
    if folder.exists() and any(folder.iterdir()):
        raise bench.BenchError(f"--out {folder}: is not empty; name a new folder")
    for option in ("device", "listen_device", "recording_device", "viewer", "stop", "rearm"):
        wrong = misspelt(getattr(options, option))
        if wrong:
            raise bench.BenchError(f"--{option.replace('_', '-')}: {wrong}")
    old = _old(options.compare)
    wire = Wire(options.profile)
    commands = Commands(
        start=options.device,
        listen=options.listen_device,
        record=options.recording_device,
        view=options.viewer,
        stop=options.stop,
        rearm=options.rearm,
        is_here=not options.elsewhere,
    )
    cases = bench.chosen(options.case, options.tag, quick=options.quick)
    _be_interruptible()
    found = bench.traffic(options.channel, wire, device_is_there=not options.device)
    if options.real_vehicle or (found and not _is_told_twice(options, wire, found)):
        run = listen.run(wire, options.channel, folder, options.duration, found, real_vehicle=options.real_vehicle)
    else:
        what = Bench(
            wire=wire,
            channel=options.channel,
            commands=commands,
            folder=folder / "cases",
            profile=options.profile,
            seed=options.seed,
        )
        plan = bench.Plan(bench=what, cases=cases, repeat=options.repeat, route=options.route)
        run = bench.run(plan, Progress(to_error=options.json))
    return _told(run, folder, old, options)


def _told(run: Run, folder: Path, old: Run | None, options: argparse.Namespace) -> int:
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
        print(f"hil_bench: {run.interrupted}; everything is put back", file=sys.stderr)
        return INTERRUPTED
    not_executed = any(case.verdict is Verdict.NOT_EXECUTED for case in run.cases)
    return FAILED if options.strict and not_executed else STATUS[run.verdict]


def _is_told_twice(options: argparse.Namespace, wire: Wire, found: Sequence[str]) -> bool:
    """On a bus that is not quiet the bench plays a vehicle only when a flag says so and the profile's name is typed."""
    print(f"{options.channel} carries traffic that the bench did not make: {'; '.join(found[:6])}", file=sys.stderr)
    if not options.despite_traffic:
        print("It only listens. To play a vehicle here all the same: --despite-traffic", file=sys.stderr)
        return False
    typed = options.type_profile
    if not typed and sys.stdin.isatty():
        print(
            f"Nobody is in danger, and the vehicle cannot move? Type the profile's name ({wire.name}):",
            end=" ",
            flush=True,
            file=sys.stderr,
        )
        typed = sys.stdin.readline()
    if typed.strip() != wire.name:
        print(f"The profile's name was not typed ({wire.name}): it only listens.", file=sys.stderr)
        return False
    return True


def _old(path: str) -> Run | None:
    if not path:
        return None
    try:
        return results.read(Path(path))
    except (OSError, msgspec.MsgspecError) as error:
        raise bench.BenchError(f"--compare {path}: {error}") from None


def _list(*, as_json: bool) -> int:
    rows = [
        {"name": case.name, "fault": case.fault, "tags": list(case.tags), "proves": case.proves} for case in CATALOGUE
    ]
    if as_json:
        print(json.dumps(rows, indent=1, ensure_ascii=False))
        return PASSED
    for row in rows:
        print(f"{row['name']:32} {row['fault']:9} {','.join(row['tags'])}\n    {row['proves']}")
    print(f"{len(rows)} cases")
    return PASSED


def _write_routes(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    for route in {case.route().name: case.route() for case in CATALOGUE if case.breaks is None}.values():
        print(route.write(folder / f"{route.name}.csv"))
    return PASSED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/hil_bench.py",
        description="Plays the vehicle on a CAN bus, breaks things on purpose, and judges the controller from outside.",
        epilog="Exit status: 0 every executed case passed, 1 a case failed, 2 bad usage, 3 nothing could be executed.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add("--channel", default="", help="SocketCAN interface: can0, vcan0, …")
    add(
        "--out",
        default="",
        metavar="DIR",
        help="a new folder for the report: index.html, junit.xml, results.json, cases/",
    )
    add("--case", action="append", default=[], metavar="NAME", help="only this one; may be repeated")
    add("--tag", action="append", default=[], metavar="TAG", help="only cases with this tag; may be repeated")
    add("--quick", action="store_true", help="the few cases that fit into two minutes")
    add("--list", action="store_true", help="all cases, and what each proves")
    add("--repeat", type=_count, default=1, metavar="N", help="each case so many times")
    add("--seed", type=int, default=0, help="of everything that is left to chance; repetition n takes seed + n − 1")
    add("--compare", default="", metavar="OLD.json", help="results.json of another run: say what changed")
    add("--json", action="store_true", help="results (or the list) as JSON to the output, progress to the error output")
    add("--strict", action="store_true", help="a case that could not be executed is a failure")
    add("--profile", default="reference", help="the vehicle that is played: a profile's name, or a .toml file")
    commands = Commands()
    add(
        "--device",
        default=commands.start,
        metavar="COMMAND",
        help="starts the device, with {channel} {profile} {trajectory} {route}; '' when it is there already",
    )
    add(
        "--listen-device",
        default=None,
        metavar="COMMAND",
        help="starts the device without arming it; by default as --device without --arm where that is this program",
    )
    add(
        "--recording-device",
        default=None,
        metavar="COMMAND",
        help="starts the device so that it writes its drive down in the folder {record}; by default this program does",
    )
    add(
        "--viewer",
        default=None,
        metavar="COMMAND",
        help="shows the device to browsers at {port} of this computer; by default as vehicle-iface view does",
    )
    add("--stop", default="", metavar="COMMAND", help="ends the device; '' for SIGINT to what --device started")
    add("--rearm", default="", metavar="COMMAND", help="arms the device again; '' for SIGUSR1 to what --device started")
    add("--route", default="", metavar="NAME", help="of a device that is there already: what it drives")
    add("--write-routes", default="", metavar="DIR", help="write every trajectory of the catalogue there, and end")
    add("--elsewhere", action="store_true", help="--device only opens a door to another computer (ssh)")
    add("--duration", type=float, default=10.0, metavar="S", help="how long to listen on a bus that is not quiet, s")
    add(
        "--despite-traffic", action="store_true", help="play a vehicle on a bus that is not quiet; asks for the profile"
    )
    add("--type-profile", default="", metavar="NAME", help="the profile's name, typed again, for --despite-traffic")
    add(
        "--real-vehicle",
        action="store_true",
        help="a real vehicle is on the bus: only listen, and name the evidence so",
    )
    return parser


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a number above 0")
    return int(text)
