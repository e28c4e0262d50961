"""Runs one case, from its trajectory file to its verdict."""

import gc
import shutil
import signal
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec
from vehicle_bus_contract.reference import S

from hil_bench import figures, host, judges, plots
from hil_bench.bus import is_virtual
from hil_bench.buses import channel_options, describe_channels
from hil_bench.case import Case, Then
from hil_bench.device import Commands
from hil_bench.expect import Observation, check_measured, measure
from hil_bench.faults.base import inject_nothing
from hil_bench.peer.build import examine
from hil_bench.result import CaseResult, Check, Event, EventKind, Evidence, Verdict
from hil_bench.rig import Rig
from hil_bench.routes import Route
from hil_bench.stages import measure_stages
from hil_bench.steps import Stretch, rearm, run_steps
from hil_bench.violations import find_violations, mark_overdue
from hil_bench.wire import Wire

ENGAGE_S = 25.0
HEALTHY_S = 0.8
UNARMED_S = 0.7
"""Time in READY before the operator arms again; a device that is still armed would engage."""
SETTLE_S = 1.5
"""A device that is already running receives the vehicle for this long before it is armed."""
END_S = 16.0


@dataclass(frozen=True, kw_only=True)
class BenchConfig:
    """What all cases of a run have in common."""

    wire: Wire
    channel: str
    """The interface of the first bus."""
    commands: Commands
    folder: Path
    """Folder for the files of every case."""
    profile: str
    seed: int = 0
    further_channels: tuple[str, ...] = ()
    """Of the buses after the first."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The interface of each bus."""
        return (self.channel, *self.further_channels)

    @property
    def described_channels(self) -> str:
        """The interfaces, for a report."""
        return describe_channels(self.channels, self.wire)

    @property
    def evidence(self) -> Evidence:
        """The class of evidence of its results."""
        return Evidence.VIRTUAL_BUS if any(map(is_virtual, self.channels)) else Evidence.REAL_BUS


def run(config: BenchConfig, case: Case, repetition: int = 1) -> CaseResult:
    """Raises `RigError` and `OSError` where the bench, not the device, is at fault."""
    name = case.name if repetition == 1 else f"{case.name}-{repetition}"
    route = case.route()
    (config.folder / f"{name}.log").unlink(missing_ok=True)  # of an attempt that was interrupted or late
    trajectory = route.write(config.folder / f"{name}.csv", config.wire.frame_id)
    if case.breaks is not None:
        trajectory.write_text(case.breaks(trajectory.read_text()))
    channel, device_channel = (host.BENCH_END, host.DEVICE_END) if case.on_vxcan else (config.channel, config.channel)
    device_channels = (case.channel or device_channel, *config.further_channels)
    placeholders = {
        "channels": channel_options(device_channels, config.wire),
        "channel": device_channels[0],
        "profile": _profile(config, case, name),
        "trajectory": str(trajectory.resolve()),
        "route": route.name,
        "record": str((config.folder / f"{name}.disk" / "drive").resolve()),
        "port": str(_free_port()),
    }
    began_ns = time.monotonic_ns()
    gc.collect()
    gc.disable()  # a collection over all frames of a long case would silence the vehicle for 0.1 s
    try:
        if case.on_vxcan:
            host.make_cable()
        if case.recorded_mib:
            host.make_disk(Path(placeholders["record"]).parent, case.recorded_mib)
        rig = Rig(
            config.wire,
            (channel, *config.further_channels),
            device_channels,
            config.commands,
            config.folder,
            placeholders,
            config.seed + repetition - 1,
            case.name,
        )
        rig.vehicle.drives_to(route.x_m[-1], route.y_m[-1])
        rig.device.log = config.folder / f"{name}.log"
        try:
            stretches = run_phases(rig, case)
        finally:
            killed = clean_up(rig, case)
        rig.write_candump(config.folder / f"{name}.candump")
    finally:
        with _defer_signals():
            gc.enable()
            if case.on_vxcan:
                host.remove_cable()
            if case.recorded_mib:
                host.remove_disk(Path(placeholders["record"]).parent)
    result = judge_case(config, case, rig, route, killed, stretches, repetition)
    ended_ns = time.monotonic_ns()
    return msgspec.structs.replace(
        result,
        duration_s=round((ended_ns - began_ns) / S, 2),
        spent_s=measure_stages(rig, rig.device_frames(), began_ns, ended_ns),
        candump=f"{name}.candump",
        device_log=f"{name}.log" if rig.device.log.exists() else "",
    )


def unjudged_result(
    config: BenchConfig, case: Case, repetition: int, why: str, verdict: Verdict = Verdict.NOT_EXECUTED
) -> CaseResult:
    """A result without checks: the case's own data, and the reason."""
    return CaseResult(
        name=case.name,
        proves=case.proves,
        fault=case.fault,
        tags=list(case.tags),
        verdict=verdict,
        why=why,
        evidence=config.evidence,
        repetition=repetition,
        seed=config.seed + repetition - 1,
        injected=case.injected,
    )


def _profile(config: BenchConfig, case: Case, name: str) -> str:
    """The profile that the device loads: the bench's, or the case's changed copy."""
    if case.profile is None:
        return str(config.wire.path) if config.profile.endswith(".toml") else config.profile
    toml, dbc = case.profile(config.wire.path.read_text(), config.wire.dbc.read_text())
    copy = config.folder / f"{name}.toml"
    copy.write_text(toml)
    (config.folder / config.wire.dbc.name).write_text(dbc)
    for further in config.wire.further_files:
        shutil.copy(further, config.folder / further.name)
    return str(copy.resolve())


@contextmanager
def _defer_signals() -> Iterator[None]:
    """Delay signals until the end of the context."""
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


def run_phases(rig: Rig, case: Case) -> list[Stretch]:
    """Preparation, injection, and what comes after it; returns when each step of the case was carried out."""
    stretches: list[Stretch] = []
    for attribute, value in case.setup.items():
        setattr(rig.vehicle.plant, attribute, value)
    if case.link_is_down:
        rig.set_link(up=False)
    rig.begin()
    rig.note(EventKind.PREPARATION, "the vehicle sends state, the device is started")
    rig.device.start(armed=case.armed, recorded=bool(case.recorded_mib), open_files=case.open_files)
    if not rig.device.is_started:
        rig.run_for(SETTLE_S)
        rig.rearm()
    if case.at_mps < 0.0:
        stretches = _inject(rig, case)
    elif rig.wait_for(lambda: rig.is_engaged or rig.device.poll() is not None, ENGAGE_S, "the device to engage"):
        rig.engaged_ns = rig.now_ns
        rig.note(EventKind.PREPARATION, "engaged", rig.engaged_ns)
        if case.at_mps > 0.0 and case.inject is not None:
            rig.wait_for(
                lambda: abs(rig.vehicle.plant.speed_mps) >= case.at_mps, case.reach_s, f"{case.at_mps:.3g} m/s"
            )
        stretches = _inject(rig, case)
    _after_injection(rig, case)
    return stretches


def _inject(rig: Rig, case: Case) -> list[Stretch]:
    if case.steps:
        rig.mark_output()
        stretches = run_steps(rig, case.steps, at_mps=max(0.0, case.at_mps))
        rig.inject_ns = rig.touched_ns
        return stretches
    if case.inject is None and case.at_mps >= 0.0:
        return []
    rig.mark_injection()
    rig.touched_ns = rig.inject_ns
    rig.mark_output()
    with (case.inject or inject_nothing)(rig):
        rig.run_for(case.for_s)
        if case.samples:
            count = len(rig.vehicle.history) + case.samples
            longest_s = 2.0 * case.samples * rig.wire.period_s
            rig.wait_for(lambda: len(rig.vehicle.history) >= count, longest_s, "the samples")
        rig.end_ns = rig.now_ns
    rig.end_ns = max(rig.end_ns, rig.now_ns)
    return []


def _after_injection(rig: Rig, case: Case) -> None:
    if case.then is Then.END_OF_ROUTE:
        longest_s = 180.0
        planned_ns = rig.begin_ns + round(case.route().time_s[-1] * S)

        def is_stuck() -> bool:
            """A vehicle that is early waits at a turning point; it is stuck if it waits when the route is over."""
            return rig.is_stuck and rig.now_ns > planned_ns

        rig.wait_for(
            lambda: rig.is_at_end or is_stuck() or rig.device.poll() is not None, longest_s, "the end of the route"
        )
        rig.run_for(0.6)
    elif case.then in (Then.GOES_ON, Then.GOES_ON_IF_MOVING, Then.MAY_GO_ON):
        rig.run_for(case.after_s)
        rig.wait_for(lambda: rig.is_engaged, 3.0, "the device to continue")
        rig.run_for(HEALTHY_S)
    elif case.then is Then.ENDED:
        rig.wait_for(lambda: rig.device.poll() is not None, END_S, "the device to end")
        rig.run_for(case.after_s)
    else:
        rig.run_for(case.after_s)
    if case.then is Then.REARM:
        rig.note(EventKind.CLEAN_UP, "the vehicle is made ready, the device is not armed")
        rig.vehicle.make_ready()
        rig.run_for(UNARMED_S)
    rig.then_ns = rig.now_ns
    rig.mark_output()
    may_stay = case.then in (Then.GOES_ON_IF_MOVING, Then.MAY_GO_ON)
    if case.then is Then.REARM or (may_stay and not rig.is_engaged):
        rearm(rig)
        rig.run_for(HEALTHY_S)
    rig.healthy_ns = rig.now_ns


def clean_up(rig: Rig, case: Case) -> list[str]:
    """End the device; returns what had to be killed."""
    rig.then_ns = rig.then_ns or rig.now_ns
    if case.link_is_down:
        rig.set_link(up=True)
    try:
        if rig.device.poll() is None:
            rig.device.stop()
            rig.wait_for(lambda: rig.device.poll() is not None or not rig.device.is_started, END_S, "the device to end")
            rig.run_for(0.05)
        rig.exit_ns = rig.exit_ns or rig.now_ns
        rig.exit_status = rig.device.poll()
    finally:
        killed = rig.device.kill()
        rig.close()
        rig.closed_ns = time.monotonic_ns()
    return killed


def judge_case(
    config: BenchConfig,
    case: Case,
    rig: Rig,
    route: Route,
    killed: list[str],
    stretches: Sequence[Stretch] = (),
    repetition: int = 1,
) -> CaseResult:
    """The result of what was observed."""
    record = examine(rig.wire, rig.judged_frames())
    frames = rig.device_frames()
    observed = Observation(
        begin_ns=rig.begin_ns,
        inject_ns=rig.inject_ns,
        end_ns=rig.end_ns or rig.then_ns,
        then_ns=rig.then_ns,
        samples_ns=[sample.stamp_ns for sample in record.samples],
        pairs=record.pairs,
        decoded=[one for one in record.decoded if one.name in rig.wire.of_device],
        told=[one for one in record.decoded if one.name not in rig.wire.of_device],
        frames=frames,
        history=rig.vehicle.history,
        exit_status=rig.exit_status,
        exit_ns=rig.exit_ns,
        route=route,
        wire=rig.wire,
        armed_ns=rig.armed_ns,
        said=rig.said(),
    )
    before = judges.check_alive(case, observed, rig) + judges.check_preparation(case, observed, rig)
    events: list[Event] = []
    expected: list[Check] = []
    for expectation in () if case.inject is not None and not observed.inject_ns else case.see:
        one, at = expectation.judge(observed)
        expected.append(one)
        events += at
        events += mark_overdue(one, observed.at_s(observed.inject_ns)) if observed.inject_ns else []
    measured = measure(case.measure, observed)
    for stretch in stretches:
        found = stretch.judge(observed)
        expected, events, measured = expected + found.checks, events + found.events, measured + found.measured
    expected += map(check_measured, measured)
    on_path, drawn = judges.check_path(case, route, rig.vehicle.history)
    answers, distributions = judges.check_answers(case, record, observed, rig)
    memory = judges.check_memory(rig.watch.memory, rig.commands_ns, rig.wire.period_s)
    protocol = judges.check_protocol(case, rig, record, observed)
    after = judges.check_health(case, observed, rig, killed)
    failed = judges.Failed(
        state=_failed([*before, *after]),
        expected=_failed(expected),
        others=_failed(on_path),
        content=_failed(memory),
        answers=_failed(answers),
        protocol=_failed(protocol),
    )
    verdict, why = judges.decide(failed, rig.lateness, record)
    checks = [*before, *expected, *on_path, *answers, *memory, *protocol, *after]
    events += find_violations(checks)
    return msgspec.structs.replace(
        unjudged_result(config, case, repetition, why, verdict),
        lateness=rig.lateness.describe(),
        checks=checks,
        events=figures.order_timeline(case, rig, observed, events),
        measured=measured,
        distributions=distributions,
        plots=plots.draw_plots(rig.wire, observed, case.max_path_error_m),
        strips=plots.draw_strips(rig.wire, observed),
        path=drawn,
        counts=figures.count(record, rig, frames),
    )


def _failed(checks: list[Check]) -> list[Check]:
    return [one for one in checks if one.verdict is Verdict.FAIL]
