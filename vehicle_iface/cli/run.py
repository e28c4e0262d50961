"""`vehicle-iface run`: runs the loop with its bus, trajectory source, telemetry and recorder."""

import argparse
import gc
import logging
import os
import shlex
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from msgspec import UNSET, UnsetType

from vehicle_iface import clock, compose, drivable
from vehicle_iface.arming import is_virtual, report_review, require_reviewed_profile
from vehicle_iface.bus.base import Bus
from vehicle_iface.cli.channels import find_channels
from vehicle_iface.cli.drive_options import DEFAULT_TELEMETRY
from vehicle_iface.cli.exit_status import BAD_USAGE, DONE, LATCHED_FAULT
from vehicle_iface.cli.files import check_writable, write_text
from vehicle_iface.cli.frames import check_frame
from vehicle_iface.cli.option_types import EMBEDDED
from vehicle_iface.cli.recording import start_recording
from vehicle_iface.cli.signals import Flag, on_end_signals
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.motion_sources import cap_unconfirmed_speed
from vehicle_iface.opening import Channels, describe_channels, open_buses, require_socketcan
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.runtime.open_wait import wait_until_open
from vehicle_iface.runtime.summary import as_json, table
from vehicle_iface.runtime.watchdog import Watchdog
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.telemetry.details import RunSummary
from vehicle_iface.trajectories.mailbox import MailboxFile
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import ns_from_s

if TYPE_CHECKING:
    from vehicle_iface.recorder.child import RecorderProcess
    from vehicle_iface.rerun.tap import InputTap

log = logging.getLogger("vehicle_iface")

EMBEDDED_HINT = "for a real bus: vehicle-iface run --channel can0, or tools/vcan for a virtual one"


def run(options: argparse.Namespace) -> int:
    """Run the loop until it is interrupted or `--duration` is over."""
    end = _EarlyEnd()
    on_end_signals(end.set)
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # there is nothing to arm yet
    if options.summary:
        check_writable(options.summary, "--summary")
    profile = load_profile(options.profile)
    channels = find_channels(options.channels, profile, command="run", interface=options.interface)
    if options.interface != EMBEDDED:
        require_socketcan(options.interface, profile)
    if options.arm and profile.only_watches:
        raise ConfigError(f"--arm: profile {profile.name} has no [command], so it can only be watched; leave out --arm")
    if options.arm:
        for channel in channels.values():
            profile = require_reviewed_profile(
                profile, interface=options.interface, channel=channel, speed_cap_mps=options.speed_cap
            )
    review = _log_review(options, channels, profile)
    database = load_database(cap_unconfirmed_speed(profile))
    frame_id = check_frame(options.frame, database)
    source = _build_source(options, database, frame_id)
    controller = compose.build_controller(options.controller, database.profile)
    open_bus = _bus_opener(options, channels, database)
    if options.wait is not None and not _wait_for_bus(open_bus, options.wait, end):
        return _report_early_end()
    with (
        _telemetry(options, channels, database) as telemetry,
        start_recording(options, channels, database, frame_id) as recording,
    ):
        with Watchdog() as watchdog:
            tap = _tap_inputs(recording)
            is_outside = options.trajectory_mailbox is not None
            loop = compose.build_loop(
                database=database,
                open_bus=open_bus if tap is None else tap.wrap_bus(open_bus),
                controller=controller,
                source=source if tap is None or not is_outside else tap.wrap_source(source),
                telemetry=telemetry,
                armed=options.arm,
                now_ns=clock.monotonic_ns if tap is None else tap.now_ns,
                feed_watchdog=watchdog.feed,
            )
            signal.signal(signal.SIGUSR1, lambda *_: loop.arming.request())
            on_end_signals(loop.shutdown.request)
            if end.is_set:  # before the loop's own handlers were installed
                loop.link.close()
                return _report_early_end()
            log.info("%s, %s: %s", loop.link.description, _arming(options), _describe_route(options))
            connect = "" if options.telemetry == DEFAULT_TELEMETRY else f" --connect {shlex.quote(options.telemetry)}"
            log.info("process %d; the page: vehicle-iface view%s", os.getpid(), connect)
            priority = realtime.FIFO_PRIORITY if options.arm else realtime.UNARMED_PRIORITY
            for lack in realtime.apply_settings(priority=priority, cpu=options.cpu):
                log.warning("%s", lack)
            run_for(loop, options.duration, tap)
            loop.link.close()
            realtime.release_priority()
        on_end_signals(None)  # the vehicle is released: a terminal or disk that hangs must not keep the program
        summary = msgspec.structs.replace(loop.summary(), review=review)
        if tap is not None and recording is not None:
            tap.close(recording.write_last_inputs)
        if recording is not None:
            summary = msgspec.structs.replace(summary, recorder=recording.end())
            recording.save_summary(as_json(summary))
    is_saved = not options.summary or _try_to_save(options.summary, summary)
    print_safely(table(summary))
    return LATCHED_FAULT if loop.shutdown.ended_in_fault else DONE if is_saved else BAD_USAGE


def _log_review(options: argparse.Namespace, channels: Channels, profile: Profile) -> str | UnsetType:
    """Log and return the record of the profile's review, for an armed run on a real bus. Warn if the profile has
    changed since."""
    if not options.arm or all(is_virtual(options.interface, channel) for channel in channels.values()):
        return UNSET
    review = report_review(profile)
    log.info("review of %s: %s", profile.name, review.text)
    if review.changes:
        log.warning(
            "%s: not as it was when it was reviewed; review it again with vehicle-iface commission --profile %s",
            " and ".join(review.changes),
            shlex.quote(options.profile),
        )
    return review.text


class _EarlyEnd(Flag):
    """A request to end that comes before the loop exists. A second one ends the program at once, even if user code
    hangs."""

    def set(self) -> None:
        super().set()
        on_end_signals(None)


def _wait_for_bus(open_bus: Callable[[], Bus], limit_s: float, end: _EarlyEnd) -> bool:
    """Wait until the bus can be opened; return False if `end` was set first."""
    gc.enable()  # off since the start, but this may take hours
    return wait_until_open(
        open_bus,
        limit_s=limit_s,
        is_over=lambda: end.is_set,
        now_ns=clock.monotonic_ns,
        sleep_until=clock.sleep_until,
    )


def _report_early_end() -> int:
    log.info("interrupted before the loop started")
    return DONE


def _try_to_save(path: str, summary: RunSummary) -> bool:
    """Save the summary; if that fails, log the reason and return False."""
    try:
        write_text(path, as_json(summary).decode(), "--summary")
    except ConfigError as error:
        log.error("%s", error)
        return False
    return True


def run_for(loop: Loop, duration_s: float | None, tap: "InputTap | None" = None) -> None:
    """Run the loop to its end. With a duration, the end is scheduled. A `tap` notes its inputs."""
    if tap is not None:
        tap.end_pass(loop)
    loop.begin()
    if tap is not None:
        tap.end_pass(loop)
    deadline_ns = None if duration_s is None else clock.monotonic_ns() + ns_from_s(duration_s)
    if deadline_ns is not None:
        loop.shutdown.schedule(deadline_ns)
        if tap is not None:
            tap.schedule(deadline_ns)
    while not loop.shutdown.is_done:
        if deadline_ns is not None and clock.monotonic_ns() >= deadline_ns:
            deadline_ns = None
            loop.shutdown.begin_on_schedule()
            if tap is not None:
                tap.begin_on_schedule()
        loop.step()
        if tap is not None:
            tap.end_pass(loop)


def _tap_inputs(recording: "RecorderProcess | None") -> "InputTap | None":
    """Return the tap that notes the inputs of a recorded loop."""
    if recording is None or not recording.records_inputs:
        return None
    from vehicle_iface.rerun.tap import InputTap

    return InputTap(recording.write_inputs, clock.monotonic_ns)


def _build_source(options: argparse.Namespace, database: VehicleDatabase, frame_id: str) -> TrajectorySource:
    if options.trajectory:
        return FixedTrajectory(drivable.load_trajectory(options.trajectory, database.profile))
    if options.trajectory_mailbox:
        if Path(options.trajectory_mailbox).is_dir():
            raise ConfigError(f"--trajectory-mailbox {options.trajectory_mailbox}: is a folder, must be a file in one")
        return MailboxFile(options.trajectory_mailbox)
    return RecedingRoute(drivable.build_route(options.route, database.profile), frame_id=frame_id)


def _bus_opener(options: argparse.Namespace, channels: Channels, database: VehicleDatabase) -> Callable[[], Bus]:
    if options.interface != EMBEDDED:
        return lambda: open_buses(
            options.interface,
            channels,
            database.profile,
            received=(*database.received, *database.sent),  # those sent, too, to notice another commander
            sent=database.sent,
            receive_timeout_ns=ns_from_s(database.profile.timing.command_period_s),
        )
    from vehicle_iface.sim.embedded import EmbeddedBus
    from vehicle_iface.sim.wire import simulated_vehicle

    vehicle = simulated_vehicle(database, start_ns=clock.monotonic_ns(), frame_id=check_frame(options.frame, database))
    return lambda: EmbeddedBus(vehicle, clock.monotonic_ns, clock.sleep_until)


@contextmanager
def _telemetry(options: argparse.Namespace, channels: Channels, database: VehicleDatabase) -> Iterator[TelemetryWriter]:
    embedded = options.interface == EMBEDDED
    channel = describe_channels(channels)
    bus = f"{options.interface} {channel}"
    info = SessionInfo(
        channel=channel,
        bus="embedded bus (no SocketCAN used)" if embedded else bus.replace("socketcan", "SocketCAN"),
        bus_hint=EMBEDDED_HINT if embedded else "",
        profile=database.profile.name,
        unprotected=database.unprotected,
        route=_describe_route(options),
        arming=_arming(options),
        period_s=database.profile.timing.sample_period_s,
        recording=str(Path(options.record).absolute()) if options.record else "",
        shape=compose.vehicle_shape(database.profile),
        pid=os.getpid(),
        limits=compose.driving_limits(database.profile),
    )
    with TelemetryWriter(options.telemetry, info) as writer:
        yield writer


def _arming(options: argparse.Namespace) -> str:
    return "armed" if options.arm else "shadow"


def _describe_route(options: argparse.Namespace) -> str:
    return str(options.trajectory or options.trajectory_mailbox or options.route)
