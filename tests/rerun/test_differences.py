"""A rerun finds what differs, and says where; it never takes a damaged recording for an honest one."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.export.unpacked import read_page, unpack
from tests.rerun.recorded import RecordedDrive
from vehicle_iface.cli import main
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.recorder.inputs import PassInputs, SentFrames, encode_pass, format_block, read_inputs
from vehicle_iface.rerun.compare import AHEAD, Comparison, key_of
from vehicle_iface.rerun.drive import rerun
from vehicle_iface.rerun.report import Difference
from vehicle_iface.rerun.tap import InputTap


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    drive = RecordedDrive().run_s(2.0)
    return drive.save(tmp_path_factory.mktemp("rerun") / "drive", with_log=True)


@pytest.fixture
def copy(recording: Path, tmp_path: Path) -> Path:
    import shutil

    return Path(shutil.copytree(recording, tmp_path / "copy"))


def change_inputs(folder: Path, change: Callable[[list[PassInputs]], object]) -> None:
    passes = list(read_inputs(folder / files.INPUTS))
    change(passes)
    (folder / files.INPUTS).write_bytes(format_block([encode_pass(one) for one in passes]))


def flip_bit(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def pass_with_command(passes: list[PassInputs]) -> PassInputs:
    """The first one of the last second that has a DRIVE_COMMAND, which is the first frame of a command."""
    return next(one for one in passes[len(passes) // 2 :] if one.sent and len(one.sent[0].frames) == 2)


@pytest.mark.parametrize("bit", range(0, 64, 9))
def test_one_flipped_bit_of_a_recorded_command_is_found(copy: Path, bit: int) -> None:
    numbers = []

    def flip(passes: list[PassInputs]) -> None:
        found = pass_with_command(passes)
        first, second = found.sent[0].frames
        found.sent = [SentFrames([(first[0], flip_bit(first[1], bit), *first[2:]), second], 2), *found.sent[1:]]
        numbers.append(found.number)

    change_inputs(copy, flip)
    (copy / files.FRAMES).unlink()
    report = rerun(copy)
    assert (report.count, report.by_message) == (1, {"DRIVE_COMMAND": 1})
    assert report.differences[0].number == numbers[0]
    assert int(report.differences[0].recorded, 16) ^ int(report.differences[0].today, 16) > 0


def test_the_signal_that_differs_is_named_with_both_values(copy: Path) -> None:
    message = next(one for one in load_database(load_profile("reference")).sent if one.name == "DRIVE_COMMAND")

    def change(passes: list[PassInputs]) -> None:
        found = pass_with_command(passes)
        first, second = found.sent[0].frames
        values = dict(zip(message.codec.names, message.codec.decode(first[1]), strict=True))
        changed = flip_bit(first[1], 24)
        differing = dict(zip(message.codec.names, message.codec.decode(changed), strict=True))
        names.extend(name for name in values if values[name] != differing[name])
        found.sent = [SentFrames([(first[0], changed, *first[2:]), second], 2), *found.sent[1:]]

    names: list[str] = []
    change_inputs(copy, change)
    (difference,) = [one for one in rerun(copy).differences if not one.is_in_log]
    assert [field.signal for field in difference.fields] == names
    assert len(names) == 1
    assert f"{names[0]} {difference.fields[0].recorded} recorded, {difference.fields[0].today} today" in difference.text


def test_one_flipped_bit_in_the_log_of_the_bus_is_found(copy: Path) -> None:
    lines = (copy / files.FRAMES).read_text().splitlines(keepends=True)
    place = len(lines) // 2
    head, _, data = lines[place].rstrip("\n").partition("#")
    lines[place] = f"{head}#{flip_bit(bytes.fromhex(data), 17).hex().upper()}\n"
    (copy / files.FRAMES).write_text("".join(lines))
    report = rerun(copy)
    assert (report.count, report.log_frames) == (1, len(lines) - 1)
    assert report.differences[0].is_in_log


def test_a_command_that_was_not_recorded_and_one_that_is_not_sent_today_are_found(copy: Path) -> None:
    def change(passes: list[PassInputs]) -> None:
        found = pass_with_command(passes)
        call = found.sent[0]
        found.sent = [SentFrames(call.frames[:1], 2), *found.sent[1:]]
        later = pass_with_command(passes[found.number + 100 :])
        later.sent = [SentFrames([*later.sent[0].frames, later.sent[0].frames[0]], 3), *later.sent[1:]]

    change_inputs(copy, change)
    (copy / files.FRAMES).unlink()
    texts = [one.text for one in rerun(copy).differences]
    assert "STEER_COMMAND: sent today, not recorded: " in texts[0]
    assert "DRIVE_COMMAND: recorded, not sent today: " in texts[1]


def test_another_profile_sends_other_commands(copy: Path) -> None:
    text = (copy / "profile" / "reference.toml").read_text()
    assert "accel_max_mps2 = 1.0" in text
    changed = copy / "profile" / "changed.toml"
    changed.write_text(text.replace("accel_max_mps2 = 1.0", "accel_max_mps2 = 0.5"))
    report = rerun(copy, profile=str(changed))
    assert report.by_message["DRIVE_COMMAND"] > 3
    assert "ACCEL_REQUEST" in report.differences[0].text


def test_what_comes_after_missing_passes_is_not_compared(copy: Path) -> None:
    change_inputs(copy, lambda passes: passes.pop(200))
    report = rerun(copy)
    assert report.passes == 200
    assert report.gap.startswith("passes 200 to 200 are missing in inputs.log")
    assert main(["rerun", str(copy)]) == 1


def test_a_damaged_line_is_a_gap(copy: Path) -> None:
    path = copy / files.INPUTS
    passes = [encode_pass(one) for one in read_inputs(path)]
    lines = [format_block(passes[at : at + 50]) for at in range(0, len(passes), 50)]
    path.write_bytes(lines[0] + lines[1][:-20] + b"\n" + b"".join(lines[2:]))
    assert rerun(copy).gap.startswith("passes 50 to 99 are missing")


def test_without_its_first_inputs_a_recording_is_refused(copy: Path) -> None:
    change_inputs(copy, lambda passes: passes.pop(0))
    with pytest.raises(ConfigError, match="the first inputs are missing"):
        rerun(copy)


def test_a_recording_of_an_older_version_is_refused(copy: Path) -> None:
    meta = json.loads((copy / files.META).read_text())
    del meta["run"]
    (copy / files.META).write_text(json.dumps(meta))
    with pytest.raises(ConfigError, match="recorded by a version that kept no inputs"):
        rerun(copy)


def test_the_command_reports_the_difference_and_its_status(
    copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rerun", str(copy)]) == 0
    assert "no difference" in capsys.readouterr().out
    (copy / files.FRAMES).unlink()

    def change(passes: list[PassInputs]) -> None:
        found = pass_with_command(passes)
        frames = [(one[0], flip_bit(one[1], 20), *one[2:]) for one in found.sent[0].frames]
        found.sent = [SentFrames(frames, 2), *found.sent[1:]]

    change_inputs(copy, change)
    assert main(["rerun", str(copy), "--json", str(tmp_path / "report.json")]) == 1
    said = capsys.readouterr().out
    assert "DIFFERENT" in said
    assert "first difference at " in said
    assert "2 frames differ: DRIVE_COMMAND 1, STEER_COMMAND 1" in said
    assert json.loads((tmp_path / "report.json").read_text())["count"] == 2
    assert main(["rerun", str(tmp_path / "nothing")]) == 2


def test_a_saved_case_is_small_and_runs_again(recording: Path, tmp_path: Path) -> None:
    case = tmp_path / "cases" / "one"
    assert main(["rerun", str(recording), "--save", str(case), "--until", "1.5"]) == 0
    assert sorted(path.name for path in case.iterdir()) == ["inputs.log", "meta.json", "profile"]
    assert sum(path.stat().st_size for path in case.rglob("*") if path.is_file()) < 100_000
    report = rerun(case)
    assert (report.count, report.gap) == (0, "")
    assert 0 < report.frames < rerun(recording).frames
    assert main(["rerun", str(recording), "--save", str(case)]) == 2  # nothing is overwritten


# Frames that are missing in the log, or another node's


def frames_of(*payloads: int) -> list[tuple[int, float, tuple[int, bytes, int, bool, bool, bool, bool, int]]]:
    return [(k, 0.0, (0x100, bytes([one]), 0, False, False, False, False, 0)) for k, one in enumerate(payloads)]


@pytest.mark.parametrize(
    ("logged", "differing"),
    [
        ([1, 2, 3, 4], []),
        ([9, 1, 9, 9, 2, 3, 9, 4], []),
        ([1, 2, 4], [2]),
        ([1, 7, 3, 4], [1]),
        ([*[9] * AHEAD, 1, 2, 3, 4], [0, 1, 2, 3]),
        ([], [0, 1, 2, 3]),
    ],
)
def test_each_frame_is_looked_for_where_the_log_may_have_it(logged: list[int], differing: list[int]) -> None:
    comparison, sent = Comparison(load_database(load_profile("reference"))), frames_of(1, 2, 3, 4)
    log = {key_of(sent[0][2]): [bytes([one]) for one in logged]}
    found = [one for one in comparison.compare_log(sent, log) if isinstance(one, Difference)]
    assert [one.number for one in found] == differing


# The tap


def test_what_the_pipe_does_not_take_is_kept_and_written_later() -> None:
    written = bytearray()
    room = [0]

    def write(data: bytes | bytearray) -> int:
        taken = min(room[0], len(data))
        written.extend(data[:taken])
        return taken

    drive = RecordedDrive()
    tap = InputTap(write, drive.clock.now_ns)
    for k in range(50):
        drive.clock.sleep_until(drive.clock.peek_ns() + 60_000_000)
        tap.now_ns()
        room[0] = 7 if k % 3 else 0
        tap.end_pass(drive.loop)
    tap.close(written.extend)
    numbers = [one.number for one in read_back(written)]
    assert numbers == list(range(50))


def test_a_pipe_that_takes_nothing_costs_passes_not_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vehicle_iface.rerun.tap.MAX_BACKLOG_BYTES", 200)
    drive, written = RecordedDrive(), bytearray()
    tap = InputTap(lambda _: 0, drive.clock.now_ns)
    for _ in range(1000):
        tap.end_pass(drive.loop)
    tap.close(written.extend)
    assert len(written) < 400


def read_back(raw: bytearray) -> list[PassInputs]:
    from vehicle_iface.recorder.inputs import LENGTH_BYTES, decode_pass, split_passes

    return [decode_pass(one[LENGTH_BYTES:]) for one in split_passes(raw)]


def test_the_plot_has_each_signal_that_differs_recorded_and_today(copy: Path, tmp_path: Path) -> None:
    def change(passes: list[PassInputs]) -> None:
        found = pass_with_command(passes)
        first, second = found.sent[0].frames
        found.sent = [SentFrames([(first[0], flip_bit(first[1], 24), *first[2:]), second], 2), *found.sent[1:]]

    change_inputs(copy, change)
    (copy / files.FRAMES).unlink()
    assert main(["rerun", str(copy), "--plot", str(tmp_path / "d.html")]) == 1
    report, page = rerun(copy), read_page(tmp_path / "d.html")
    (difference,) = report.differences
    (field,) = difference.fields
    (plot,) = page.plots
    assert plot.title == f"DRIVE_COMMAND {field.signal}"
    times_s = [unpack(page.drives[one.drive].time) for one in plot.curves]
    recorded, today = (unpack(one.values) for one in plot.curves)
    (place,) = np.flatnonzero(recorded != today)
    assert (recorded[place], today[place]) == (field.recorded, field.today)
    assert times_s[0][place] == times_s[1][place] == pytest.approx(difference.at_s, abs=1e-4)
    (event,) = page.drives[0].events
    assert (event.name, event.text) == ("DRIVE_COMMAND", difference.what)
    assert "1 frames differ" in (tmp_path / "d.html").read_text()


def test_frames_that_are_missing_are_a_gap_in_the_plot(copy: Path, tmp_path: Path) -> None:
    def silence(passes: list[PassInputs]) -> None:
        for one in passes[len(passes) // 2 : len(passes) // 2 + 30]:
            one.sent = [SentFrames([], call.accepted) for call in one.sent]

    change_inputs(copy, silence)
    (copy / files.FRAMES).unlink()
    rerun(copy, plot=tmp_path / "d.html")
    page = read_page(tmp_path / "d.html")
    plot = next(one for one in page.plots if one.title.startswith("DRIVE_COMMAND"))
    recorded, today = (unpack(one.values) for one in plot.curves)
    assert (np.isnan(recorded).sum(), np.isnan(today).sum()) == (1, 0)
    assert len(recorded) < len(today)


def test_the_plot_of_an_honest_recording_is_empty(copy: Path, tmp_path: Path) -> None:
    assert main(["rerun", str(copy), "--plot", str(tmp_path / "d.html")]) == 0
    page = read_page(tmp_path / "d.html")
    assert (page.plots, page.drives[0].events) == ([], [])
    assert "no difference" in (tmp_path / "d.html").read_text()
