"""The bench's command line."""

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from hil_bench import bench, drive_pages, listen, resume
from hil_bench import result as results
from hil_bench.applicable import find_inapplicable, scale_for
from hil_bench.bench_config import BenchConfig
from hil_bench.buses import describe_channels, read_channels
from hil_bench.cases import catalogue_for
from hil_bench.device import OWN, OWN_RECORDING, OWN_VIEWER, Commands, find_template_error
from hil_bench.journal import JournalError, remove_journal
from hil_bench.options import build_parser
from hil_bench.parts import parts_of
from hil_bench.peer.build import open_wire
from hil_bench.profile import ProfileError
from hil_bench.report import compare, html, junit
from hil_bench.report.terminal import Progress
from hil_bench.result import Run, Verdict
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
    parser = build_parser()
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
    for option in ("device", "listen_device", "recording_device", "export", "viewer", "stop", "rearm"):
        wrong = find_template_error(getattr(options, option))
        if wrong:
            raise bench.BenchError(f"--{option.replace('_', '-')}: {wrong}")
    if options.export and not options.recording_device:
        raise bench.BenchError("--export requires a device that records its drive in {record}: --recording-device")
    old = _read_old_run(options.compare)
    wire = open_wire(options.profile)
    commands = Commands(
        start=options.device,
        listen=options.listen_device,
        record=options.recording_device,
        export=options.export,
        view=options.viewer,
        stop=options.stop,
        rearm=options.rearm,
        is_here=not options.elsewhere,
    )
    channels = read_channels(options.channel, wire)
    catalogue = catalogue_for(wire)
    cases = bench.select_cases(options.case, options.tag, quick=options.quick, catalogue=catalogue)
    _turn_signals_into_interrupt()
    found = bench.observe_traffic(channels, wire, is_device_running=not options.device)
    if options.beside and (len(wire.buses) > 1 or not options.device):
        raise bench.BenchError("--beside is for vehicles on one bus, and for a device that --device starts")
    for channel in options.beside:
        found += bench.observe_traffic((channel,), wire)
    if options.resume and found and not options.despite_traffic:
        raise JournalError(
            f"--resume {options.resume}: {describe_channels(channels, wire)} has traffic: {'; '.join(found[:6])}; "
            "end the device that the interrupted run has left"
        )
    if options.real_vehicle or (found and not _is_confirmed(options, wire, channels, found)):
        run = listen.run(wire, channels, folder, options.duration, found, real_vehicle=options.real_vehicle)
        run = results.judge_strictly(run) if options.strict else run
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
            is_strict=options.strict,
        )
        run = drive_pages.write_pages(bench.run(plan, Progress(to_error=options.json)), folder, commands.export)
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
    remove_journal(folder)
    return STATUS[run.verdict]


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
        for case in catalogue_for(wire)
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
    for route in {case.route().name: case.route() for case in catalogue_for(wire) if case.breaks is None}.values():
        print(scale_for(route, wire).write(folder / f"{route.name}.csv", wire.frame_id))
    return PASSED
