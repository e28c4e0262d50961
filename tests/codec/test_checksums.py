"""Checksums by parts: published check values, and what each part of `over` contributes."""

from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.codec.checksums import (
    BitPlace,
    CoveredMessage,
    build_cover,
    crc_function,
    sum_function,
    xor_function,
)

CHECK = b"123456789"


@pytest.mark.parametrize(
    ("bits", "poly", "init", "xor_out", "reflect", "expected"),
    [
        (8, 0x1D, 0xFF, 0xFF, False, 0x4B),  # CRC-8/SAE-J1850
        (8, 0x07, 0x00, 0x00, False, 0xF4),  # CRC-8
        (8, 0x2F, 0xFF, 0xFF, False, 0xDF),  # CRC-8/AUTOSAR
        (8, 0x31, 0x00, 0x00, True, 0xA1),  # CRC-8/MAXIM-DOW
        (16, 0x1021, 0xFFFF, 0x0000, False, 0x29B1),  # CRC-16/CCITT-FALSE
        (16, 0x8005, 0x0000, 0x0000, True, 0xBB3D),  # CRC-16/ARC
        (16, 0x8005, 0xFFFF, 0x0000, True, 0x4B37),  # CRC-16/MODBUS
        (16, 0x1021, 0xB2AA, 0x0000, True, 0x63D0),  # CRC-16/RIELLO
        (16, 0x1021, 0xFFFF, 0xFFFF, True, 0x906E),  # CRC-16/X-25
    ],
)
def test_crcs_have_their_published_check_values(
    bits: int, poly: int, init: int, xor_out: int, reflect: bool, expected: int
) -> None:
    assert crc_function(bits, poly, init, xor_out, reflect=reflect)(CHECK) == expected


def test_sums_and_exclusive_ors_have_their_width() -> None:
    data = bytes([0x12, 0xF0, 0xFF])
    assert sum_function(8)(data) == (0x12 + 0xF0 + 0xFF) % 256
    assert sum_function(12)(data) == 0x12 + 0xF0 + 0xFF
    assert sum_function(7)(data) == (0x12 + 0xF0 + 0xFF) % 128
    assert sum_function(4)(data) == (1 + 2 + 15 + 0 + 15 + 15) % 16
    assert xor_function(8)(data) == 0x12 ^ 0xF0 ^ 0xFF
    assert xor_function(4)(data) == 1 ^ 2 ^ 15 ^ 0 ^ 15 ^ 15


@given(data=st.binary(max_size=64), constant=st.integers(0, 15))
def test_a_nibble_sum_can_be_subtracted_from_a_constant(data: bytes, constant: int) -> None:
    nibbles = sum(byte // 16 + byte % 16 for byte in data)
    assert sum_function(4, init=(15 - constant) % 16, xor_out=15)(data) == (constant - nibbles) % 16


def covered(
    over: tuple[str, ...],
    *,
    checksum: BitPlace,
    data: bytes = bytes(range(0xA0, 0xA8)),
    can_id: int = 0x1F8,
    is_extended: bool = False,
    counter: BitPlace | None = None,
    data_id: int | tuple[int, ...] | None = None,
) -> str:
    message = CoveredMessage(
        can_id=can_id,
        is_extended=is_extended,
        length=len(data),
        checksum=checksum,
        counter=counter,
        data_id=data_id,
    )
    return bytes(build_cover(over, message)(data)).hex(" ")


LAST_BYTE = BitPlace(0, 8, "big")


def test_parts_are_covered_in_their_order() -> None:
    assert covered(("id", "length", "bytes"), checksum=LAST_BYTE) == "f8 01 08 a0 a1 a2 a3 a4 a5 a6"
    assert covered(("bytes", "id"), checksum=LAST_BYTE) == "a0 a1 a2 a3 a4 a5 a6 f8 01"
    assert covered(("id",), checksum=LAST_BYTE, can_id=0x18FF1234, is_extended=True) == "34 12 ff 18"


@pytest.mark.parametrize(
    ("shift", "width", "order", "expected"),
    [
        (0, 8, "little", "a1 a2 a3 a4 a5 a6 a7"),
        (24, 8, "little", "a0 a1 a2 a4 a5 a6 a7"),
        (0, 16, "little", "a2 a3 a4 a5 a6 a7"),
        (56, 8, "big", "a1 a2 a3 a4 a5 a6 a7"),
        (0, 4, "big", "a0 a1 a2 a3 a4 a5 a6 a0"),
        (60, 4, "little", "a0 a1 a2 a3 a4 a5 a6 07"),
        (4, 12, "little", "00 a2 a3 a4 a5 a6 a7"),
        (12, 8, "little", "a0 01 a0 a3 a4 a5 a6 a7"),
    ],
)
def test_bytes_are_covered_without_the_checksums_own_bits(
    shift: int, width: int, order: Literal["little", "big"], expected: str
) -> None:
    assert covered(("bytes",), checksum=BitPlace(shift, width, order)) == expected


def test_a_data_id_is_two_bytes_or_one_by_the_counter() -> None:
    counter = BitPlace(56, 2, "big")  # in a0: 0
    second = BitPlace(48, 2, "big")  # in a1: 1
    assert covered(("data_id",), checksum=LAST_BYTE, data_id=0x1F8) == "f8 01"
    assert covered(("data_id",), checksum=LAST_BYTE, data_id=(7,)) == "07"
    assert covered(("data_id",), checksum=LAST_BYTE, data_id=(7, 8, 9, 10), counter=counter) == "07"
    assert covered(("data_id",), checksum=LAST_BYTE, data_id=(7, 8, 9, 10), counter=second) == "08"


def test_a_counter_is_covered_in_as_few_bytes_as_hold_it() -> None:
    assert covered(("counter",), checksum=LAST_BYTE, counter=BitPlace(8, 8, "big")) == "a6"
    assert covered(("counter", "length"), checksum=LAST_BYTE, counter=BitPlace(8, 12, "big")) == "a6 05 08"


@given(
    data=st.binary(min_size=1, max_size=64),
    draw=st.data(),
    order=st.sampled_from(["little", "big"]),
)
def test_bits_are_read_as_written_and_no_others_change(
    data: bytes, draw: st.DataObject, order: Literal["little", "big"]
) -> None:
    shift = draw.draw(st.integers(0, 8 * len(data) - 1))
    place = BitPlace(shift, draw.draw(st.integers(1, min(64, 8 * len(data) - shift))), order)
    number = draw.draw(st.integers(0, place.mask))
    written = bytearray(data)
    place.write(written, number)
    assert place.read(written) == number
    assert place.clear(written) == place.clear(data)
    place.write(written, place.read(data))
    assert written == data
