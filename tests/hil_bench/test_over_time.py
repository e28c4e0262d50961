"""What the report draws over time: one axis, limits that vary, marks of violations, strips, and thinned curves."""

import math
import random
import re

import pytest
from hil_bench import plots
from hil_bench.along_route import follow_route
from hil_bench.by_speed import max_accel_mps2, max_wheel_rad
from hil_bench.report import over_time
from hil_bench.result import CaseResult, Check, Event, EventKind, Evidence, Plot, Series, Strip, Verdict
from hil_bench.routes import slalom, u_turn
from hil_bench.thinning import MOST_POINTS, thin_series
from hil_bench.vehicle import Instant
from hil_bench.violations import find_violations, mark_overdue
from scenes import WIRE, at, observed, pair, steady, stop
from vehicle_bus_contract.reference import AUTONOMOUS, MANUAL, S


def case(**more: object) -> CaseResult:
    plain = {"name": "silence", "proves": "It stops.", "verdict": Verdict.PASS, "evidence": Evidence.VIRTUAL_BUS}
    return CaseResult(**(plain | more))  # type: ignore[arg-type]


def line(*values: float | None, step_s: float = 1.0, name: str = "angle") -> Series:
    return Series(name=name, at_s=[step_s * i for i in range(len(values))], values=values)


def plot(*series: Series, **more: object) -> Plot:
    return Plot(title="Angle", unit="rad", series=list(series), **more)  # type: ignore[arg-type]


def event(at_s: float, kind: EventKind) -> Event:
    return Event(at_s=at_s, kind=kind, text="")


def points_of(d: str) -> list[tuple[int, int]]:
    """Absolute points of the first piece of a path."""
    numbers = [int(text) for text in re.split("[l ]", d.split("M")[1].rstrip("z"))]
    x, y = numbers[:2]
    points = [(x, y)]
    for dx, dy in zip(numbers[2::2], numbers[3::2], strict=True):
        x, y = x + dx, y + dy
        points.append((x, y))
    return points


def test_events_strips_and_plots_have_one_axis() -> None:
    drawn = over_time.draw_case(
        case(
            events=[event(-1.0, EventKind.PREPARATION), event(4.0, EventKind.INJECTION)],
            strips=[Strip(name="MODE", at_s=[0.0, 3.0, 9.0], values=["READY", "AUTONOMOUS", ""])],
            plots=[plot(line(0.0, 1.0, 2.0)), plot(line(0.0, 1.0))],
        )
    )
    assert (drawn.x.low, drawn.x.high, drawn.injected_s) == (-1.0, 9.0, 4.0)
    assert [one.share for one in drawn.stations] == [0.0, 0.5]
    segments = drawn.strips[0].segments
    assert [(round(one.left, 6), round(one.width, 6), one.value, one.colour) for one in segments] == [
        (0.1, 0.3, "READY", "s1"),
        (0.4, 0.6, "AUTONOMOUS", "good"),
    ]
    ends = [points_of(one.curves[0].d)[-1][0] for one in drawn.plots]
    assert ends == [0.3 * over_time.WIDTH, 0.2 * over_time.WIDTH]


def test_times_on_the_line_count_from_the_injection() -> None:
    kinds = {4.034: EventKind.REACTION, 4.0: EventKind.INJECTION, 1.0: EventKind.PREPARATION, 6.0: EventKind.VIOLATION}
    drawn = over_time.draw_case(case(events=[event(at_s, kind) for at_s, kind in kinds.items()]))
    assert [one.since for one in drawn.stations] == ["−3.00 s", "+0 ms", "+34 ms", "+2.00 s"]
    assert [round(one.share, 3) for one in drawn.stations] == [0.0, 0.6, 0.607, 1.0]


def test_a_limit_that_varies_with_speed_is_drawn_as_it_varies() -> None:
    limit = line(0.6, 0.6, 0.2, name="limit")
    (drawn,) = over_time.draw_case(case(plots=[plot(line(0.0, 0.1, 0.3), highest_at=limit)])).plots
    (found,) = drawn.limits
    heights = [y for _, y in points_of(found.d)]
    assert heights == [round((1 - drawn.y.share(value)) * over_time.HEIGHT) for value in (0.6, 0.6, 0.2)]
    assert {points_of(found.beyond)[0][1], points_of(found.beyond)[-1][1]} == {0}
    assert points_of(drawn.curves[0].d)[-1][1] < heights[-1]  # the curve ends above its limit


def test_a_limit_far_away_is_named_and_does_not_flatten_the_curve() -> None:
    (drawn,) = over_time.draw_case(case(plots=[plot(line(0.0, 0.1), lowest=-3.0, highest=0.12)])).plots
    assert drawn.far == "−3 rad"
    assert len(drawn.limits) == 1
    assert drawn.y.low > -0.1


def test_a_curve_that_hardly_changes_is_drawn_flat() -> None:
    (drawn,) = over_time.draw_case(case(plots=[plot(line(0.0, 1e-5, -1e-5))])).plots
    assert drawn.y.high - drawn.y.low >= 0.05


def test_a_decimated_curve_keeps_its_extremes() -> None:
    values = [0.0] * 20_000
    values[7777], values[15001] = 3.0, -2.0
    (drawn,) = over_time.draw_case(case(plots=[plot(line(*values, step_s=0.01))])).plots
    heights = [y for _, y in points_of(drawn.curves[0].d)]
    assert drawn.curves[0].undrawn == 0
    assert min(heights) == round((0.4 / 5.8) * over_time.HEIGHT)
    assert max(heights) == round((5.4 / 5.8) * over_time.HEIGHT)


def test_a_gap_is_no_line_and_what_cannot_be_drawn_is_counted() -> None:
    (drawn,) = over_time.draw_case(case(plots=[plot(line(0.0, 1.0, None, 1.0, math.inf, 2.0))])).plots
    assert drawn.curves[0].d.count("M") == 3
    assert drawn.curves[0].undrawn == 1


@pytest.mark.parametrize("tolerance", [0.001, 0.05])
def test_a_thinned_curve_differs_nowhere_by_more_than_its_tolerance(tolerance: float) -> None:
    chance = random.Random(3)
    at_s = [0.01 * i for i in range(500)]
    values = [math.sin(at) + (0.4 if 2.0 < at < 2.05 else 0.0) + chance.uniform(0, 0.2 * tolerance) for at in at_s]
    thin = thin_series("speed", at_s, values, tolerance)
    assert 2 < len(thin.at_s) < 500
    for (a_s, a), (b_s, b) in zip(
        zip(thin.at_s, thin.values, strict=True), zip(thin.at_s[1:], thin.values[1:], strict=True), strict=False
    ):
        assert a is not None
        assert b is not None
        between = [(at, value) for at, value in zip(at_s, values, strict=True) if a_s <= at <= b_s]
        assert all(abs(a + (b - a) * (at - a_s) / (b_s - a_s) - value) < 2 * tolerance + 1e-3 for at, value in between)


def test_a_noisy_curve_is_thinned_until_it_is_small_and_gaps_stay() -> None:
    chance = random.Random(3)
    values: list[float | None] = [chance.random() for _ in range(20_000)]
    values[10_000] = None
    thin = thin_series("noise", [0.01 * i for i in range(20_000)], values, 1e-4)
    assert len(thin.at_s) <= MOST_POINTS
    assert list(thin.values).count(None) == 1
    empty = thin_series("none", [], [], 0.1)
    assert (empty.at_s, empty.values) == ([], [])


def driving(speed_mps: float, *modes: int) -> list[Instant]:
    return [at(0.01 * i, speed_mps, mode=mode, x_m=2.0) for i, mode in enumerate(modes)]


def test_limits_reference_and_lateral_error_are_among_the_plots() -> None:
    seen = observed(*steady(0, 8), *steady(8, 10, stop), history=driving(8.0, *[AUTONOMOUS] * 900))
    speed, accel, wheels, lateral = plots.draw_plots(WIRE, seen, max_path_error_m=0.3)
    assert [series.name for series in speed.series] == ["vehicle", "reference"]
    assert all(
        value == pytest.approx(2.0, abs=0.01) for value in speed.series[1].values
    )  # 2 m after the start, by 1 m/s²
    assert accel.highest_at is not None
    assert set(accel.highest_at.values) == {max_accel_mps2(WIRE, 8.0)}
    assert wheels.highest_at is not None
    assert wheels.highest_at.values[0] == pytest.approx(max_wheel_rad(WIRE, 8.0), abs=1e-3)
    assert wheels.lowest_at is not None
    assert wheels.lowest_at.values[0] == pytest.approx(-max_wheel_rad(WIRE, 8.0), abs=1e-3)
    assert (lateral.lowest, lateral.highest) == (-0.3, 0.3)


def test_there_is_no_reference_speed_while_the_vehicle_is_not_driven() -> None:
    (speed, *_) = plots.draw_plots(WIRE, observed(history=driving(1.0, *[MANUAL] * 300, *[AUTONOMOUS] * 300)))
    assert min(speed.series[1].at_s) == pytest.approx(3.0, abs=0.02)


def test_strips_show_mode_and_commands_and_where_there_were_none() -> None:
    seen = observed(
        *steady(0, 2), *steady(2, 3, stop), *steady(5, 6, lambda at_s: pair(at_s, enable=0, reason="DRIVER_OVERRIDE")),
        history=driving(1.0, *[MANUAL] * 100, *[AUTONOMOUS] * 500),
    )  # fmt: skip
    mode, enable, safe_stop, reason = plots.draw_strips(WIRE, seen)
    assert (mode.values, [round(at_s, 1) for at_s in mode.at_s]) == (["MANUAL", "AUTONOMOUS", ""], [0.0, 1.0, 6.0])
    assert enable.values == ["1", "", "0", ""]
    assert [round(at_s, 1) for at_s in enable.at_s] == [0.0, 3.1, 5.0, 6.0]
    assert safe_stop.values == ["0", "1", "", "0", ""]
    assert reason.values == ["NOMINAL", "STATE_STALE", "", "DRIVER_OVERRIDE", ""]


@pytest.mark.parametrize("route", [slalom(), u_turn()])
def test_the_lateral_error_has_its_sign_on_every_part_of_a_route(route: object) -> None:
    offset_m = 0.25
    instants = [
        Instant(i * S, x - offset_m * math.sin(h), y + offset_m * math.cos(h), h, 3.0, 0.0, 0.0, AUTONOMOUS)
        for i, (x, y, h) in enumerate(zip(route.x_m, route.y_m, route.heading_rad, strict=True))  # type: ignore[attr-defined]
    ]
    errors = [place.lateral_m for place in follow_route(route, instants)]  # type: ignore[arg-type]
    assert sum(abs(error - offset_m) < 0.02 for error in errors) > 0.95 * len(errors)


def failed(text: str, *found: str, measured: float | None = None, limit: float | None = None) -> Check:
    return Check(text=text, verdict=Verdict.FAIL, measured=measured, limit=limit, unit="ms", found=list(found))


def test_the_first_dated_finding_of_each_failed_check_is_marked() -> None:
    checks = [
        failed("limits", "4.250 s: 0.6600 rad at 3.00 m/s", "4.260 s: 0.6700 rad at 3.00 m/s"),
        failed("answers", "a silence", "sample at 5.500 s"),
        failed("no date", "31.0 ms, more than 10 ms"),
        Check(text="kept", verdict=Verdict.PASS, found=["1.000 s: nothing"]),
    ]
    found = find_violations(checks)
    assert [(one.at_s, one.kind) for one in found] == [(4.25, EventKind.VIOLATION), (5.5, EventKind.VIOLATION)]
    assert found[0].text == "limits: 4.250 s: 0.6600 rad at 3.00 m/s"


def test_a_reaction_that_comes_late_or_never_is_marked_where_it_was_due() -> None:
    assert [one.at_s for one in mark_overdue(failed("stop", measured=212.0, limit=150.0), 4.0)] == [4.15]
    assert [one.at_s for one in mark_overdue(failed("stop", "no such stop", limit=150.0), 4.0)] == [4.15]
    assert mark_overdue(failed("stop", "another reason", measured=80.0, limit=150.0), 4.0) == []
    assert mark_overdue(Check(text="stop", verdict=Verdict.PASS, measured=80.0, limit=150.0, unit="ms"), 4.0) == []
