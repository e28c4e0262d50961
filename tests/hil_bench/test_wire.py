"""The bench's own decoding, its CAN interfaces and records."""

import random
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from hil_bench import bus
from hil_bench.profile import ProfileError
from hil_bench.wire import Wire
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import WIRE, other_wire
from vehicle_bus_contract.judge import examine
from vehicle_bus_contract.reference import MS, REFERENCE, S
from vehicle_bus_contract.reference_fd import REFERENCE_FD


@pytest.mark.parametrize(("wire", "contract"), [(WIRE, REFERENCE), (Wire("reference_fd"), REFERENCE_FD)])
@given(st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None)
def test_frames_equal_those_of_the_bus_contract(wire: Wire, contract: object, chance: random.Random) -> None:
    assert isinstance(contract, type(REFERENCE))
    for name, (can_id, _, layout) in contract.messages.items():
        values = {
            signal: chance.randrange(-(1 << length - 1) if signed else 0, 1 << length - 1) * factor
            for signal, (_, length, signed, factor) in layout.items()
            if signal != "COUNTER"
        }
        counter = chance.randrange(contract.counters)
        frame = wire.pack(name, counter, **values)
        assert (frame.can_id, frame.data) == (can_id, contract.pack(name, counter, **values)[1])
        told, theirs = wire.intact(frame), contract.intact(frame)
        assert told is not None
        assert theirs is not None
        assert {word: told[word] for word in theirs.signals} == pytest.approx(dict(theirs.signals))


@given(st.integers(0, 63), st.sampled_from(["POSE", "DRIVE_COMMAND", "VEHICLE_STATUS"]))
def test_one_flipped_bit_is_detected(bit: int, name: str) -> None:
    frame = WIRE.pack(name, 3)
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    assert WIRE.intact(replace(frame, data=bytes(data))) is None
    assert WIRE.intact(WIRE.seal(replace(frame, data=bytes(data)))) is not None
    assert WIRE.intact(WIRE.seal(frame, data_id=0x3F0)) is None


def test_a_profile_that_cannot_be_judged_is_rejected_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="no-such"):
        Wire("no-such")
    for spoilt, why in (
        (('accel_mps2 = "DRIVE_COMMAND.ACCEL_REQUEST"', ""), "accel_mps2 is missing"),
        (('data_id_mode = "BOTH"', 'data_id_mode = "ALT"'), "not 1 \\(ALT\\)"),
        (("lateral_jerk_mps3", "# lateral_jerk_mps3"), "lateral_jerk_mps3 is missing"),
        (("stop_jerk_mps3", "# stop_jerk_mps3"), "stop_jerk_mps3 is missing"),
        (("front_wheel_rate_radps = 0.3", ""), "\\[limits.while_engaging\\] front_wheel_rate_radps is missing"),
    ):
        with pytest.raises(ProfileError, match=why):
            other_wire(tmp_path, profile=spoilt)

    old = other_wire(tmp_path, profile=("[limits.while_engaging]", "[limits.engaging]"))
    assert old.profile["limits"]["while_engaging"] == WIRE.profile["limits"]["while_engaging"]


@pytest.mark.parametrize(
    ("kind", "is_virtual"), [("vcan addrgenmode", True), ("vxcan addrgenmode", True), ("slcan x", False), ("", False)]
)
def test_an_interface_counts_as_real_unless_it_is_known_to_be_virtual(
    kind: str, is_virtual: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = f"3: can7: <NOARP,UP> mtu 16\n    link/can  promiscuity 0 \n    {kind}\n"
    done = subprocess.CompletedProcess([], 0, said, "")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    assert bus.is_virtual("can7") is is_virtual


@pytest.mark.parametrize("order", [("DRIVE_COMMAND", "STEER_COMMAND"), ("STEER_COMMAND", "DRIVE_COMMAND")])
@pytest.mark.parametrize("missing", [(20, 0), (20, 1)])
def test_a_lost_half_of_a_pair_costs_one_pair(order: tuple[str, str], missing: tuple[int, int]) -> None:
    frames = [
        replace(WIRE.pack(name, tick % 15), stamp_ns=S + tick * 10 * MS + half * MS)
        for tick in range(60)
        for half, name in enumerate(order)
        if (tick, half) != missing
    ]
    record = examine(frames, WIRE)
    assert len(record.pairs) == 59
    assert all(pair.drive.stamp_ns // (10 * MS) == pair.steer.stamp_ns // (10 * MS) for pair in record.pairs)
    assert [text.split()[:2] for text in record.doubled if "alone" in text] == [[order[1 - missing[1]], "alone"]]


def test_a_record_that_begins_within_a_pair_starts_with_the_next_pair() -> None:
    frames = [
        replace(WIRE.pack(name, tick % 15), stamp_ns=S + tick * 10 * MS + half * MS)
        for tick in range(60)
        for half, name in enumerate(WIRE.command)
    ][1:]
    record = examine(frames, WIRE)
    assert len(record.pairs) == 59
    assert not [text for text in record.doubled if "alone" in text]
