"""The strip: colours of states, ticks, and nothing where nothing is known."""

import re

import pytest

from vehicle_iface import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import Snapshot
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_MS, NS_PER_S, ns_from_s
from vehicle_iface_viewer.panels.colors import AMBER, GREEN, GREY, LIMITED, RED, VIOLET, state_color
from vehicle_iface_viewer.panels.strip import Span, strip_html
from vehicle_iface_viewer.recent import RecentSnapshots

BEGIN_NS = 1000 * NS_PER_S
SPAN = Span.between(BEGIN_NS, BEGIN_NS + 30 * NS_PER_S)
STOP, DROPPED, LATE = "#fff", "#74c0fc", "#ffd43b"


def snapshots(begin_s: float, end_s: float, state: ControllerState, **changes: int) -> list[Snapshot]:
    """Snapshots at 100 Hz."""
    return [
        Snapshot(BEGIN_NS + k * 10 * NS_PER_MS, state, Reason.NOMINAL, **changes)  # type: ignore[arg-type]
        for k in range(round(begin_s * 100), round(end_s * 100))
    ]


def event(number: int, at_s: float, kind: EventKind, name: str = "a", phase: Phase = Phase.ONCE) -> LoopEvent:
    return LoopEvent(number=number, at_ns=BEGIN_NS + ns_from_s(at_s), kind=kind, name=name, phase=phase)


def strokes(of: list[Snapshot], *events: LoopEvent) -> dict[str, list[tuple[float, float]]]:
    """Begin and length of each stroke in s, by colour."""
    recent = RecentSnapshots(length_s=60.0)
    recent.extend(of)
    shown = strip_html("x", SPAN, recent.between(0, SPAN.end_ns), events, ("a", "b"))
    return {
        color: [(int(at) / 10, int(length) / 10) for at, length in re.findall(r"M(\d+) [\d.]+h(\d+)", path)]
        for path, color in re.findall(r'<path d="([^"]*)" stroke="([^"]*)"', shown)
    }


ENGAGED, STOPPING, FAULT = ControllerState.ENGAGED, ControllerState.STOPPING, ControllerState.FAULT


def test_each_state_has_the_colour_of_the_banner_for_as_long_as_it_lasts() -> None:
    found = strokes([*snapshots(0, 10, ENGAGED), *snapshots(10, 11, STOPPING), *snapshots(11, 30, FAULT)])
    assert found == {GREEN: [(0.0, 10.0)], AMBER: [(10.0, 1.0)], RED: [(11.0, 19.0)]}


def test_the_worst_state_of_a_column_is_drawn_however_short() -> None:
    found = strokes([*snapshots(0, 10, ENGAGED), *snapshots(10.04, 10.05, FAULT), *snapshots(10.05, 30, ENGAGED)])
    assert found[RED] == [(10.0, 0.1)]


def test_a_time_without_data_has_no_colour() -> None:
    assert strokes([]) == {}
    found = strokes([*snapshots(2, 10, ENGAGED), *snapshots(10.2, 12, ENGAGED), *snapshots(13, 14, ENGAGED)])
    assert found == {GREEN: [(2.0, 10.0), (13.0, 1.0)]}


def test_stops_limits_drops_and_late_passes_are_marked() -> None:
    drive = [
        *snapshots(0, 5, ENGAGED, drops=3),
        *snapshots(5, 8, ENGAGED, drops=5),
        *snapshots(8, 30, ENGAGED, drops=5, deadline_misses=1),
    ]
    events = (
        event(1, 4.0, EventKind.LIMIT, "accel", Phase.BEGAN),
        event(2, 4.5, EventKind.LIMIT, "angle", Phase.ENDED),
        event(3, 6.0, EventKind.LIMIT, "accel", Phase.ENDED),
        event(4, 20.0, EventKind.STOP, "DEVIATION", Phase.BEGAN),
        event(5, 21.0, EventKind.STOP, "DEVIATION", Phase.ENDED),
        event(6, 29.0, EventKind.LIMIT, "accel", Phase.BEGAN),
    )
    found = strokes(drive, *events)
    assert found[STOP] == [(20.0, 0.1)]
    assert found[LIMITED] == [(0.0, 6.1), (29.0, 1.0)]
    assert (found[DROPPED], found[LATE]) == ([(5.0, 0.1)], [(8.0, 0.1)])


def test_what_happened_is_counted_in_words() -> None:
    recent = RecentSnapshots(length_s=60.0)
    recent.extend([*snapshots(0, 5, ENGAGED), *snapshots(5, 9, ENGAGED, drops=4)])
    events = [event(1, 3.0, EventKind.STOP), event(2, 40.0, EventKind.STOP)]
    shown = strip_html("x", SPAN, recent.between(0, SPAN.end_ns), events, ("-30 s", "now"))
    assert re.sub("<[^>]*>", " ", shown).split() == ["-30", "s", "stops", "1", "dropped", "4", "now"]


@pytest.mark.parametrize(
    ("state", "reason", "color"),
    [
        (ControllerState.STOPPING, Reason.SHUTDOWN, GREY),
        (ControllerState.STANDBY, Reason.DRIVER_OVERRIDE, VIOLET),
        (99, 77, RED),
        (-1, 10**6, RED),
    ],
)
def test_reasons_that_change_the_colour_and_codes_that_are_not_known(state: int, reason: int, color: str) -> None:
    assert state_color(state, reason) == color
    assert next(iter(strokes([Snapshot(BEGIN_NS + 1, state, reason)]))) == color


def test_the_columns_of_a_live_strip_keep_their_places_in_time() -> None:
    now_ns = 12345 * NS_PER_MS
    first, next_one = Span.until(now_ns, 30 * NS_PER_S), Span.until(now_ns + 100 * NS_PER_MS, 30 * NS_PER_S)
    assert next_one.begin_ns - first.begin_ns == first.width_ns == 100 * NS_PER_MS
    assert 0 < first.end_ns - now_ns <= first.width_ns
