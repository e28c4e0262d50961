"""Runs one case, from its trajectory file to its verdict."""

import gc
import shutil
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
from vehicle_bus_contract.reference import S

from hil_bench import host
from hil_bench.bench_config import BenchConfig
from hil_bench.buses import channel_options
from hil_bench.case import Case
from hil_bench.drive_pages import is_shown
from hil_bench.judge_case import judge_case
from hil_bench.phases import clean_up, run_phases
from hil_bench.result import CaseResult
from hil_bench.rig import Rig
from hil_bench.stages import measure_stages


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
    recording = _recording(config, case, name)
    shutil.rmtree(recording, ignore_errors=True)  # of an earlier attempt
    placeholders = {
        "channels": channel_options(device_channels, config.wire),
        "channel": device_channels[0],
        "profile": _profile(config, case, name),
        "trajectory": str(trajectory.resolve()),
        "route": route.name,
        "record": str(recording.resolve()),
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
            stretches = run_phases(rig, case, is_recorded=bool(case.recorded_mib) or is_shown(config, case))
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
        recording=recording.name if is_shown(config, case) and recording.is_dir() else "",
    )


def _recording(config: BenchConfig, case: Case, name: str) -> Path:
    """The folder in which the device records: on a disk of its own that is removed, or to stay."""
    return config.folder / (f"{name}.disk/drive" if case.recorded_mib else f"{name}.recording")


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
