"""The bench without a bus: its catalogue, its vehicle, its own decoding, and that each of its checks can fail."""

import ast
import json
import math
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from bus_contract import AUTONOMOUS, FAULT, MANUAL, MS, READY, REFERENCE, Frame, S, Told
from bus_contract_fd import REFERENCE_FD
from bus_contract_judge import Pair, Record, examine
from hil import bench, bus, cli, expect, faults, judge, routes, run_case
from hil.case import Case, Need, Then
from hil.cases import BESIDE, CATALOGUE, FILES
from hil.device import Commands, Device
from hil.expect import Expectation, Seen
from hil.plant import Plant
from hil.result import CaseResult, Verdict
from hil.rig import Rig, StrangerError
from hil.vehicle import Instant, Vehicle
from hil.wire import ProfileError, Wire
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.profile import load_profile
from vehicle_iface.safety.feasible import refusal
from vehicle_iface.trajectories.csv_file import load_csv

ROOT = Path(__file__).resolve().parents[2]

WIRE = Wire("reference")
PROFILE = load_profile("reference")
NEWS = ("begun", "case_begun", "case_ended", "ended")
NOT_FROM_OUTSIDE = {"T3", "T4", "C1", *(f"W{n}" for n in range(2, 9))}
"""Rows of the catalogue of faults that are inside a controller, or not on a bus."""


def rows() -> set[str]:
    """Every row of the failures' page."""
    page = (ROOT / "vehicle_iface" / "FAILURES.md").read_text()
    return set(re.findall(r"^\| ([BFSTCVPW]\d+) \|", page, re.MULTILINE))


def test_it_shares_no_code_with_the_controller() -> None:
    for path in sorted((ROOT / "tools" / "hil").rglob("*.py")) + sorted((ROOT / "tools").glob("bus_contract*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] in ("vehicle_iface", "viewer", "e2e")], path


def test_every_row_that_can_be_injected_from_outside_has_a_case() -> None:
    covered = {row for case in CATALOGUE for row in case.fault.split()}
    assert covered <= rows()
    assert not rows() - covered - NOT_FROM_OUTSIDE
    assert not covered & NOT_FROM_OUTSIDE


def test_the_catalogue_has_sixty_cases_each_with_a_name_of_its_own_and_something_that_must_be_seen() -> None:
    assert len(CATALOGUE) >= 60
    assert len({case.name for case in CATALOGUE}) == len(CATALOGUE)
    for case in CATALOGUE:
        assert case.see, case.name
        assert case.proves.endswith("."), case.name
        assert case.allow <= set(judge.KINDS), case.name
        assert case.injected or case.inject is None, case.name
        assert Need.REARM in case.needs or case.then is not Then.REARM, case.name
    assert {case.name for case in bench.chosen((), (), quick=True)} < {case.name for case in CATALOGUE}


@pytest.mark.parametrize("case", CATALOGUE, ids=lambda case: case.name)
def test_every_trajectory_is_one_that_the_program_takes_but_those_that_are_spoilt(case: Case, tmp_path: Path) -> None:
    path = case.route().write(tmp_path / "route.csv", case.frame_id)
    refused = refusal(load_csv(path), PROFILE.limits, PROFILE.geometry.wheelbase_m)
    assert bool(refused) == (case.name == "trajectory-too-sharp"), refused
    if case.breaks is not None and not refused:
        assert case.breaks(path.read_text()) != path.read_text()


def test_spoilt_profiles_are_spoilt() -> None:
    toml, dbc = WIRE.path.read_text(), WIRE.dbc.read_text()
    spoilt = [case.profile(toml, dbc) for case in FILES if case.profile is not None]
    assert len(spoilt) >= 4
    assert all(texts != (toml, dbc) for texts in spoilt)


# Its own decoding.


@pytest.mark.parametrize(("wire", "contract"), [(WIRE, REFERENCE), (Wire("reference_fd"), REFERENCE_FD)])
@given(st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None)
def test_frames_are_those_of_the_contracts_page(wire: Wire, contract: object, chance: random.Random) -> None:
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
def test_a_frame_with_one_bit_that_is_wrong_is_not_intact(bit: int, name: str) -> None:
    frame = WIRE.pack(name, 3)
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    assert WIRE.intact(replace(frame, data=bytes(data))) is None
    assert WIRE.intact(WIRE.seal(replace(frame, data=bytes(data)))) is not None
    assert WIRE.intact(WIRE.seal(frame, data_id=0x3F0)) is None


def other_wire(folder: Path, *, profile: tuple[str, str] = ("", ""), dbc: tuple[str, str] = ("", "")) -> Wire:
    """The reference vehicle with a text of its profile, or of its DBC, in place of another."""
    for text, (old, new) in ((WIRE.path.read_text(), profile), (WIRE.dbc.read_text(), dbc)):
        assert old in text
        name = "reference.dbc" if text.startswith("VERSION") else "mine.toml"
        (folder / name).write_text(text.replace(old, new) if old else text)
    return Wire(str(folder / "mine.toml"))


def test_a_profile_that_cannot_be_benched_is_refused_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="no-such"):
        Wire("no-such")
    for spoilt, why in (
        (('accel_mps2 = "DRIVE_COMMAND.ACCEL_REQUEST"', ""), "accel_mps2 is missing"),
        (('data_id_mode = "BOTH"', 'data_id_mode = "ALT"'), "not 1 \\(ALT\\)"),
        (("lateral_jerk_mps3", "# lateral_jerk_mps3"), "lateral_jerk_mps3 is missing"),
        (("stop_jerk_mps3", "# stop_jerk_mps3"), "stop_jerk_mps3 is missing"),
        (("front_wheel_rate_radps = 0.3", ""), "\\[limits.engaging\\] front_wheel_rate_radps is missing"),
    ):
        with pytest.raises(ProfileError, match=why):
            other_wire(tmp_path, profile=spoilt)


# Its vehicle.


class Ride:
    """The bench's vehicle with somebody who commands it, in made-up time."""

    def __init__(self) -> None:
        self.vehicle = Vehicle(WIRE, Plant(wheelbase_m=2.7))
        self.now_ns, self.counter = S, 0

    def pair(
        self, *, enable: float = 1, accel: float = 1.0, wheel: float = 0.0, stop: float = 0, gear: float = 3
    ) -> None:
        self.counter = (self.counter + 1) % 15
        drive = {"ENABLE": enable, "SAFE_STOP": stop, "ACCEL_REQUEST": accel, "GEAR_REQUEST": gear}
        self.say(WIRE.pack("DRIVE_COMMAND", self.counter, **drive))
        self.say(WIRE.pack("STEER_COMMAND", self.counter, ENABLE=enable, FRONT_WHEEL_ANGLE_REQUEST=wheel))

    def say(self, frame: Frame) -> None:
        self.vehicle.hear(frame, self.now_ns)

    def tick(self, count: int = 1, **wish: float) -> None:
        for _ in range(count):
            if wish:
                self.pair(**wish)
            self.vehicle.move(0.01, self.now_ns)
            self.now_ns += 10 * MS


def test_it_engages_with_the_third_intact_pair_and_lets_go_with_enable_0() -> None:
    ride = Ride()
    for _ in range(2):
        ride.pair()
    assert ride.vehicle.mode == READY
    ride.pair()
    assert ride.vehicle.mode == AUTONOMOUS
    ride.pair(enable=0)
    assert ride.vehicle.mode == READY


def test_it_obeys_and_its_watchdog_stops_it_after_100_ms_of_silence() -> None:
    ride = Ride()
    ride.tick(200, accel=2.0)
    assert ride.vehicle.plant.speed_mps == pytest.approx(3.8, abs=0.2)
    ride.tick(10)
    assert ride.vehicle.mode == AUTONOMOUS
    ride.tick(2)
    assert ride.vehicle.mode == FAULT
    ride.tick(200)
    assert ride.vehicle.plant.speed_mps == 0.0


def test_repeated_counters_feed_no_watchdog() -> None:
    ride = Ride()
    ride.tick(50, accel=2.0)
    for _ in range(15):
        ride.say(WIRE.pack("DRIVE_COMMAND", ride.counter, ENABLE=1))
        ride.say(WIRE.pack("STEER_COMMAND", ride.counter, ENABLE=1))
        ride.tick()
    assert ride.vehicle.mode == FAULT


@pytest.mark.parametrize(
    ("attribute", "value"), [("driver_brake", True), ("driver_throttle", True), ("driver_torque_nm", -3.0)]
)
def test_the_driver_has_it_at_once(attribute: str, value: object) -> None:
    ride = Ride()
    ride.tick(20, accel=1.0)
    setattr(ride.vehicle, attribute, value)
    ride.tick(1, accel=1.0)
    assert ride.vehicle.mode == MANUAL
    ride.tick(10, accel=1.0)
    assert ride.vehicle.mode == MANUAL


def test_a_stop_holds_it_and_never_pulls_it_backwards_and_gears_change_only_at_rest() -> None:
    ride = Ride()
    ride.tick(150, accel=2.0)
    ride.tick(20, accel=-3.0, gear=1)
    assert ride.vehicle.gear == 3
    ride.tick(300, accel=-3.0, stop=1, gear=7)
    assert ride.vehicle.plant.speed_mps == 0.0
    assert min(instant.speed_mps for instant in ride.vehicle.history) >= 0.0
    ride.tick(100, accel=-1.0, gear=1)
    assert ride.vehicle.gear == 1
    assert ride.vehicle.plant.speed_mps < -0.5


# What must be seen.


def pair(at_s: float, *, enable: int = 1, stop: int = 0, reason: str = "NOMINAL", accel: float = 0.0) -> Pair:
    number = WIRE.number("REASON", reason)
    values = {"ENABLE": enable, "SAFE_STOP": stop, "REASON": number, "ACCEL_REQUEST": accel}
    drive = WIRE.intact(replace(WIRE.pack("DRIVE_COMMAND", 1, **values), stamp_ns=round(at_s * S)))
    steer = WIRE.intact(replace(WIRE.pack("STEER_COMMAND", 1, ENABLE=enable), stamp_ns=round(at_s * S)))
    assert drive is not None
    assert steer is not None
    return Pair(drive, steer)


def seen(*pairs: Pair, samples: Sequence[float] = (), history: Sequence[Instant] = (), status: int | None = 0) -> Seen:
    """A case of 10 s, with something injected from 5 s to 6 s, and the operator at 8 s."""
    return Seen(
        begin_ns=0,
        inject_ns=5 * S,
        end_ns=6 * S,
        then_ns=8 * S,
        samples_ns=[round(at_s * S) for at_s in samples],
        pairs=pairs,
        told=[pair.drive for pair in pairs],
        frames=[Frame(pair.stamp_ns, 0x080, b"") for pair in pairs],
        history=history,
        exit_status=status,
        exit_ns=9 * S,
        route=routes.straight(7.0),
    )


def steady(begin_s: float, end_s: float, make: Callable[[float], Pair] = pair) -> list[Pair]:
    return [make(begin_s + 0.01 * i) for i in range(round((end_s - begin_s) / 0.01))]


def stop(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="STATE_STALE", accel=-3.0)


def released(at_s: float) -> Pair:
    return pair(at_s, enable=0, reason="DRIVER_OVERRIDE")


def at(at_s: float, speed_mps: float, mode: int = AUTONOMOUS, x_m: float = 7.0) -> Instant:
    return Instant(round(at_s * S), x_m, 0.0, 0.0, speed_mps, 0.0, 0.0, mode)


def lit(at_s: float, on: int = 1) -> Told:
    told = WIRE.intact(replace(WIRE.pack("BODY_COMMAND", 1, HAZARD_LIGHTS=on), stamp_ns=round(at_s * S)))
    assert told is not None
    return told


def ended(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="PAST_END_SPACE")


def out_of_time(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="PAST_END_TIME")


DRIVES, STOPS, SILENT = [*steady(0, 10)], [*steady(0, 5.06), *steady(5.06, 6, stop), *steady(6, 10)], [*steady(0, 5.05)]
EIGHTH_MISSING = [pair for number, pair in enumerate(DRIVES) if number % 8]
HISTORY = [at(tick / 100, 3.0) for tick in range(1000)]
LETS_GO = [*steady(0, 5.02), *steady(5.02, 8, released), *steady(8, 10)]
JUDGED: list[tuple[Expectation, Seen, Seen]] = [
    (expect.Stops(("STATE_STALE",)), seen(*STOPS), seen(*DRIVES)),
    (expect.Stops(("STATE_STALE",)), seen(*STOPS), seen(*steady(0, 5.3), *steady(5.3, 6, stop))),
    (expect.Stops(("STATE_STALE",)), seen(*STOPS), seen(*steady(0, 5.06), *steady(5.06, 5.5, stop), *steady(5.5, 6))),
    (expect.Stops(("STATE_STALE",)), seen(*STOPS), seen(*LETS_GO)),
    (expect.Stops(("STATE_STALE",)), seen(*STOPS), seen(*steady(0, 5.06), *steady(5.06, 5.5, stop), released(5.5))),
    (expect.Answers(0.7, 0.95), seen(*EIGHTH_MISSING, history=HISTORY), seen(*DRIVES, history=HISTORY)),
    (expect.Answers(0.7, 1.0), seen(*DRIVES, history=HISTORY), seen(*DRIVES, *DRIVES[::9], history=HISTORY)),
    (expect.Answers(0.7, 1.0), seen(*DRIVES, history=HISTORY), seen(*steady(0, 10, stop), history=HISTORY)),
    (expect.Answers(0.7, 1.0), seen(*DRIVES, history=HISTORY), seen(*DRIVES)),
    (expect.FallsSilent(), seen(*SILENT), seen(*DRIVES)),
    (expect.FallsSilent(), seen(*SILENT), seen(*SILENT, pair(7.0))),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.06), seen(*LETS_GO), seen(*DRIVES)),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.06), seen(*LETS_GO), seen(*LETS_GO[:600], pair(7.5))),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.01), seen(*steady(5, 8, released)), seen(*LETS_GO)),
    (expect.DrivesOn(), seen(*DRIVES), seen(*STOPS)),
    (expect.DrivesOn(), seen(*DRIVES), seen()),
    (expect.MomentaryAtMost(("STATE_STALE",), 0.2), seen(*DRIVES, stop(5.5)), seen(*STOPS)),
    (expect.MomentaryAtMost(("STATE_STALE",), 0.2), seen(*DRIVES), seen(*LETS_GO)),
    (expect.Standstill(2.0), seen(history=[at(5.5, 1.0), at(6.5, 0.0)]), seen(history=[at(7.5, 0.0)])),
    (expect.Standstill(2.0), seen(history=[at(6.5, 0.0)]), seen(history=[at(6.5, 1.0)])),
    (expect.NeverEnables(), seen(*steady(0, 8, released)), seen(*steady(0, 5, released), pair(5.5))),
    (expect.NeverEnables(at_all=True), seen(), seen(released(3.0))),
    (expect.HazardLights(), replace(seen(), told=[lit(5.3)]), replace(seen(), told=[lit(4.0), lit(5.6)])),
    (expect.HazardLights(), replace(seen(), told=[lit(5.3)]), replace(seen(), told=[lit(5.3, on=0)])),
    (expect.StaysOut(), seen(*SILENT), seen(*SILENT, pair(7.0))),
    (expect.StaysOut(), seen(*SILENT, pair(6.001)), seen(*SILENT, pair(6.001), pair(6.002))),
    (expect.DrivesOn(), seen(*DRIVES), seen(*steady(0, 5.3), *steady(5.42, 10))),
    (expect.DrivesOn(), seen(*DRIVES), seen(*steady(0, 5.3))),
    (expect.DrivesOn(), seen(*DRIVES), seen(*steady(5.3, 10))),
    (expect.GivesUp(3.0), seen(*steady(1, 4)), seen(*steady(1, 7.9))),
    (expect.GivesUp(3.0), seen(*steady(1, 4)), seen(*steady(1, 2))),
    (expect.GivesUp(3.0), seen(*steady(1, 4)), seen()),
    (expect.Refuses(2), seen(status=2), seen(status=0)),
    (expect.Refuses(2), seen(status=2), seen(released(2.0), status=2)),
    (expect.Refuses(2), seen(status=2), seen(status=None)),
    (expect.Ends((0,), 5.0), seen(), seen(status=4)),
    (expect.Ends((0,), 5.0), seen(), seen(status=None)),
    (expect.Ends((-9,), 5.0), seen(status=-9), replace(seen(status=-9), exit_ns=11 * S)),
    (expect.EndsOrderly(), seen(*steady(5, 7, stop), released(7.0)), seen(*steady(5, 7, stop))),
    (expect.EndsOrderly(), seen(*steady(5, 7, stop), released(7.0)), seen(*steady(5, 7), released(7.0))),
    (
        expect.EndsOrderly(),
        seen(*steady(5, 7, stop), released(7.0), history=[at(7.1, 0.0)]),
        seen(*steady(5, 7, stop), released(7.0), history=[at(7.1, 2.0)]),
    ),
    (expect.WatchdogActs(), seen(history=[at(5.1, 3.0, FAULT)]), seen(history=[at(5.5, 3.0, FAULT)])),
    (expect.WatchdogActs(), seen(history=[at(5.1, 3.0, FAULT)]), seen(history=[at(5.1, 3.0)])),
    (
        expect.ReachesEnd(),
        seen(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        seen(*steady(0, 7), stop(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
    ),
    (
        expect.ReachesEnd(),
        seen(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        seen(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 1.0)]),
    ),
    (
        expect.ReachesEnd(),
        seen(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        seen(*steady(0, 1), *steady(1, 8, ended), history=[at(0.9, 0.0, x_m=0.0), at(7.5, 0.0, x_m=0.0)]),
    ),
    (
        expect.ReachesEnd(("PAST_END_TIME",)),
        replace(
            seen(*steady(0, 7), *steady(7, 8, out_of_time), history=[at(1.0, 0.0), at(7.5, 0.0)]),
            route=replace(routes.straight(7.0), time_s=[0.0, 6.0]),
        ),
        replace(
            seen(*steady(0, 3), *steady(3, 8, out_of_time), history=[at(1.0, 0.0), at(7.5, 0.0)]),
            route=replace(routes.straight(7.0), time_s=[0.0, 6.0]),
        ),
    ),
    (
        expect.FollowsGaps(),
        seen(*steady(5.001, 5.101), *steady(5.121, 6), samples=[5.08, 5.09, 5.1 - 0.0005, 5.12, 5.13]),
        seen(*steady(5.001, 5.131), *steady(5.151, 6), samples=[5.08, 5.09, 5.1 - 0.0005, 5.12, 5.13]),
    ),
    (
        expect.FollowsGaps(),
        seen(*steady(5.001, 5.09), samples=[5.08, 5.1 - 0.0005]),
        seen(*DRIVES, samples=[5.1, 5.11]),
    ),
]


@pytest.mark.parametrize(
    ("expectation", "right", "wrong"), JUDGED, ids=[f"{type(row[0]).__name__}-{i}" for i, row in enumerate(JUDGED)]
)
def test_what_must_be_seen_passes_where_it_is_there_and_fails_where_it_is_not(
    expectation: Expectation, right: Seen, wrong: Seen
) -> None:
    passed, _ = expectation.judge(right)
    failed, _ = expectation.judge(wrong)
    assert (passed.verdict, failed.verdict) == (Verdict.PASS, Verdict.FAIL), (passed, failed)
    assert failed.found


def test_every_expectation_of_the_catalogue_is_judged_here() -> None:
    assert {type(e) for case in CATALOGUE for e in case.see} == {type(row[0]) for row in JUDGED}


# What must never be seen.

Values = dict[str, float]
Lie = Callable[[str, int, Values], Sequence[Values]]
"""Message, tick, what is true → what is said: nothing, once, several times."""
SPEED_MPS = 8.0
STOPPED_FROM = 200
"""Tick from which the made-up device stops."""


def truth(_name: str, _tick: int, values: Values) -> Sequence[Values]:
    return [values]


def lie(name: str, change: Callable[[int, Values], Sequence[Values]]) -> Lie:
    return lambda said, tick, values: change(tick, values) if said == name else [values]


def with_value(name: str, from_tick: int = 0, **wrong: float) -> Lie:
    return lie(name, lambda tick, values: [values | wrong if tick >= from_tick else values])


def steered(angle_rad: Callable[[int], float], speed_mps: Callable[[int], float] = lambda _: SPEED_MPS) -> Lie:
    """Front wheels at a speed, both by the tick."""
    of = {
        "MOTION": lambda tick: {"SPEED": speed_mps(tick)},
        "STEER_COMMAND": lambda tick: {"FRONT_WHEEL_ANGLE_REQUEST": angle_rad(tick)},
    }
    return lambda name, tick, values: [values | of[name](tick) if name in of else values]


def led_back(to_rad: float) -> Lie:
    """Into a curve at 6 m/s, which then is 9 m/s, where the wheels may not be beyond 0.1 rad."""
    return steered(
        lambda tick: 0.0037 * min(54, tick) if tick < 100 else max(to_rad, 0.1998 - 0.0079 * (tick - 99)),
        lambda tick: 6.0 if tick < 100 else 9.0,
    )


def ready(wrong: Mapping[str, Callable[[int], Values]]) -> Lie:
    """To a vehicle that is not autonomous yet."""
    of = {"VEHICLE_STATUS": lambda _: {"MODE": READY}, **wrong}
    return lambda name, tick, values: [values | of[name](tick) if name in of else values]


def judged(tell: Lie, *, case: Case = CATALOGUE[0], wire: Wire = WIRE) -> dict[str, Verdict]:
    """Four seconds of commands at 8 m/s, a stop from the second one on; the verdict of each kind."""
    counters: dict[str, int] = {}
    frames = []

    def say(at_s: float, name: str, tick: int, **values: float) -> None:
        for told in tell(name, tick, values):
            counters[name] = counters.get(name, -1) + 1
            frame = wire.pack(name, counters[name] % 15, **told)
            frames.append(replace(frame, stamp_ns=S + round(at_s * S) + len(frames)))

    for tick in range(400):
        at_s, is_stop = tick / 100, tick >= STOPPED_FROM
        number = wire.number("REASON", "STATE_INVALID" if is_stop else "NOMINAL")
        for name in wire.sample:
            say(at_s, name, tick, **({"SPEED": SPEED_MPS} if name == "MOTION" else {}))
        braked = max(-3.0, -0.3 * (tick - STOPPED_FROM + 1)) * is_stop
        drive = {"ENABLE": 1, "SAFE_STOP": is_stop, "REASON": number, "ACCEL_REQUEST": braked, "GEAR_REQUEST": 7}
        if tick % 2 == 0:
            say(at_s, "VEHICLE_STATUS", tick, MODE=AUTONOMOUS)
        say(at_s + 0.001, "DRIVE_COMMAND", tick, **drive)
        say(at_s + 0.001, "STEER_COMMAND", tick, ENABLE=1)
        if tick % 10 == 0:
            say(at_s + 0.002, "BODY_COMMAND", tick, HAZARD_LIGHTS=is_stop)
            say(at_s + 0.002, "CONTROLLER_STATUS", tick, STATE=4 if is_stop else 3, REASON=number)
    record = judge.examine(frames, wire)
    history = [at(1.0 + tick / 100, SPEED_MPS) for tick in range(400)]
    rig = SimpleNamespace(wire=wire, touched_ns=0, healthy_ns=0)
    checks = judge.protocol(case, rig, record, seen(history=history))  # type: ignore[arg-type]
    return {kind: check.verdict for kind, check in zip(judge.KINDS, checks, strict=True)}


LIES: dict[str, tuple[str, Lie]] = {
    "a stop that never brakes": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=0.0)),
    "a stop with a third of the brake": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=-1.0)),
    "a stop that lets the brake go": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM + 60, ACCEL_REQUEST=-1.0)),
    "a stop that brakes too hard": ("dynamics", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=-5.0)),
    "a stop that brakes at once": ("dynamics", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=-3.0)),
    "drive that sets in at once": ("dynamics", with_value("DRIVE_COMMAND", 150, ACCEL_REQUEST=2.0)),
    "drive that sets in twice as fast": (
        "dynamics",
        lie("DRIVE_COMMAND", lambda tick, v: [v | {"ACCEL_REQUEST": min(2.5, max(0.0, 0.6 * (tick - 150)))}]),
    ),
    "hard drive while it engages": ("dynamics", ready({"DRIVE_COMMAND": lambda _: {"ACCEL_REQUEST": 1.2}})),
    "drive that stays hard while it engages": ("dynamics", ready({"DRIVE_COMMAND": lambda _: {"ACCEL_REQUEST": 1.5}})),
    "wheels that turn while it engages": (
        "dynamics",
        ready({"STEER_COMMAND": lambda tick: {"FRONT_WHEEL_ANGLE_REQUEST": min(0.1, 0.006 * tick)}}),
    ),
    "a curve too tight for 8 m/s": ("dynamics", with_value("STEER_COMMAND", FRONT_WHEEL_ANGLE_REQUEST=0.19)),
    "a swerve within the wheels' rate": ("dynamics", steered(lambda tick: min(0.1, max(0.0, 0.0079 * (tick - 100))))),
    "a swerve of twice the jerk": ("dynamics", steered(lambda tick: -min(0.1, max(0.0, 0.0042 * (tick - 100))))),
    "wheels that come back from a swerve too far": ("dynamics", led_back(0.0)),
    "wheels led away from hanging ones": ("dynamics", steered(lambda tick: min(0.32, 0.005 * tick), lambda _: 0.5)),
    "wheels that are elsewhere from the beginning": ("dynamics", steered(lambda _: 0.5, lambda _: 0.5)),
    "wheels that begin a little elsewhere": ("dynamics", steered(lambda _: 0.08)),
    "a swerve at the lateral limit": ("dynamics", steered(lambda tick: 0.126 if tick < 150 else 0.0)),
    "rear wheels that it has not": ("dynamics", with_value("STEER_COMMAND", REAR_WHEEL_ANGLE_REQUEST=0.05)),
    "a speed beyond every limit": ("dynamics", with_value("DRIVE_COMMAND", SPEED_REQUEST=90.0)),
    "no lights at all": ("periods", lie("BODY_COMMAND", lambda *_: [])),
    "lights every half second": ("periods", lie("BODY_COMMAND", lambda tick, v: [] if tick % 50 else [v])),
    "no report at all": ("periods", lie("CONTROLLER_STATUS", lambda *_: [])),
    "reports ten times as often": ("periods", lie("CONTROLLER_STATUS", lambda _, values: [values] * 10)),
    "a report that all is well": ("periods", with_value("CONTROLLER_STATUS", REASON=0)),
    "lights that stay off": ("command", with_value("BODY_COMMAND", HAZARD_LIGHTS=0)),
    "half of a pair that lets go": ("command", with_value("STEER_COMMAND", 150, ENABLE=0)),
    "another gear at speed": ("command", with_value("DRIVE_COMMAND", 150, GEAR_REQUEST=3)),
    "every command twice": ("burst", lie("DRIVE_COMMAND", lambda _, values: [values, values])),
    "a burst of thirty": ("burst", lie("DRIVE_COMMAND", lambda tick, v: [v] * (30 if tick == 150 else 1))),
    "every other sample answered": (
        "unanswered",
        lambda name, tick, values: [] if tick % 2 and name in WIRE.command else [values],
    ),
}


def test_a_device_that_says_the_truth_has_nothing_against_it() -> None:
    assert set(judged(truth).values()) == {Verdict.PASS}
    brakes_meanwhile = ready({"DRIVE_COMMAND": lambda tick: {"ACCEL_REQUEST": -1.5} if tick < STOPPED_FROM else {}})
    assert judged(brakes_meanwhile)["dynamics"] is Verdict.PASS


@pytest.mark.parametrize(
    "tell",
    [
        steered(lambda tick: 0.0021 * min(50, max(0, tick - 100))),
        led_back(0.097),
        steered(lambda tick: min(0.3, 0.005 * tick), lambda _: 0.5),
    ],
    ids=["by the lateral jerk", "back by their own rate", "from where they are measured"],
)
def test_wheels_that_go_as_far_as_they_may_have_nothing_against_them(tell: Lie) -> None:
    assert judged(tell)["dynamics"] is Verdict.PASS


@pytest.mark.parametrize("name", LIES)
def test_a_lie_is_found_by_the_kind_that_is_there_for_it(name: str) -> None:
    kind, tell = LIES[name]
    assert judged(tell)[kind] is Verdict.FAIL


def test_wheels_that_the_device_is_not_told_are_not_compared(tmp_path: Path) -> None:
    line = 'front_wheel_angle_rad = "CHASSIS.FRONT_WHEEL_ANGLE"'
    wire = other_wire(tmp_path, profile=(line, ""))
    hang = steered(lambda tick: min(0.5, 0.005 * tick), lambda _: 0.5)
    assert (judged(hang)["dynamics"], judged(hang, wire=wire)["dynamics"]) == (Verdict.FAIL, Verdict.PASS)


def test_wheels_that_turn_by_coarse_counts_do_not_swerve(tmp_path: Path) -> None:
    fine = re.search(r"SG_ FRONT_WHEEL_ANGLE_REQUEST : .*", WIRE.dbc.read_text())
    assert fine is not None
    wire = other_wire(tmp_path, dbc=(fine[0], fine[0].replace("(0.0001,0)", "(0.01,0)")))
    assert (WIRE.wheel_count_rad, wire.wheel_count_rad) == (0.002, 0.01)
    by_counts = steered(lambda tick: 0.01 * min(5, max(0, tick - 100) // 5))
    assert (judged(by_counts)["dynamics"], judged(by_counts, wire=wire)["dynamics"]) == (Verdict.FAIL, Verdict.PASS)


def test_what_a_bad_cable_left_owing_is_no_finding_and_more_than_that_is() -> None:
    rig = SimpleNamespace(wire=WIRE, touched_ns=S, healthy_ns=0)
    for count, verdict in ((10, Verdict.PASS), (11, Verdict.FAIL)):
        record = Record(unanswered=[f"sample at {9.0 + i / 100:.3f} s" for i in range(count)])
        checks = judge.protocol(named("cable-loses-5-percent"), rig, record, seen())  # type: ignore[arg-type]
        assert {check.text: check.verdict for check in checks}[judge.KINDS["unanswered"]] is verdict


def named(name: str) -> Case:
    return next(case for case in CATALOGUE if case.name == name)


@pytest.mark.parametrize("share_of_it", [0.1, 1.0])
def test_a_load_that_was_not_there_was_not_borne(share_of_it: float, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(faults.time, "monotonic", lambda: now_s[0])
    per_second = 0.9 * 500_000 / faults.STRANGERS_BITS
    rig = SimpleNamespace(
        wire=WIRE,
        heard=[],
        bus=SimpleNamespace(channel="vcan9", packets=lambda: round(now_s[0] * per_second * share_of_it)),
        **dict.fromkeys(("beside", "run_for", "injects", "rest"), lambda *_: None),
    )
    inject = faults.load(0.9)(rig)  # type: ignore[arg-type]
    with nullcontext() if share_of_it > 0.5 else pytest.raises(OSError, match="were on the bus"), inject:
        now_s[0] += 2.0


def test_an_injection_into_a_vehicle_that_is_not_driven_is_no_pass() -> None:
    rig = SimpleNamespace(touched_ns=5 * S)
    for name, instants in (
        ("state-lost-at-speed", [at(4.9, 3.0)]),
        ("state-lost", [at(4.9, 3.0, READY)]),
        ("state-lost", []),
    ):
        checks = judge.prepared(named(name), seen(history=instants), rig)  # type: ignore[arg-type]
        assert [check.verdict for check in checks] == [Verdict.FAIL], name
    good = judge.prepared(named("state-lost"), seen(history=[at(4.9, 2.5)]), rig)  # type: ignore[arg-type]
    assert [check.verdict for check in good] == [Verdict.PASS]


def test_health_is_to_move_to_hold_and_to_live_until_told() -> None:
    rig = SimpleNamespace(healthy_ns=9 * S)
    drives, holds, waits = named("half-the-rate"), named("rolling-back"), named("not-armed")
    moves, stands = [at(7.9, 2.0)], [at(7.9, 0.0)]
    for case, sound, broken in (
        (drives, seen(*DRIVES, history=moves), seen(*DRIVES, history=stands)),
        (holds, seen(*steady(5, 8, stop)), seen(*steady(5, 7.9, stop), *steady(7.9, 8))),
        (holds, seen(*steady(5, 8, stop)), seen()),
        (waits, seen(), replace(seen(), exit_ns=3 * S)),
    ):
        for found, verdict in ((sound, Verdict.PASS), (broken, Verdict.FAIL)):
            checks = judge.health(case, found, rig, [])  # type: ignore[arg-type]
            assert (verdict is Verdict.FAIL) == any(check.verdict is Verdict.FAIL for check in checks), case.name


def test_a_late_bench_excuses_what_was_late_and_nothing_else() -> None:
    late, wrong, *rates = (
        expect.check("a stop", ["no such stop"]),
        expect.check(judge.KINDS["command"], ["3.100 s: ENABLE 1 and 0 in one pair"]),
        expect.check(judge.KINDS["command"], ["3.100 s: wheels faster than 0.8 rad/s"]),
        expect.check(judge.KINDS["dynamics"], ["3.100 s: a swerve at 8.00 m/s, wheels to 0.1000 rad"]),
    )
    assert judge.certain([late, wrong]) == [wrong]
    assert judge.certain([late, *rates]) == []


def test_a_driver_who_lets_go_again_leaves_a_vehicle_that_is_ready() -> None:
    ride = Ride()
    ride.tick(20, accel=1.0)
    rig = SimpleNamespace(vehicle=ride.vehicle)
    inject = named("driver-lets-go-again").inject
    assert inject is not None
    with inject(rig):  # type: ignore[arg-type]
        ride.tick(2, accel=1.0)
        assert ride.vehicle.mode == MANUAL
    ride.tick(2)
    assert ride.vehicle.mode == READY
    assert not ride.vehicle.driver_brake


@given(st.lists(st.floats(0.0, 1e4), min_size=1, max_size=300))
def test_a_distribution_counts_everything_once_and_its_quantiles_are_measurements(values: list[float]) -> None:
    found = judge.distribution("x", values)
    assert sum(found.counts) == found.count == len(values)
    assert len(found.edges) == len(found.counts) + 1
    assert found.p50 <= found.p95 <= found.p99 <= found.max == pytest.approx(max(values), abs=1e-4)


# The bench as a whole.


def test_a_case_that_lacks_something_says_what() -> None:
    everywhere = Commands(start="")
    own = Commands()
    for case in CATALOGUE:
        why = bench.missing(case, everywhere, "no-such-interface", case.route().name)
        of_device = {Need.OWN_PROCESS, Need.START, Need.REARM} & set(case.needs)
        assert not (of_device or case.breaks or case.profile or case.setup) or why, case.name
        assert not why or case.needs or case.setup, case.name
    assert "drives the route straight-400-m-at-5" in bench.missing(
        next(case for case in CATALOGUE if case.name == "half-the-rate"), everywhere, "no-such-interface", "u-turn"
    )
    door = Commands(start="ssh bench2 run", is_here=False, rearm="ssh bench2 rearm")
    killed = next(case for case in CATALOGUE if case.name == "killed")
    assert "on this computer" in bench.missing(killed, door, "no-such-interface")
    assert not bench.missing(killed, own, "no-such-interface")
    stubborn = Commands(start="my-loop --channel {channel}")
    spoilt = {case.name: bench.missing(case, stubborn, "no-such-interface") for case in FILES}
    assert all("started with {profile}" in why for name, why in spoilt.items() if name.startswith("profile-"))
    assert "started with {trajectory}" in spoilt["trajectory-with-nan"]
    plain = Commands(start="my-loop --channel {channel}", record="", view="")
    beside = {case.name: bench.missing(case, plain, "no-such-interface") for case in BESIDE}
    assert sum("--recording-device" in why for name, why in beside.items() if name.startswith("recorder-")) == 3
    assert sum("--viewer" in why for name, why in beside.items() if name.startswith("viewer-")) == 3
    absent = next(case for case in CATALOGUE if case.name == "link-absent-at-start")
    assert "started with {channel}" in bench.missing(absent, Commands(start="my-loop"), "no-such-interface")


def test_a_device_can_be_given_many_descriptors_and_no_more_memory(tmp_path: Path) -> None:
    grows = "import os, time; print(os.open('/', 0), flush=True); time.sleep(0.5); bytearray(1 << 28)"
    starved, fed = (
        Device(Commands(start=f'{sys.executable} -c "{grows}"'), tmp_path / name, {}, lambda _: None)
        for name in ("starved", "fed")
    )
    for device in (starved, fed):
        device.start(open_files=1100)
    while not (starved.log.read_text() and fed.log.read_text()):
        time.sleep(0.01)
    with starved.without_memory():
        while starved.poll() is None or fed.poll() is None:
            time.sleep(0.01)
    assert (starved.status, fed.status) == (1, 0)
    assert "MemoryError" in starved.log.read_text()
    assert int(fed.log.read_text()) > 1100
    with starved.without_memory():
        pass  # one that has ended is judged for that, and is no mistake of the bench's


def test_who_writes_the_drive_down_is_found_behind_whatever_began_it_and_is_nobody_else_when_it_is_gone(
    tmp_path: Path,
) -> None:
    place = tmp_path / "disk"
    place.mkdir()
    command = f"sh -c 'sleep 60 & sleep 60 > {place}/drive & wait'"
    device = Device(Commands(start=command), tmp_path / "log", {}, lambda _: None)
    assert device.writers(place) == []
    device.start()
    try:
        while not (found := device.writers(place)):
            assert device.poll() is None
        (writer,) = found
        assert writer.lives
        writer.send(signal.SIGKILL)
        while writer.lives:
            time.sleep(0.01)
        writer.send(signal.SIGKILL)  # to nobody
        writer.close()
        assert device.writers(place) == []
        assert device.poll() is None
    finally:
        device.kill()
    assert device.writers(place) == []


def test_pages_that_are_turned_away_come_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        pages = subprocess.Popen([sys.executable, "tools/hil/pages.py", str(port)], cwd=ROOT)
        try:
            for number in range(30):
                page, _ = server.accept()
                if number % 2:
                    page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    page.close()  # by a reset
                else:
                    assert page.recv(4) == b"GET "
                    page.close()
            assert pages.poll() is None
        finally:
            pages.kill()
            pages.wait()


def test_a_wall_clock_is_put_back_whatever_is_heard_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[float] = []
    monkeypatch.setattr(faults.time, "clock_settime", lambda _, to_s: steps.append(round(to_s - time.time())))
    heard = iter([None, StrangerError("somebody else says POSE")])

    def hear_answers() -> None:
        if error := next(heard):
            raise error

    with pytest.raises(StrangerError), faults.wall_clock(60.0)(SimpleNamespace(hear_answers=hear_answers)):  # type: ignore[arg-type]
        assert steps == [60]
    assert steps == [60, -60]


@pytest.mark.parametrize(
    ("kind", "is_virtual"), [("vcan addrgenmode", True), ("vxcan addrgenmode", True), ("slcan x", False), ("", False)]
)
def test_an_interface_has_a_wire_unless_it_is_known_to_have_none(
    kind: str, is_virtual: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = f"3: can7: <NOARP,UP> mtu 16\n    link/can  promiscuity 0 \n    {kind}\n"
    done = subprocess.CompletedProcess([], 0, said, "")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    assert bus.is_virtual("can7") is is_virtual


@pytest.mark.parametrize("name", ["BODY_COMMAND", "CONTROLLER_STATUS", "DRIVE_COMMAND", "POSE"])
def test_a_device_that_is_there_may_report_but_command_nobody(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    heard = bus.Heard(WIRE.pack(name, 3), False, 0)
    monkeypatch.setattr(bench, "Bus", lambda *_: SimpleNamespace(drain=lambda: [heard], close=lambda: None))
    monkeypatch.setattr(bench, "LISTEN_S", 0.02)
    assert bench.traffic("vcan9", WIRE)
    reports = name in ("BODY_COMMAND", "CONTROLLER_STATUS")
    assert bool(bench.traffic("vcan9", WIRE, device_is_there=True)) is not reports


def test_beside_another_vehicle_it_falls_silent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rig = Rig.__new__(Rig)
    rig.wire, rig.vehicle_speaks, rig.every_tick, rig.heard = WIRE, True, [lambda: None], []
    rig._device_ids = {WIRE.ids["DRIVE_COMMAND"]}
    pose, told = WIRE.pack("POSE", 3), WIRE.pack("DRIVE_COMMAND", 3)
    rig.vehicle = Vehicle(WIRE, Plant(wheelbase_m=2.7))
    rig.bus = SimpleNamespace(drain=lambda: heard)  # type: ignore[assignment]
    heard = [bus.Heard(pose, True, 0), bus.Heard(told, False, 0), bus.Heard(replace(pose, data=bytes(8)), False, 0)]
    rig._drain(0)
    heard = [bus.Heard(pose, False, 0)]
    with pytest.raises(StrangerError, match="POSE"):
        rig._drain(0)
    assert not rig.vehicle_speaks
    assert not rig.every_tick
    rig._drain(0)  # so that the device can still be ended

    def run(*_: object) -> None:
        raise StrangerError("somebody else says POSE")

    monkeypatch.setattr(run_case, "run", run)
    what = run_case.Bench(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    plan = bench.Plan(bench=what, cases=FILES[:3])
    found = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [Verdict.FAIL, Verdict.NOT_EXECUTED, Verdict.NOT_EXECUTED]
    assert all("fallen silent" in case.why for case in found.cases)


def test_what_it_injects_ends_in_silence_when_somebody_else_speaks() -> None:
    def falls_silent(rig: SimpleNamespace) -> None:
        rig.vehicle_speaks = False
        rig.every_tick.clear()
        raise StrangerError("somebody else says POSE")

    for injection in (faults.flood(faults.rival_command, 2), faults.replayed(1.0), faults.skips(6, every=10)):
        rig = SimpleNamespace(heard=[], every_tick=[], vehicle_speaks=True)
        with pytest.raises(StrangerError), injection(rig):  # type: ignore[arg-type]
            falls_silent(rig)
        assert not rig.every_tick
        assert not rig.vehicle_speaks


def test_a_mistake_of_the_benchs_own_costs_one_case(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def run(which: run_case.Bench, case: Case, repetition: int) -> CaseResult:
        if case is FILES[1]:
            raise ZeroDivisionError("in the bench")
        return run_case.unjudged(which, case, repetition, "", Verdict.PASS)

    monkeypatch.setattr(run_case, "run", run)
    what = run_case.Bench(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    found = bench.run(bench.Plan(bench=what, cases=FILES[:3]), SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [Verdict.PASS, Verdict.NOT_EXECUTED, Verdict.PASS]
    assert "ZeroDivisionError('in the bench')" in found.cases[1].why


@pytest.mark.parametrize(("first", "verdict"), [(Verdict.PASS, Verdict.NOT_EXECUTED), (Verdict.FAIL, Verdict.FAIL)])
def test_an_interrupted_run_keeps_what_it_found_and_never_passes(
    first: Verdict, verdict: Verdict, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(which: run_case.Bench, case: Case, repetition: int) -> CaseResult:
        if repetition == 2:
            raise KeyboardInterrupt
        return run_case.unjudged(which, case, repetition, "", first)

    monkeypatch.setattr(run_case, "run", run)
    what = run_case.Bench(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    plan = bench.Plan(bench=what, cases=FILES[:3], repeat=4)
    found = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [first, Verdict.NOT_EXECUTED]
    assert found.interrupted == "interrupted in case 2 of 12"
    assert found.verdict is verdict


def test_the_command_line_refuses_what_it_does_not_know(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "index.html").write_text("")
    for arguments, why in (
        (["--channel", "vcan9", "--out", str(tmp_path / "old")], "is not empty"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--case", "no-such"], "no such case or tag: no-such"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--compare", "no.json"], "--compare no.json"),
        (["--out", str(tmp_path / "new")], "--channel and --out"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--device", "sh -c 'x"], "--device: No closing quot"),
        (["--channel", "vcan9", "--out", str(tmp_path / "new"), "--rearm", "x ${A}"], "--rearm: {A} is not known"),
    ):
        assert cli.main(arguments) == cli.BAD_USAGE
        assert why in capsys.readouterr().err


def test_every_option_of_the_guide_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    known = set(re.findall(r"--[a-z][a-z-]+", capsys.readouterr().out))
    used = set(re.findall(r"--[a-z][a-z-]+", (ROOT / "docs" / "bench.md").read_text(encoding="utf-8")))
    of_the_controllers = {"--arm", "--trajectory", "--speed-cap", "--show"}
    assert of_the_controllers < used
    assert used <= known | of_the_controllers


def test_the_list_names_every_case_and_what_it_proves(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--list", "--json"]) == cli.PASSED
    listed = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in listed] == [case.name for case in CATALOGUE]
    assert cli.main(["--list"]) == cli.PASSED
    text = capsys.readouterr().out
    assert all(case.name in text and case.proves in text for case in CATALOGUE)


def test_routes_begin_at_the_origin_along_x_and_their_time_grows() -> None:
    for make in (routes.step, routes.slalom, routes.double_lane_change, routes.stop_and_go, routes.reverse_bay):
        route = make()
        assert (route.x_m[0], route.y_m[0], route.heading_rad[0]) == (0.0, 0.0, 0.0)
        assert all(b > a for a, b in zip(route.time_s, route.time_s[1:], strict=False))
        for i in range(1, len(route.x_m)):
            step_m = math.hypot(route.x_m[i] - route.x_m[i - 1], route.y_m[i] - route.y_m[i - 1])
            assert 0.0 <= step_m < 0.6


@pytest.mark.parametrize("order", [("DRIVE_COMMAND", "STEER_COMMAND"), ("STEER_COMMAND", "DRIVE_COMMAND")])
@pytest.mark.parametrize("missing", [(20, 0), (20, 1)])
def test_a_half_that_was_lost_makes_one_pair_too_few_and_none_wrong(
    order: tuple[str, str], missing: tuple[int, int]
) -> None:
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


def test_a_record_that_begins_within_a_pair_begins_with_the_next_one() -> None:
    frames = [
        replace(WIRE.pack(name, tick % 15), stamp_ns=S + tick * 10 * MS + half * MS)
        for tick in range(60)
        for half, name in enumerate(WIRE.command)
    ][1:]
    record = examine(frames, WIRE)
    assert len(record.pairs) == 59
    assert not [text for text in record.doubled if "alone" in text]


def test_a_vehicle_without_lights_and_report_can_be_benched(tmp_path: Path) -> None:
    (tmp_path / "reference.dbc").write_text(WIRE.dbc.read_text())
    (tmp_path / "plain.toml").write_text(WIRE.path.read_text().partition("[body.signals]")[0])
    wire = Wire(str(tmp_path / "plain.toml"))
    assert set(wire.ids) == set(WIRE.ids) - {"BODY_COMMAND", "CONTROLLER_STATUS"}


def test_a_vehicle_without_gears_whose_modes_have_other_numbers_can_be_benched(tmp_path: Path) -> None:
    gears = ('"VEHICLE_STATUS.GEAR"', '"DRIVE_COMMAND.GEAR_REQUEST"')
    toml = [line for line in WIRE.path.read_text().splitlines() if not any(gear in line for gear in gears)]
    toml[toml.index(next(line for line in toml if "[status.modes]" in line))] = '[status.modes]\nAUTO = "AUTONOMOUS"'
    dbc = [line for line in WIRE.dbc.read_text().splitlines() if not {"GEAR", "GEAR_REQUEST"} & set(line.split()[:4])]
    modes = 'MODE 4 "MANUAL" 3 "READY" 0 "AUTO" 2 "FAULT" 1 "EMERGENCY_STOP" ;'
    (tmp_path / "reference.dbc").write_text(re.sub(r'MODE 0 "MANUAL".*', modes, "\n".join(dbc) + "\n"))
    (tmp_path / "other.toml").write_text("\n".join(toml) + "\n")
    wire = Wire(str(tmp_path / "other.toml"))
    vehicle = Vehicle(wire, Plant(wheelbase_m=2.7))
    for accel, way in ((1.0, 1.0), (-1.0, -1.0)):
        vehicle.mode = AUTONOMOUS
        vehicle.told = {"DRIVE_COMMAND": Told(0, "DRIVE_COMMAND", {"ACCEL_REQUEST": accel, "SAFE_STOP": 0.0})}
        vehicle._seen_ns = dict.fromkeys(wire.command, 10 * S)
        vehicle.plant.speed_mps = 0.0
        for _ in range(50):
            vehicle.move(0.01, 10 * S)
        assert vehicle.plant.speed_mps * way > 0.2
    status = wire.intact(vehicle.speak()[0])
    assert status is not None
    assert status["MODE"] == 0


def test_a_device_that_ends_before_its_first_frame_is_told_by_its_last_words(tmp_path: Path) -> None:
    log = tmp_path / "device.log"
    log.write_text("begun\nno such option: --arm\n")
    rig = SimpleNamespace(device=SimpleNamespace(log=log))
    dead = replace(seen(status=2), exit_ns=1 * S)
    found = judge.alive(named("state-lost"), dead, rig)  # type: ignore[arg-type]
    assert [(c.verdict, c.found) for c in found] == [
        (Verdict.FAIL, ["it ended with status 2 before its first frame; it said: no such option: --arm"])
    ]
    for case, what in (
        (FILES[0], dead),
        (named("state-lost"), seen(status=None)),
        (named("state-lost"), seen(pair(1))),
    ):
        assert judge.alive(case, what, rig) == []  # type: ignore[arg-type]
