"""Messages with checksums and counters of many kinds: sent as their vehicles expect, received whole or dropped."""

import operator
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest
from cantools.database import Message, Signal
from cantools.typechecking import ByteOrder
from hypothesis import assume, given
from hypothesis import strategies as st

from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.codec.e2e import autosar_protection
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.layout import bits_of
from vehicle_iface.codec.protection import Protection
from vehicle_iface.codec.protection_rules import build_protection
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.profile.protection import MessageProtection
from vehicle_iface.sim.wire import simulated_vehicle

from .layouts import network_start
from .small_vehicle import COMMAND, POSE, SUM, load_command, load_vehicle


class Command(NamedTuple):
    enable: bool = True
    accel_mps2: float = -1.234
    front_wheel_angle_rad: float = 0.1


RULE = "\n[protection.messages]\nCMD = 'rule'\n"
TOYOTA = '[protection.rule]\nchecksum = { signal = "CHECKSUM", kind = "sum", over = ["id", "length", "bytes"] }\n'
COUNTER = 'counter = { signal = "COUNTER", max_step = 3 }\n'
LITTLE = """\
BO_ 294 CMD: 8 PC
 SG_ CHECKSUM : 0|8@1+ (1,0) [0|255] "" CAR
 SG_ COUNTER : 8|4@1+ (1,0) [0|15] "" CAR
 SG_ EN : 12|1@1+ (1,0) [0|1] "" CAR
 SG_ ACC : 16|16@1- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ STEER : 32|16@1- (0.0001,0) [-1|1] "rad" CAR
"""
HONDA = """\
BO_ 228 CMD: 5 PC
 SG_ STEER : 7|16@0- (0.0001,0) [-1|1] "rad" CAR
 SG_ EN : 23|1@0+ (1,0) [0|1] "" CAR
 SG_ ACC : 22|15@0- (0.001,0) [-10|10] "m/s^2" CAR
 SG_ COUNTER : 37|2@0+ (1,0) [0|3] "" CAR
 SG_ CHECKSUM : 35|4@0+ (1,0) [0|15] "" CAR
"""


def send(message: BoundMessage, count: int = 1) -> list[CanFrame]:
    """Frames one after the other, as the encoder sends them."""
    encoder, frames = Encoder([message]), []
    for _ in range(count):
        frames.append(encoder.encode(message.name, Command()))
        encoder.commit(frames[-1:])
    return frames


def receive(message: BoundMessage, frames: list[CanFrame]) -> tuple[Decoder, list[int]]:
    """A decoder, and the counters of the frames that it accepted."""
    decoder = Decoder([message])
    return decoder, [decoded.counter for decoded in map(decoder.decode, frames) if decoded is not None]


def flip(frame: CanFrame, bit: int) -> CanFrame:
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    return frame._replace(data=bytes(data))


def test_a_sum_over_address_length_and_bytes_with_a_counter_of_six_bits(tmp_path: Path) -> None:
    message = load_command(tmp_path, TOYOTA + COUNTER + RULE, COMMAND)
    frames = send(message, 65)
    for count, frame in enumerate(frames):
        data = frame.data
        assert data[0] >> 1 & 63 == count % 64
        assert data[7] == (0x91 + 0x01 + 8 + sum(data[:7])) % 256
    decoder, counters = receive(message, frames)
    assert counters == [*range(64), 0]
    assert decoder.decode(flip(frames[1], 20)) is None
    assert decoder.drops == {(DropCause.BAD_CRC, "CMD"): 1}


def test_a_counter_without_a_checksum(tmp_path: Path) -> None:
    command = LITTLE.replace(LITTLE.splitlines()[1] + "\n", "")
    command = command.replace("8|4@1+ (1,0) [0|15]", "56|8@1+ (1,0) [0|255]")
    message = load_command(tmp_path, f"[protection.rule]\n{COUNTER}{RULE}", command)
    frames = send(message, 257)
    assert [frame.data[7] for frame in frames] == [*range(256), 0]
    decoder, counters = receive(message, [frames[0], frames[1], frames[1], frames[4], frames[9], frames[10]])
    assert counters == [0, 1, 4, 10]
    assert decoder.drops == {(DropCause.REPEATED, "CMD"): 1, (DropCause.WRONG_SEQUENCE, "CMD"): 1}
    assert decoder.lost == {"CMD": 2}


TABLE = [218, 3, 77, *range(13)]


@pytest.mark.parametrize("place", ["rule", "message"])
def test_a_crc_with_a_table_by_the_counter_is_that_of_autosar_profile_2(tmp_path: Path, place: str) -> None:
    checksum = 'signal = "CHECKSUM", kind = "crc8", poly = 0x2F, init = 0xFF, xor_out = 0xFF'
    table = f", table = {TABLE}" if place == "rule" else ""
    used = RULE if place == "rule" else f'[protection.messages]\nCMD = {{ use = "rule", data_id = {TABLE} }}\n'
    message = load_command(tmp_path, f"[protection.rule]\nchecksum = {{ {checksum}{table} }}\n{COUNTER}{used}", LITTLE)
    assert_same(message, autosar_protection(2, tuple(TABLE), 8))


def assert_same(message: BoundMessage, oracle: Protection) -> None:
    assert message.protection is not None
    for counter in range(oracle.counter_states):
        ours, theirs = bytearray(b"\x5a" * 8), bytearray(b"\x5a" * 8)
        message.protection.protect(ours, counter)
        oracle.protect(theirs, counter)
        assert ours == theirs


@pytest.mark.parametrize(
    ("checksum", "width", "profile"),
    [
        ('kind = "crc8", poly = 0x1D, over = ["data_id", "bytes"]', 8, 1),
        ('kind = "crc16", poly = 0x1021, init = 0xFFFF', 16, 5),
        ('kind = "autosar-1"', 8, 1),
        ('kind = "autosar-5"', 16, 5),
        ('kind = "autosar-11", data_id_mode = "NIBBLE"', 8, 11),
    ],
)
def test_a_number_as_data_id_gives_the_checksums_of_autosar(
    tmp_path: Path, checksum: str, width: int, profile: int
) -> None:
    command = LITTLE
    if width == 16:
        command = command.replace("0|8@1+ (1,0) [0|255]", "0|16@1+ (1,0) [0|65535]")
        command = command.replace("8|4@1+ (1,0) [0|15]", "16|8@1+ (1,0) [0|255]").replace(": 12|1", ": 24|1")
        command = command.replace(": 16|16", ": 48|16")
    if profile == 11:
        command = command.replace(": 12|1", ": 48|1")
    toml = f'[protection.rule]\nchecksum = {{ signal = "CHECKSUM", {checksum} }}\n{COUNTER}'
    message = load_command(
        tmp_path, f'{toml}[protection.messages]\nCMD = {{ use = "rule", data_id = 0x1F8 }}\n', command
    )
    assert_same(message, autosar_protection(profile, 0x1F8, 8, "NIBBLE" if profile == 11 else "BOTH"))


def test_a_nibble_that_brings_the_sum_of_all_nibbles_to_eight(tmp_path: Path) -> None:
    rule = 'checksum = { signal = "CHECKSUM", kind = "sum", over = ["id", "bytes"], init = 7, xor_out = 15 }'
    toml = f'[protection.rule]\n{rule}\ncounter = {{ signal = "COUNTER" }}\n{RULE}'
    message = load_command(tmp_path, toml, HONDA)
    frames = send(message, 5)
    for count, frame in enumerate(frames):
        nibbles = [int(digit, 16) for digit in frame.data.hex()]
        assert (0xE + 0x4 + sum(nibbles)) % 16 == 8
        assert frame.data[4] >> 4 & 3 == count % 4
    assert message.protection is not None
    assert message.protection.max_step == 2
    assert receive(message, frames)[1] == [0, 1, 2, 3, 0]


@pytest.mark.parametrize(("kind", "combine"), [("xor", operator.xor), ("sum", operator.add)])
def test_a_checksum_of_four_bits_is_that_of_all_other_nibbles(
    tmp_path: Path, kind: str, combine: Callable[[int, int], int]
) -> None:
    command = LITTLE.replace("0|8@1+ (1,0) [0|255]", "60|4@1+ (1,0) [0|15]")
    rule = f'[protection.rule]\nchecksum = {{ signal = "CHECKSUM", kind = "{kind}" }}\n{COUNTER}{RULE}'
    for frame in send(load_command(tmp_path, rule, command), 4):
        nibbles = [int(digit, 16) for digit in frame.data.hex()]
        own = nibbles.pop(14)
        assert own == reduce(combine, nibbles) % 16


def test_a_checksum_without_a_counter_still_counts_damaged_frames(tmp_path: Path) -> None:
    command = COMMAND.replace(' SG_ COUNTER : 6|6@0+ (1,0) [0|63] "" CAR\n', "")
    message = load_command(tmp_path, TOYOTA + RULE, command)
    frame = send(message)[0]
    decoder, counters = receive(message, [frame, frame, flip(frame, 3), frame])
    assert counters == [-1, -1, -1]
    assert (decoder.drops, decoder.lost) == ({(DropCause.BAD_CRC, "CMD"): 1}, {})


def test_while_most_frames_are_damaged_one_without_a_counter_is_not_trusted(tmp_path: Path) -> None:
    command = COMMAND.replace(' SG_ COUNTER : 6|6@0+ (1,0) [0|63] "" CAR\n', "")
    message = load_command(tmp_path, TOYOTA + RULE, command)
    frame = send(message)[0]
    decoder, counters = receive(message, [flip(frame, 3)] * 12 + [frame] * 10)
    assert len(counters) == 3
    assert decoder.drops[DropCause.TOO_MANY_DAMAGED, "CMD"] == 7
    decoder.reset()
    assert decoder.decode(frame) is not None


def test_messages_with_counters_of_their_own_are_each_counted_for_themselves(tmp_path: Path) -> None:
    pose = POSE.replace("SUM : 56|8", "CNT : 56|8")
    toml = f'[protection.alive]\ncounter = {{ signal = "CNT" }}\n{TOYOTA}{COUNTER}'
    database = load_vehicle(tmp_path, f"{toml}{RULE}POSE = 'alive'\n", pose=pose)
    decoder = Decoder(database.received)
    pose_frames = [CanFrame(272, bytes([0] * 7 + [count % 256]), 0) for count in range(200, 300)]
    accepted = [decoder.decode(frame) for frame in (*pose_frames, CanFrame(256, bytes([1, 0]), 0))]
    assert [decoded.counter for decoded in accepted if decoded is not None] == [*range(200, 256), *range(44), -1]
    assert decoder.lost == {"POSE": 0}


def test_a_counter_runs_as_far_as_its_range(tmp_path: Path) -> None:
    message = load_command(tmp_path, TOYOTA + COUNTER + RULE, COMMAND.replace("[0|63]", "[0|14]"))
    frames = send(message, 17)
    assert [frame.data[0] >> 1 & 63 for frame in frames] == [*range(15), 0, 1]
    decoder, _ = receive(message, frames)
    assert decoder.drops == {}
    protected = bytearray(frames[1].data)
    assert message.protection is not None
    message.protection.protect(protected, 15)
    assert decoder.decode(frames[0]._replace(data=bytes(protected))) is None
    assert decoder.drops == {(DropCause.BAD_COUNTER, "CMD"): 1}


def test_the_contracts_example_covers_the_data_id_last(tmp_path: Path) -> None:
    toml = f'{TOYOTA}{COUNTER}[protection.messages]\nCMD = {{ use = "rule", data_id = 0x1F8 }}\n'
    data = send(load_command(tmp_path, toml, COMMAND))[0].data
    assert data[7] == (0x91 + 0x01 + 8 + sum(data[:7]) + 0xF8 + 0x01) % 256


def test_the_simulated_vehicle_protects_and_checks_by_the_same_rules(tmp_path: Path) -> None:
    database = load_vehicle(tmp_path, f"{SUM}{TOYOTA}{COUNTER}{RULE}POSE = 'sum'\n")
    vehicle = simulated_vehicle(database, start_ns=0)
    decoder, command = Decoder(database.received), send(database.commands[0], 2)
    frames = [frame for tick in range(1, 11) for frame in vehicle.advance(tick * 10_000_000)]
    pose = [frame for frame in frames if frame.can_id == 272]
    assert pose
    assert all(frame.data[7] == sum(frame.data[:7]) % 256 for frame in pose)
    assert all(decoder.decode(frame) is not None for frame in frames)
    for frame in (command[0], flip(command[1], 9), command[1], command[1]):
        vehicle.receive(frame, 100_000_000)
    assert vehicle.counters["commands_intact"] == 2
    assert vehicle.counters["commands_dropped"] == 2


# --- laws

REFERENCE = load_profile("reference")


def protection_of(message: Message, rule: dict[str, object]) -> Protection:
    tables = {"rules": {"rule": rule}, "messages": {"CMD": {"use": "rule", "data_id": 0x1F8}}}
    profile = msgspec.structs.replace(REFERENCE, e2e=None, protection=msgspec.convert(tables, MessageProtection))
    protection = build_protection(profile, message)
    assert protection is not None
    return protection


@st.composite
def messages(draw: st.DrawFn, least_bits: int) -> Message:
    """Checksum and counter anywhere in 8 bytes, of any width, in either byte order."""
    widths = draw(st.integers(least_bits, 20)), draw(st.integers(2, 16))
    first = draw(st.integers(0, 64 - sum(widths)))
    second = draw(st.integers(first + widths[0], 64 - widths[1]))
    big = draw(st.booleans())
    found = []
    for name, start, width in zip(draw(st.permutations(["CHECKSUM", "COUNTER"])), (first, second), widths, strict=True):
        order: ByteOrder = "big_endian" if big else "little_endian"
        found.append(Signal(name, network_start(start) if big else start, max(width, least_bits), byte_order=order))
    assume(len({bit for signal in found for bit in bits_of(signal)}) == sum(signal.length for signal in found))
    assume(max(bit for signal in found for bit in bits_of(signal)) < 64)
    return Message(0x191, "CMD", 8, found)


FORMULAS: list[dict[str, object]] = [
    {"kind": "sum", "init": 3, "xor_out": 1, "over": ["id", "length", "bytes", "data_id", "counter"]},
    {"kind": "xor", "over": ["bytes", "counter"]},
    {"kind": "crc8", "poly": 0x1D, "init": 0xFF, "xor_out": 0xFF},
    {"kind": "crc8", "poly": 0x31, "reflect": True, "over": ["data_id", "bytes", "length"]},
    {"kind": "crc16", "poly": 0x1021, "init": 0xFFFF, "over": ["bytes", "id"]},
    {"kind": "crc16", "poly": 0x8005, "reflect": True},
]
LEAST_BITS = {"sum": 2, "xor": 2, "crc8": 8, "crc16": 16}


@pytest.mark.parametrize("formula", FORMULAS, ids=lambda formula: " ".join(map(str, formula.values())))
@given(draw=st.data(), payload=st.binary(min_size=8, max_size=8), count=st.integers(0, 3), bit=st.integers(0, 63))
def test_a_protected_payload_is_intact_and_a_crc_detects_each_flipped_bit(
    formula: dict[str, object], draw: st.DataObject, payload: bytes, count: int, bit: int
) -> None:
    message = draw.draw(messages(LEAST_BITS[str(formula["kind"])]))
    rule: dict[str, object] = {"checksum": {"signal": "CHECKSUM", **formula}, "counter": {"signal": "COUNTER"}}
    protection, data = protection_of(message, rule), bytearray(payload)
    protection.protect(data, count)
    assert protection.intact(bytes(data))
    assert protection.read_counter(bytes(data)) == count
    own = {bit for signal in message.signals for bit in bits_of(signal)}
    others = [bit for bit in range(64) if bit not in own]
    assert [data[bit // 8] >> bit % 8 & 1 for bit in others] == [payload[bit // 8] >> bit % 8 & 1 for bit in others]
    if "poly" in formula:
        data[bit // 8] ^= 1 << bit % 8
        assert not protection.intact(bytes(data))


# --- a user's function

PYTHON = """
[protection.rule]
checksum = { signal = "CHECKSUM", kind = "python", function = "own.py:checksum" }
counter = { signal = "COUNTER" }
"""


def test_a_users_function_gets_the_id_and_the_payload_without_the_checksum(tmp_path: Path) -> None:
    source = "def checksum(can_id, data):\n    assert data[7] == 0\n    return (can_id ^ sum(data)) & 0xFF\n"
    (tmp_path / "own.py").write_text(source, encoding="utf-8")
    message = load_command(tmp_path, PYTHON + RULE, COMMAND)
    frames = send(message, 3)
    assert all(frame.data[7] == (401 ^ sum(frame.data[:7])) & 0xFF for frame in frames)
    decoder, counters = receive(message, [frames[0], flip(frames[1], 60), frames[1], frames[2]])
    assert counters == [0, 1, 2]
    assert decoder.drops == {(DropCause.BAD_CRC, "CMD"): 1}


def test_a_users_function_that_fails_drops_the_frame_and_sends_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source = (
        "def checksum(can_id, data):\n    if data[6] == 7: raise SystemExit\n"
        "    return {9: 300}.get(data[6], abs(100 // (8 - data[6])))\n"
    )
    (tmp_path / "own.py").write_text(source, encoding="utf-8")
    message = load_command(tmp_path, PYTHON + RULE, COMMAND)
    decoder, counters = receive(message, [CanFrame(401, bytes([0] * 6 + [last, 0]), 0) for last in (8, 7, 9)])
    assert counters == []
    assert decoder.drops == {(DropCause.BAD_CRC, "CMD"): 3}
    failure = "CMD: checksum: ZeroDivisionError: integer division or modulo by zero"
    assert [record.message.partition(" (")[0] for record in caplog.records] == [failure]
    assert message.protection is not None
    for last, text in (
        (8, failure),
        (7, "CMD: checksum: SystemExit"),
        (9, "CMD: checksum = 300: must be an int of 8 bits"),
    ):
        with pytest.raises(SignalError, match=text):
            message.protection.protect(bytearray([0] * 6 + [last, 0]), 0)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (None, "'own.py:checksum': no such file "),
        ("", "'own.py:checksum': there is no function checksum in "),
        ("checksum = 3", "'own.py:checksum': there is no function checksum in "),
        ("\n1 / 0", r"'own.py:checksum': ZeroDivisionError: division by zero \(.*own\.py:2\)"),
        ("def checksum(:", r"'own.py:checksum': SyntaxError: .*own\.py:1\)"),
        ("def checksum(can_id): return 0", "'own.py:checksum' for CMD: TypeError: "),
        ("def checksum(can_id, data): raise SystemExit(3)", "for CMD: SystemExit: 3"),
        ("def checksum(can_id, data): return 256", r"for CMD: returned 256 for 0{16}; must be an int in \[0, 255\]"),
        ("def checksum(can_id, data): return -1 + data[0]", r"for CMD: returned -1 for"),
        ("def checksum(can_id, data): return 0.5", r"for CMD: returned 0\.5 for"),
        (
            "calls = []\ndef checksum(can_id, data):\n calls.append(1)\n return len(calls)",
            "returned 1 and 2 for the same",
        ),
    ],
)
def test_a_users_function_that_cannot_be_used_is_refused_at_the_start(
    tmp_path: Path, source: str | None, text: str
) -> None:
    if source is not None:
        (tmp_path / "own.py").write_text(source, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"v\.toml: \$\.protection\.rule\.checksum\.function: .*" + text):
        load_command(tmp_path, PYTHON + RULE, COMMAND)
