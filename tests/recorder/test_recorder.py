"""The recorder at a loop's telemetry: everything, in order, and the numbers of what was lost."""

import hashlib
import json
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from vehicle_iface import Trajectory
from vehicle_iface.bus import listening
from vehicle_iface.bus.receive import SO_TIMESTAMPNS
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder.files import SNAPSHOT_HEADER, parse_event, parse_snapshot
from vehicle_iface.recorder.folder import RecordingRequest
from vehicle_iface.recorder.frame_tap import FrameTaps
from vehicle_iface.recorder.recorder import Recorder
from vehicle_iface.telemetry import RING_LENGTH, SessionInfo, Snapshot, TelemetryWriter
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent
from vehicle_iface.telemetry.layout import EVENT_SLOTS
from vehicle_iface.units import NS_PER_S

INFO = SessionInfo(channel="embedded", bus="embedded bus", profile="reference")
COLUMNS = SNAPSHOT_HEADER.decode().strip().split(",")
PATH = Trajectory(
    stamp_ns=5,
    time_from_start_ns=np.arange(3),
    x_m=np.array([0.0, 1.23456789, 2.0]),
    y_m=np.zeros(3),
    heading_rad=np.zeros(3),
    speed_mps=np.ones(3),
)


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[TelemetryWriter]:
    with TelemetryWriter(str(tmp_path / "loop"), INFO) as opened:
        yield opened


@pytest.fixture
def recording(tmp_path: Path) -> RecordingRequest:
    profile = load_profile("reference")
    return RecordingRequest(
        folder=str(tmp_path / "folder"),
        telemetry=str(tmp_path / "loop"),
        channels=[],
        profile=profile.file,
        named_files=[profile.dbc],
        command_line=["vehicle-iface", "run"],
    )


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def recorder(writer: TelemetryWriter, recording: RecordingRequest, said: list[str]) -> Iterator[Recorder]:  # noqa: ARG001
    made = Recorder(recording, said.append)
    yield made
    made.close(0)


def rows(recording: RecordingRequest) -> list[Snapshot]:
    header, *lines = (Path(recording.folder) / "snapshots.csv").read_text().splitlines()
    assert header.split(",") == COLUMNS
    found = [parse_snapshot(COLUMNS, line) for line in lines]
    assert None not in found
    return [snapshot for snapshot in found if snapshot is not None]


def report(recording: RecordingRequest) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((Path(recording.folder) / "recorder.json").read_text())
    return content


def test_every_snapshot_is_written_once_and_in_full(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest
) -> None:
    sent = [Snapshot(k, 3, 0, x_m=k / 3.0, has_state=True) for k in range(1, 100)]
    for k, snapshot in enumerate(sent):
        writer.publish(snapshot)
        if k % 7 == 0:
            recorder.step(k)
    recorder.step(100)
    recorder.step(101)
    assert rows(recording) == [snapshot._replace(sequence=k + 1) for k, snapshot in enumerate(sent)]


def test_a_late_recorder_counts_and_reports_lost_data(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest, said: list[str]
) -> None:
    late = 100
    for k in range(RING_LENGTH + late):
        writer.publish(Snapshot(k, 3, 0))
    recorder.step(NS_PER_S)
    numbers = [snapshot.sequence for snapshot in rows(recording)]
    assert numbers == list(range(late + 1, RING_LENGTH + late + 1))
    assert report(recording)["lost"]["snapshots"] == late
    assert report(recording)["written"]["snapshots"] == RING_LENGTH
    assert said == [f"too slow: {late} snapshots lost; the drive continues"]
    recorder.step(3 * NS_PER_S)
    assert len(said) == 1


def test_trajectories_are_written_as_drawn_and_those_that_came_too_fast_are_counted(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest
) -> None:
    for count in (1, 4):
        version = 0
        for _ in range(count):
            version = writer.publish_trajectory(PATH)
        writer.publish(Snapshot(1, 3, 0, trajectory_version=version))
        recorder.step(1)
    lines = [json.loads(line) for line in (Path(recording.folder) / "trajectories.jsonl").read_text().splitlines()]
    assert [line["version"] for line in lines] == [1, 4, 5]
    assert lines[0]["x_m"] == [0.0, 1.234568, 2.0]
    assert (lines[0]["stamp_ns"], lines[0]["original_count"]) == (5, 3)
    assert recorder.status(1).lost["trajectories"] == 2


def test_counters_are_written_twice_a_second(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest
) -> None:
    details = LiveDetails(link=LinkDetails(state="UP"), loop={"samples": 7})
    writer.publish_details(details)
    for tenth in range(20):
        recorder.step(tenth * NS_PER_S // 10)
    lines = [json.loads(line) for line in (Path(recording.folder) / "counters.jsonl").read_text().splitlines()]
    assert [line["at_ns"] for line in lines] == [0, NS_PER_S // 2, NS_PER_S, 3 * NS_PER_S // 2]
    assert msgspec.convert(lines[0]["counters"], LiveDetails) == details


def test_events_are_written_once_each_and_those_that_were_overwritten_are_counted(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest
) -> None:
    def publish(first: int, last: int) -> None:
        for number in range(first, last + 1):
            writer.publish_event(LoopEvent(number=number, at_ns=number, kind=EventKind.MODE, name="ENGAGED", text="é"))

    publish(1, 3)
    recorder.step(1)
    publish(4, 4 + EVENT_SLOTS)
    recorder.step(2)
    recorder.step(3)
    lines = (Path(recording.folder) / "events.jsonl").read_text().splitlines()
    events = [parse_event(line) for line in lines]
    assert [event.number for event in events if event is not None] == [1, 2, 3, *range(5, 5 + EVENT_SLOTS)]
    assert recorder.status(3).lost["events"] == 1
    assert parse_event(lines[0][:-1]) is None


def test_another_run_at_the_same_address_is_not_mixed_in(
    writer: TelemetryWriter, recorder: Recorder, recording: RecordingRequest
) -> None:
    writer.publish(Snapshot(1, 3, 0))
    recorder.step(1)
    writer.close()
    with TelemetryWriter(recording.telemetry, INFO) as other:
        for _ in range(5):
            other.publish(Snapshot(2, 3, 0))
        recorder.step(2)
    assert len(rows(recording)) == 1
    assert recorder.status(2).lost["snapshots"] == 0


def test_the_folder_describes_its_recording_and_has_the_profile_with_its_hashes(
    recorder: Recorder,  # noqa: ARG001
    recording: RecordingRequest,
) -> None:
    folder = Path(recording.folder)
    meta = json.loads((folder / "meta.json").read_text())
    assert meta["frames"] == "none: embedded bus has no frames on a socket"
    assert not (folder / "frames.log").exists()
    assert meta["command_line"] == ["vehicle-iface", "run"]
    assert meta["session"]["profile"] == "reference"
    assert meta["wall_ns"] > 10**18
    assert 0 < meta["monotonic_ns"] < 10**18
    assert {"python", "numpy", "kernel"} <= set(meta["versions"])
    copies = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (folder / "profile").iterdir()}
    assert copies == meta["sha256"]
    assert (folder / "profile" / "reference.dbc").read_bytes() == Path(recording.named_files[0]).read_bytes()
    assert (folder / "profile" / "reference.toml").read_bytes() == Path(recording.profile).read_bytes()


@pytest.mark.usefixtures("writer")
def test_dbcs_of_one_name_in_two_folders_are_both_kept_where_the_profile_finds_them(
    recording: RecordingRequest, said: list[str], tmp_path: Path
) -> None:
    for bus in ("vehicle", "ins"):
        (tmp_path / bus).mkdir()
        (tmp_path / bus / "can.dbc").write_text(bus)
    profile = tmp_path / "two.toml"
    profile.write_text("name = 'two'")
    dbcs = [str(tmp_path / bus / "can.dbc") for bus in ("vehicle", "ins")]
    Recorder(msgspec.structs.replace(recording, profile=str(profile), named_files=dbcs), said.append).close(1)
    folder = Path(recording.folder)
    assert [(folder / "profile" / bus / "can.dbc").read_text() for bus in ("vehicle", "ins")] == ["vehicle", "ins"]
    assert set(json.loads((folder / "meta.json").read_text())["sha256"]) == {
        "two.toml",
        "vehicle/can.dbc",
        "ins/can.dbc",
    }


@pytest.mark.usefixtures("writer")
def test_a_folder_with_something_in_it_is_refused_and_stays_as_it_is(
    recording: RecordingRequest, said: list[str]
) -> None:
    folder = Path(recording.folder)
    folder.mkdir()
    (folder / "notes").write_text("mine")
    with pytest.raises(ConfigError, match=r"--record .*: is not an empty folder; nothing is overwritten: choose"):
        Recorder(recording, said.append)
    assert [path.name for path in folder.iterdir()] == ["notes"]


@pytest.mark.usefixtures("writer")
@pytest.mark.parametrize("folder", ["/proc/nowhere/drive", "/dev/null/drive"])
def test_a_folder_that_cannot_be_made_is_refused_with_what_helps(
    recording: RecordingRequest, said: list[str], folder: str
) -> None:
    with pytest.raises(ConfigError, match=rf"--record {folder}: cannot be written: .*; choose a folder that this user"):
        Recorder(
            RecordingRequest(
                **{name: getattr(recording, name) for name in recording.__struct_fields__} | {"folder": folder}
            ),
            said.append,
        )


def test_without_a_loop_there_is_nothing_to_record(recording: RecordingRequest, said: list[str]) -> None:
    with pytest.raises(ConfigError, match="cannot be recorded"):
        Recorder(recording, said.append)
    assert not Path(recording.folder).exists()


def test_the_frames_of_two_buses_are_lines_in_the_order_of_their_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = {name: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for name in ("can0", "can1")}
    for near, _ in pairs.values():
        near.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    monkeypatch.setattr(listening, "open_socket", lambda channel, *_, **__: pairs[channel][0])
    taps = FrameTaps(list(pairs), print)
    for number, name in enumerate(("can1", "can0", "can1", "can0")):
        pairs[name][1].send(struct.pack("=IB3x8s", 0x100, 1, bytes((number,))))
    lines = taps.read(0)
    assert [line.split(b" ", 1)[1] for line in lines] == [
        b"can1 100#00\n",
        b"can0 100#01\n",
        b"can1 100#02\n",
        b"can0 100#03\n",
    ]
    assert taps.lost == 0
    taps.close()
    for _, far in pairs.values():
        far.close()
