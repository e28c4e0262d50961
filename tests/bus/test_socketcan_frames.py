"""The kernel's struct can_frame and canfd_frame (linux/can.h), there and back."""

import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface.bus.receive import CANFD_MTU
from vehicle_iface.bus.socketcan import packed, unpacked
from vehicle_iface.frame import CanFrame


@st.composite
def frames(draw: st.DrawFn) -> CanFrame:
    is_extended, is_fd = draw(st.booleans()), draw(st.booleans())
    return CanFrame(
        draw(st.integers(0, 0x1FFFFFFF if is_extended else 0x7FF)),
        draw(st.binary(max_size=64 if is_fd else 8)),
        stamp_ns=draw(st.integers(0, 2**62)),
        is_extended=is_extended,
        is_remote=not is_fd and draw(st.booleans()),
        is_fd=is_fd,
    )


@given(frames())
def test_every_frame_comes_back_as_it_went(frame: CanFrame) -> None:
    assert unpacked(packed(frame), frame.stamp_ns) == frame


@given(frames())
def test_the_length_tells_the_kernel_which_kind_it_is(frame: CanFrame) -> None:
    assert len(packed(frame)) == (CANFD_MTU if frame.is_fd else 16)


def test_a_frame_is_laid_out_as_the_header_file_says() -> None:
    assert packed(CanFrame(0x123, b"\x01\x02")) == struct.pack("=IB3x8s", 0x123, 2, b"\x01\x02")
    assert packed(CanFrame(0x123, b"", is_extended=True))[:4] == struct.pack("=I", 0x80000123)
    assert packed(CanFrame(0x123, b"", is_remote=True))[:4] == struct.pack("=I", 0x40000123)
    assert packed(CanFrame(0x1, bytes(12), is_fd=True))[:8] == struct.pack("=IBBxx", 1, 12, 1)


@pytest.mark.parametrize("can_class", [0x001, 0x040, 0x080, 0x100])
def test_an_error_frame_is_told_from_a_data_frame_of_the_same_number(can_class: int) -> None:
    frame = unpacked(struct.pack("=IB3x8s", 0x20000000 | can_class, 8, bytes(8)), 5)
    assert (frame.can_id, frame.is_error, frame.is_extended, frame.is_remote) == (can_class, True, False, False)


def test_bytes_beyond_the_length_are_not_part_of_the_frame() -> None:
    raw = struct.pack("=IB3x8s", 0x123, 3, b"\x01\x02\x03\xff\xff\xff\xff\xff")
    assert unpacked(raw, 0) == replace(CanFrame(0x123, b"\x01\x02\x03"), stamp_ns=0)
