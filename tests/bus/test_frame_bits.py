"""The length of a frame on the wire, against the standard's own words: bit by bit, without any table."""

from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.frame_bits import wire_bits
from vehicle_iface.frame import CanFrame

SOME_DATA = st.one_of(st.binary(max_size=8), st.integers(0, 8).map(bytes), st.integers(0, 8).map(lambda n: b"\xff" * n))
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


def bits_of(value: int, count: int) -> list[int]:
    return [value >> place & 1 for place in range(count - 1, -1, -1)]


def crc15(bits: list[int]) -> int:
    """Bosch CAN 2.0, 3.1.1."""
    crc = 0
    for bit in bits:
        differs = bit ^ (crc >> 14)
        crc = crc << 1 & 0x7FFF
        if differs:
            crc ^= 0x4599
    return crc


def stuffed(bits: list[int]) -> list[int]:
    """A transmitter puts in the opposite bit after five equal ones, its own ones included."""
    sent: list[int] = []
    for bit in bits:
        sent.append(bit)
        if len(sent) >= 5 and len(set(sent[-5:])) == 1 and is_row_of_five(sent):
            sent.append(1 - bit)
    return sent


def is_row_of_five(sent: list[int]) -> bool:
    row = 0
    for bit in reversed(sent):
        if bit != sent[-1]:
            break
        row += 1
    return row == 5


def head_of(can_id: int, *, is_extended: bool, is_remote: bool) -> list[int]:
    if not is_extended:
        return [0, *bits_of(can_id, 11), int(is_remote), 0, 0]
    return [0, *bits_of(can_id >> 18, 11), 1, 1, *bits_of(can_id & 0x3FFFF, 18), int(is_remote), 0, 0]


@given(st.booleans(), st.booleans(), SOME_DATA, st.data())
def test_a_classical_frame_is_as_long_as_its_stuffed_bits_and_its_tail(
    is_extended: bool, is_remote: bool, payload: bytes, data: st.DataObject
) -> None:
    can_id = data.draw(st.integers(0, (1 << 29) - 1 if is_extended else 0x7FF))
    payload = b"" if is_remote else payload
    bits = head_of(can_id, is_extended=is_extended, is_remote=is_remote) + bits_of(len(payload), 4)
    bits += [bit for byte in payload for bit in bits_of(byte, 8)]
    bits += bits_of(crc15(bits), 15)
    frame = CanFrame(can_id, payload, 0, is_extended, is_remote)
    assert wire_bits(frame) == (len(stuffed(bits)) + 13, 0)


@given(st.booleans(), st.sampled_from(FD_LENGTHS), st.data())
def test_an_fd_frame_holds_the_bus_at_both_rates(is_extended: bool, length: int, data: st.DataObject) -> None:
    can_id = data.draw(st.integers(0, (1 << 29) - 1 if is_extended else 0x7FF))
    payload = data.draw(st.binary(min_size=length, max_size=length))
    if is_extended:
        head = [0, *bits_of(can_id >> 18, 11), 1, 1, *bits_of(can_id & 0x3FFFF, 18), 0, 1, 0, 1]
    else:
        head = [0, *bits_of(can_id, 11), 0, 0, 1, 0, 1]
    body = [0, *bits_of(FD_LENGTHS.index(length), 4), *(bit for byte in payload for bit in bits_of(byte, 8))]
    nominal = len(stuffed(head))
    fast = len(stuffed(head + body)) - nominal
    check = 4 + 17 + 6 if length <= 16 else 4 + 21 + 7
    assert wire_bits(CanFrame(can_id, payload, 0, is_extended, is_fd=True)) == (nominal + 12, fast + check + 1)


def test_stuffing_makes_a_frame_longer_by_a_fifth_at_most() -> None:
    assert wire_bits(CanFrame(0x000, bytes(8))).nominal > wire_bits(CanFrame(0x555, b"\x55" * 8)).nominal
    assert wire_bits(CanFrame(0x000, bytes(8))).nominal <= 111 + 24
