"""Measured thresholds: the sound program acts where the profile says, and each wrong threshold is found.

The cases run in virtual time, with the program's loop in place of a device.
"""

from dataclasses import replace
from pathlib import Path

import pytest
from hil_bench.case import Case
from hil_bench.cases import catalogue_for
from hil_bench.cases.thresholds import threshold_cases
from hil_bench.expect.base import check_measured
from hil_bench.expect.limit import Limit
from hil_bench.expect.stop_thresholds import SilentAfter
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from scenes import WIRE, observed, stop
from vehicle_bus_contract.reference import S
from virtual_rig import run_virtual

from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.modes import Event

SOUND = (
    "threshold-missing-state",
    "threshold-command-age",
    "threshold-engaging",
    "threshold-recovery",
    "threshold-latch",
    "threshold-lateral-backwards",
    "threshold-heading",
    "threshold-overspeed-forwards",
    "threshold-rollback-backwards",
    "threshold-stop-steering",
    "threshold-end-of-run",
    "threshold-jumps",
    "threshold-frozen",
    "threshold-counter-step",
    "threshold-driver-torque",
    "threshold-gear-change",
    "driver-signals-alone",
    "modes-in-every-order",
    "override-lasts",
    "wrong-from-the-start",
    "message-vehicle-status",
)
"""The rest of them only repeat these in another place."""


def case_named(name: str, profile: str = "reference") -> Case:
    return next(case for case in catalogue_for(open_wire(profile)) if case.name == name)


def run(name: str, folder: Path, profile: str = "reference") -> CaseResult:
    return run_virtual(case_named(name, profile), profile, folder)


@pytest.mark.parametrize("name", SOUND)
def test_the_program_acts_where_its_profile_says(name: str, tmp_path: Path) -> None:
    found = run(name, tmp_path)
    assert found.verdict is Verdict.PASS, (found.why, found.measured)
    assert found.measured or not name.startswith("threshold")
    assert all(one.verdict is Verdict.PASS for one in found.measured)


@pytest.mark.parametrize(
    ("profile", "name"),
    [
        ("j1939_truck", "threshold-command-age"),
        ("j1939_truck", "threshold-jumps"),
        ("j1939_truck", "threshold-stop"),
        ("mqb_by_wire", "threshold-jumps"),
        ("agilex_hunter", "threshold-command-age"),
        ("agilex_hunter_ins", "threshold-command-age"),
    ],
)
def test_the_program_acts_where_the_profile_of_another_vehicle_says(profile: str, name: str, tmp_path: Path) -> None:
    found = run(name, tmp_path, profile)
    assert found.verdict is Verdict.PASS, (found.why, found.measured)
    assert found.measured


@pytest.mark.parametrize(
    ("key", "wrong", "name"),
    [
        ("max_command_age_s = 0.1", "max_command_age_s = 0.3", "threshold-command-age"),
        ("status_stale_s = 0.35", "status_stale_s = 0.8", "threshold-stop"),
        ("speed_tolerance_mps = 0.8 ", "speed_tolerance_mps = 1.2 ", "threshold-jumps"),
    ],
)
def test_a_truck_with_another_threshold_fails(key: str, wrong: str, name: str, tmp_path: Path) -> None:
    files = open_wire("j1939_truck")
    text = files.path.read_text()
    assert text.count(key) == 1
    for file in files.path.parent.glob("j1939_*"):
        (tmp_path / file.name).write_text(file.read_text())
    (tmp_path / "wrong.toml").write_text(text.replace(key, wrong))
    found = run_virtual(case_named(name, "j1939_truck"), "j1939_truck", tmp_path, str(tmp_path / "wrong.toml"))
    assert found.verdict is Verdict.FAIL
    assert any(one.verdict is Verdict.FAIL for one in found.measured)


@pytest.mark.parametrize(
    ("key", "wrong", "name"),
    [
        ("state_stale_s = 0.05 ", "state_stale_s = 0.1 ", "threshold-missing-state"),
        ("status_stale_s = 0.1 ", "status_stale_s = 0.2 ", "threshold-missing-state"),
        ("max_command_age_s = 0.1 ", "max_command_age_s = 0.3 ", "threshold-command-age"),
        ("state_silent_s = 0.5 ", "state_silent_s = 0.6 ", "threshold-missing-state"),
        ("engage_timeout_s = 3.0", "engage_timeout_s = 4.0", "threshold-engaging"),
        ("engage_settle_s = 0.5", "engage_settle_s = 0.1", "threshold-engaging"),
        ("state_invalid_s = 0.5", "state_invalid_s = 0.1", "threshold-recovery"),
        ("latch_stops = 4", "latch_stops = 6", "threshold-latch"),
        ("lateral_stop_m = 3.0", "lateral_stop_m = 5.0", "threshold-lateral-straight"),
        ("heading_stop_rad = 0.8", "heading_stop_rad = 1.0", "threshold-heading"),
        ("overspeed_mps = 1.0", "overspeed_mps = 3.0", "threshold-overspeed-forwards"),
        ("rollback_mps = 0.5", "rollback_mps = 1.0", "threshold-rollback-forwards"),
        ("safe_deceleration_mps2 = 3.0", "safe_deceleration_mps2 = 2.1", "threshold-stop"),
        ("stop_jerk_mps3 = 30.0", "stop_jerk_mps3 = 15.0", "threshold-stop"),
        ('stop_steering = "straight"', 'stop_steering = "hold"', "threshold-stop-steering"),
        ("shutdown_s = 10.0", "shutdown_s = 3.1", "threshold-end-of-run"),
        ("max_counter_step = 3", "max_counter_step = 5", "threshold-counter-step"),
        ("driver_steer_torque_nm = 3.0", "driver_steer_torque_nm = 4.0", "threshold-driver-torque"),
        ("position_tolerance_m = 0.5", "position_tolerance_m = 1.0", "threshold-jumps"),
        ("yaw_rate_tolerance_radps = 0.8 ", "yaw_rate_tolerance_radps = 1.6 ", "threshold-jumps"),
        ("gear_change_speed_mps = 0.5", "gear_change_speed_mps = 5.0", "threshold-gear-change"),
        ("frozen_time_s = 0.09", "frozen_time_s = 0.3", "threshold-frozen"),
    ],
)
def test_a_device_with_another_threshold_fails(key: str, wrong: str, name: str, tmp_path: Path) -> None:
    text = WIRE.path.read_text()
    assert text.count(key) == 1
    (tmp_path / "reference.dbc").write_text(WIRE.dbc.read_text())
    (tmp_path / "wrong.toml").write_text(text.replace(key, wrong))
    found = run_virtual(case_named(name), "reference", tmp_path, str(tmp_path / "wrong.toml"))
    assert found.verdict is Verdict.FAIL
    assert any(one.verdict is Verdict.FAIL for one in found.measured)


@pytest.mark.parametrize("action", ["driver_brake", "driver_throttle", "driver_steer_torque_nm"])
def test_a_device_that_does_not_read_a_signal_of_the_driver_fails(action: str, tmp_path: Path) -> None:
    text = WIRE.path.read_text()
    (tmp_path / "reference.dbc").write_text(WIRE.dbc.read_text())
    lines = [line for line in text.splitlines() if not line.startswith(f"{action} = ")]
    assert len(lines) < len(text.splitlines())
    if action == "driver_steer_torque_nm":
        lines.insert(
            lines.index("gear_change_speed_mps = 0.5    # above it the vehicle refuses another gear"), f"{action} = 3.0"
        )
    (tmp_path / "wrong.toml").write_text("\n".join(lines))
    found = run_virtual(case_named("driver-signals-alone"), "reference", tmp_path, str(tmp_path / "wrong.toml"))
    assert found.verdict is Verdict.FAIL


@pytest.mark.parametrize(("name", "after_s"), [("override-lasts", 4), ("modes-in-every-order", 1)])
def test_a_device_that_arms_itself_again_fails(
    name: str, after_s: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick, since_ns = Engagement.on_tick, list[int]()

    def arm_again(engagement: Engagement, now_ns: int) -> None:
        tick(engagement, now_ns)
        if engagement.mode.name == "OVERRIDDEN":
            since_ns.append(now_ns)
            if now_ns - since_ns[0] > after_s * S:
                engagement.apply(Event.ARMED, now_ns)

    monkeypatch.setattr(Engagement, "on_tick", arm_again)
    assert run(name, tmp_path).verdict is Verdict.FAIL


def test_the_catalogue_is_each_vehicles_own() -> None:
    reference, pacmod = (threshold_cases(open_wire(profile)) for profile in ("reference", "pacmod3"))
    assert [case.name for case in reference] == [case.name for case in pacmod]
    lateral = {case.name: case.lacks for case in pacmod}["threshold-lateral-straight"]
    assert lateral == "the vehicle has no position on its bus: where it drifts cannot be seen"
    assert not any(case.lacks for case in reference)
    assert {"message-global-rpt-2", "message-vehicle-speed-rpt"} < {
        case.name for case in catalogue_for(open_wire("pacmod3"))
    }


def test_a_threshold_between_its_ends_is_kept_and_one_beyond_is_not() -> None:
    limit = Limit(key="deviation.lateral_stop_m", name="distance", unit="m", profile=3.0, lowest=2.9, highest=3.2)
    verdicts = [limit.at(value)[0].verdict for value in (2.8, 2.9, 3.2, 3.3, None)]
    assert verdicts == [Verdict.FAIL, Verdict.PASS, Verdict.PASS, Verdict.FAIL, Verdict.FAIL]
    assert replace(limit, lowest=None).at(0.0)[0].verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("lowest", "highest", "where"),
    [(2.9, 3.2, "between 2.9 and 3.2 m"), (2.9, None, "at 2.9 m or more"), (None, 3.2, "at 3.2 m or less")],
)
def test_the_check_of_a_threshold_says_where_it_must_act(
    lowest: float | None, highest: float | None, where: str
) -> None:
    limit = Limit(key="", name="distance", unit="m", profile=3.0, lowest=lowest, highest=highest)
    assert check_measured(limit.at(3.1)[0]).text == f"distance: acts {where} (profile 3)"


@pytest.mark.parametrize(
    ("period_s", "last_s", "is_kept"), [(0.01, 0.49, True), (0.01, 0.48, False), (0.02, 0.48, True)]
)
def test_silence_may_begin_with_the_command_that_would_have_come_next(
    period_s: float, last_s: float, is_kept: bool
) -> None:
    silence = SilentAfter(limit=Limit(key="", name="silence", unit="s", profile=0.5, lowest=0.489, highest=0.521))
    sent = [stop(5.0 + last_s - period_s * number) for number in reversed(range(10))]
    (found,) = silence.measure(replace(observed(*sent, samples=[5.0]), end_ns=7 * S))
    assert found.acts_at == pytest.approx(last_s)
    assert (found.verdict is Verdict.PASS) is is_kept
