"""A vehicle that sends wrong values in intact frames: one drive, one wrong value after another."""

import math
import random
import signal
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, COUNTERS, LAYOUT, SAMPLE, Frame, checksum, pack
from vehicle_bus_contract.socketcan import send

from .conftest import ROOT, Programs
from .driving import driven, line_file, own_faults, summary
from .observer import Observer, decided, reasons
from .peer import Vehicle

Signals = Mapping[str, float]
Replacement = Callable[[str, int, Signals], bytes]
MIXED, LOST_ROUND = 30, COUNTERS
JITTER_S = 0.008
HANG_RAD = 0.3
"""As far as a command may be from what is measured."""


class WrongVehicle(Vehicle):
    """Sends other values than its own, as a test sets them."""

    def __init__(self) -> None:
        super().__init__()
        self.replacements: dict[str, Replacement] = {}
        """By message: what is sent instead of its next frame."""
        self.mixed = 0
        """This many of its next samples each lack another part than the one before."""
        self.wraps_early = False
        """Once, the counter of its samples restarts in the middle."""
        self.jitter_s = 0.0
        """Each sample comes late by up to this."""
        self.hangs_at_rad: float | None = None
        """The front wheels do not move from here."""
        self._dice = random.Random(0)

    def _move(self, dt_s: float) -> None:
        command = self._commands.get("STEER_COMMAND")
        if command is not None and self.hangs_at_rad is not None:
            signals = {**command.signals, "FRONT_WHEEL_ANGLE_REQUEST": self.hangs_at_rad}
            self._commands["STEER_COMMAND"] = replace(command, signals=signals)
        super()._move(dt_s)

    def _send_state(self, tick: int) -> None:
        time.sleep(self._dice.uniform(0.0, self.jitter_s))
        counter = self._counters["POSE"] % COUNTERS
        if self.wraps_early and 5 <= counter <= 9:
            self.wraps_early, self.faults.skipped = False, COUNTERS - 1 - counter
        super()._send_state(tick)
        self.mixed = max(0, self.mixed - 1)

    def _send_message(self, name: str, counter: int, **signals: float) -> None:
        replacement = self.replacements.pop(name, None)
        if replacement is not None:
            send(self._raws[-1], Frame(0, LAYOUT[name][0], replacement(name, counter % COUNTERS, signals)))
        elif not (self.mixed and name in SAMPLE and counter % len(SAMPLE) == SAMPLE.index(name)):
            super()._send_message(name, counter, **signals)


def with_data_id_of(other: str) -> Replacement:
    """The message as it is, its checksum made with another message's data id."""

    def replacement(name: str, counter: int, signals: Signals) -> bytes:
        data = pack(name, counter, **signals)[1]
        return bytes((checksum(LAYOUT[other][0], data),)) + data[1:]

    return replacement


def with_values(**wrong: float) -> Replacement:
    """The message with other values, and the checksum that belongs to them."""
    return lambda name, counter, signals: pack(name, counter, **{**signals, **wrong})[1]


OTHER_IDS = {"POSE": "MOTION", "MOTION": "CHASSIS", "CHASSIS": "POSE", "VEHICLE_STATUS": "POSE"}
IMPOSSIBLE: list[tuple[str, dict[str, float]]] = [
    ("MOTION", {"SPEED": 150.0}),
    ("MOTION", {"SPEED": -100.005}),
    ("CHASSIS", {"ACCEL": 20.001}),
    ("CHASSIS", {"LATERAL_SPEED": -32.0}),
    ("CHASSIS", {"FRONT_WHEEL_ANGLE": 1.5}),
    ("POSE", {"POSE_FRAME": 3}),
    ("VEHICLE_STATUS", {"MODE": 7}),
    ("VEHICLE_STATUS", {"GEAR": 6}),
    ("VEHICLE_STATUS", {"REAR_WHEEL_ANGLE": -1.5}),
]
"""Beyond the range that the DBC gives, or a number without a name."""
INCREDIBLE = [("MOTION", {"SPEED": 45.0}), ("MOTION", {"YAW_RATE": -3.5}), ("MOTION", {"YAW_RATE": 0.9})]
"""In the DBC's range, and nothing that this vehicle can do."""


@pytest.fixture
def wrong_vehicle(bus: Observer) -> Iterator[WrongVehicle]:
    """At the origin, READY, sending."""
    vehicle = WrongVehicle()
    vehicle.start()
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    yield vehicle
    vehicle.close()


def test_wrong_data_ids_impossible_values_early_wraps_and_jitter_are_counted_and_driving_continues(
    programs: Programs, bus: Observer, wrong_vehicle: WrongVehicle
) -> None:
    loop, moving = driven(programs, bus)
    for name, other in OTHER_IDS.items():
        wrong_vehicle.replacements[name] = with_data_id_of(other)
        bus.wait_samples(8)
    for name, wrong in IMPOSSIBLE:
        wrong_vehicle.replacements[name] = with_values(**wrong)
        bus.wait_samples(8)
    for name, wrong in INCREDIBLE:
        wrong_vehicle.replacements[name] = with_values(**wrong)
        bus.wait_samples(8)
    wrong_vehicle.wraps_early = True
    bus.wait_samples(COUNTERS + 10)
    wrong_vehicle.jitter_s = JITTER_S
    bus.wait_samples(100)
    wrong_vehicle.jitter_s = 0.0
    end = bus.wait_samples(10)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL"]
    assert all(decoded["MODE"] in (AUTONOMOUS, 7) for decoded in record.of("VEHICLE_STATUS"))
    found = summary(programs)
    assert {what: count for what, count in found["implausible"].items() if count} == {"out of range": 2, "disagree": 1}
    assert found["drops"] == {
        **{f"bad CRC {name}": 1 for name in OTHER_IDS},
        **{f"wrong sequence {name}": 1 for name in SAMPLE},
        **{f"out of range {name}": sum(each == name for each, _ in IMPOSSIBLE) for name, _ in IMPOSSIBLE},
    }


def test_a_lost_counter_cycle_and_mixed_sample_parts_stop_the_vehicle_while_they_last(
    programs: Programs, bus: Observer, wrong_vehicle: WrongVehicle
) -> None:
    loop, moving = driven(programs, bus)
    faults: list[Callable[[], None]] = [
        lambda: wrong_vehicle.mute(LOST_ROUND),
        lambda: setattr(wrong_vehicle, "mixed", MIXED),
    ]
    for begin_fault in faults:
        begin = bus.wait_samples(20)
        begin_fault()
        stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", ENABLE=1, SAFE_STOP=1, since=begin)
        index, _ = bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", ENABLE=1, since=stop)
        assert reasons(bus.pairs(begin, bus.wait_samples(10, since=index))) == ["NOMINAL", "STATE_STALE", "NOMINAL"]
    end = bus.now()
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    record = bus.record(moving, end)
    assert set(decided(record)) == {"NOMINAL", "STATE_STALE"}
    found = summary(programs)
    assert found["incomplete_samples"] == MIXED
    assert found["counts"]["stops_on_stale_state"] >= (LOST_ROUND - 5 + MIXED - 5) // 2
    assert found["drops"] == {}


def test_samples_with_gaps_prevent_engaging_and_commands_stay_near_stuck_wheels(
    programs: Programs, bus: Observer, wrong_vehicle: WrongVehicle
) -> None:
    wrong_vehicle.hangs_at_rad = 0.0
    programs.run("--arm", "--route", "circle").wait_for_line("armed")
    for _ in range(5):
        wrong_vehicle.mute(8)
        gaps = bus.wait_samples(20)
    assert not any(pair.is_enabled for pair in bus.pairs(0, gaps))
    index, _ = bus.wait_for("a vehicle off its path is stopped", "DRIVE_COMMAND", REASON="DEVIATION", ENABLE=1)
    angles = [decoded["FRONT_WHEEL_ANGLE_REQUEST"] for decoded in bus.record(gaps, index).of("STEER_COMMAND")]
    assert HANG_RAD - 0.01 < max(map(abs, angles)) <= HANG_RAD


AXLE_ID = 0x103
AXLE = f"""BO_ {AXLE_ID} AXLE: 8 VEHICLE
 SG_ BRANCH M : 0|8@1+ (1,0) [0|255] "" CONTROLLER
 SG_ REAR_WHEEL_ANGLE : 8|32@1- (1,0) [-1|1] "rad" CONTROLLER
 SG_ LEFT_TEMPERATURE m0 : 40|8@1+ (1,0) [0|200] "degC" CONTROLLER
 SG_ RIGHT_TEMPERATURE m1 : 40|8@1+ (1,0) [0|200] "degC" CONTROLLER

"""
FLOAT = f"SIG_VALTYPE_ {AXLE_ID} REAR_WHEEL_ANGLE : 1;\n"
UNUSED = ("VEHICLE_STATUS.REAR_WHEEL_ANGLE", "AXLE.BRANCH", "AXLE.LEFT_TEMPERATURE", "AXLE.RIGHT_TEMPERATURE")
SENSELESS = [(0, math.nan), (0, math.inf), (1, -math.inf), (0, 1e30), (2, 0.0), (255, 0.0)]
"""Branch and angle: no number, beyond the range, a branch that there is not."""


class Axle(Vehicle):
    """Has another control unit that sends an angle as a float, beside the branches of a multiplexer."""

    def __init__(self) -> None:
        super().__init__()
        self.usual = (0, 0.0)
        self.once: list[tuple[int, float]] = []
        """Sent once, one after the other."""

    def _send_state(self, tick: int) -> None:
        if tick % 2 == 0:
            branch, angle_rad = self.once.pop() if self.once and tick % 16 == 0 else self.usual
            send(self._raws[-1], Frame(0, AXLE_ID, struct.pack("<BfBxx", branch, angle_rad, 20)))
        super()._send_state(tick)


def with_an_axle(folder: Path) -> str:
    """The reference profile, its rear wheels' angle sent by the axle."""
    toml = (ROOT / "dbc" / "reference.toml").read_text(encoding="utf-8")
    for old, new in (
        ('"VEHICLE_STATUS.REAR_WHEEL_ANGLE"', '"AXLE.REAR_WHEEL_ANGLE"'),
        ("ignored = []", f"ignored = {list(UNUSED)}"),
    ):
        assert old in toml
        toml = toml.replace(old, new)
    dbc = (ROOT / "dbc" / "reference.dbc").read_text(encoding="utf-8")
    before = "BO_ 384 CONTROLLER_STATUS"
    assert before in dbc
    (folder / "reference.dbc").write_text(dbc.replace(before, AXLE + before, 1) + FLOAT, encoding="utf-8")
    (folder / "axle.toml").write_text(toml, encoding="utf-8")
    return str(folder / "axle.toml")


def test_nan_floats_and_unknown_branches_are_dropped_and_stop_the_vehicle_if_they_persist(
    programs: Programs, bus: Observer
) -> None:
    vehicle = Axle()
    vehicle.start()
    try:
        line = line_file(programs.folder)
        loop, moving = driven(programs, bus, "--profile", with_an_axle(programs.folder), "--trajectory", line)
        vehicle.once = list(SENSELESS)
        fine = bus.wait_samples(16 * (len(SENSELESS) + 1), since=bus.now())
        assert decided(bus.record(moving, fine)) == ["NOMINAL"]
        vehicle.usual = (0, math.nan)
        lost = bus.wait_samples(15, since=bus.now())
        stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", ENABLE=1, SAFE_STOP=1, since=lost)
        vehicle.usual = (1, 0.0)
        index, _ = bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", ENABLE=1, since=stop)
        assert not own_faults(bus.record(moving, bus.wait_samples(10, since=index)))
        loop.send_signal(signal.SIGTERM)
        assert loop.wait_for_end() == 0
    finally:
        vehicle.close()
    drops = summary(programs)["drops"]
    assert set(drops) == {"out of range AXLE"}
    assert drops["out of range AXLE"] >= len(SENSELESS) + 4
