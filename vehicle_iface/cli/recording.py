"""What a run records: the folder of `--record`, and the black boxes."""

import argparse
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from vehicle_iface.arming import is_virtual
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.errors import VehicleIfaceError
from vehicle_iface.opening import Channels

if TYPE_CHECKING:
    from vehicle_iface.recorder.child import RecorderProcess

log = logging.getLogger("vehicle_iface")


@contextmanager
def start_recording(
    options: argparse.Namespace, channels: Channels, database: VehicleDatabase, frame_id: str
) -> "Iterator[RecorderProcess | None]":
    """Start the recorder, or yield None where nothing is recorded. It is started last, after all checks."""
    black_box = find_black_box(options, channels)
    if not options.record and not black_box:
        yield None
        return
    from vehicle_iface.recorder.child import RecorderProcess
    from vehicle_iface.recorder.files import RunOptions
    from vehicle_iface.recorder.folder import RecordingRequest

    controller_file = options.controller.rpartition(":")[0]
    run = RunOptions(
        armed=options.arm,
        profile=Path(database.profile.file).name,
        controller=options.controller,
        frame_id=frame_id,
        speed_cap_mps=options.speed_cap if options.arm else None,
        route=options.route,
        trajectory=Path(options.trajectory).name if options.trajectory else None,
        channels=list(channels.values()),
    )
    request = RecordingRequest(
        folder=options.record or "",
        black_box=black_box,
        telemetry=options.telemetry,
        channels=list(channels.values()) if options.interface == "socketcan" else [],
        profile=database.profile.file,
        named_files=[str(file) for file in (*database.profile.dbc_files, *database.profile.checksum_files)],
        run=run,
        input_files=[
            *([options.trajectory] if options.trajectory else []),
            *([controller_file] if controller_file.endswith(".py") else []),
        ],
        command_line=[argument.encode(errors="replace").decode() for argument in sys.argv],
    )
    try:
        process = RecorderProcess(request)
    except VehicleIfaceError as error:
        if options.record or options.black_box:
            raise
        log.warning("no black box: %s", error)
        yield None
        return
    with process as recording:
        log.info("recording to %s", options.record or black_box)
        yield recording


def find_black_box(options: argparse.Namespace, channels: Channels) -> str:
    """Return the folder of the black boxes; empty for none.

    By default, a recording and an armed drive on a bus that may be real have them.
    """
    if options.no_black_box:
        return ""
    if options.black_box:
        return str(options.black_box)
    if options.record:
        from vehicle_iface.recorder.files import BLACK_BOXES

        return str(Path(options.record) / BLACK_BOXES)
    if not options.arm or all(is_virtual(options.interface, channel) for channel in channels.values()):
        return ""
    from vehicle_iface.recorder.black_box import default_place

    return str(default_place())
