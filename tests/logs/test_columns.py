"""The columns of a log hold what the codec gives frame by frame, to the last bit."""

import io
import math
import struct
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from cantools.database import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.codec.layouts import messages
from vehicle_iface import cli
from vehicle_iface.codec import MessageCodec
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.logs.bulk_codec import BulkCodec
from vehicle_iface.logs.columns import DecodedLog, save, scan_log, summarize, to_arrays
from vehicle_iface.logs.message_columns import Columns
from vehicle_iface.logs.reading import open_candump

from .conftest import CLASSICAL, FD, POSE, REGULAR, Decode


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
    return int(ours) == theirs and not isinstance(ours, float)  # type: ignore[call-overload]


def rows_of(columns: Columns) -> list[tuple[object, ...]]:
    return [tuple(values[i] for values in columns.values.values()) for i in range(len(columns))]


def decode(payloads: Sequence[bytes], *of: Message, checked: bool = False) -> DecodedLog:
    """A log in which each payload is a frame of the first message, decoded."""
    can_id = f"{of[0].frame_id:08X}" if of[0].is_extended_frame else f"{of[0].frame_id:03X}"
    mark = "##0" if any(len(data) > 8 for data in payloads) else "#"
    with tempfile.NamedTemporaryFile("w", suffix=".log") as file:
        file.writelines(f"(1.{i:09d}) vcan0 {can_id}{mark}{data.hex()}\n" for i, data in enumerate(payloads))
        file.flush()
        return scan_log(open_candump(Path(file.name)), of, checked=checked)


def expected(codec: MessageCodec, payloads: list[bytes]) -> list[tuple[int, tuple[object, ...]]]:
    """Line and values of those that the codec decodes."""
    found: list[tuple[int, tuple[object, ...]]] = []
    for line, data in enumerate(payloads, start=1):
        try:
            found.append((line, codec.decode(data)))
        except SignalError:
            continue
    return found


PAYLOADS = st.lists(st.binary(min_size=64, max_size=64), min_size=1, max_size=12)


@settings(max_examples=120, deadline=None)
@given(messages(), PAYLOADS, st.integers(0, 3))
def test_every_value_is_the_codecs_to_the_last_bit(of: Message, payloads: list[bytes], more: int) -> None:
    cut = [data[: min(64, of.length + more)] for data in payloads]
    log = decode(cut, of)
    columns = log.messages[of.name]
    wanted = expected(MessageCodec(of, checked=False), cut)
    assert tuple(columns.values) == MessageCodec(of, checked=False).names
    assert columns.lines.tolist() == [line for line, _ in wanted]
    for ours, (_, theirs) in zip(rows_of(columns), wanted, strict=True):
        assert all(map(same, ours, theirs)), (ours, theirs)
    assert log.decoded + len(log.refused) == log.lines == len(cut)


@settings(max_examples=120, deadline=None)
@given(messages(bounded=True), PAYLOADS)
def test_in_range_is_what_the_checked_codec_accepts(of: Message, payloads: list[bytes]) -> None:
    cut = [data[: of.length] for data in payloads]
    columns = decode(cut, of, checked=True).messages[of.name]
    accepted = {line for line, _ in expected(MessageCodec(of, checked=True), cut)}
    assert set(columns.lines[columns.in_range].tolist()) == accepted


@pytest.mark.parametrize("of", [*CLASSICAL, *FD], ids=lambda of: f"{of.name}-{of.length}")
def test_the_shipped_messages_are_decoded_like_the_codec_does(of: Message) -> None:
    random = np.random.default_rng(of.frame_id)
    payloads = [random.bytes(of.length) for _ in range(500)]
    columns = decode(payloads, of).messages[of.name]
    for ours, (_, theirs) in zip(rows_of(columns), expected(MessageCodec(of, checked=False), payloads), strict=True):
        assert all(map(same, ours, theirs))


def test_whole_signals_are_integers_and_scaled_ones_are_floats() -> None:
    columns = decode([], *CLASSICAL).messages["POSE"]
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
    columns = decode(payloads, of).messages["M"]
    assert columns.values["WIDE"].dtype == dtype
    codec = MessageCodec(of, checked=False)
    assert columns.values["WIDE"].tolist() == [codec.decode(data)[0] for data in payloads]


def test_hidden_multiplexed_values_are_masked_and_an_unknown_number_is_rejected() -> None:
    of = message(
        2,
        Signal("MUX", 0, 8, is_multiplexer=True),
        Signal("A", 8, 8, multiplexer_ids=[1], multiplexer_signal="MUX"),
        Signal("B", 8, 8, multiplexer_ids=[2], multiplexer_signal="MUX"),
    )
    log = decode([b"\1\7", b"\2\7", b"\3\7"], of)
    columns = log.messages["M"]
    assert np.ma.getmaskarray(columns.values["A"]).tolist() == [False, True]
    assert np.ma.getmaskarray(columns.values["B"]).tolist() == [True, False]
    assert columns.values["A"].compressed().tolist() == [7]  # type: ignore[attr-defined]
    assert [(refused.line, refused.why) for refused in log.refused] == [(3, "M: unknown multiplexer")]
    named = to_arrays(log)
    assert named["M.A:shown"].tolist() == [True, False]


def test_two_messages_of_one_identifier_are_refused() -> None:
    signal = Signal("A", 0, 8)
    with pytest.raises(ConfigError, match="M and M have one identifier, 0x123"):
        decode([], message(1, signal), message(1, signal))
    both = [message(1, signal), message(1, signal, name="X", extended=True)]
    assert set(decode([], *both).messages) == {"M", "X"}


def test_an_fd_log_is_read_too(decode_text: Decode) -> None:
    data = bytes(range(32))
    log = decode_text(f"(5.000000) vcan0 110##1{data.hex()}\n", FD)
    columns = log.messages["STATE"]
    codec = MessageCodec(FD[3], checked=False)
    assert codec.message_name == "STATE"
    assert rows_of(columns) == [codec.decode(data)]


def test_the_arrays_can_be_saved_and_read_back(decode_text: Decode) -> None:
    log = decode_text(REGULAR.format(pose=POSE))
    file = io.BytesIO()
    save(log, file)
    file.seek(0)
    with np.load(file) as saved:
        assert saved["POSE.POS_X"].tolist() == log.messages["POSE"].values["POS_X"].tolist()
        assert saved["POSE:stamp_ns"].tolist() == log.messages["POSE"].stamps_ns.tolist()
    assert list(summarize(log))[-1] == "7 lines, 5 decoded, 2 of other identifiers"


def test_payloads_may_be_given_as_a_matrix() -> None:
    decoded = BulkCodec(CLASSICAL[0], checked=True).decode(np.zeros((3, 8), np.uint8))
    assert decoded.values["ENABLE"].tolist() == [0, 0, 0]
    assert decoded.known.all()
    assert decoded.out_of_range == {}


def test_the_command_writes_the_arrays_and_prints_the_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "candump.log", tmp_path / "out.npz"
    path.write_text(REGULAR.format(pose=POSE).replace(" can1 ", " vcan0 ") + "noise\n")
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
        (("{log}", "--out", "x.npz", "--message", "POOSE"), "message POOSE: must be one of: "),
        (("{log}", "--out", "x.npz", "--dbc", "none.dbc"), "none.dbc: cannot be read"),
    ],
)
def test_the_command_names_what_it_cannot_use(tmp_path: Path, capsys, arguments, text) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "candump.log"
    path.write_text(f"(1.000000) vcan0 110#{POSE}\n")
    assert cli.main(["decode", *(argument.format(log=path) for argument in arguments)]) == 2
    assert text in capsys.readouterr().err
