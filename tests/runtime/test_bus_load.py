"""Loads and rates from samples of the traffic."""

import pytest

from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.frame import FrameKey
from vehicle_iface.runtime.bus_load import BusLoad
from vehicle_iface.telemetry.details import LinkDetails, LinkSummary
from vehicle_iface.units import NS_PER_S

NAMES = {FrameKey(0x110): "POSE"}


def test_without_traffic_samples_no_bus_load_is_published() -> None:
    assert BusLoad().now("UP", NAMES, {}) == LinkDetails(state="UP")
    assert BusLoad().whole("UP", [], NAMES, {}) == LinkSummary(state="UP", transitions=[])


def test_a_stretch_of_no_time_changes_nothing() -> None:
    load = BusLoad()
    load.add(TrafficSample(0, 5, 100, {}))
    assert load.whole("UP", [], NAMES, {}) == LinkSummary(state="UP", transitions=[])


def test_load_is_the_share_of_time_in_which_the_bus_was_held() -> None:
    load = BusLoad()
    load.add(TrafficSample(NS_PER_S, 600, NS_PER_S // 4, {FrameKey(0x110): 100.0, FrameKey(0x3A0): 500.0}))
    load.add(TrafficSample(NS_PER_S, 200, NS_PER_S // 20, {FrameKey(0x110): 100.0, FrameKey(0x12D687, True): 100.0}))
    now, whole = load.now("UP", NAMES, {}), load.whole("UP", [], NAMES, {})
    assert now == LinkDetails(
        state="UP", load_percent=5.0, frames_per_s=200.0, rates_hz={"0x110 POSE": 100.0, "0x0012D687x": 100.0}
    )
    assert whole.load_percent == 15.0
    assert whole.highest_load_percent == 25.0
    assert whole.frames_per_s == 400.0
    assert whole.rates_hz == {"0x110 POSE": 100.0, "0x3A0": 250.0, "0x0012D687x": 50.0}


def test_a_bus_that_is_held_all_the_time_has_a_load_of_one_hundred_percent() -> None:
    load = BusLoad()
    load.add(TrafficSample(NS_PER_S // 2, 2000, NS_PER_S // 2, {}))
    assert load.whole("UP", [], NAMES, {}).load_percent == pytest.approx(100.0)


def test_counted_bits_replace_estimates() -> None:
    load = BusLoad()
    pose, unknown = FrameKey(0x110), FrameKey(0x3A0)
    load.add(TrafficSample(NS_PER_S, 200, 0, {pose: 80.0, unknown: 120.0}))
    assert load.now("UP", NAMES, {pose: 100}).rates_hz == {"0x110 POSE": 100.0, "0x3A0": 120.0}
    load.add(TrafficSample(NS_PER_S // 2, 200, 0, {pose: 90.0, unknown: 110.0}))
    assert load.now("UP", NAMES, {pose: 150}).rates_hz == {"0x110 POSE": 100.0, "0x3A0": 220.0}
    assert load.now("UP", NAMES, {pose: 151}).rates_hz == {"0x110 POSE": 100.0, "0x3A0": 220.0}
    assert load.whole("UP", [], NAMES, {pose: 150}).rates_hz == {"0x110 POSE": 100.0, "0x3A0": 153.3}
