"""Recorded frames on a bus again: which ones, in which order, and never on a real one by mistake."""

from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from tests.rerun.recorded import RecordedDrive
from vehicle_iface.cli import main, replay
from vehicle_iface.codec.database import load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return RecordedDrive().run_s(0.1).save(tmp_path_factory.mktemp("replay") / "drive")


@pytest.fixture
def recording(drive: Path) -> Iterator[Path]:
    yield drive
    (drive / files.FRAMES).unlink(missing_ok=True)


@pytest.fixture
def receiver(request: pytest.FixtureRequest) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=request.node.name, receive_own_messages=False) as bus:
        yield bus


def write_log(recording: Path, *lines: str) -> None:
    (recording / files.FRAMES).write_text("".join(f"{line}\n" for line in lines))


def run(recording: Path, channel: str, *options: str) -> int:
    return main(["replay", str(recording), "--interface", "virtual", "--channel", channel, *options])


def received(bus: can.BusABC) -> list[tuple[int, bool, bytes]]:
    found = []
    while (message := bus.recv(timeout=0)) is not None:
        found.append((message.arbitration_id, message.is_extended_id, bytes(message.data)))
    return found


def our_identifiers() -> list[int]:
    return [message.can_id for message in load_database(load_profile("reference")).sent]


def test_frames_of_other_nodes_are_sent_in_their_order(
    recording: Path, receiver: can.BusABC, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    ours = our_identifiers()
    others = ["(0.000000) vcan0 7F1#01", "(0.001000) vcan0 00000123#0203", "(0.002000) vcan0 7F1#04"]
    write_log(recording, *others, *(f"(0.003000) vcan0 {can_id:03X}#00" for can_id in ours))
    assert run(recording, request.node.name) == 0
    assert received(receiver) == [(0x7F1, False, b"\x01"), (0x123, True, b"\x02\x03"), (0x7F1, False, b"\x04")]
    said = capsys.readouterr().out
    assert f"3 frames sent; {len(ours)} that the controller had sent were left out (--with-commands)" in said


def test_frames_of_the_controller_are_sent_when_asked_for(
    recording: Path, receiver: can.BusABC, request: pytest.FixtureRequest
) -> None:
    ours = our_identifiers()
    write_log(recording, *(f"(0.000000) vcan0 {can_id:03X}#00" for can_id in ours))
    assert run(recording, request.node.name, "--with-commands") == 0
    assert [can_id for can_id, _, _ in received(receiver)] == ours


def test_error_frames_damaged_lines_and_other_channels_are_left_out_and_counted(
    recording: Path, receiver: can.BusABC, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(
        recording,
        "(0.000000) vcan0 20000004#0001000000000000",
        "(0.000000) vcan0 20000088#0000000000000000",
        "(0.000000) can7 7F1#01",
        "(0.000000) vcan0 7F1#0",
        "(0.000000) vcan0 7F2#01",
        "(0.0000",
    )
    assert run(recording, request.node.name) == 0
    assert [can_id for can_id, _, _ in received(receiver)] == [0x7F2]
    said = capsys.readouterr().out
    assert "1 frames sent; 2 error frames were left out; 1 of other channels were left out; 2 damaged lines" in said


def test_no_frame_is_sent_sooner_than_it_was_recorded(
    recording: Path, receiver: can.BusABC, request: pytest.FixtureRequest
) -> None:
    stamps_s = [1000.0, 1000.05, 1000.051, 1000.2]
    write_log(recording, *(f"({stamp_s:.6f}) vcan0 7F1#{k:02X}" for k, stamp_s in enumerate(stamps_s)))
    assert run(recording, request.node.name) == 0
    messages = [receiver.recv(timeout=0) for _ in stamps_s]
    times_s = [message.timestamp for message in messages if message is not None]
    assert len(times_s) == len(stamps_s)
    for recorded_s, sent_s in zip(stamps_s, times_s, strict=True):
        assert sent_s - times_s[0] > recorded_s - stamps_s[0] - 0.01


def test_a_bus_that_may_be_real_is_refused_before_anything_is_sent(
    recording: Path,
    receiver: can.BusABC,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(replay, "is_virtual", lambda *_: False)
    write_log(recording, "(0.000000) vcan0 7F1#01")
    assert run(recording, request.node.name) == 2
    assert received(receiver) == []
    assert "may be a real bus" in capsys.readouterr().err
    assert run(recording, request.node.name, "--real-bus") == 0
    assert len(received(receiver)) == 1


def test_a_recording_without_frames_is_refused(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(recording, "x") == 2
    assert "no frames.log" in capsys.readouterr().err


def test_a_signal_ends_the_replay(
    recording: Path, receiver: can.BusABC, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_log(recording, "(0.000000) vcan0 7F1#01", "(0.001000) vcan0 7F1#02", "(0.002000) vcan0 7F1#03")

    def end_at_once(end: object) -> None:
        end()  # type: ignore[operator]

    monkeypatch.setattr(replay, "on_end_signals", end_at_once)
    assert run(recording, request.node.name) == 0
    assert received(receiver) == []
