"""Drives in virtual time that the recorder writes to a folder, for everything that reads a recording."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.harness import Drive, reference
from vehicle_iface import compose, drivable
from vehicle_iface.recorder.folder import RecordingRequest
from vehicle_iface.recorder.recorder import Recorder
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryReader, TelemetryWriter
from vehicle_iface.trajectories.receding import RecedingRoute


@dataclass(frozen=True)
class Recorded:
    """A recording, with the snapshots and the loop that it was made of."""

    folder: Path
    shown: list[Snapshot]
    driven: Drive


MUTED_S = (4.0, 4.5)


def mute_state(drive: Drive) -> None:
    """The vehicle's state is missing between these times."""
    now_s = round(drive.now_s, 1)
    if now_s in MUTED_S:
        drive.send_line(f"mute STATE {'on' if now_s == MUTED_S[0] else 'off'}")


def record_drive(
    home: Path,
    seconds: float,
    *,
    name: str = "drive",
    route: str | None = None,
    start_x_m: float = 0.0,
    act: Callable[[Drive], None] = lambda _: None,
) -> Recorded:
    """Record a drive along a route, or along a straight line at the start. `act` is called every 0.1 s."""
    profile, shown = reference().profile, list[Snapshot]()
    info = SessionInfo(
        channel="embedded",
        bus="embedded",
        route=route or "x,y",
        profile=profile.name,
        arming="armed",
        shape=compose.vehicle_shape(profile),
        limits=compose.driving_limits(profile),
    )
    address = str(home / f"{name}-loop")
    source = None if route is None else RecedingRoute(drivable.build_route(route, profile))
    with TelemetryWriter(address, info) as writer:
        request = RecordingRequest(
            folder=str(home / name),
            telemetry=address,
            channels=[],
            profile=profile.file,
            named_files=[profile.dbc],
            command_line=[],
        )
        recorder, driven, reader = (
            Recorder(request, lambda _: None),
            Drive(source, telemetry=writer, start=BicycleState(x_m=start_x_m)),
            TelemetryReader(address),
        )
        reader.poll()
        while driven.now_s < seconds and not driven.loop.shutdown.is_done:
            driven.run_s(0.1)
            act(driven)
            recorder.step(driven.clock.t_ns)
            shown += reader.since(shown[-1].sequence if shown else 0)
        recorder.close(driven.clock.t_ns)
    return Recorded(home / name, shown, driven)
