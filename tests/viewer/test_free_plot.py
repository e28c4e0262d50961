"""The free plot: every number of the telemetry, with its unit, flag and range."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import viser

from vehicle_iface.telemetry import Snapshot
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.bus_table.bus_signals import SAMPLE, BusSignals
from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow, Samples, SignalValue
from vehicle_iface_viewer.panels import free_plot as module
from vehicle_iface_viewer.panels.free_plot import NONE, FreePlot, _find_gap, find_range
from vehicle_iface_viewer.panels.free_signals import FREE_SIGNALS
from vehicle_iface_viewer.panels.plot_frame import Range
from vehicle_iface_viewer.recent import RecentSnapshots

from .test_access import camera, joined, packed, wait_for_answer

NOW_NS = 1000 * NS_PER_S
FLAGS = {"has_state", "has_reference", "has_lookahead", "has_requested", "has_status", "sent", "handover_pending"}


def kept(*snapshots: Snapshot) -> RecentSnapshots:
    recent = RecentSnapshots(length_s=60.0)
    recent.extend(snapshots)
    return recent


def numbered(**changes: object) -> Snapshot:
    """Each field has its place as its value; all flags are set."""
    fields: dict[str, object] = {name: place for place, name in enumerate(Snapshot._fields, 1)}
    fields |= dict.fromkeys(FLAGS, True) | {"published_ns": NOW_NS, "stamp_ns": NOW_NS - 7 * NS_PER_MS}
    return Snapshot(**(fields | changes))  # type: ignore[arg-type]


def values(snapshot: Snapshot) -> dict[str, float]:
    rows = kept(snapshot).between(0, NOW_NS)
    return {name: float(signal.read(rows)[0]) for name, signal in FREE_SIGNALS.items()}


def test_each_signal_is_the_field_that_it_names_in_its_unit() -> None:
    found = values(numbered())
    place = {name: place for place, name in enumerate(Snapshot._fields, 1)}
    assert found.pop("state age, ms") == 7.0
    for name, value in found.items():
        words, _, unit = name.partition(", ")
        ending, factor = {
            "": ("", 1.0),
            "m": ("_m", 1.0),
            "m/s": ("_mps", 1.0),
            "m/s²": ("_mps2", 1.0),
            "°": ("_rad", math.degrees(1.0)),
            "°/s": ("_radps", math.degrees(1.0)),
            "ms": ("_ns", 1e-6),
        }[unit]
        assert value == pytest.approx(place[words.replace(" ", "_") + ending] * factor), name
    assert len(found) == len(Snapshot._fields) - len(FLAGS) - len(("published_ns", "stamp_ns", "frame_id", "sequence"))


@pytest.mark.parametrize(
    ("flag", "unknown"),
    [
        ("has_reference", {"lateral error, m", "heading error, °", "spatial index", "reference speed, m/s"}),
        ("has_lookahead", {"lookahead x, m", "lookahead y, m"}),
        ("has_requested", {"requested accel, m/s²", "requested front wheel angle, °"}),
        ("sent", {"sent accel, m/s²", "sent front wheel angle, °", "latency, ms"}),
        ("has_status", {"vehicle mode", "gear"}),
        ("handover_pending", {"handover in, ms"}),
    ],
)
def test_a_signal_is_unknown_where_its_flag_is_not_set(flag: str, unknown: set[str]) -> None:
    found = {name for name, value in values(numbered(**{flag: False})).items() if math.isnan(value)}
    assert unknown <= found
    assert not found & {"speed, m/s", "samples", "state age, ms"}
    assert values(numbered())["speed, m/s"] == values(numbered(**{flag: False}))["speed, m/s"]


def test_an_old_state_is_not_drawn_and_counters_are() -> None:
    found = {name for name, value in values(numbered(stamp_ns=NOW_NS - NS_PER_S)).items() if math.isnan(value)}
    assert {"x, m", "speed, m/s", "lateral error, m"} <= found
    assert not found & {"samples", "reason", "requested accel, m/s²", "latency, ms"}


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 0.0, (-0.5, 0.5)),
        (0.31, 0.47, (0.3, 0.5)),
        (-2000.3, -1990.0, (-2005.0, -1990.0)),
        (0.0, 1e9, (0.0, 1e9)),
        (100.0, 100.0, (99.95, 100.05)),
    ],
)
def test_a_range_has_round_ends_around_the_values(low: float, high: float, expected: tuple[float, float]) -> None:
    found = find_range(np.array([high, math.nan, low]), None)
    assert found is not None
    assert (found.low, found.high) == pytest.approx(expected)
    assert find_range(np.array([low, high]), found) is found


def test_a_range_is_kept_until_the_values_leave_it_or_fill_little_of_it() -> None:
    old = Range(low=0.0, high=10.0)
    assert find_range(np.array([2.0, 7.0]), old) is old
    assert find_range(np.array([math.nan]), old) is old
    assert find_range(np.array([2.0, 11.0]), old) == Range(low=0.0, high=15.0)
    assert find_range(np.array([2.0, 2.5]), old) == Range(low=2.0, high=2.6)


@pytest.fixture
def client(tmp_path: Path) -> Iterator[viser.ClientHandle]:
    app = App(Access(port=0), str(tmp_path / "loop"))
    with joined(app.server) as browser:
        browser.send(packed(camera()))
        while not app.server.get_clients():
            wait_for_answer(browser)
        (found,) = app.server.get_clients().values()
        yield found
    app.close()


def test_signals_of_one_unit_share_an_axis_and_others_do_not(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[list[float]] = []
    monkeypatch.setattr(module, "send_curves", lambda _, __, curves, *___: sent.append([np.nanmax(c) for c in curves]))
    plot = FreePlot(client, kept(numbered(speed_mps=5.0, reference_speed_mps=6.0, lateral_error_m=0.1)), BusSignals())

    def scales() -> list[str | None]:
        plot.show(end_ns=NOW_NS, window_s=20.0)
        return [series.get("scale") for series in plot._handle.series[1:-3]]

    assert scales() == ["y"]
    plot.choose(0, "speed, m/s")
    plot.choose(1, "reference speed, m/s")
    assert scales() == ["y", "y"]
    plot.choose(1, "lateral error, m")
    assert scales() == ["y", "right"]
    for place, name in ((1, "no such signal"), (0, NONE)):
        plot.choose(place, name)
    assert scales() == ["y", "right"]
    plot.choose(1, NONE)
    assert scales() == ["y"]
    assert sent[1:] == [[5.0, 6.0], [5.0, 0.1], [5.0]]  # what has not changed is not sent again


def test_a_signal_of_the_bus_is_named_until_it_is_received_and_then_drawn_at_its_full_rate(
    client: viser.ClientHandle, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[list[float]] = []
    monkeypatch.setattr(
        module, "send_curves", lambda _, __, curves, *___: sent.append(list(map(np.fmax.reduce, curves)))
    )
    bus, name = BusSignals(), "MOTION.SPEED, m/s"
    plot = FreePlot(client, kept(numbered(speed_mps=5.0)), bus)
    plot.choose(0, "speed, m/s")
    plot.choose(1, name)

    def show() -> str:
        plot.show(end_ns=NOW_NS, window_s=20.0)
        return plot._note.content

    bus.problem = "No frames were recorded."
    assert f"“{name}” is not among the signals, at least not yet, and not drawn (No frames" in show()
    assert (plot.names[1], plot.wanted[1]) == (NONE, name)
    signal = SignalValue(name="SPEED", value="1", unit="m/s")
    row = MessageRow(bus="", can_id="0x111", name="MOTION", frames=1, rate_hz=0.0, age_s=0.0, data="", signals=[signal])
    bus.update(BusReport(rows=[row]))
    assert show() == ""
    assert plot.names[1] == name
    assert [name in box.options for box in plot._boxes] == [True, True]
    (key,) = bus.advance()
    times = [NOW_NS - k * NS_PER_MS for k in range(500, 0, -1)]
    bus.extend([key], [Samples(times, [50.0 if k == 250 else 1.0 for k in range(500)])])
    show()
    assert sent[-1] == [5.0, 50.0]  # one sample in 500, half a pixel wide, is drawn
    assert not plot._has_two_axes()
    bus.extend([key], [Samples([NOW_NS], [60.0])])
    show()
    assert sent[-1] == [5.0, 60.0]
    bus.clear()
    assert "is not among the signals" in show()


@pytest.mark.parametrize(("period_ms", "gap_ms"), [(10, 250), (1000, 3000)])
def test_a_slow_message_is_no_line_of_gaps(period_ms: int, gap_ms: int) -> None:
    rows = np.zeros(20, SAMPLE)
    rows["at_ns"] = np.arange(20) * period_ms * NS_PER_MS
    assert _find_gap(rows) == gap_ms * NS_PER_MS
    assert _find_gap(rows[:1]) == 250 * NS_PER_MS
