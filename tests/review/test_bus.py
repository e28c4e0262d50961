"""What the frames themselves say: periods, gaps, lengths, ranges, counters and checksums."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.review.drives import Frames, note, record, review, review_profile
from vehicle_iface.codec.checksums import BitPlace
from vehicle_iface.frame import CanFrame
from vehicle_iface.review.checksum_search import SearchedMessage, search_checksum
from vehicle_iface.review.findings import Finding, Level

POSE, MOTION, CHASSIS = 0x110, 0x111, 0x112
Checksum = Callable[[CanFrame], int]


def crc8(data: bytes, poly: int, init: int = 0, xor_out: int = 0) -> int:
    """Bit by bit, most significant first."""
    register = init
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ (poly if register & 0x80 else 0)) & 0xFF
    return register ^ xor_out


def sum_of_all(frame: CanFrame) -> int:
    return (frame.can_id // 256 + frame.can_id % 256 + len(frame.data) + sum(frame.data[1:])) % 256


CHECKSUMS: dict[str, tuple[Checksum, str]] = {
    "sum": (sum_of_all, "a sum over id, length and bytes"),
    "plain sum": (lambda frame: sum(frame.data[1:]) % 256, "a sum over bytes"),
    "xor": (
        lambda frame: (
            frame.data[1]
            ^ frame.data[2]
            ^ frame.data[3]
            ^ frame.data[4]
            ^ frame.data[5]
            ^ frame.data[6]
            ^ frame.data[7]
        ),
        "an exclusive or over bytes",
    ),
    "crc 2F": (
        lambda frame: crc8(frame.data[1:], 0x2F, 0xFF, 0xFF),
        "crc8 with polynomial 0x2f over bytes (init 0xff, xor_out 0xff)",
    ),
    "crc 1D": (lambda frame: crc8(frame.data[1:], 0x1D, 0xFF), "crc8 with polynomial 0x1d over bytes (init 0xff)"),
    "crc 07 of the id": (
        lambda frame: crc8(frame.can_id.to_bytes(2, "little") + frame.data[1:], 0x07),
        "crc8 with polynomial 0x07 over id and bytes",
    ),
}


def protect(frames: Frames, checksum: Checksum, can_id: int = MOTION) -> list[CanFrame]:
    """The frames of one message with another checksum."""
    return [f._replace(data=bytes([checksum(f)]) + f.data[1:]) if f.can_id == can_id else f for f in frames]


def contradictions(folder: Path, frames: Frames, more: str = "") -> list[Finding]:
    return review(folder, frames, more).contradictions


@pytest.mark.parametrize("name", CHECKSUMS)
def test_a_checksum_of_another_kind_is_recognised(tmp_path: Path, name: str) -> None:
    checksum, described = CHECKSUMS[name]
    (found,) = contradictions(tmp_path, protect(record("figure8"), checksum))
    assert found.about == "MOTION.CRC"
    assert found.text.startswith(f"MOTION.CRC fits {described}, not the rule of the profile")
    assert 'MOTION = "found"' in found.fix


def test_a_checksum_that_fits_nothing_is_named(tmp_path: Path) -> None:
    (found,) = contradictions(tmp_path, protect(record("figure8"), lambda frame: frame.data[2] * frame.data[5] % 251))
    assert found.text.startswith("MOTION.CRC is not autosar-1 as stated (fits ")


def test_a_rule_that_is_found_holds_in_a_profile(tmp_path: Path) -> None:
    frames = protect(record("figure8"), sum_of_all)
    (found,) = contradictions(tmp_path, frames)
    profile = (tmp_path / "profile.toml").read_text().replace("MOTION = 0x111\n", "") + found.fix
    profile = profile.replace("[state]\n", '[state]\nassemble = "counter"\n')
    assert review_profile(tmp_path, frames, profile).contradictions == []


def test_few_payloads_fit_no_checksum_by_chance() -> None:
    place = BitPlace(0, 8, "little")
    message = SearchedMessage(can_id=1, is_extended=False, length=2, place=place)
    assert search_checksum(message, [bytes((number % 4, number % 4)) for number in range(200)], 0.99) == []


def test_a_period_other_than_stated_is_measured(tmp_path: Path) -> None:
    count = 0

    def is_kept(frame: CanFrame) -> bool:
        nonlocal count
        count += frame.can_id == POSE
        return frame.can_id != POSE or count % 2 == 0

    found = contradictions(tmp_path, [frame for frame in record("figure8") if is_kept(frame)])
    assert [one.text.partition(",")[0] for one in found] == ["POSE comes every 20 ms", "POSE.COUNTER steps by 2"]


def test_a_counter_that_stands_still_is_named(tmp_path: Path) -> None:
    stuck = [
        f._replace(data=f.data[:1] + bytes([f.data[1] & 0xF0 | 3]) + f.data[2:]) if f.can_id == MOTION else f
        for f in record("figure8")
    ]
    frames = protect(stuck, lambda frame: crc8(bytes((0x11, 0x01)) + frame.data[1:], 0x1D))
    (found,) = contradictions(tmp_path, frames)
    assert found.text == "MOTION.COUNTER does not count: it is always 3"


def test_a_message_that_never_came_is_named_with_its_fields(tmp_path: Path) -> None:
    found = review(tmp_path, [frame for frame in record("figure8") if frame.can_id != CHASSIS])
    assert [one.text for one in found.contradictions] == ["the vehicle never sent CHASSIS in this log"]
    missing = {one.field for one in found.bindings if one.text == "no value in this log"}
    assert missing == {"accel_mps2", "lateral_speed_mps", "front_wheel_angle_rad"}


def test_pauses_are_doubts_and_no_contradiction(tmp_path: Path) -> None:
    frames = [f for f in record("figure8") if f.can_id != MOTION or not 11_000 < f.stamp_ns // 10**6 < 11_600]
    doubts = [one.text for one in review(tmp_path, frames).findings if one.level is not Level.NOTE]
    assert [one[:-11] for one in doubts] == ["MOTION paused for more than 5 periods once, for 0.6"]


def test_frames_of_another_length_are_counted(tmp_path: Path) -> None:
    frames = [f._replace(data=f.data[:7]) if f.can_id == POSE else f for f in record("figure8")]
    (found,) = contradictions(tmp_path, frames)
    assert found.text == "4001 of 4001 frames of POSE do not have the DBC's 8 bytes"


def test_values_out_of_range_are_counted_with_an_example(tmp_path: Path) -> None:
    (found,) = contradictions(tmp_path, record("figure8"), note("MOTION.SPEED", "range = [0, 4.5]"))
    assert found.text.partition(" of ")[2].startswith("4001 frames of MOTION are out of range: MOTION.SPEED = 4.5")
