"""A frame is used whole or not at all, and every frame that is not used is counted by cause and message."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.codec.e2e import autosar_protection
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile

from .conftest import Variant

MOTION = 0x111
DATABASE = load_database(load_profile("reference"))


@pytest.fixture
def decoder() -> Decoder:
    return Decoder(DATABASE.received)


def motion(
    counter: int, *, payload: bytes = bytes(8), can_id: int = MOTION, data_id: int | None = None, **flags: bool
) -> CanFrame:
    data = bytearray(payload)
    autosar_protection(1, can_id if data_id is None else data_id, len(data)).protect(data, counter)
    return CanFrame(can_id, bytes(data), 5, **flags)


def test_an_intact_frame_becomes_numbers_with_its_stamp_and_counter(decoder: Decoder) -> None:
    payload = bytes(2) + (-31416).to_bytes(2, "little", signed=True) + (400).to_bytes(2, "little") + bytes(2)
    received = decoder.decode(motion(3, payload=payload))
    assert received is not None
    assert received == DecodedMessage("MOTION", 5, 3, (-31416 * 0.0001, 2.0, 0.0))
    assert (decoder.accepted, decoder.drops) == (1, {})


@pytest.mark.parametrize(
    ("frame", "cause"),
    [
        (motion(0)._replace(is_remote=True), DropCause.WRONG_TYPE),
        (motion(0)._replace(is_fd=True), DropCause.WRONG_TYPE),
        (motion(0)._replace(is_extended=True), DropCause.WRONG_TYPE),
        (motion(0)._replace(is_error=True), DropCause.WRONG_TYPE),
        (CanFrame(MOTION, b""), DropCause.WRONG_LENGTH),
        (CanFrame(MOTION, bytes(7)), DropCause.WRONG_LENGTH),
        (CanFrame(MOTION, bytes(9), is_fd=True), DropCause.WRONG_TYPE),
        (CanFrame(MOTION, b"\xff" * 8), DropCause.BAD_CRC),
        (motion(0, data_id=0x112), DropCause.BAD_CRC),
        (motion(15), DropCause.BAD_COUNTER),
        (motion(0, payload=b"\0\0\0\0\xff\x7f\0\0"), DropCause.OUT_OF_RANGE),
    ],
)
def test_each_refusal_is_counted_by_cause_and_message(decoder: Decoder, frame: CanFrame, cause: DropCause) -> None:
    assert decoder.decode(frame) is None
    assert decoder.drops == {(cause, "MOTION"): 1}
    assert decoder.accepted == 0


@pytest.mark.parametrize("length", [0, 24, 48, 64])
def test_an_fd_frame_longer_or_shorter_than_its_message_has_the_wrong_length(length: int) -> None:
    state = next(found for found in load_database(load_profile("reference_fd")).received if found.name == "STATE")
    decoder = Decoder([state])
    assert decoder.decode(CanFrame(state.can_id, bytes(length), is_fd=True)) is None
    assert decoder.drops == {(DropCause.WRONG_LENGTH, "STATE"): 1}


def test_an_unknown_identifier_is_counted_without_a_name(decoder: Decoder) -> None:
    assert decoder.decode(CanFrame(0x7FF, bytes(8))) is None
    assert decoder.decode(CanFrame(0x80, bytes(8))) is None
    assert decoder.drops == {(DropCause.UNKNOWN_ID, ""): 2}


def test_an_error_frame_is_never_decoded(decoder: Decoder) -> None:
    assert decoder.decode(CanFrame(0x40, bytes(8), is_error=True)) is None
    assert decoder.drops == {(DropCause.WRONG_TYPE, ""): 1}


@pytest.mark.parametrize(
    ("message", "position", "raw", "allowed"),
    [
        ("VEHICLE_STATUS", 16, 5, 4),
        ("VEHICLE_STATUS", 12, 4, 3),
        ("POSE", 12, 2, 1),
        ("POSE", 12, 3, 0),
    ],
)
def test_a_number_without_a_name_drops_the_frame(message: str, position: int, raw: int, allowed: int) -> None:
    bound = next(found for found in DATABASE.received if found.name == message)
    for number, good in ((raw, False), (allowed, True)):
        decoder = Decoder([bound])
        payload = (number << position).to_bytes(8, "little")
        assert (decoder.decode(motion(0, payload=payload, can_id=bound.can_id)) is not None) is good


def test_steps_of_one_to_three_are_taken_and_the_lost_counted(decoder: Decoder) -> None:
    accepted = [decoder.decode(motion(counter)) is not None for counter in (0, 1, 3, 6, 9, 12, 0)]
    assert accepted == [True] * 7
    assert decoder.lost == {"POSE": 0, "MOTION": 1 + 2 + 2 + 2 + 2, "CHASSIS": 0, "VEHICLE_STATUS": 0}


def test_a_repeated_frame_is_dropped_and_the_next_one_taken(decoder: Decoder) -> None:
    assert decoder.decode(motion(4)) is not None
    assert [decoder.decode(motion(4)) for _ in range(3)] == [None] * 3
    assert decoder.decode(motion(5)) is not None
    assert decoder.drops == {(DropCause.REPEATED, "MOTION"): 3}


@pytest.mark.parametrize("jump", range(4, 15))
def test_a_jump_is_dropped_and_the_next_one_counted_from_it(decoder: Decoder, jump: int) -> None:
    decoder.decode(motion(0))
    assert decoder.decode(motion(jump)) is None
    assert decoder.decode(motion((jump + 1) % 15)) is not None
    assert decoder.drops == {(DropCause.WRONG_SEQUENCE, "MOTION"): 1}


def test_a_frame_with_an_impossible_value_was_its_senders_next_one(decoder: Decoder) -> None:
    decoder.decode(motion(0))
    for counter in (1, 2, 3, 4):
        assert decoder.decode(motion(counter, payload=b"\0\0\0\0\xff\x7f\0\0")) is None
    assert decoder.decode(motion(5)) is not None
    assert decoder.lost["MOTION"] == 0


def test_a_damaged_frame_was_sent_and_does_not_break_the_sequence(decoder: Decoder) -> None:
    decoder.decode(motion(0))
    for counter in (1, 2, 3, 4):
        assert decoder.decode(motion(counter, data_id=1)) is None
    assert decoder.decode(motion(5)) is not None
    assert decoder.drops == {(DropCause.BAD_CRC, "MOTION"): 4}


def test_damaged_frames_excuse_one_step_each_and_only_until_the_next_good_one(decoder: Decoder) -> None:
    decoder.decode(motion(0))
    decoder.decode(motion(1, data_id=1))
    assert decoder.decode(motion(5)) is None
    assert decoder.drops[DropCause.WRONG_SEQUENCE, "MOTION"] == 1
    assert decoder.decode(motion(6)) is not None
    assert decoder.decode(motion(10)) is None


def test_each_message_has_its_own_sequence(decoder: Decoder) -> None:
    assert decoder.decode(motion(0)) is not None
    assert decoder.decode(motion(9, can_id=0x110)) is not None
    assert decoder.decode(motion(1)) is not None


def test_after_a_reset_any_counter_is_the_first(decoder: Decoder) -> None:
    decoder.decode(motion(3))
    decoder.reset()
    assert decoder.decode(motion(11)) is not None
    assert decoder.drops == {}


def test_the_same_number_in_the_other_identifier_format_is_another_message(variant: Variant) -> None:
    database = variant(dbc=(("BO_ 273 MOTION", f"BO_ {273 | 1 << 31} MOTION"), (" 273 ", f" {273 | 1 << 31} ")))
    decoder = Decoder(database.received)
    assert decoder.decode(motion(0)) is None
    assert decoder.decode(motion(0, is_extended=True)) is not None
    assert decoder.drops == {(DropCause.WRONG_TYPE, "MOTION"): 1}


def test_the_vehicles_other_numbers_become_the_programs(variant: Variant) -> None:
    database = variant(
        dbc=(('0 "MANUAL" 1 "READY" 2 "AUTONOMOUS"', '2 "HAND" 1 "READY" 0 "AUTONOMOUS"'),),
        toml=(("[status.modes]", '[status.modes]\nHAND = "MANUAL"'),),
    )
    position = database.status[0].fields.index("mode")
    for on_bus, ours in ((2, 0), (1, 1), (0, 2), (3, 3)):
        frame = motion(0, payload=(on_bus << 16).to_bytes(8, "little"), can_id=0x100)
        received = Decoder(database.status).decode(frame)
        assert received is not None
        assert received.values[position] == ours


frames = st.one_of(
    st.builds(
        CanFrame,
        st.sampled_from([0x80, 0x81, 0x100, 0x110, 0x111, 0x112, 0x180, 0x7FF]),
        st.binary(max_size=8),
        is_extended=st.booleans(),
        is_remote=st.booleans(),
        is_fd=st.booleans(),
        is_error=st.booleans(),
    ),
    st.builds(
        motion,
        st.integers(0, 15),
        payload=st.binary(min_size=8, max_size=8),
        can_id=st.sampled_from([0x100, 0x110, 0x111, 0x112]),
    ),
)


@settings(max_examples=300)
@given(st.lists(frames, max_size=30))
def test_no_frame_makes_it_raise_and_every_frame_is_accounted_for(some: list[CanFrame]) -> None:
    decoder = Decoder(DATABASE.received)
    messages = [message for message in map(decoder.decode, some) if message is not None]
    assert decoder.accepted == len(messages)
    assert decoder.accepted + sum(decoder.drops.values()) == len(some)
