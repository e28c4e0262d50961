"""Runs one case, from the trajectory's file to the verdict."""

import gc
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec
from bus_contract import S

from hil import judge
from hil import rig as rigs
from hil.bus import is_virtual
from hil.case import Case, Then
from hil.device import Commands
from hil.expect import Seen
from hil.faults import nothing
from hil.result import CaseResult, Event, EventKind, Evidence, Verdict
from hil.rig import Rig
from hil.routes import Route
from hil.wire import Wire

ENGAGE_S = 25.0
REACH_SPEED_S = 12.0
REARM_S = 8.0
REARM_AGAIN_S = 2.5
HEALTHY_S = 0.8
UNARMED_S = 0.7
"""A vehicle that is ready tempts a device that has not been armed for so long; one that was armed engages."""
SETTLE_S = 1.5
"""A device that is there already has seen the vehicle before it is armed."""
END_S = 16.0


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What all cases of a run have in common."""

    wire: Wire
    channel: str
    commands: Commands
    folder: Path
    """For every case's files."""
    profile: str
    seed: int = 0

    @property
    def evidence(self) -> Evidence:
        """What its results are evidence about."""
        return Evidence.VIRTUAL_BUS if is_virtual(self.channel) else Evidence.REAL_BUS


def run(bench: Bench, case: Case, repetition: int = 1) -> CaseResult:
    """Raises `RigError` and `OSError` where the bench, not the device, is at fault."""
    name = case.name if repetition == 1 else f"{case.name}-{repetition}"
    route = case.route()
    trajectory = route.write(bench.folder / f"{name}.csv", case.frame_id)
    if case.breaks is not None:
        trajectory.write_text(case.breaks(trajectory.read_text()))
    channel, device_channel = (rigs.BENCH_END, rigs.DEVICE_END) if case.on_vxcan else (bench.channel, bench.channel)
    words = {
        "channel": case.channel or device_channel,
        "profile": _profile(bench, case, name),
        "trajectory": str(trajectory.resolve()),
        "route": route.name,
        "record": str((bench.folder / f"{name}.disk" / "drive").resolve()),
        "port": str(_free_port()),
    }
    began = time.monotonic()
    gc.collect()
    gc.disable()  # the vehicle would fall silent for 0.1 s whenever all that a long case has heard is looked through
    try:
        if case.on_vxcan:
            rigs.make_cable()
        if case.recorded_mib:
            rigs.make_disk(Path(words["record"]).parent, case.recorded_mib)
        rig = Rig(bench.wire, channel, bench.commands, bench.folder, words, bench.seed + repetition - 1, case.name)
        rig.device.log = bench.folder / f"{name}.log"
        try:
            _go(rig, case)
        finally:
            killed = _clean_up(rig, case)
        rig.write_candump(bench.folder / f"{name}.candump")
    finally:
        with _undisturbed():
            gc.enable()
            if case.on_vxcan:
                rigs.remove_cable()
            if case.recorded_mib:
                rigs.remove_disk(Path(words["record"]).parent)
    result = _judged(bench, case, rig, route, killed, repetition)
    return msgspec.structs.replace(
        result,
        duration_s=round(time.monotonic() - began, 2),
        candump=f"{name}.candump",
        device_log=f"{name}.log" if rig.device.log.exists() else "",
    )


def unjudged(
    bench: Bench, case: Case, repetition: int, why: str, verdict: Verdict = Verdict.NOT_EXECUTED
) -> CaseResult:
    """A result that has nothing but what the case says of itself, and why it ended so."""
    return CaseResult(
        name=case.name,
        proves=case.proves,
        fault=case.fault,
        tags=list(case.tags),
        verdict=verdict,
        why=why,
        evidence=bench.evidence,
        repetition=repetition,
        seed=bench.seed + repetition - 1,
        injected=case.injected,
    )


def _profile(bench: Bench, case: Case, name: str) -> str:
    """What the device is told to load: the profile, or the case's own spoilt copy of it."""
    if case.profile is None:
        return str(bench.wire.path) if bench.profile.endswith(".toml") else bench.profile
    toml, dbc = case.profile(bench.wire.path.read_text(), bench.wire.dbc.read_text())
    copy = bench.folder / f"{name}.toml"
    copy.write_text(toml)
    (bench.folder / bench.wire.dbc.name).write_text(dbc)
    return str(copy.resolve())


@contextmanager
def _undisturbed() -> Iterator[None]:
    """What tells the bench to end is obeyed afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _free_port() -> int:
    with socket.socket() as any_socket:
        any_socket.bind(("127.0.0.1", 0))
        port: int = any_socket.getsockname()[1]
        return port


def _go(rig: Rig, case: Case) -> None:
    for attribute, value in case.setup.items():
        setattr(rig.vehicle.plant, attribute, value)
    if case.link_is_down:
        rig.set_link(up=False)
    rig.begin()
    rig.note(EventKind.PREPARATION, "the vehicle speaks, the device is started")
    rig.device.start(armed=case.armed, recorded=bool(case.recorded_mib), open_files=case.open_files)
    if not rig.device.is_started:
        rig.run_for(SETTLE_S)
        rig.device.rearm()
    if case.at_mps < 0.0:
        _inject(rig, case)
    elif rig.wait_for(lambda: rig.is_engaged or rig.device.poll() is not None, ENGAGE_S, "the device to engage"):
        rig.note(EventKind.PREPARATION, "engaged")
        if case.at_mps > 0.0 and case.inject is not None:
            rig.wait_for(lambda: abs(rig.vehicle.plant.speed_mps) >= case.at_mps, REACH_SPEED_S, f"{case.at_mps} m/s")
        _inject(rig, case)
    _afterwards(rig, case)


def _inject(rig: Rig, case: Case) -> None:
    if case.inject is None and case.at_mps >= 0.0:
        return
    rig.injects()
    rig.touched_ns = rig.inject_ns
    with (case.inject or nothing)(rig):
        rig.run_for(case.for_s)
        if case.samples:
            count = len(rig.vehicle.history) + case.samples
            rig.wait_for(lambda: len(rig.vehicle.history) >= count, case.samples / 50.0, "the samples")
        rig.end_ns = time.monotonic_ns()
    rig.end_ns = max(rig.end_ns, time.monotonic_ns())


def _afterwards(rig: Rig, case: Case) -> None:
    if case.then is Then.END_OF_ROUTE:
        longest_s = 180.0
        rig.wait_for(
            lambda: rig.is_at_end or rig.is_stuck or rig.device.poll() is not None, longest_s, "the end of the route"
        )
        rig.run_for(0.6)
    elif case.then is Then.GOES_ON:
        rig.run_for(case.after_s)
        rig.wait_for(lambda: rig.is_engaged, 3.0, "the device to drive on")
        rig.run_for(HEALTHY_S)
    elif case.then is Then.ENDED:
        rig.wait_for(lambda: rig.device.poll() is not None, END_S, "the device to end")
        rig.run_for(case.after_s)
    else:
        rig.run_for(case.after_s)
    if case.then is Then.REARM:
        rig.note(EventKind.CLEAN_UP, "the vehicle is made ready, nobody arms the device")
        rig.vehicle.make_ready()
        rig.run_for(UNARMED_S)
    rig.then_ns = time.monotonic_ns()
    if case.then is Then.REARM:
        _rearm(rig)
    rig.healthy_ns = time.monotonic_ns()


def _rearm(rig: Rig) -> None:
    """As an operator does: make the vehicle ready, then arm; once more if nothing comes of it."""
    end_ns = time.monotonic_ns() + round(REARM_S * S)
    rig.note(EventKind.CLEAN_UP, "the vehicle is made ready, the device is armed again")
    while time.monotonic_ns() < end_ns and not rig.is_engaged:
        rig.vehicle.make_ready()
        rig.run_for(0.3)
        rig.device.rearm()
        again_ns = time.monotonic_ns() + round(REARM_AGAIN_S * S)
        while not rig.is_engaged and time.monotonic_ns() < again_ns:
            rig.tick()
    if rig.is_engaged:
        rig.note(EventKind.CLEAN_UP, "engaged again")
    rig.run_for(HEALTHY_S)


def _clean_up(rig: Rig, case: Case) -> list[str]:
    """End the device; returns what would not end by itself."""
    rig.then_ns = rig.then_ns or time.monotonic_ns()
    if case.link_is_down:
        rig.set_link(up=True)
    try:
        if rig.device.poll() is None:
            rig.device.stop()
            rig.wait_for(lambda: rig.device.poll() is not None or not rig.device.is_started, END_S, "the device to end")
            rig.run_for(0.05)
        rig.exit_ns = rig.exit_ns or time.monotonic_ns()
        rig.exit_status = rig.device.poll()
    finally:
        killed = rig.device.kill()
        rig.close()
    return killed


def _judged(bench: Bench, case: Case, rig: Rig, route: Route, killed: list[str], repetition: int) -> CaseResult:
    record = judge.examined(rig)
    frames = rig.device_frames()
    seen = Seen(
        begin_ns=rig.begin_ns,
        inject_ns=rig.inject_ns,
        end_ns=rig.end_ns or rig.then_ns,
        then_ns=rig.then_ns,
        samples_ns=[sample.stamp_ns for sample in record.samples],
        pairs=record.pairs,
        told=[told for told in record.told if told.name not in (*rig.wire.sample, "VEHICLE_STATUS")],
        frames=frames,
        history=rig.vehicle.history,
        exit_status=rig.exit_status,
        exit_ns=rig.exit_ns,
        route=route,
    )
    checks = judge.alive(case, seen, rig)
    events: list[Event] = []
    for expectation in case.see:
        expected, at = expectation.judge(seen)
        checks.append(expected)
        events += at
    path_checks, drawn = judge.path(case, route, rig.vehicle.history)
    answer_checks, distributions = judge.answers(case, record, seen, rig)
    checks += judge.prepared(case, seen, rig) + path_checks + answer_checks + judge.protocol(case, rig, record, seen)
    checks += judge.health(case, seen, rig, killed)
    failed = [c for c in checks if c.verdict is Verdict.FAIL]
    verdict = Verdict.FAIL if failed else Verdict.PASS
    first = (judge.certain(failed) if rig.late else failed) or failed
    why = f"{first[0].text}: {'; '.join(first[0].found[:1])}" if failed else ""
    if failed and rig.late and not judge.certain(failed):
        verdict = Verdict.NOT_EXECUTED
        why = f"the bench itself was late ({rig.late[0]}), so that this is no finding: {why}"
    return msgspec.structs.replace(
        unjudged(bench, case, repetition, why, verdict),
        checks=checks,
        events=judge.timeline(case, rig, seen, events),
        distributions=distributions,
        plots=judge.plots(rig.wire, seen),
        path=drawn,
        counts=judge.counts(record, rig, frames),
    )
