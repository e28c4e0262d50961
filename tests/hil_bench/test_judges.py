"""What no device may do is found, and nothing else is."""

import re
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil_bench import figures, judges, routes
from hil_bench.case import Case
from hil_bench.cases import CATALOGUE
from hil_bench.cases.files import FILES
from hil_bench.faults import frames
from hil_bench.judges import protocol
from hil_bench.judges.dynamics import beyond, jerky, rising
from hil_bench.peer.build import open_wire
from hil_bench.result import Verdict
from hil_bench.wire import Wire
from hypothesis import given
from hypothesis import strategies as st
from scenes import DRIVES, WIRE, at, find_case, observed, other_wire, pair, steady, stop
from vehicle_bus_contract.judge import Pair, Record, Sample, examine, find_pairs_beside
from vehicle_bus_contract.reference import AUTONOMOUS, MS, READY, DecodedFrame, Frame, S
from virtual_drive import VirtualDrive

Values = dict[str, float]
Lie = Callable[[str, int, Values], Sequence[Values]]
"""Message, tick, what is true → what is said: nothing, once, several times."""
Judge = Callable[[Wire, Record], Iterable[str]]
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
    of: dict[str, Callable[[int], Values]] = {"VEHICLE_STATUS": lambda _: {"MODE": READY}, **wrong}
    return lambda name, tick, values: [values | of[name](tick) if name in of else values]


def judged(tell: Lie, *, case: Case = CATALOGUE[0], wire: Wire = WIRE) -> dict[str, Verdict]:
    """Four seconds of commands at 8 m/s, a stop from the second one on; the verdict of each kind."""
    counters: dict[str, int] = {}
    said: list[Frame] = []

    def send(at_s: float, name: str, tick: int, **values: float) -> None:
        for told in tell(name, tick, values):
            counters[name] = counters.get(name, -1) + 1
            frame = wire.pack(name, counters[name] % 15, **told)
            said.append(replace(frame, stamp_ns=S + round(at_s * S) + len(said)))

    for tick in range(400):
        at_s, is_stop = tick / 100, tick >= STOPPED_FROM
        number = wire.number("REASON", "STATE_INVALID" if is_stop else "NOMINAL")
        for name in wire.sample:
            send(at_s, name, tick, **({"SPEED": SPEED_MPS} if name == "MOTION" else {}))
        braked = max(-3.0, -0.3 * (tick - STOPPED_FROM + 1)) * is_stop
        drive = {"ENABLE": 1, "SAFE_STOP": is_stop, "REASON": number, "ACCEL_REQUEST": braked, "GEAR_REQUEST": 7}
        if tick % 2 == 0:
            send(at_s, "VEHICLE_STATUS", tick, MODE=AUTONOMOUS)
        send(at_s + 0.001, "DRIVE_COMMAND", tick, **drive)
        send(at_s + 0.001, "STEER_COMMAND", tick, ENABLE=1)
        if tick % 10 == 0:
            send(at_s + 0.002, "BODY_COMMAND", tick, HAZARD_LIGHTS=is_stop)
            index = bisect_right(routes.straight(7.0).time_s, at_s) - 1
            report = {"STATE": 4 if is_stop else 3, "REASON": number, "REF_TEMPORAL_INDEX": index}
            send(at_s + 0.002, "CONTROLLER_STATUS", tick, **report)
    record = examine(said, wire)
    history = [at(1.0 + tick / 100, SPEED_MPS, x_m=0.0) for tick in range(400)]
    rig = SimpleNamespace(wire=wire, touched_ns=0, healthy_ns=0)
    checks = judges.check_protocol(case, rig, record, observed(history=history))  # type: ignore[arg-type]
    return {kind: check.verdict for kind, check in zip(judges.KINDS, checks, strict=True)}


LIES: dict[str, tuple[str, Lie]] = {
    "a stop that never brakes": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=0.0)),
    "a stop with a third of the brake": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=-1.0)),
    "a stop with 70 % of the brake": ("brakes", with_value("DRIVE_COMMAND", STOPPED_FROM, ACCEL_REQUEST=-2.1)),
    "a stop whose brake rises with a fifth of its jerk": (
        "brakes",
        lie(
            "DRIVE_COMMAND",
            lambda tick, v: [v | {"ACCEL_REQUEST": max(-3.0, 0.06 * (STOPPED_FROM - tick))} if v["SAFE_STOP"] else v],
        ),
    ),
    "a stop that holds the wheels": ("stop_steering", steered(lambda _: 0.08)),
    "a place on the route that it has left": ("report", with_value("CONTROLLER_STATUS", REF_SPATIAL_INDEX=9)),
    "a time of the route that stands still": ("report", with_value("CONTROLLER_STATUS", REF_TEMPORAL_INDEX=0)),
    "a time of the route that goes back": (
        "report",
        lie("CONTROLLER_STATUS", lambda tick, v: [v | {"REF_TEMPORAL_INDEX": 9 - tick // 10 % 2}]),
    ),
    "missed deadlines that the bus does not show": (
        "report",
        lie("CONTROLLER_STATUS", lambda tick, v: [v | {"DEADLINE_MISSES": tick // 20}]),
    ),
    "a moving vehicle that is released at the end": (
        "release",
        lambda name, tick, values: [
            values | ({"ENABLE": 0, "REASON": 15} if name in WIRE.command and tick > STOPPED_FROM + 100 else {})
        ],
    ),
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
    "a report that all is well": ("report", with_value("CONTROLLER_STATUS", REASON=0)),
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


def test_a_correct_device_has_no_findings() -> None:
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
def test_steering_at_its_limit_has_no_findings(tell: Lie) -> None:
    assert judged(tell)["dynamics"] is Verdict.PASS


@pytest.mark.parametrize("name", LIES)
def test_each_wrong_command_is_found_by_its_kind(name: str) -> None:
    kind, tell = LIES[name]
    assert judged(tell)[kind] is Verdict.FAIL


def test_unmeasured_wheels_are_not_compared(tmp_path: Path) -> None:
    line = 'front_wheel_angle_rad = "CHASSIS.FRONT_WHEEL_ANGLE"'
    wire = other_wire(tmp_path, profile=(line, ""))
    hang = steered(lambda tick: min(0.5, 0.005 * tick), lambda _: 0.5)
    assert (judged(hang)["dynamics"], judged(hang, wire=wire)["dynamics"]) == (Verdict.FAIL, Verdict.PASS)


def test_coarse_steering_steps_are_not_reported_as_a_swerve(tmp_path: Path) -> None:
    fine = re.search(r"SG_ FRONT_WHEEL_ANGLE_REQUEST : .*", WIRE.dbc.read_text())
    assert fine is not None
    wire = other_wire(tmp_path, dbc=(fine[0], fine[0].replace("(0.0001,0)", "(0.01,0)")))
    assert (WIRE.wheel_count_rad, wire.wheel_count_rad) == (0.002, 0.01)
    by_counts = steered(lambda tick: 0.01 * min(5, max(0, tick - 100) // 5))
    assert (judged(by_counts)["dynamics"], judged(by_counts, wire=wire)["dynamics"]) == (Verdict.FAIL, Verdict.PASS)


def test_a_few_unanswered_samples_after_a_bad_cable_are_tolerated() -> None:
    rig = SimpleNamespace(wire=WIRE, touched_ns=S, healthy_ns=0)
    for count, verdict in ((10, Verdict.PASS), (11, Verdict.FAIL)):
        record = Record(unanswered=[f"sample at {9.0 + i / 100:.3f} s" for i in range(count)])
        checks = judges.check_protocol(find_case("cable-loses-5-percent"), rig, record, observed())  # type: ignore[arg-type]
        assert {check.text: check.verdict for check in checks}[judges.KINDS["unanswered"]] is verdict


def test_an_injection_into_a_vehicle_that_is_not_driven_fails() -> None:
    rig = SimpleNamespace(wire=WIRE, touched_ns=5 * S)
    for name, instants in (
        ("state-lost-at-speed", [at(4.9, 3.0)]),
        ("state-lost", [at(4.9, 3.0, READY)]),
        ("state-lost", []),
    ):
        checks = judges.check_preparation(find_case(name), observed(history=instants), rig)  # type: ignore[arg-type]
        assert [check.verdict for check in checks] == [Verdict.FAIL], name
    good = judges.check_preparation(find_case("state-lost"), observed(history=[at(4.9, 2.5)]), rig)  # type: ignore[arg-type]
    assert [check.verdict for check in good] == [Verdict.PASS]


def test_a_device_that_never_engages_fails_with_that_reason() -> None:
    rig = SimpleNamespace(wire=WIRE, touched_ns=0)
    for history, verdict in (([at(1.0, 0.0, READY)], Verdict.FAIL), ([at(1.0, 0.0)], Verdict.PASS)):
        (check,) = judges.check_preparation(find_case("drive-step"), observed(history=history), rig)  # type: ignore[arg-type]
        assert (check.text, check.verdict) == ("the device engages", verdict)


def test_health_requires_motion_hold_or_survival_as_the_case_demands() -> None:
    rig = SimpleNamespace(wire=WIRE, healthy_ns=9 * S)
    drives, holds, waits = find_case("half-the-rate"), find_case("rolling-back"), find_case("not-armed")
    moves, stands = [at(7.9, 2.0)], [at(7.9, 0.0)]
    for case, sound, broken in (
        (drives, observed(*DRIVES, history=moves), observed(*DRIVES, history=stands)),
        (holds, observed(*steady(5, 8, stop)), observed(*steady(5, 7.9, stop), *steady(7.9, 8))),
        (holds, observed(*steady(5, 8, stop)), observed()),
        (waits, observed(), replace(observed(), exit_ns=3 * S)),
    ):
        for found, verdict in ((sound, Verdict.PASS), (broken, Verdict.FAIL)):
            checks = judges.check_health(case, found, rig, [])  # type: ignore[arg-type]
            assert (verdict is Verdict.FAIL) == any(check.verdict is Verdict.FAIL for check in checks), case.name


@given(st.lists(st.floats(0.0, 1e4), min_size=1, max_size=300))
def test_a_distribution_counts_every_value_once_and_its_quantiles_are_measured_values(values: list[float]) -> None:
    found = figures.describe_distribution("x", values)
    assert sum(found.counts) == found.count == len(values)
    assert len(found.edges) == len(found.counts) + 1
    assert found.p50 <= found.p95 <= found.p99 <= found.max == pytest.approx(max(values), abs=1e-4)


def test_a_device_that_ends_before_its_first_frame_is_reported_with_its_last_line(tmp_path: Path) -> None:
    log = tmp_path / "device.log"
    log.write_text("begun\nno such option: --arm\n")
    rig = SimpleNamespace(device=SimpleNamespace(log=log))
    dead = replace(observed(status=2), exit_ns=1 * S)
    found = judges.check_alive(find_case("state-lost"), dead, rig)  # type: ignore[arg-type]
    assert [(c.verdict, c.found) for c in found] == [
        (Verdict.FAIL, ["it ended with status 2 before its first frame; its last line: no such option: --arm"])
    ]
    for case, what in (
        (FILES[0], dead),
        (find_case("state-lost"), observed(status=None)),
        (find_case("state-lost"), observed(pair(1))),
    ):
        assert judges.check_alive(case, what, rig) == []  # type: ignore[arg-type]


def burst(hold: int) -> tuple[Record, list[str]]:
    """A drive of the program in which samples are held up once, then come at once; and what the judge makes of it."""
    with tempfile.TemporaryDirectory() as folder:
        drive = VirtualDrive("reference", routes.straight(60.0), Path(folder))
        drive.run_until(lambda: drive.vehicle.plant.speed_mps > 2.0, 12.0)
        with frames.delay_in_gateway(0.01 * hold)(SimpleNamespace(vehicle=drive.vehicle)):  # type: ignore[arg-type]
            drive.run_s(0.01 * hold)
        drive.run_s(1.5)
    record = drive.record()
    rig = SimpleNamespace(wire=WIRE, touched_ns=0, healthy_ns=0)
    checks = judges.check_protocol(CATALOGUE[0], rig, record, observed(history=[]))  # type: ignore[arg-type]
    return record, next(c.found for c in checks if c.text == judges.KINDS["unanswered"])


@pytest.mark.parametrize(("hold", "crowded"), [(2, 0), (3, 1), (4, 2)])
def test_samples_that_catch_up_in_a_burst_need_not_all_be_answered(hold: int, crowded: int) -> None:
    record, found = burst(hold)
    assert len(record.unanswered) == crowded  # by the program, as its failures' page has it (S10)
    assert found == []


def test_no_more_answers_are_missing_than_samples_came_in_bursts() -> None:
    unanswered = ["a sample after 0.200 s", "a sample after 2.000 s", "a sample after 2.000 s"]
    assert protocol._without_crowded(unanswered, []) == unanswered
    assert protocol._without_crowded(unanswered, [2.03]) == ["a sample after 0.200 s", "a sample after 2.000 s"]
    assert protocol._without_crowded(unanswered, [2.03, 5.0]) == ["a sample after 0.200 s"]


STOPPED = [*steady(0, 5.06), *steady(5.06, 7, stop)]


@pytest.mark.parametrize(
    ("case", "commands", "speed_mps", "verdict"),
    [
        ("sensor-speed-low", STOPPED, 0.0, Verdict.PASS),
        ("sensor-speed-low", STOPPED, 1.0, Verdict.FAIL),
        ("sensor-speed-low", [*steady(0, 7)], 0.0, Verdict.FAIL),
        ("sensor-speed-low", [], 0.0, Verdict.FAIL),
        ("sensor-heading-off", STOPPED, 0.0, Verdict.FAIL),
        ("sensor-heading-off", [*STOPPED, *steady(7, 8, stop)], 0.0, Verdict.PASS),
    ],
)
def test_a_stop_may_end_in_silence_at_rest_in_the_case_for_it_only(
    case: str, commands: Sequence[Pair], speed_mps: float, verdict: Verdict
) -> None:
    seen = observed(*commands, history=[at(tick / 100, speed_mps) for tick in range(1000)], status=4)
    checks = judges.check_health(find_case(case), seen, SimpleNamespace(wire=WIRE), [])  # type: ignore[arg-type]
    assert next(c.verdict for c in checks if c.text == "the stop is held") is verdict


def test_a_stop_may_continue_a_brake_whatever_it_ends_with() -> None:
    braking = [pair(1.0 + 0.01 * tick, accel=-0.01 - 0.2 * tick) for tick in range(6)]
    stopping = [pair(1.06 + 0.01 * tick, stop=1, accel=-1.2 - 0.25 * tick) for tick in range(4)]
    ends = [pair(1.10 + 0.01 * tick, stop=1) for tick in range(4)]
    assert not list(jerky(WIRE, Record(pairs=[*braking, *stopping, *ends])))
    jumps = [pair(1.06 + 0.01 * tick, stop=1, accel=-2.5) for tick in range(4)]
    assert list(jerky(WIRE, Record(pairs=[*braking, *jumps])))


VEHICLES = {name: open_wire(name) for name in ("pacmod3", "vbox_kart")}


def found_by(judge: Judge, profile: str, *told: tuple[float, float, bool]) -> list[str]:
    """What a judge finds in enabled commands 20 ms apart: each m/s², measured m/s, and whether it is a stop."""
    record = Record()
    for number, (accel_mps2, speed_mps, is_stop) in enumerate(told, start=50):
        stamp_ns = number * S // 50
        record.samples.append(Sample(stamp_ns, 0.0, 0.0, 0.0, speed_mps))
        said = {"ENABLE": 1.0, "SAFE_STOP": float(is_stop), "ACCEL_REQUEST": accel_mps2}
        frame = DecodedFrame(stamp_ns, "COMMAND", {**said, "FRONT_WHEEL_ANGLE_REQUEST": 0.0})
        record.pairs.append(Pair(frame, frame))
    return list(judge(VEHICLES[profile], record))


AT_REST_MPS = (0.0, -0.004, 0.003, -0.01, 0.0)
"""As measured, with noise."""
BACKWARDS_MPS = (-0.06, -0.1)


@pytest.mark.parametrize(("rate_mps3", "is_found"), [(19.0, False), (25.0, True)])
def test_a_drive_backwards_from_rest_rises_from_what_was_commanded_at_rest(rate_mps3: float, is_found: bool) -> None:
    told = [(-rate_mps3 * 0.02 * n, mps, False) for n, mps in enumerate(AT_REST_MPS + BACKWARDS_MPS)]
    assert bool(found_by(rising, "pacmod3", *told)) is is_found


@pytest.mark.parametrize(("is_stop", "is_found"), [(True, False), (False, True)])
def test_at_rest_a_stop_brakes_the_motion_before_it_and_a_drive_begins_the_one_after_it(
    is_stop: bool, is_found: bool
) -> None:
    told = [(-2.48, mps, is_stop) for mps in (*((0.3, 0.1) if is_stop else ()), -0.01, -0.03, -0.06, -0.1)]
    found = found_by(beyond, "vbox_kart", *(told if not is_stop else told[:-2]))
    assert bool(found) is is_found


@pytest.mark.parametrize(("apart_ns", "reasons"), [(0, [0, 1]), (2 * MS, [1])])
def test_a_report_belongs_to_every_command_that_came_at_the_same_time(apart_ns: int, reasons: list[int]) -> None:
    def pair_at(stamp_ns: int, reason: int) -> Pair:
        said = DecodedFrame(stamp_ns, "COMMAND", {"REASON": float(reason)})
        return Pair(said, said)

    pairs = [pair_at(S - apart_ns, 0), pair_at(S, 1)]
    assert [pair.drive["REASON"] for pair in find_pairs_beside(pairs, S)] == reasons
    assert [pair.drive["REASON"] for pair in find_pairs_beside(pairs, S - 5 * MS)] == [0]
    assert find_pairs_beside([], S) == []
