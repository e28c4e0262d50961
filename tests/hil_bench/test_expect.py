"""Each expectation passes on the right observation and fails on a wrong one."""

from dataclasses import replace

import pytest
from hil_bench import expect, routes
from hil_bench.cases import catalogue_of
from hil_bench.cases.limits import limit_cases
from hil_bench.expect import Expectation, Observation
from hil_bench.peer.build import open_wire
from hil_bench.result import Verdict
from scenes import DRIVES, SILENT, STOPS, WIRE, at, observed, pair, released, steady, stop
from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import FAULT, DecodedFrame, S


def lit(at_s: float, on: int = 1) -> DecodedFrame:
    told = WIRE.intact(replace(WIRE.pack("BODY_COMMAND", 1, HAZARD_LIGHTS=on), stamp_ns=round(at_s * S)))
    assert told is not None
    return told


def ended(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="PAST_END_SPACE")


def out_of_time(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="PAST_END_TIME")


def asking(at_s: float, speed_mps: float) -> Pair:
    drive = WIRE.intact(
        replace(WIRE.pack("DRIVE_COMMAND", 1, ENABLE=1, SPEED_REQUEST=speed_mps), stamp_ns=round(at_s * S))
    )
    assert drive is not None
    return Pair(drive, pair(at_s).steer)


def turning(at_s: float, wheel_rad: float) -> Pair:
    values = {"ENABLE": 1, "FRONT_WHEEL_ANGLE_REQUEST": wheel_rad}
    steer = WIRE.intact(replace(WIRE.pack("STEER_COMMAND", 1, **values), stamp_ns=round(at_s * S)))
    assert steer is not None
    return Pair(pair(at_s).drive, steer)


def drive_past_dwells(*, stands_until_s: float, v_mps: float = 0.0) -> Observation:
    """Both dwells of the route, at 16 and 32 m; at the second one the vehicle is at rest until its time."""
    route = routes.stop_and_go()
    first, second = (route.time_s[point] for point in route.dwells())
    history = [at(stands_until_s * first, v_mps, x_m=16.0), at(second, 0.0, x_m=32.0)]
    return replace(observed(pair(0.0), history=history), route=route)


def given_up(at_s: float) -> Pair:
    return pair(at_s, enable=0, reason="VEHICLE_NOT_AUTONOMOUS")


def lost(said: str) -> Observation:
    """With this output of the device of a vehicle on two buses."""
    return replace(observed(), said=said, wire=open_wire("agilex_hunter_ins"))


EIGHTH_MISSING = [pair for number, pair in enumerate(DRIVES) if number % 8]
HISTORY = [at(tick / 100, 3.0) for tick in range(1000)]
GAVE_UP = observed(*steady(1, 4), *steady(4, 8, given_up))
LETS_GO = [*steady(0, 5.02), *steady(5.02, 8, released), *steady(8, 10)]
JUDGED: list[tuple[Expectation, Observation, Observation]] = [
    (expect.Stops(("STATE_STALE",)), observed(*STOPS), observed(*DRIVES)),
    (expect.Stops(("STATE_STALE",)), observed(*STOPS), observed(*steady(0, 5.3), *steady(5.3, 6, stop))),
    (
        expect.Stops(("STATE_STALE",)),
        observed(*STOPS),
        observed(*steady(0, 5.06), *steady(5.06, 5.5, stop), *steady(5.5, 6)),
    ),
    (expect.Stops(("STATE_STALE",)), observed(*STOPS), observed(*LETS_GO)),
    (
        expect.Stops(("STATE_STALE",)),
        observed(*STOPS),
        observed(*steady(0, 5.06), *steady(5.06, 5.5, stop), released(5.5)),
    ),
    (expect.Answers(0.7, 0.95), observed(*EIGHTH_MISSING, history=HISTORY), observed(*DRIVES, history=HISTORY)),
    (expect.Answers(0.7, 1.0), observed(*DRIVES, history=HISTORY), observed(*DRIVES, *DRIVES[::9], history=HISTORY)),
    (expect.Answers(0.7, 1.0), observed(*DRIVES, history=HISTORY), observed(*steady(0, 10, stop), history=HISTORY)),
    (expect.Answers(0.7, 1.0), observed(*DRIVES, history=HISTORY), observed(*DRIVES)),
    (expect.FallsSilent(), observed(*SILENT), observed(*DRIVES)),
    (expect.FallsSilent(), observed(*SILENT), observed(*SILENT, pair(7.0))),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.06), observed(*LETS_GO), observed(*DRIVES)),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.06), observed(*LETS_GO), observed(*LETS_GO[:600], pair(7.5))),
    (expect.LetsGo(("DRIVER_OVERRIDE",), 0.01), observed(*steady(5, 8, released)), observed(*LETS_GO)),
    (expect.DrivesOn(), observed(*DRIVES), observed(*STOPS)),
    (expect.DrivesOn(), observed(*DRIVES), observed()),
    (expect.MomentaryAtMost(("STATE_STALE",), 0.2), observed(*DRIVES, stop(5.5)), observed(*STOPS)),
    (expect.MomentaryAtMost(("STATE_STALE",), 0.2), observed(*DRIVES), observed(*LETS_GO)),
    (expect.Standstill(2.0), observed(history=[at(5.5, 1.0), at(6.5, 0.0)]), observed(history=[at(7.5, 0.0)])),
    (expect.Standstill(2.0), observed(history=[at(6.5, 0.0)]), observed(history=[at(6.5, 1.0)])),
    (expect.NeverEnables(), observed(*steady(0, 8, released)), observed(*steady(0, 5, released), pair(5.5))),
    (expect.NeverEnables(at_all=True), observed(), observed(released(3.0))),
    (expect.NeverDrives(), observed(*steady(5, 6, stop), *steady(6, 8)), observed(*steady(5, 5.9, stop), pair(5.95))),
    (expect.NeverDrives(), observed(*steady(5, 6, released)), observed(pair(5.0), *steady(5.01, 6, released))),
    (expect.HazardLights(), replace(observed(), decoded=[lit(5.3)]), replace(observed(), decoded=[lit(4.0), lit(5.6)])),
    (expect.HazardLights(), replace(observed(), decoded=[lit(5.3)]), replace(observed(), decoded=[lit(5.3, on=0)])),
    (expect.StaysOut(), observed(*SILENT), observed(*SILENT, pair(7.0))),
    (expect.StaysOut(), observed(*SILENT, pair(6.001)), observed(*SILENT, pair(6.001), pair(6.002))),
    (expect.DrivesOn(), observed(*DRIVES), observed(*steady(0, 5.3), *steady(5.42, 10))),
    (expect.DrivesOn(), observed(*DRIVES), observed(*steady(0, 5.3))),
    (expect.DrivesOn(), observed(*DRIVES), observed(*steady(5.3, 10))),
    (expect.GivesUp(), GAVE_UP, observed(*steady(1, 7.9))),
    (expect.GivesUp(), GAVE_UP, observed(*steady(1, 2), *steady(2, 8, given_up))),
    (expect.GivesUp(), GAVE_UP, observed(*steady(1, 4), *steady(4, 8, released))),
    (expect.GivesUp(), GAVE_UP, observed()),
    (expect.Refuses(2), observed(status=2), observed(status=0)),
    (expect.Refuses(2), observed(status=2), observed(released(2.0), status=2)),
    (expect.Refuses(2), observed(status=2), observed(status=None)),
    (expect.NamesBus(1), lost("link DOWN: bus ins: vcan1: Network is down"), lost("link DOWN: inside vcan1")),
    (expect.NamesBus(1), lost("ins is down"), lost("")),
    (expect.Ends((0,), 5.0), observed(), observed(status=4)),
    (expect.Ends((0,), 5.0), observed(), observed(status=None)),
    (expect.Ends((-9,), 5.0), observed(status=-9), replace(observed(status=-9), exit_ns=11 * S)),
    (expect.EndsOrderly(), observed(*steady(5, 7, stop), released(7.0)), observed(*steady(5, 7, stop))),
    (expect.EndsOrderly(), observed(*steady(5, 7, stop), released(7.0)), observed(*steady(5, 7), released(7.0))),
    (
        expect.EndsOrderly(),
        observed(*steady(5, 7, stop), released(7.0), history=[at(7.1, 0.0)]),
        observed(*steady(5, 7, stop), released(7.0), history=[at(7.1, 2.0)]),
    ),
    (expect.WatchdogActs(), observed(history=[at(5.1, 3.0, FAULT)]), observed(history=[at(5.5, 3.0, FAULT)])),
    (expect.WatchdogActs(), observed(history=[at(5.1, 3.0, FAULT)]), observed(history=[at(5.1, 3.0)])),
    (
        expect.AsksForItsSpeed(),
        observed(asking(5.0, 1.5), history=[at(4.9, 1.0)]),
        observed(asking(5.0, 1.5 * 3.6), history=[at(4.9, 1.0)]),
    ),
    (
        expect.AsksForItsSpeed(),
        observed(asking(5.0, 0.0), history=[at(4.9, 1.0)]),
        observed(asking(5.0, -1.0), history=[at(4.9, 1.0)]),
    ),
    (
        expect.ReachesEnd(),
        observed(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        observed(*steady(0, 7), stop(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
    ),
    (
        expect.ReachesEnd(),
        observed(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        observed(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 1.0)]),
    ),
    (
        expect.ReachesEnd(),
        observed(*steady(0, 7), ended(7.0), history=[at(6.9, 1.0), at(7.5, 0.0)]),
        observed(*steady(0, 1), *steady(1, 8, ended), history=[at(0.9, 0.0, x_m=0.0), at(7.5, 0.0, x_m=0.0)]),
    ),
    (
        expect.ReachesEnd(("PAST_END_TIME",)),
        replace(
            observed(*steady(0, 7), *steady(7, 8, out_of_time), history=[at(1.0, 0.0), at(7.5, 0.0)]),
            route=replace(routes.straight(7.0), time_s=[0.0, 6.0]),
        ),
        replace(
            observed(*steady(0, 3), *steady(3, 8, out_of_time), history=[at(1.0, 0.0), at(7.5, 0.0)]),
            route=replace(routes.straight(7.0), time_s=[0.0, 6.0]),
        ),
    ),
    (
        expect.MakesUpForNothing(),
        observed(*steady(0, 5), turning(6.3, -0.08)),
        observed(*steady(0, 5), turning(6.3, -0.085)),
    ),
    (
        expect.StandsAtDwells(),
        drive_past_dwells(stands_until_s=1.0),
        drive_past_dwells(stands_until_s=1.0, v_mps=0.3),
    ),
    (expect.StandsAtDwells(), drive_past_dwells(stands_until_s=1.01), drive_past_dwells(stands_until_s=0.98)),
    (
        expect.FollowsGaps(),
        observed(*steady(5.001, 5.101), *steady(5.121, 6), samples=[5.08, 5.09, 5.1 - 0.0005, 5.12, 5.13]),
        observed(*steady(5.001, 5.131), *steady(5.151, 6), samples=[5.08, 5.09, 5.1 - 0.0005, 5.12, 5.13]),
    ),
    (
        expect.FollowsGaps(),
        observed(*steady(5.001, 5.09), samples=[5.08, 5.1 - 0.0005]),
        observed(*DRIVES, samples=[5.1, 5.11]),
    ),
]


@pytest.mark.parametrize(
    ("expectation", "right", "wrong"), JUDGED, ids=[f"{type(row[0]).__name__}-{i}" for i, row in enumerate(JUDGED)]
)
def test_each_expectation_passes_on_the_right_observation_and_fails_on_the_wrong_one(
    expectation: Expectation, right: Observation, wrong: Observation
) -> None:
    passed, _ = expectation.judge(right)
    failed, _ = expectation.judge(wrong)
    assert (passed.verdict, failed.verdict) == (Verdict.PASS, Verdict.FAIL), (passed, failed)
    assert failed.found


def test_every_expectation_of_the_catalogue_is_tested() -> None:
    assert {type(e) for case in (*catalogue_of(2), *limit_cases(WIRE)) for e in case.see} == {
        type(row[0]) for row in JUDGED
    }
