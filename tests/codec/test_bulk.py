"""A recording decoded at once is what the codec says frame by frame, and every line of a log is accounted for."""

import io
import math
import struct
from pathlib import Path

import cantools
import numpy as np
import pytest
from cantools.database import Message, Signal
from cantools.database.can import Database
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.codec.layouts import messages
from vehicle_iface import cli
from vehicle_iface.codec import MessageCodec, candump
from vehicle_iface.codec.bulk import BulkCodec, Columns, Recording, arrays, decode_frames, decode_log, save, summary
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame

DBC_FOLDER = Path(__file__).parents[2] / "dbc"


def loaded(name: str) -> list[Message]:
    database = cantools.database.load_file(DBC_FOLDER / f"{name}.dbc", strict=True)
    assert isinstance(database, Database)
    return database.messages


CLASSICAL, FD = loaded("reference"), loaded("reference_fd")


def message(length: int, *signals: Signal, can_id: int = 0x123, name: str = "M", extended: bool = False) -> Message:
    return Message(can_id, name, length, list(signals), strict=True, is_extended_frame=extended, is_fd=length > 8)


def same(ours: object, theirs: object) -> bool:
    """The same number, to the bit; a NaN is a NaN."""
    if theirs is None:
        return ours is np.ma.masked
    if isinstance(theirs, float):
        if math.isnan(theirs):
            return isinstance(ours, float) and math.isnan(ours)
        return isinstance(ours, float) and struct.pack("<d", float(ours)) == struct.pack("<d", theirs)
    return int(ours) == theirs and not isinstance(ours, float)  # type: ignore[call-overload,no-any-return]


def rows_of(columns: Columns) -> list[tuple[object, ...]]:
    return [tuple(values[i] for values in columns.values.values()) for i in range(len(columns))]


def frames_of(payloads: list[bytes], of: Message) -> list[CanFrame]:
    is_fd = any(len(data) > 8 for data in payloads)
    return [
        CanFrame(of.frame_id, data, 10**9 + i, of.is_extended_frame, False, is_fd) for i, data in enumerate(payloads)
    ]


def expected(codec: MessageCodec, payloads: list[bytes]) -> list[tuple[int, tuple[object, ...]]]:
    """Line and values of those that the codec decodes."""
    found = []
    for line, data in enumerate(payloads, start=1):
        try:
            found.append((line, codec.decode(data)))
        except SignalError:
            continue
    return found


PAYLOADS = st.lists(st.binary(min_size=64, max_size=64), min_size=1, max_size=12)


@settings(max_examples=300, deadline=None)
@given(messages(), PAYLOADS, st.integers(0, 3))
def test_every_value_is_the_codecs_to_the_last_bit(of: Message, payloads: list[bytes], more: int) -> None:
    cut = [data[: min(64, of.length + more)] for data in payloads]
    recording = decode_frames(frames_of(cut, of), [of])
    columns = recording.messages[of.name]
    wanted = expected(MessageCodec(of, checked=False), cut)
    assert tuple(columns.values) == MessageCodec(of, checked=False).names
    assert columns.lines.tolist() == [line for line, _ in wanted]
    for ours, (_, theirs) in zip(rows_of(columns), wanted, strict=True):
        assert all(map(same, ours, theirs)), (ours, theirs)
    assert recording.decoded + len(recording.refused) == recording.lines == len(cut)


@settings(max_examples=300, deadline=None)
@given(messages(bounded=True), PAYLOADS)
def test_in_range_is_what_the_checked_codec_accepts(of: Message, payloads: list[bytes]) -> None:
    cut = [data[: of.length] for data in payloads]
    columns = decode_frames(frames_of(cut, of), [of], checked=True).messages[of.name]
    accepted = {line for line, _ in expected(MessageCodec(of, checked=True), cut)}
    assert set(columns.lines[columns.in_range].tolist()) == accepted


@pytest.mark.parametrize("of", [*CLASSICAL, *FD], ids=lambda of: f"{of.name}-{of.length}")
def test_the_shipped_messages_are_decoded_like_the_codec_does(of: Message) -> None:
    random = np.random.default_rng(of.frame_id)
    payloads = [random.bytes(of.length) for _ in range(500)]
    columns = decode_frames(frames_of(payloads, of), [of]).messages[of.name]
    for ours, (_, theirs) in zip(rows_of(columns), expected(MessageCodec(of, checked=False), payloads), strict=True):
        assert all(map(same, ours, theirs))


def test_whole_signals_are_integers_and_scaled_ones_are_floats() -> None:
    columns = decode_frames([], CLASSICAL).messages["POSE"]
    assert {name: values.dtype.name for name, values in columns.values.items()} == {
        "CRC": "int64",
        "COUNTER": "int64",
        "POSE_FRAME": "int64",
        "POSE_VALID": "int64",
        "POS_X": "float64",
        "POS_Y": "float64",
    }


@pytest.mark.parametrize(
    ("scale", "offset", "signed", "dtype"),
    [
        (1, 0, True, "int64"),
        (1, 0, False, "uint64"),
        (2, 0, True, "object"),
        (1, -5, False, "object"),
        (1, 0.5, False, "float64"),
        (3, 0.5, True, "float64"),
        (0.1, 7, False, "float64"),
        (-1, 0, True, "object"),
    ],
)
def test_64_bits_are_exact_in_the_narrowest_type_that_holds_them(
    scale: float, offset: float, signed: bool, dtype: str
) -> None:
    conversion = BaseConversion.factory(scale, offset)
    of = message(8, Signal("WIDE", 0, 64, is_signed=signed, conversion=conversion))
    payloads = [b"\xff" * 8, b"\xff" * 7 + b"\x7f", bytes(7) + b"\x80", b"\x01\x02\x03\x04\x05\x06\x07\x88"]
    columns = decode_frames(frames_of(payloads, of), [of]).messages["M"]
    assert columns.values["WIDE"].dtype == dtype
    codec = MessageCodec(of, checked=False)
    assert columns.values["WIDE"].tolist() == [codec.decode(data)[0] for data in payloads]


def test_what_a_multiplexer_hides_is_masked_and_an_unknown_number_is_refused() -> None:
    of = message(
        2,
        Signal("MUX", 0, 8, is_multiplexer=True),
        Signal("A", 8, 8, multiplexer_ids=[1], multiplexer_signal="MUX"),
        Signal("B", 8, 8, multiplexer_ids=[2], multiplexer_signal="MUX"),
    )
    recording = decode_frames(frames_of([b"\1\7", b"\2\7", b"\3\7"], of), [of])
    columns = recording.messages["M"]
    assert np.ma.getmaskarray(columns.values["A"]).tolist() == [False, True]
    assert np.ma.getmaskarray(columns.values["B"]).tolist() == [True, False]
    assert columns.values["A"].compressed().tolist() == [7]  # type: ignore[attr-defined]
    assert [(refused.line, refused.why) for refused in recording.refused] == [(3, "M: unknown multiplexer")]
    named = arrays(recording)
    assert named["M.A:shown"].tolist() == [True, False]


def test_two_messages_of_one_identifier_are_refused() -> None:
    signal = Signal("A", 0, 8)
    with pytest.raises(ConfigError, match="M and M have one identifier, 0x123"):
        decode_frames([], [message(1, signal), message(1, signal)])
    both = [message(1, signal), message(1, signal, name="X", extended=True)]
    assert set(decode_frames([], both).messages) == {"M", "X"}


# Logs

REGULAR = """\
(1436509052.249713) vcan0 110#{pose}
(1436509052.250001) vcan0 111#0102030405060708
(1436509052.260000000) can1 110#{pose} R
(1436509052.270000) vcan0 110##1{pose}
(9.000001) vcan0 110##0{pose} T
(1436509053.000000) vcan0 00000110#{pose}
(1436509053.000000) vcan0 7FF#
"""
POSE = "00112233445566AA"


@pytest.fixture
def log(tmp_path: Path):  # type: ignore[no-untyped-def]
    """Decode a text as a log of the reference vehicle's messages."""

    def decode(text: str | bytes, of: list[Message] = CLASSICAL) -> Recording:
        path = tmp_path / "candump.log"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return decode_log(path, of)

    return decode


def adds_up(recording: Recording) -> bool:
    parts = (recording.decoded, recording.foreign, recording.remote, recording.errors, recording.blank)
    return sum(parts) + len(recording.refused) == recording.lines


def test_regular_lines_of_every_shape_are_read(log) -> None:  # type: ignore[no-untyped-def]
    recording = log(REGULAR.format(pose=POSE))
    pose = recording.messages["POSE"]
    assert pose.lines.tolist() == [1, 3, 4, 5]
    assert pose.stamps_ns.tolist() == [1436509052249713000, 1436509052260000000, 1436509052270000000, 9000001000]
    assert pose.values["CRC"].tolist() == [0] * 4
    assert len(recording.messages["MOTION"]) == 1
    assert (recording.foreign, recording.decoded, recording.lines) == (2, 5, 7)
    assert recording.refused == ()
    assert adds_up(recording)


def test_lines_that_are_not_regular_are_understood_or_reported_with_their_number(log) -> None:  # type: ignore[no-untyped-def]
    recording = log(
        f"(1.000000)  vcan0\t110#{POSE.lower()}\n"  # two blanks and a tab
        "\n"
        "(1.0) vcan0 110#00.11.22.33.44.55.66.AA\n"
        "(1.000000) vcan0 110#R\n"
        "(1.000000) vcan0 110#R8\n"
        "(1.000000) vcan0 20000088#0000000000000000\n"
        f"(1.000000) vcan0 110#{POSE}_9\n"
        f"(1.000000) vcan0 110#{POSE[:-1]}\n"
        f"(1.000000) vcan0 110#{POSE[:-2]}\n"
        f"(1.000000) vcan0 110#{POSE}00\n"
        f"(1.000000) vcan0 810#{POSE}\n"
        f"(x.000000) vcan0 110#{POSE}\n"
        f"1.000000 vcan0 110#{POSE}\n"
        f"(1.000000) vcan0 11G#{POSE}\n"
        f"(1.000000) vcan0 110#{POSE[:-2]}GG\n"
        f"(9999999999.000000) vcan0 110#{POSE}\n"
        f"(1.000000) vcan0 110##z{POSE}\n"
        f"(1.000000) vcan0 110#{POSE} X\n"
        "\x00\xff#  # \n"
        f"(1.000000) vcan0 110#{POSE}"  # no line end
    )
    assert recording.messages["POSE"].lines.tolist() == [1, 3, 7, 20]
    assert set(recording.messages["POSE"].stamps_ns.tolist()) == {10**9}
    assert (recording.blank, recording.remote, recording.errors) == (1, 2, 1)
    assert [refused.line for refused in recording.refused] == list(range(8, 20))
    assert "7 bytes: must be 8" in recording.refused[1].why
    assert adds_up(recording)


def test_windows_line_ends_and_an_empty_file_are_read(log) -> None:  # type: ignore[no-untyped-def]
    recording = log(REGULAR.format(pose=POSE).replace("\n", "\r\n"))
    assert (recording.decoded, recording.lines, recording.refused) == (5, 7, ())
    empty = log("")
    assert (empty.lines, empty.decoded) == (0, 0)
    assert set(empty.messages) == {of.name for of in CLASSICAL}


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.log: cannot be read: No such file"):
        decode_log(tmp_path / "none.log", CLASSICAL)


HEX = st.text("0123456789ABCDEFabcdef", max_size=20)


@st.composite
def lines(draw: st.DrawFn) -> str:
    stamp = f"({draw(st.integers(0, 10**10))}.{draw(st.integers(0, 10**6 - 1)):06d})"
    can_id = draw(st.sampled_from(["110", "111", "7FF", "00000110", "20000004", "FFF", "1F", "9FFFFFFF"]))
    data = draw(HEX | st.sampled_from([POSE, POSE, POSE, "R", "R4", "", "##", "1122 R", "1122 T", POSE * 4]))
    mark = draw(st.sampled_from(["#", "#", "#", "##1", "##", "###"]))
    return draw(st.sampled_from([f"{stamp} vcan0 {can_id}{mark}{data}"] * 9 + ["", "noise", f"{stamp} # {data}"]))


@settings(max_examples=150, deadline=None)
@given(st.lists(lines(), max_size=30), st.sampled_from([40, 200, 1 << 21]))
def test_the_fast_way_and_the_careful_way_agree_on_every_log(tmp_path_factory, text, size) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path_factory.mktemp("log") / "candump.log"
    path.write_text("\n".join(text))
    careful = candump.Chunk()
    slow = [candump._irregular(line.encode(), i, careful) for i, line in enumerate(text, start=1)]
    wanted = sorted(frame for frame in slow if frame is not None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump, "CHUNK_BYTES", size)
        chunks = list(candump.read_candump(path))
    found = sorted(
        (line, stamp_ns, key, data.tobytes())
        for chunk in chunks
        for group in chunk.frames
        for line, stamp_ns, key, data in zip(
            group.lines.tolist(), group.stamps_ns.tolist(), group.keys.tolist(), group.data, strict=True
        )
    )
    assert found == wanted
    assert sum(chunk.remote for chunk in chunks) == careful.remote
    assert sum(chunk.errors for chunk in chunks) == careful.errors
    refused = [one.line for chunk in chunks for one in chunk.refused]
    assert refused == [one.line for one in careful.refused]
    assert sum(chunk.lines for chunk in chunks) == len(path.read_bytes().splitlines())


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=300))
def test_noise_is_counted_line_by_line(tmp_path_factory, noise) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path_factory.mktemp("noise") / "candump.log"
    path.write_bytes(noise)
    recording = decode_log(path, CLASSICAL)
    assert adds_up(recording)
    assert recording.lines == noise.replace(b"\r\n", b"\n").count(b"\n") + (not noise.endswith(b"\n") and bool(noise))


def test_a_long_log_comes_in_pieces_with_progress_and_nothing_is_lost_between_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candump, "CHUNK_BYTES", 1000)
    path = tmp_path / "candump.log"
    path.write_text("".join(f"({i}.000000) vcan0 110#{i:016X}\n" for i in range(500)) + "x" * 3000 + "\n")
    told: list[tuple[int, int]] = []
    recording = decode_log(path, CLASSICAL, progress=lambda done, total: told.append((done, total)))
    assert recording.messages["POSE"].stamps_ns.tolist() == [i * 10**9 for i in range(500)]
    assert [refused.line for refused in recording.refused] == [501]
    assert len(told) > 10
    assert told == sorted(told)
    assert told[-1] == (path.stat().st_size, path.stat().st_size)


def test_an_fd_log_is_read_too(log) -> None:  # type: ignore[no-untyped-def]
    data = bytes(range(32))
    recording = log(f"(5.000000) vcan0 110##1{data.hex()}\n", FD)
    columns = recording.messages["STATE"]
    codec = MessageCodec(FD[3], checked=False)
    assert codec.message_name == "STATE"
    assert rows_of(columns) == [codec.decode(data)]


def test_the_arrays_can_be_saved_and_read_back(log) -> None:  # type: ignore[no-untyped-def]
    recording = log(REGULAR.format(pose=POSE))
    file = io.BytesIO()
    save(recording, file)
    file.seek(0)
    with np.load(file) as saved:
        assert saved["POSE.POS_X"].tolist() == recording.messages["POSE"].values["POS_X"].tolist()
        assert saved["POSE:stamp_ns"].tolist() == recording.messages["POSE"].stamps_ns.tolist()
    assert list(summary(recording))[-1] == "7 lines, 5 decoded, 2 of other identifiers"


def test_payloads_may_be_given_as_a_matrix() -> None:
    decoded = BulkCodec(CLASSICAL[0], checked=True).decode(np.zeros((3, 8), np.uint8))
    assert decoded.values["ENABLE"].tolist() == [0, 0, 0]
    assert decoded.known.all()
    assert decoded.out_of_range == {}


def test_the_command_writes_the_arrays_and_says_what_it_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "candump.log", tmp_path / "out.npz"
    path.write_text(REGULAR.format(pose=POSE) + "noise\n")
    arguments = ["decode", str(path), "--profile", "reference", "--out", str(out), "--message", "POSE"]
    assert cli.main(arguments) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[-1] == "8 lines, 4 decoded, 3 of other identifiers, 1 refused"
    assert f"{path}:8: no frame: noise" in said.err
    assert "100 %" in said.err
    with np.load(out) as saved:
        assert sorted(name for name in saved.files if ":" in name and "." not in name) == ["POSE:line", "POSE:stamp_ns"]
        assert len(saved["POSE.POS_X"]) == 4


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("none.log", "--out", "x.npz"), "none.log: cannot be read"),
        (("{log}", "--out", "{log}/x.npz"), "cannot be written"),
        (("{log}", "--out", "x.npz", "--message", "POOSE"), "--message POOSE: must be one of: "),
        (("{log}", "--out", "x.npz", "--dbc", "none.dbc"), "none.dbc: cannot be read"),
    ],
)
def test_the_command_names_what_it_cannot_use(tmp_path: Path, capsys, arguments, text) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "candump.log"
    path.write_text("")
    assert cli.main(["decode", *(argument.format(log=path) for argument in arguments)]) == 2
    assert text in capsys.readouterr().err
