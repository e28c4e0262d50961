"""A recorded drive of twelve seconds along the publisher's figure of eight, with a stop at its ninth second."""

from pathlib import Path

import msgspec

from vehicle_iface.recorder import files
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S

from .publisher import Drive, figure_eight

_BEGIN_NS, _PERIOD_NS, _COUNT = 10**12, NS_PER_S // 100, 1201
STOP_S = 9.0


def write_recording(folder: Path) -> Path:
    """Write it to `folder`, which must not exist; return it."""
    folder.mkdir()
    bus = "embedded bus (no SocketCAN used)"
    info = SessionInfo(channel="embedded", bus=bus, profile="reference", route="figure8", arming="armed")
    meta = files.Meta(
        format=files.FORMAT,
        session=info,
        wall_ns=1_795_331_353 * NS_PER_S,
        monotonic_ns=_BEGIN_NS,
        frames="no frames: embedded bus",
        command_line=[],
        versions={},
        sha256={},
    )
    (folder / files.META).write_bytes(msgspec.json.encode(meta))
    route = figure_eight(_BEGIN_NS)
    drive, rows = Drive(route, version=1), []
    for k in range(_COUNT):
        drive.order = "engaged" if k * _PERIOD_NS < STOP_S * NS_PER_S else "ending"
        snapshot = drive.snapshot(_BEGIN_NS + k * _PERIOD_NS)
        rows.append(files.format_snapshot(snapshot._replace(sequence=k + 1)))
    (folder / files.SNAPSHOTS).write_bytes(b"".join([files.SNAPSHOT_HEADER, *rows]))
    chosen = slice(0, len(route), 10)
    drawn = DrawnTrajectory(
        version=1,
        stamp_ns=_BEGIN_NS,
        frame_id=route.frame_id,
        original_count=len(route),
        x_m=route.x_m[chosen],
        y_m=route.y_m[chosen],
        heading_rad=route.heading_rad[chosen],
        speed_mps=route.speed_mps[chosen],
        time_s=route.time_from_start_ns[chosen] / NS_PER_S,
    )
    (folder / files.TRAJECTORIES).write_bytes(files.format_trajectory(drawn))
    events = ((1, 0.5, EventKind.MODE, "ENGAGED", Phase.ONCE), (2, STOP_S, EventKind.STOP, "SHUTDOWN", Phase.BEGAN))
    lines = [
        LoopEvent(number=number, at_ns=_BEGIN_NS + round(at_s * NS_PER_S), kind=kind, name=name, phase=phase)
        for number, at_s, kind, name, phase in events
    ]
    (folder / files.EVENTS).write_bytes(b"".join(map(files.format_event, lines)))
    return folder
