"""Each line of the driver socket does what it says, and none disturbs the vehicle."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vehicle_bus_contract.reference import SAMPLE, DecodedFrame

from vehicle_iface.sim.driver_commands import COMMANDS
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.status import Gear, VehicleMode

from .harness import MS, VehicleHarness


@pytest.fixture
def harness() -> VehicleHarness:
    return VehicleHarness()


def sent_in_100_ms(harness: VehicleHarness, name: str) -> list[DecodedFrame]:
    before = len(harness.decoded)
    harness.wait_ms(100)
    return [decoded for decoded in harness.decoded[before:] if decoded.name == name]


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
def test_a_line_that_is_no_order_is_answered_with_what_is_allowed_and_changes_nothing(
    harness: VehicleHarness, line: str
) -> None:
    harness.engage()
    before, driver = harness.vehicle.state, harness.vehicle.driver
    answer = harness.send_line(line)
    if line == "ready":
        assert answer.startswith("error: ready: only from MANUAL")
    else:
        assert answer.startswith("error: ")
    assert "must be" in answer or "only from" in answer
    assert "\n" not in answer
    assert len(answer) < 400
    assert (harness.vehicle.state, harness.vehicle.driver) == (before, driver)
    assert harness.vehicle.mode is VehicleMode.AUTONOMOUS


_pressed_at_random = VehicleHarness()


@given(line=st.one_of(st.text(), st.builds(" ".join, st.lists(st.sampled_from([*COMMANDS, "1", "on", "ALL", "-5"])))))
@settings(max_examples=300, deadline=None)
def test_every_line_has_one_line_as_an_answer_and_the_vehicle_ticks_on(line: str) -> None:
    harness = _pressed_at_random
    answer = harness.send_line(line)
    assert answer
    assert len(answer.splitlines()) == 1
    frames = harness.vehicle.counters["overruns"]
    harness.wait_ms(10)
    assert harness.vehicle.counters["overruns"] == frames


def test_status_is_one_line_of_json(harness: VehicleHarness) -> None:
    harness.wait_ms(100)
    status = json.loads(harness.send_line("status"))
    assert status["mode"] == "READY"
    assert status["gear"] == "PARK"
    assert status["speed_mps"] == 0.0
    assert {"x_m", "y_m", "heading_rad", "pairs", "counters", "fault_code", "frame_id"} <= set(status)


def test_help_names_every_order(harness: VehicleHarness) -> None:
    assert all(word in harness.send_line("help") for word in COMMANDS)


def test_muted_pose_is_lost_while_its_counter_goes_on(harness: VehicleHarness) -> None:
    assert harness.send_line("mute POSE on") == "ok"
    assert sent_in_100_ms(harness, "POSE") == []
    assert len(sent_in_100_ms(harness, "MOTION")) == 10
    assert harness.send_line("mute POSE off") == "ok"
    assert len(sent_in_100_ms(harness, "POSE")) == 10
    assert harness.last("POSE").counter == harness.last("MOTION").counter


def test_mute_state_leaves_the_status_and_mute_all_leaves_nothing(harness: VehicleHarness) -> None:
    harness.send_line("mute STATE on")
    harness.wait_ms(100)
    assert {decoded.name for decoded in harness.decoded} == {"VEHICLE_STATUS"}
    harness.send_line("mute ALL on")
    assert sent_in_100_ms(harness, "VEHICLE_STATUS") == []
    harness.send_line("mute ALL off")
    assert len(sent_in_100_ms(harness, "VEHICLE_STATUS")) == 5


def test_corrupt_damages_so_many_frames_and_no_more(harness: VehicleHarness) -> None:
    harness.send_line("corrupt MOTION 3")
    harness.wait_ms(100)
    intact = harness.are_intact("MOTION")
    assert intact[:3] == [False, False, False]
    assert len(intact) > 3
    assert all(intact[3:])
    assert all(harness.are_intact("POSE", "CHASSIS", "VEHICLE_STATUS"))


def test_a_corrupt_order_is_taken_back_with_zero(harness: VehicleHarness) -> None:
    harness.send_line("corrupt ALL 1000")
    harness.send_line("corrupt ALL 0")
    harness.wait_ms(100)
    assert all(harness.are_intact())


@pytest.mark.parametrize("steps", [1, 3, 14])
def test_skip_counter_looks_like_lost_frames(harness: VehicleHarness, steps: int) -> None:
    harness.wait_ms(50)
    before = harness.last("POSE").counter
    harness.send_line(f"skip_counter STATE {steps}")
    harness.wait_ms(10)
    counters = {harness.last(name).counter for name in SAMPLE}
    assert counters == {(before + 1 + steps) % 15}


def test_skipping_one_messages_counter_takes_the_sample_apart(harness: VehicleHarness) -> None:
    harness.send_line("skip_counter POSE 1")
    harness.wait_ms(50)
    assert harness.last("POSE").counter != harness.last("MOTION").counter


def test_frozen_samples_repeat_their_values_with_live_counters() -> None:
    harness = VehicleHarness(BicycleState(speed_mps=5.0), gear=Gear.DRIVE)
    harness.wait_ms(50)
    harness.send_line("freeze on")
    decoded = sent_in_100_ms(harness, "POSE")
    assert len({one["POS_X"] for one in decoded}) == 1
    assert len({one.counter for one in decoded}) == 10
    harness.send_line("freeze off")
    assert sent_in_100_ms(harness, "POSE")[-1]["POS_X"] > decoded[-1]["POS_X"] + 0.8


def test_a_jump_is_on_the_bus_with_the_next_sample(harness: VehicleHarness) -> None:
    harness.tick()
    harness.send_line("jump 3.0 -2.0")
    harness.wait_ms(10)
    assert (harness.last("POSE")["POS_X"], harness.last("POSE")["POS_Y"]) == pytest.approx((3.0, -2.0))


def test_the_gear_lever_is_refused_above_its_speed() -> None:
    harness = VehicleHarness(BicycleState(speed_mps=2.0), mode=VehicleMode.MANUAL, gear=Gear.DRIVE)
    assert harness.send_line("gear REVERSE").startswith("error: gear: only up to 0.5 m/s")
    assert harness.vehicle.gear is Gear.DRIVE


def test_orders_take_no_time_on_the_grid(harness: VehicleHarness) -> None:
    harness.tick()
    due_ns = harness.vehicle.next_due_ns
    harness.send_line("skip_counter ALL 15")
    assert harness.vehicle.next_due_ns == due_ns == harness.now_ns + 10 * MS
