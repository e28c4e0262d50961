"""Sensors that are wrong, and inputs that come and go: real processes on a real vcan0, an independent vehicle."""

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import pytest
from vehicle_bus_contract.reference import AUTONOMOUS, MS, NEUTRAL, PARK, REVERSE

from .conftest import ROOT, Programs
from .driving import driven, is_standing, line_file, summary
from .observer import Observer, reasons
from .peer import Vehicle

PATH_MPS, OVERSPEED_MPS, OVERSPEED_S = 5.0, 1.0, 1.0
LATERAL_STOP_M = 3.0
WATCH_S = 12.0
SLACK_NS = 60 * MS
HELD_SAMPLES = 30

Change = Callable[[float], float]


def delayed(samples: int) -> Change:
    held: deque[float] = deque(maxlen=samples + 1)

    def change(value: float) -> float:
        held.append(value)
        return held[0]

    return change


def frozen() -> Change:
    held: list[float] = []

    def change(value: float) -> float:
        if not held:
            held.append(value)
        return held[0]

    return change


class WrongSensors(Vehicle):
    """Reports something else than what it does, and keeps account of what it truly did."""

    def __init__(self) -> None:
        super().__init__()
        self.wrong: dict[str, Change] = {}
        """By signal: what is sent in the place of the value."""
        self.is_held_up = False
        """Its frames wait in a gateway."""
        self.fastest_mps = self.farthest_m = self.too_fast_s = self.longest_too_fast_s = 0.0
        self._held: list[tuple[str, int, dict[str, float]]] = []

    def _move(self, dt_s: float) -> None:
        super()._move(dt_s)
        self.fastest_mps = max(self.fastest_mps, abs(self.speed_mps))
        self.farthest_m = max(self.farthest_m, abs(self.y_m))
        is_too_fast = abs(self.speed_mps) > PATH_MPS + OVERSPEED_MPS
        self.too_fast_s = self.too_fast_s + dt_s if is_too_fast else 0.0
        self.longest_too_fast_s = max(self.longest_too_fast_s, self.too_fast_s)

    def _send_message(self, name: str, counter: int, **signals: float) -> None:
        for signal_name, change in list(self.wrong.items()):
            if signal_name in signals:
                signals[signal_name] = change(signals[signal_name])
        if self.is_held_up:
            self._held.append((name, counter, signals))
            return
        held, self._held = self._held, []
        for earlier in held:
            super()._send_message(earlier[0], earlier[1], **earlier[2])
        super()._send_message(name, counter, **signals)


@pytest.fixture
def sensors(bus: Observer) -> Iterator[WrongSensors]:
    """At the origin, READY, sending."""
    vehicle = WrongSensors()
    vehicle.start()
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    yield vehicle
    vehicle.close()


FAULTS: Mapping[str, tuple[str, Callable[[], Change], bool]] = {
    "speed frozen": ("SPEED", frozen, False),
    "speed at 0 from the start": ("SPEED", lambda: lambda _: 0.0, True),
    "speed at 30 % from the start": ("SPEED", lambda: lambda value: 0.3 * value, True),
    "speed of the wrong sign from the start": ("SPEED", lambda: lambda value: -value, True),
    "speed 1 s late from the start": ("SPEED", lambda: delayed(100), True),
    "position frozen": ("POS_X", frozen, False),
    "position at half": ("POS_X", lambda: lambda value: 0.5 * value, True),
    "position sideways by 2 m": ("POS_Y", lambda: lambda value: value + 2.0, False),
    "heading off by 0.15 rad from the start": ("HEADING", lambda: lambda value: value + 0.15, True),
    "yaw rate off by 0.3 rad/s": ("YAW_RATE", lambda: lambda value: value + 0.3, False),
    "acceleration off by 3 m/s²": ("ACCEL", lambda: lambda value: value + 3.0, False),
    "wheels off by 0.25 rad": ("FRONT_WHEEL_ANGLE", lambda: lambda value: value + 0.25, False),
}
"""Signal, what is sent in the place of its value, and whether it is so from the start."""


@pytest.mark.parametrize("name", FAULTS)
def test_a_wrong_sensor_stops_the_vehicle_before_it_is_too_fast_or_off_its_path(
    programs: Programs, bus: Observer, sensors: WrongSensors, name: str
) -> None:
    field, make, from_start = FAULTS[name]
    path = line_file(programs.folder, speed_mps=PATH_MPS, last_s=1000.0)
    if from_start:
        sensors.wrong[field] = make()
    loop = programs.run("--arm", "--trajectory", path)
    engaged, _ = bus.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS)
    if not from_start:
        bus.wait_until("it moves", lambda decoded: decoded.name == "MOTION" and decoded["SPEED"] > 2.0, since=engaged)
        sensors.wrong[field] = make()
    stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_INVALID", SAFE_STOP=1, ENABLE=1, since=engaged)
    deadline_s = time.monotonic() + WATCH_S
    while sensors.speed_mps != 0.0 and time.monotonic() < deadline_s:
        bus.wait_samples(10)
    assert sensors.speed_mps == 0.0
    rested = bus.wait_samples(50)
    assert sensors.longest_too_fast_s <= OVERSPEED_S
    assert sensors.farthest_m <= LATERAL_STOP_M
    pairs = bus.pairs(stop, rested)
    assert not [pair for pair in pairs if pair.is_enabled and not pair.is_stop]
    loop.send_signal(signal.SIGINT)
    assert loop.wait_for_end() == 4
    found = summary(programs)
    assert found["latched_fault"] in ("STATE_INVALID", "STATE_STALE")
    assert sum(found["disagreements"].values()) + sum(found["implausible"].values()) >= 1


FLAPS: Mapping[str, tuple[str, Callable[[WrongSensors, int], None]]] = {
    "pose invalid in one of two": ("STATE_INVALID", lambda v, tick: setattr(v, "pose_valid", tick % 2 == 0)),
    "pose invalid in one of three": ("STATE_INVALID", lambda v, tick: setattr(v, "pose_valid", tick % 3 != 0)),
    "frame of reference in one of two": ("FRAME_MISMATCH", lambda v, tick: setattr(v, "pose_frame", tick % 2)),
}


@pytest.mark.parametrize("name", FLAPS)
def test_an_intermittent_input_brakes_as_hard_as_a_missing_one(
    programs: Programs, bus: Observer, sensors: WrongSensors, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reason, flap = FLAPS[name]
    driven(programs, bus)
    bus.wait_samples(50)
    send_state = sensors._send_state
    begin = bus.now()

    def flapping(tick: int) -> None:
        flap(sensors, tick)
        send_state(tick)

    monkeypatch.setattr(sensors, "_send_state", flapping)
    stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON=reason, SAFE_STOP=1, since=begin)
    rest, _ = bus.wait_until("standstill", is_standing, since=stop)
    pairs = bus.pairs(stop, rest)
    assert all(pair.is_stop and pair.is_enabled for pair in pairs)
    assert min(pair.drive["ACCEL_REQUEST"] for pair in pairs) == pytest.approx(-3.0)
    stayed = bus.wait_samples(100)
    assert all(pair.is_stop for pair in bus.pairs(rest, stayed))


def test_a_pose_that_is_repeatedly_invalid_latches_the_stop_until_armed_again(
    programs: Programs, bus: Observer, sensors: WrongSensors
) -> None:
    loop, _ = driven(programs, bus)
    for _ in range(4):
        sensors.pose_valid = False
        stop = bus.wait_samples(5)
        sensors.pose_valid = True
        last = bus.wait_samples(100)
    loop.wait_for_line("the stop is latched")
    bus.wait_until("standstill", is_standing, since=stop)
    held = bus.wait_samples(200)
    assert all(pair.is_stop and pair.is_enabled for pair in bus.pairs(last, held))
    loop.send_signal(signal.SIGUSR1)
    bus.wait_for("driving on", "DRIVE_COMMAND", REASON="NOMINAL", SAFE_STOP=0, since=held)


@pytest.mark.parametrize("gear", [PARK, REVERSE, NEUTRAL])
def test_a_gear_in_which_the_vehicle_cannot_be_driven_stops_it(
    programs: Programs, bus: Observer, sensors: WrongSensors, gear: int
) -> None:
    loop, moving = driven(programs, bus)
    sensors.wrong["GEAR"] = lambda _: float(gear)
    begin = bus.now()
    _, decoded = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_INVALID", SAFE_STOP=1, ENABLE=1, since=begin)
    wrong = next(status for status in bus.record(moving, bus.now()).of("VEHICLE_STATUS") if status["GEAR"] == gear)
    assert decoded.stamp_ns - wrong.stamp_ns <= 230 * MS + SLACK_NS
    bus.wait_until("standstill", is_standing, since=begin)
    loop.send_signal(signal.SIGINT)
    assert loop.wait_for_end() == 4
    assert summary(programs)["disagreements"]["gear and motion disagree"] == 1


def test_frames_delayed_by_300_ms_and_released_together_cause_no_burst_of_commands(
    programs: Programs, bus: Observer, sensors: WrongSensors
) -> None:
    driven(programs, bus)
    begin = bus.wait_samples(40)
    bus.wait_samples(10)
    sensors.is_held_up = True
    time.sleep(HELD_SAMPLES / 100.0)
    sensors.is_held_up = False
    end = bus.wait_samples(HELD_SAMPLES + 80)
    pairs = bus.pairs(begin, end)
    assert reasons(pairs) == ["NOMINAL", "STATE_STALE", "NOMINAL"]
    for window in zip(pairs, pairs[3:], strict=False):
        assert window[1].stamp_ns - window[0].stamp_ns >= 10 * MS
    gaps_ns = [after.stamp_ns - before.stamp_ns for before, after in pairwise(pairs)]
    assert max(gaps_ns[len(gaps_ns) // 2 :]) <= 20 * MS + SLACK_NS


def test_a_flood_of_requests_to_arm_is_logged_once_a_second_and_delays_no_command(
    programs: Programs, bus: Observer, sensors: WrongSensors
) -> None:
    loop, _ = driven(programs, bus)
    begin, begin_s = bus.now(), time.monotonic()
    while time.monotonic() - begin_s < 2.0:
        loop.send_signal(signal.SIGUSR1)
        time.sleep(0.001)
    record = bus.record(begin, bus.wait_samples(10))
    assert len([line for line in loop.lines if "not armed: it drives" in line]) <= 4
    assert {pair.reason for pair in record.pairs if pair.is_enabled} == {"NOMINAL"}
    assert sensors.mode == AUTONOMOUS


def test_a_vehicle_with_an_unconfirmed_speed_is_driven_slowly(
    programs: Programs, bus: Observer, sensors: WrongSensors
) -> None:
    """No acceleration, and a position in the frame of odometry."""
    text = (ROOT / "dbc" / "reference.toml").read_text().replace('accel_mps2 = "CHASSIS.ACCEL"\n', "")
    text = text.replace("ignored = [] ", 'ignored = ["CHASSIS.ACCEL"] ').replace('MAP = "map"', 'MAP = "odom"')
    text = text.replace('dbc = "reference.dbc"', f'dbc = "{ROOT / "dbc" / "reference.dbc"}"')
    profile, path = programs.folder / "odometry.toml", Path(line_file(programs.folder, speed_mps=PATH_MPS, last_s=1e3))
    profile.write_text(text)
    path.write_text("# frame_id: odom\n" + path.read_text())
    fast = programs.run("--arm", "--profile", str(profile), "--trajectory", str(path))
    fast.wait_for_line(r"speed_mps\[0\] = 5: must be in \[-3\.0, 3\.0\]")
    assert fast.wait_for_end() == 2
    path.write_text(path.read_text().replace(",0,0,5.0", ",0,0,3.0"))
    loop, _ = driven(programs, bus, "--profile", str(profile), "--trajectory", str(path))
    bus.wait_samples(300)
    assert 2.5 <= sensors.fastest_mps <= 3.1
    loop.send_signal(signal.SIGINT)
    assert loop.wait_for_end() == 0
