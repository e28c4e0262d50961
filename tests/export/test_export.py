"""A drive in other formats, read back by readers that are not ours."""

import csv
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.export.recorded import Recorded, record_drive
from vehicle_iface.cli import main
from vehicle_iface.export import mcap_file
from vehicle_iface.recorder import files
from vehicle_iface.telemetry import Snapshot

SECONDS = 3.0


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record_drive(tmp_path_factory.mktemp("export"), SECONDS)


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_mcap(path: Path, topic: str) -> list[tuple[int, dict[str, Any]]]:
    with path.open("rb") as file:
        return [
            (message.log_time, json.loads(message.data)) for _, _, message in make_reader(file).iter_messages([topic])
        ]


def test_csv_has_every_snapshot_with_its_values(drive: Recorded, tmp_path: Path) -> None:
    folder, shown = drive.folder, drive.shown
    assert main(["export", str(folder), "--csv", str(tmp_path / "d.csv")]) == 0
    rows = read_csv(tmp_path / "d.csv")
    assert [int(row["sequence"]) for row in rows] == [snapshot.sequence for snapshot in shown]
    for row, snapshot in zip(rows, shown, strict=True):
        assert float(row["time_s"]) == pytest.approx((snapshot.published_ns - shown[0].published_ns) / 1e9, abs=1e-6)
        assert (float(row["x_m"]), float(row["speed_mps"])) == (snapshot.x_m, snapshot.speed_mps)
        assert row["sent"] == str(int(snapshot.sent))
    assert (rows[-1]["controller_state"], rows[-1]["reason"], rows[-1]["frame_id"]) == ("ENGAGED", "NOMINAL", "map")


def test_csv_of_a_window_has_only_its_rows(drive: Recorded, tmp_path: Path) -> None:
    folder, shown = drive.folder, drive.shown
    assert main(["export", str(folder), "--csv", str(tmp_path / "d.csv"), "--from", "1.0", "--to", "1.5"]) == 0
    within = [one for one in shown if 1_000_000_000 <= one.published_ns - shown[0].published_ns <= 1_500_000_000]
    assert [int(row["sequence"]) for row in read_csv(tmp_path / "d.csv")] == [one.sequence for one in within]
    assert 10 < len(within) < len(shown)


def test_mcap_has_samples_events_counters_and_trajectories(drive: Recorded, tmp_path: Path) -> None:
    folder, shown, driven = drive.folder, drive.shown, drive.driven
    path = tmp_path / "d.mcap"
    assert main(["export", str(folder), "--mcap", str(path)]) == 0
    meta = files.load_meta(folder)
    snapshots = read_mcap(path, "/snapshot")
    assert [body["sequence"] for _, body in snapshots] == [snapshot.sequence for snapshot in shown]
    for (log_ns, body), snapshot in zip(snapshots, shown, strict=True):
        assert log_ns == snapshot.published_ns - meta.monotonic_ns + meta.wall_ns
        assert {name: body[name] for name in Snapshot._fields} == snapshot._asdict()
    assert snapshots[-1][1]["reason_name"] == "NOMINAL"
    kept = driven.loop.events.log.kept
    assert [(body["number"], body["kind"], body["name"]) for _, body in read_mcap(path, "/event")] == [
        (event.number, event.kind, event.name) for event in kept
    ]
    assert read_mcap(path, "/counters")[-1][1]["counters"]["loop"]["samples"] > 200
    assert read_mcap(path, "/trajectory")[0][1]["original_count"] == 501


def test_mcap_is_in_the_order_of_time_in_small_chunks_with_schemas_that_fit(drive: Recorded, tmp_path: Path) -> None:
    folder = drive.folder
    path = tmp_path / "d.mcap"
    assert main(["export", str(folder), "--mcap", str(path)]) == 0
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert {channel.topic for channel in summary.channels.values()} == {
            "/snapshot",
            "/event",
            "/counters",
            "/trajectory",
        }
        assert len(summary.chunk_indexes) > 5
        largest = max(body_length(message) for _, _, message in reader.iter_messages())
        assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) <= mcap_file.CHUNK_BYTES + largest + 1000
        in_file = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        assert all(before <= after for before, after in pairwise(in_file))
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            described = json.loads(schema.data)
            assert described["type"] == "object"
            assert set(json.loads(message.data)) <= set(described["properties"])


def body_length(message: Any) -> int:
    return len(message.data)


def test_damaged_lines_are_left_out_and_counted(
    drive: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import shutil

    folder, shown = drive.folder, drive.shown
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    lines = (copy / files.SNAPSHOTS).read_text().splitlines(keepends=True)
    lines[5] = "not, a, row\n"
    (copy / files.SNAPSHOTS).write_text("".join(lines)[:-9])
    assert main(["export", str(copy), "--csv", str(tmp_path / "d.csv")]) == 0
    assert len(read_csv(tmp_path / "d.csv")) == len(shown) - 2
    assert "2 damaged lines were left out" in capsys.readouterr().out


def test_mcap_without_the_library_is_refused_with_the_command_that_installs_it(
    drive: Recorded,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(mcap_file, "find_spec", lambda _: None)
    assert main(["export", str(drive.folder), "--mcap", str(tmp_path / "d.mcap")]) == 2
    assert "pip install 'vehicle-iface[mcap]'" in capsys.readouterr().err
    assert not (tmp_path / "d.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["DIR"], "--html FILE, --csv FILE or --mcap FILE"),
        (["DIR", "--csv", "x", "--from", "2", "--to", "1"], "--to 1: must be greater than --from 2"),
        (["NOTHING", "--csv", "x"], "not a recording"),
        (["DIR", "--csv", "NOTHING/x"], "--csv NOTHING/x: cannot be written"),
    ],
)
def test_bad_usage_is_refused_with_what_is_missing(
    drive: Recorded,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", *(str(drive.folder) if one == "DIR" else one for one in arguments)]) == 2
    assert said in capsys.readouterr().err
