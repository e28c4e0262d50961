"""The pedals' words: each does what it says, and none disturbs the vehicle."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.orders import ORDERS
from vehicle_iface.status import Gear, VehicleMode

from .bench import MS, Bench
from .contract import SAMPLE, Told


@pytest.fixture
def bench() -> Bench:
    return Bench()


def sent_in_100_ms(bench: Bench, name: str) -> list[Told]:
    before = len(bench.told)
    bench.wait_ms(100)
    return [told for told in bench.told[before:] if told.name == name]


@pytest.mark.parametrize(
    "line",
    [
        "",
        "   ",
        "fly",
        "brake",
        "brake 2",
        "brake 1 1",
        "BRAKE 1",
        "throttle maybe",
        "steer",
        "steer left",
        "steer nan",
        "steer inf",
        "steer 12.8",
        "steer -1e300",
        "gear 3",
        "gear NO_REQUEST",
        "fault 0",
        "fault 256",
        "fault 1.5",
        "fault " + "9" * 200,
        "pose_valid 2",
        "frame UTM",
        "mute",
        "mute POSE",
        "mute NOTHING on",
        "mute DRIVE_COMMAND on",
        "corrupt POSE -1",
        "corrupt POSE many",
        "corrupt POSE 1000000000",
        "skip_counter POSE 0",
        "skip_counter POSE 16",
        "jump 1",
        "jump nan 0",
        "status please",
        "ready",
        "reset",
        "\x00\x1b[2J",
        "brake\n1\nreset",
    ],
)
def test_a_line_that_is_no_order_is_answered_with_what_is_allowed_and_changes_nothing(bench: Bench, line: str) -> None:
    bench.engage()
    before, driver = bench.vehicle.state, bench.vehicle.driver
    answer = bench.say(line)
    if line == "ready":
        assert answer.startswith("error: ready: only from MANUAL")
    else:
        assert answer.startswith("error: ")
    assert "must be" in answer or "only from" in answer
    assert "\n" not in answer
    assert len(answer) < 400
    assert (bench.vehicle.state, bench.vehicle.driver) == (before, driver)
    assert bench.vehicle.mode is VehicleMode.AUTONOMOUS


_pressed_at_random = Bench()


@given(line=st.one_of(st.text(), st.builds(" ".join, st.lists(st.sampled_from([*ORDERS, "1", "on", "ALL", "-5"])))))
@settings(max_examples=300, deadline=None)
def test_every_line_has_one_line_as_an_answer_and_the_vehicle_ticks_on(line: str) -> None:
    bench = _pressed_at_random
    answer = bench.say(line)
    assert answer
    assert len(answer.splitlines()) == 1
    frames = bench.vehicle.counters["overruns"]
    bench.wait_ms(10)
    assert bench.vehicle.counters["overruns"] == frames


def test_status_is_one_line_of_json(bench: Bench) -> None:
    bench.wait_ms(100)
    status = json.loads(bench.say("status"))
    assert status["mode"] == "READY"
    assert status["gear"] == "PARK"
    assert status["speed_mps"] == 0.0
    assert {"x_m", "y_m", "heading_rad", "pairs", "counters", "fault_code", "frame_id"} <= set(status)


def test_help_names_every_order(bench: Bench) -> None:
    assert all(word in bench.say("help") for word in ORDERS)


def test_muted_pose_is_lost_while_its_counter_goes_on(bench: Bench) -> None:
    assert bench.say("mute POSE on") == "ok"
    assert sent_in_100_ms(bench, "POSE") == []
    assert len(sent_in_100_ms(bench, "MOTION")) == 10
    assert bench.say("mute POSE off") == "ok"
    assert len(sent_in_100_ms(bench, "POSE")) == 10
    assert bench.last("POSE").counter == bench.last("MOTION").counter


def test_mute_state_leaves_the_status_and_mute_all_leaves_nothing(bench: Bench) -> None:
    bench.say("mute STATE on")
    bench.wait_ms(100)
    assert {told.name for told in bench.told} == {"VEHICLE_STATUS"}
    bench.say("mute ALL on")
    assert sent_in_100_ms(bench, "VEHICLE_STATUS") == []
    bench.say("mute ALL off")
    assert len(sent_in_100_ms(bench, "VEHICLE_STATUS")) == 5


def test_corrupt_damages_so_many_frames_and_no_more(bench: Bench) -> None:
    bench.say("corrupt MOTION 3")
    told = sent_in_100_ms(bench, "MOTION")
    assert [one.is_intact for one in told[:4]] == [False, False, False, True]
    assert all(one.is_intact for one in told[3:])
    assert all(one.is_intact for one in bench.told if one.name != "MOTION")


def test_a_corrupt_order_is_taken_back_with_zero(bench: Bench) -> None:
    bench.say("corrupt ALL 1000")
    bench.say("corrupt ALL 0")
    bench.wait_ms(100)
    assert all(told.is_intact for told in bench.told)


@pytest.mark.parametrize("steps", [1, 3, 14])
def test_skip_counter_looks_like_lost_frames(bench: Bench, steps: int) -> None:
    bench.wait_ms(50)
    before = bench.last("POSE").counter
    bench.say(f"skip_counter STATE {steps}")
    bench.wait_ms(10)
    counters = {bench.last(name).counter for name in SAMPLE}
    assert counters == {(before + 1 + steps) % 15}


def test_skipping_one_messages_counter_takes_the_sample_apart(bench: Bench) -> None:
    bench.say("skip_counter POSE 1")
    bench.wait_ms(50)
    assert bench.last("POSE").counter != bench.last("MOTION").counter


def test_frozen_samples_repeat_their_values_with_live_counters() -> None:
    bench = Bench(BicycleState(speed_mps=5.0), gear=Gear.DRIVE)
    bench.wait_ms(50)
    bench.say("freeze on")
    told = sent_in_100_ms(bench, "POSE")
    assert len({one["POS_X"] for one in told}) == 1
    assert len({one.counter for one in told}) == 10
    bench.say("freeze off")
    assert sent_in_100_ms(bench, "POSE")[-1]["POS_X"] > told[-1]["POS_X"] + 0.8


def test_a_jump_is_on_the_bus_with_the_next_sample(bench: Bench) -> None:
    bench.tick()
    bench.say("jump 3.0 -2.0")
    bench.wait_ms(10)
    assert (bench.last("POSE")["POS_X"], bench.last("POSE")["POS_Y"]) == pytest.approx((3.0, -2.0))


def test_the_gear_lever_is_refused_above_its_speed() -> None:
    bench = Bench(BicycleState(speed_mps=2.0), mode=VehicleMode.MANUAL, gear=Gear.DRIVE)
    assert bench.say("gear REVERSE").startswith("error: gear: only up to 0.5 m/s")
    assert bench.vehicle.gear is Gear.DRIVE


def test_orders_take_no_time_on_the_grid(bench: Bench) -> None:
    bench.tick()
    due_ns = bench.vehicle.next_due_ns
    bench.say("skip_counter ALL 15")
    assert bench.vehicle.next_due_ns == due_ns == bench.now_ns + 10 * MS
