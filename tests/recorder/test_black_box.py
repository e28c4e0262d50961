"""The seconds around each stop: kept in a folder that the viewer opens, and never more than the limit."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from vehicle_iface import Trajectory
from vehicle_iface.profile import load_profile
from vehicle_iface.reason import Reason
from vehicle_iface.recorder import files
from vehicle_iface.recorder.black_box import BlackBox, default_place
from vehicle_iface.recorder.folder import RecordingRequest
from vehicle_iface.recorder.recorder import Recorder
from vehicle_iface.recorder.telemetry_tap import NewLines
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.playback import Playback

INFO = SessionInfo(channel="embedded", bus="embedded bus", profile="reference")


@pytest.fixture
def request_(tmp_path: Path) -> RecordingRequest:
    profile = load_profile("reference")
    return RecordingRequest(
        folder="",
        telemetry=str(tmp_path / "loop"),
        channels=["vcan0"],
        profile=profile.file,
        named_files=[profile.dbc],
        command_line=["vehicle-iface", "run"],
    )


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def box(request_: RecordingRequest, tmp_path: Path, said: list[str]) -> BlackBox:
    return BlackBox(tmp_path / "boxes", request_, INFO, said.append)


def stop(number: int, reason: Reason, phase: Phase = Phase.BEGAN) -> bytes:
    event = LoopEvent(number=number, at_ns=number, kind=EventKind.STOP, name=reason.name, phase=phase)
    return files.format_event(event)


def drive(box: BlackBox, begin_s: int, end_s: int, stops: dict[int, Reason] | None = None) -> None:
    """One snapshot, one frame and perhaps a stop a second."""
    for second in range(begin_s, end_s):
        snapshot = Snapshot(second * NS_PER_S, 3, 0, trajectory_version=1, sequence=second + 1)
        lines = NewLines(snapshots=[files.format_snapshot(snapshot)])
        if stops is not None and second in stops:
            lines.events.append(stop(second, stops[second]))
        box.add(lines, [f"({second:010}.000000) vcan0 7F1#01\n".encode()], second * NS_PER_S)


def boxes(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "boxes").iterdir()) if (tmp_path / "boxes").exists() else []


def seconds(folder: Path) -> list[int]:
    """Of the snapshots in a box."""
    header, *lines = (folder / files.SNAPSHOTS).read_text().splitlines()
    found = [files.parse_snapshot(header.split(","), line) for line in lines]
    return [snapshot.published_ns // NS_PER_S for snapshot in found if snapshot is not None]


def test_thirty_seconds_before_a_stop_and_five_after_it_are_kept(
    box: BlackBox, tmp_path: Path, said: list[str]
) -> None:
    drive(box, 0, 104, {100: Reason.DEVIATION})
    assert boxes(tmp_path) == []
    drive(box, 104, 120)
    (folder,) = boxes(tmp_path)
    assert folder.name.endswith("-DEVIATION")
    assert seconds(folder) == list(range(70, 106))
    assert len((folder / files.FRAMES).read_text().splitlines()) == 36
    assert said == [f"DEVIATION: vehicle-iface view {folder}"]


def test_a_box_is_opened_by_the_viewer_with_its_trajectory_and_profile(box: BlackBox, tmp_path: Path) -> None:
    path = Trajectory(
        stamp_ns=5,
        time_from_start_ns=np.arange(3),
        x_m=np.arange(3.0),
        y_m=np.zeros(3),
        heading_rad=np.zeros(3),
        speed_mps=np.ones(3),
    )
    with TelemetryWriter(str(tmp_path / "loop"), INFO) as writer:
        recorder = Recorder(
            msgspec.structs.replace(box._request, channels=[], black_box=str(tmp_path / "boxes")), lambda _: None
        )
        version = writer.publish_trajectory(path)
        for second in range(60):
            writer.publish(Snapshot(second * NS_PER_S, 3, 0, trajectory_version=version))
            if second == 50:
                writer.publish_event(msgspec.json.decode(stop(1, Reason.STATE_STALE), type=LoopEvent))
            recorder.step(second * NS_PER_S)
        status = recorder.close(60 * NS_PER_S)
    (folder,) = boxes(tmp_path)
    playback = Playback(str(folder))
    assert playback.length_s == 35.0
    drawn = playback.trajectory(version)
    assert drawn is not None
    assert drawn.x_m.tolist() == [0.0, 1.0, 2.0]
    assert (folder / "profile" / "reference.dbc").exists()
    assert status.written == {"black boxes": 1}


def test_the_end_of_a_drive_is_no_stop_to_keep(box: BlackBox, tmp_path: Path) -> None:
    drive(box, 0, 60, {20: Reason.PAST_END_SPACE, 30: Reason.PAST_END_TIME, 40: Reason.SHUTDOWN})
    box.finish()
    assert boxes(tmp_path) == []


def test_stops_that_follow_one_another_are_in_one_box_of_at_most_a_minute(box: BlackBox, tmp_path: Path) -> None:
    drive(box, 0, 130, dict.fromkeys(range(40, 110, 4), Reason.STATE_STALE))
    assert [seconds(folder) for folder in boxes(tmp_path)] == [
        list(range(10, 101)),
        list(range(74, 114)),
    ]


def test_a_box_that_has_begun_is_written_at_the_end(box: BlackBox, tmp_path: Path) -> None:
    drive(box, 0, 42, {40: Reason.LINK_DOWN})
    box.finish()
    (folder,) = boxes(tmp_path)
    assert seconds(folder) == list(range(10, 42))


def test_a_loop_that_is_killed_is_a_stop(box: BlackBox, tmp_path: Path) -> None:
    drive(box, 0, 40)
    for second in range(40, 60):
        box.add(NewLines(), [b"(0000000000.000000) vcan0 7F1#01\n"], second * NS_PER_S, is_loop_dead=True)
    (folder,) = boxes(tmp_path)
    assert folder.name.endswith("-LOOP-KILLED")
    assert seconds(folder) == list(range(10, 40))


def test_the_oldest_boxes_are_removed_beyond_the_limit_and_the_newest_stays(
    request_: RecordingRequest, tmp_path: Path, said: list[str]
) -> None:
    box = BlackBox(tmp_path / "boxes", request_, INFO, said.append, limit_bytes=1)
    (tmp_path / "boxes").mkdir()
    (tmp_path / "boxes" / "notes").write_text("mine")
    drive(box, 0, 250, dict.fromkeys((40, 120, 200), Reason.DEVIATION))
    kept = [path.name for path in boxes(tmp_path)]
    assert len(kept) == 2
    assert "notes" in kept
    assert box.kept == 3
    assert seconds(next(path for path in boxes(tmp_path) if path.is_dir())) == list(range(170, 206))


def test_a_place_that_cannot_be_written_costs_the_box_only(
    request_: RecordingRequest, tmp_path: Path, said: list[str]
) -> None:
    (tmp_path / "file").write_text("")
    box = BlackBox(tmp_path / "file" / "boxes", request_, INFO, said.append)
    drive(box, 0, 60, {40: Reason.DEVIATION})
    assert (box.kept, box.lost) == (0, 1)
    assert "cannot be written" in said[0]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    return tmp_path


def test_the_default_place_is_in_the_users_state(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert default_place() == home / ".local/state/vehicle-iface/black-box"
    monkeypatch.setenv("XDG_STATE_HOME", "/var/state")
    assert default_place() == Path("/var/state/vehicle-iface/black-box")
    monkeypatch.setenv("XDG_STATE_HOME", "relative")
    assert default_place() == home / ".local/state/vehicle-iface/black-box"
