"""Logs of other programs come to the same columns as `candump -L`, or are refused with a way on."""

import logging
import os
from pathlib import Path

import can
import numpy as np
import pytest

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs.columns import DecodedLog, decode_log, summarize
from vehicle_iface.logs.kinds import LogKind, recognize_log

from .conftest import CLASSICAL, FD, adds_up

START_S = 1_700_000_000.0
PAYLOADS = [bytes([7 * i % 256, i, *range(6)]) for i in range(20)]


def sent(channel: int | None = 0, can_id: int = 0x110) -> list[can.Message]:
    """20 frames, 10 ms apart, then a remote frame, and one with another identifier of 29 bits."""
    frames = [
        can.Message(
            timestamp=START_S + i / 100, arbitration_id=can_id, is_extended_id=False, data=data, channel=channel
        )
        for i, data in enumerate(PAYLOADS)
    ]
    last = frames[-1].timestamp
    remote = {"is_remote_frame": True, "dlc": 8, "is_extended_id": False}
    return [
        *frames,
        can.Message(timestamp=last + 0.01, arbitration_id=0x110, channel=channel, **remote),  # type: ignore[arg-type]
        can.Message(timestamp=last + 0.02, arbitration_id=0x110, data=bytes(8), channel=channel),
    ]


def written(path: Path, messages: list[can.Message]) -> Path:
    """A log by python-can's writer for the suffix."""
    with can.Logger(path) as writer:
        for message in messages:
            writer(message)
    return path


def reference_log(tmp_path: Path) -> DecodedLog:
    return decode_log(written(tmp_path / "reference.log", sent()), CLASSICAL)


def lines_of(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("suffix", "kind", "offset_s"),
    [(".asc", LogKind.ASC, START_S), (".trc", LogKind.TRC, 0), (".blf", LogKind.BLF, 0), (".csv", LogKind.CSV, 0)],
)
@pytest.mark.parametrize("is_renamed", [False, True])
def test_a_log_by_python_can_has_the_same_values_and_times_whatever_its_name(
    tmp_path: Path, suffix: str, kind: LogKind, offset_s: float, is_renamed: bool
) -> None:
    path = written(tmp_path / f"drive{suffix}", sent())
    if is_renamed:
        path = path.rename(tmp_path / "drive.txt")
    log, reference = decode_log(path, CLASSICAL), reference_log(tmp_path)
    assert recognize_log(path).kind is kind
    remote = 0 if kind is LogKind.TRC else 1  # python-can writes none into a .trc
    assert (log.decoded, log.foreign, log.remote, log.refused) == (20, 1, remote, ())
    assert adds_up(log)
    ours, theirs = log.messages["POSE"], reference.messages["POSE"]
    assert all(np.array_equal(ours.values[name], theirs.values[name]) for name in theirs.values)
    assert np.abs(ours.stamps_ns + round(offset_s * 1e9) - theirs.stamps_ns).max() <= 1000
    assert log.stamps in next(iter(summarize(log)))


@pytest.mark.parametrize("suffix", [".asc", ".blf"])
def test_fd_frames_of_another_program_are_read(tmp_path: Path, suffix: str) -> None:
    longest = max(FD, key=lambda message: message.length)
    frame = can.Message(
        timestamp=START_S,
        arbitration_id=longest.frame_id,
        is_extended_id=longest.is_extended_frame,
        data=bytes(longest.length),
        is_fd=True,
        channel=0,
    )
    log = decode_log(written(tmp_path / f"drive{suffix}", [frame] * 3), FD)
    assert (len(log.messages[longest.name]), log.refused) == (3, ())
    assert longest.length > 8


def test_fd_frames_of_a_trc_have_codes_of_length_or_lengths(tmp_path: Path) -> None:
    payload = "01 " * 16
    head, columns = (";$FILEVERSION=2.1", ";$STARTTIME=45244.9"), ";$COLUMNS=N,O,T,B,I,d,R"
    of = [message for message in FD if message.length == 16][:1]
    frame = f"1 1.059 FD 1 {of[0].frame_id:04X} Rx -"
    codes = decode_log(lines_of(tmp_path / "1.trc", *head, f"{columns},L,D", f"{frame} 10 {payload}"), of)
    lengths = decode_log(lines_of(tmp_path / "2.trc", *head, f"{columns},l,D", f"{frame} 16 {payload}"), of)
    assert (codes.decoded, lengths.decoded) == (1, 1)


def test_stamps_of_an_asc_that_are_relative_are_summed_and_decimal_numbers_understood(tmp_path: Path) -> None:
    log = decode_log(
        lines_of(
            tmp_path / "drive.asc",
            "date Tue Nov 14 10:13:20.000 pm 2023",
            "base dec  timestamps relative",
            "Begin Triggerblock Tue Nov 14 10:13:20.000 pm 2023",
            "   0.000000 Start of measurement",
            "   0.500000123 2  272             Rx   d 8 16 39 0 0 0 0 0 0",
            "   0.250000 2  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.1%",
            "   0.250000 2  272             Rx   d 8 16 39 0 0 0 0 0 0",
            "End TriggerBlock",
        ),
        CLASSICAL,
    )
    assert log.messages["POSE"].stamps_ns.tolist() == [500_000_123, 1_000_000_123]
    assert log.messages["POSE"].values["CRC"].tolist() == [16, 16]
    assert "differences" in log.stamps
    assert (log.comments, log.channels) == (6, {"2": 2})


def test_damaged_lines_of_another_program_are_refused_with_their_number_and_the_rest_is_read(tmp_path: Path) -> None:
    good = "   0.001000 1  110             Rx   d 8 10 27 00 00 00 00 00 00"
    bad = [
        "   0.001000 1  110             Rx   d 8 10 27 00 00 00 00 00",
        "   0.001000 1  11G             Rx   d 8 10 27 00 00 00 00 00 00",
        "   0.001000 1  110             Rx   d 8 10 27 00 00 00 00 00 1FF",
        "   0.001000 1  810             Rx   d 8 10 27 00 00 00 00 00 00",
        "   0.001000 1  110",
        "rubbish",
    ]
    head = ["base hex  timestamps absolute", "no internal events logged"]
    asc = decode_log(lines_of(tmp_path / "drive.asc", *head, good, *bad, "", good), CLASSICAL)
    assert asc.messages["POSE"].lines.tolist() == [3, 11]
    assert [refused.line for refused in asc.refused] == [4, 5, 6, 7, 8, 9]
    assert "7 bytes: must be 8" in asc.refused[0].why
    assert "11G" in asc.refused[1].why
    assert adds_up(asc)


def test_a_length_that_is_not_its_code_is_refused(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    frame = "   0.0 CANFD   1 Rx        110                                  1 0 {} 12 " + "00 " * 12
    log = decode_log(lines_of(tmp_path / "drive.asc", "base hex", frame.format(9), frame.format(8)), CLASSICAL)
    assert (log.decoded, [refused.line for refused in log.refused]) == (1, [3])
    assert "mismatch" in log.refused[0].why
    assert caplog.records == []


def test_errors_and_status_lines_of_a_trc_are_counted_and_damaged_ones_refused_without_output_of_python_can(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "can.io")
    log = decode_log(
        lines_of(
            tmp_path / "drive.trc",
            ";$FILEVERSION=1.1",
            ";$STARTTIME=45244.9",
            "     1)         1.0  Rx         0110  8  10 27 00 00 00 00 00 00",
            "     2)         2.0  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY",
            "     3)         3.0  Rx         0110  8  10 27 00 00",
            "     4)         4.0  Rx         0110  8  RTR",
        ),
        CLASSICAL,
    )
    assert (log.decoded, log.remote, log.comments) == (1, 1, 3)
    assert [refused.line for refused in log.refused] == [5]
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert adds_up(log)


@pytest.mark.parametrize("direction", ["Dir,", ""])
def test_the_csv_of_savvycan_is_read_in_both_versions(tmp_path: Path, direction: str) -> None:
    way = direction.replace("Dir", "Rx")
    log = decode_log(
        lines_of(
            tmp_path / "savvy.csv",
            f"Time Stamp,ID,Extended,{direction}Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8",
            f"973,00000110,false,{way}0,8,10,27,00,00,00,00,00,00,",
            f"1700000000000001,00000110,true,{way}0,8,10,27,00,00,00,00,00,00,",
            f"973,00000110,false,{way}0,8,10,27,00,,,,,,",
            f"973,00000110,false,{way}0,65,10,27,00,,,,,,",
            f"973,20000110,false,{way}0,8,10,27,00,00,00,00,00,00,",
            f"x,00000110,false,{way}0,8,10,27,00,00,00,00,00,00,",
            f"{10**17},00000110,false,{way}0,8,10,27,00,00,00,00,00,00,",
            "973,00000110",
            f"1973,111,false,{way}0,8,10,27,00,00,00,00,00,FF,",
        ),
        CLASSICAL,
    )
    assert log.messages["POSE"].stamps_ns.tolist() == [973_000]
    assert log.messages["MOTION"].stamps_ns.tolist() == [1_973_000]
    assert (log.foreign, log.comments, log.channels) == (1, 1, {"0": 2})
    assert [refused.line for refused in log.refused] == [4, 5, 6, 7, 8, 9]
    assert "3 bytes: must be 8" in log.refused[0].why
    assert adds_up(log)


def test_a_savvycan_header_without_a_needed_column_is_refused_with_its_name(tmp_path: Path) -> None:
    path = lines_of(tmp_path / "savvy.csv", "Time Stamp,ID,Extended,Dir,LEN,D1", "973,110,false,Rx,1,00")
    with pytest.raises(ConfigError, match="header lacks Bus"):
        decode_log(path, CLASSICAL)


def test_a_truncated_blf_is_read_up_to_its_last_frame_with_a_warning(tmp_path: Path) -> None:
    path = written(tmp_path / "drive.blf", sent() * 2)
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    log = decode_log(path, CLASSICAL)
    assert 0 < log.decoded < 40
    assert len(log.refused) == 1
    assert "the file is cut off" in log.refused[0].why
    assert adds_up(log)
    container = whole.index(b"LOBJ") + 16
    path.write_bytes(whole[:container] + b"\x07" + whole[container + 1 :])  # a compression that nobody knows
    with pytest.raises(ConfigError, match="line 1: frames before this one are missing: Unknown compression method"):
        decode_log(path, CLASSICAL)
    path.write_bytes(whole[:20])
    with pytest.raises(ConfigError, match=r"drive\.blf: cannot be read as \.blf"):
        decode_log(path, CLASSICAL)
    path.write_bytes(whole[:144] + b"rubbish" * 100)
    with pytest.raises(ConfigError, match=r"no frame in 1 lines, read as Vector \.blf; line 1: the rest cannot be"):
        decode_log(path, CLASSICAL)


@pytest.mark.parametrize("suffix", [".log", ".asc", ".trc", ".blf"])
def test_two_buses_in_one_log_are_kept_apart(tmp_path: Path, suffix: str) -> None:
    messages = [*sent(0), *sent(1)[:7], *sent(2, can_id=0x7FF)[:5]]
    if suffix == ".log":
        for message in messages:
            message.channel = f"can{message.channel}"
    path = written(tmp_path / f"drive{suffix}", messages)
    names = ("can0", "can1") if suffix == ".log" else ("1", "2")
    with pytest.raises(ConfigError) as refusal:
        decode_log(path, CLASSICAL)
    assert f"on 2 channels: {names[0]} (20 frames), {names[1]} (7 frames): choose one: --channel" in str(refusal.value)
    log = decode_log(path, CLASSICAL, channel=names[1])
    assert (log.decoded, log.foreign, log.other_channels) == (7, 0, 26)
    assert adds_up(log)
    with pytest.raises(ConfigError, match=rf"--channel can9: must be one of .*{names[0]} \(20 frames\)"):
        decode_log(path, CLASSICAL, channel="can9")


def test_other_identifiers_on_a_second_bus_need_no_choice(tmp_path: Path) -> None:
    path = written(tmp_path / "drive.asc", [*sent(0), *sent(1, can_id=0x7FF)[:5]])
    assert decode_log(path, CLASSICAL).decoded == 20


@pytest.mark.parametrize(
    ("name", "content", "way"),
    [
        ("drive.mf4", b"MDF     4.10    ", r"MF4.*pipx run --spec 'python-can\[mf4\]' can_logconvert .*drive\.mf4"),
        ("drive.mf4", b"UnFinMF 4.10    ", "MF4.*can_logconvert"),
        ("drive.db", b"SQLite format 3\0", r"SQLite.*can_logconvert .*drive\.db .*drive\.log"),
        ("drive.log", b"\x1f\x8b\x08\0", "compressed.*unpack"),
        ("drive.log", "(1.0)".encode("utf-16"), "UTF-16.*iconv"),
        ("drive.pcapng", b"\x0a\x0d\x0d\x0a", "capture.*candump -L"),
        (
            "drive.csv",
            b"time,id,data\n1,2,3\n",
            r"drive\.csv:1: CSV with the header 'time,id,data': must be Time Stamp",
        ),
        ("drive.log", b"", r"no frame in 0 lines.*Logs that can be read: candump, Vector \.asc"),
        ("drive.log", b"\xef\xbb\xbf", "no frame in 1 lines"),
        ("drive.asc", b"one\ntwo\n", r"no frame in 2 lines, read as Vector \.asc; line 1: no frame: one"),
        ("notes.txt", b"one\ntwo\n", r"no frame in 2 lines, read as candump; line 1: no frame: one"),
    ],
)
def test_an_unreadable_log_is_rejected_with_a_hint(tmp_path: Path, name: str, content: bytes, way: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=way):
        decode_log(path, CLASSICAL)


def test_a_pipe_is_refused_since_its_beginning_cannot_be_read_twice() -> None:
    reading, writing = os.pipe()
    with open(reading), open(writing, "w"), pytest.raises(ConfigError, match="must be a file, not a pipe"):
        decode_log(Path(f"/dev/fd/{reading}"), CLASSICAL)
