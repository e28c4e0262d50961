"""One short drive on real frames, and all that its recording is for: rerun, replay, export."""

import signal
from pathlib import Path

import numpy as np

from tests.export.unpacked import curve, read_page

from .conftest import Programs
from .driving import driven
from .observer import CHANNEL, CONTROLLER_IDS, Observer
from .peer import Vehicle

DONE, LATCHED_FAULT = 0, 4


def read_log(path: Path) -> list[tuple[int, bytes]]:
    """Identifier and data of each frame."""
    frames = (line.split()[2].split("#") for line in path.read_text().splitlines())
    return [(int(can_id, 16), bytes.fromhex(data)) for can_id, data in frames]


def test_a_recorded_drive_is_run_again_put_back_on_the_bus_and_exported(
    programs: Programs, bus: Observer, vehicle: Vehicle, tmp_path: Path
) -> None:
    vehicle.watches = False  # whether the machine stood still for a moment does not matter here
    folder = tmp_path / "drive"
    loop, moving = driven(programs, bus, "--route", "figure8", "--record", str(folder))
    bus.wait_samples(100, since=moving)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() in (DONE, LATCHED_FAULT)  # on a slow machine the state may be missing for too long
    vehicle.close()

    rerun = programs.start("rerun", str(folder), "--plot", str(tmp_path / "rerun.html"))
    assert rerun.wait_for_end() == DONE, rerun.text
    assert "no difference" in rerun.text
    assert read_page(tmp_path / "rerun.html").plots == []

    begin = bus.now()
    replay = programs.start("replay", str(folder), "--channel", CHANNEL)
    assert replay.wait_for_end() == DONE, replay.text
    logged = [frame for frame in read_log(folder / "frames.log") if frame[0] not in CONTROLLER_IDS]
    assert len(logged) > 300
    assert [(frame.can_id, frame.data) for frame in bus.frames[begin:]] == logged

    export = programs.start("export", str(folder), "--html", str(tmp_path / "drive.html"))
    assert export.wait_for_end() == DONE, export.text
    page = read_page(tmp_path / "drive.html")
    speeds_mps = curve(page, "speed_mps")
    received_mps = np.array([decoded["SPEED"] for decoded in bus.record(0, begin).of("MOTION")])
    known_mps = speeds_mps[np.isfinite(speeds_mps)]
    assert known_mps.max() > 1.0
    assert np.abs(known_mps[:, None] - np.unique(received_mps)).min(axis=1).max() < 2e-4
    sent_mps2 = curve(page, "sent_accel_mps2")
    assert np.isfinite(sent_mps2).sum() > 100
    assert ("mode", "ENGAGED") in [(one.kind, one.name) for one in page.drives[0].events]
