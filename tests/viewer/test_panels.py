"""The words of the page: right, and only words."""

import html
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Reason
from vehicle_iface.status import ControllerState, Gear
from vehicle_iface.telemetry import DrawnTrajectory, SessionInfo, Snapshot, WriterState
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails, ShadowSummary, Spread
from vehicle_iface.telemetry.events import EventKind, LoopEvent, Phase
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.banner import banner_html
from vehicle_iface_viewer.panels.counters import counters_html
from vehicle_iface_viewer.panels.events import events_html
from vehicle_iface_viewer.panels.latency import latency_html
from vehicle_iface_viewer.panels.legend import legend_html
from vehicle_iface_viewer.panels.numbers import numbers_html
from vehicle_iface_viewer.panels.plots import PLOTS
from vehicle_iface_viewer.panels.text import plain
from vehicle_iface_viewer.recent import RecentSnapshots


class _PageText(HTMLParser):
    """The tags of a piece of HTML with their attributes' names, and its words."""

    def __init__(self, content: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, tuple[str, ...]]] = []
        self.text = ""
        self.feed(content)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, tuple(name for name, _ in attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data + " "


def view(
    snapshot: Snapshot | None, *, text: str = "plain", writer_state: WriterState = WriterState.LIVE, age_s: float = 0.0
) -> View:
    return View(
        now_ns=NS_PER_S + round(age_s * NS_PER_S),
        address=text,
        writer_state=writer_state,
        problem=text,
        info=SessionInfo(
            channel=text, bus=text, bus_hint=text, profile=text, route=text, arming=text, unprotected=(text,)
        ),
        snapshot=snapshot,
        trajectory=path(frame_id=text),
        details=LiveDetails(link=LinkDetails(state=text), drops={text: 1, "list": 2}),
    )


def path(frame_id: str = "map", speed_mps: float = 3.0) -> DrawnTrajectory:
    two = np.array([0.0, 1.0])
    speeds = np.full(2, speed_mps)
    return DrawnTrajectory(
        version=1,
        stamp_ns=0,
        frame_id=frame_id,
        original_count=2,
        x_m=two,
        y_m=two,
        heading_rad=two,
        speed_mps=speeds,
        time_s=two,
    )


def whole_page(of: View) -> str:
    return "".join((banner_html(of), numbers_html(of), legend_html(of), counters_html(of)))


def driving(**changes: object) -> Snapshot:
    return Snapshot(NS_PER_S, ControllerState.ENGAGED, Reason.NOMINAL, has_state=True, stamp_ns=NS_PER_S)._replace(
        **changes  # type: ignore[arg-type]
    )


def test_the_banner_names_the_messages_that_have_no_protection_once_and_briefly() -> None:
    of = view(driving())
    assert of.info is not None
    assert "unprotected" not in banner_html(replace(of, info=replace(of.info, unprotected=())))
    few = replace(of, info=replace(of.info, unprotected=("MOTION_STATE", "<b>")))
    assert "unprotected: MOTION_STATE, <b> " in _PageText(banner_html(few)).text
    many = replace(of, info=replace(of.info, unprotected=tuple(f"M{number}" for number in range(9))))
    assert "unprotected: M0, M1, M2, M3, M4, M5 and 3 more " in _PageText(banner_html(many)).text


@given(
    text=st.text(st.characters(codec="utf-8"), min_size=1) | st.sampled_from(("<b>", "'\"><script>x</script>", "&lt;"))
)
@pytest.mark.parametrize("writer_state", list(WriterState))
def test_no_text_becomes_markup(text: str, writer_state: WriterState) -> None:
    for snapshot in (None, driving(frame_id="?" + text)):
        expected = _PageText(whole_page(view(snapshot, writer_state=writer_state)))
        assert _PageText(whole_page(view(snapshot, text=text, writer_state=writer_state))).tags == expected.tags


def test_markup_is_shown_as_it_was_written() -> None:
    words = _PageText(banner_html(view(driving(), text="<b onclick=x>&amp;")))
    assert words.text.count("<b onclick=x>&amp;") >= 4


def test_long_texts_are_cut_and_lines_joined() -> None:
    assert len(plain("x" * 10_000)) < 200
    assert "\n" not in plain("a\nb")


def test_a_shadow_shows_its_differences_from_another_commander() -> None:
    found = ShadowSummary(
        compared=812,
        takeovers=1,
        unmatched_commands=0,
        drops={},
        mismatches={},
        accel_mps2=Spread(mean=0.01, p50=0.011, p95=0.0204, max=0.03),
        front_wheel_angle_rad=Spread(mean=0.0001, p50=0.00011, p95=0.00031, max=0.0005),
    )
    of = view(driving(controller_state=ControllerState.SHADOW))
    link = LinkDetails(state="UP")
    banner = banner_html(replace(of, details=LiveDetails(link=link, shadow=found)))
    assert "other commander: 812 commands, 95 % differ by at most 0.020 m/s², 0.0003 rad" in _PageText(banner).text
    for other in (
        None,
        LiveDetails(link=link),
        LiveDetails(link=link, shadow=msgspec.structs.replace(found, compared=0)),
    ):
        assert "other commander" not in banner_html(replace(of, details=other))


def test_the_banner_shows_the_distance_of_odometry_and_the_oldest_part_of_a_sample() -> None:
    details = LiveDetails(
        link=LinkDetails(state="UP"), odometry_m=51.66, part_ages_s={"ABS": 0.002, "GNSS<": 0.0491, "ESP": 0.01}
    )
    words = _PageText(banner_html(replace(view(driving()), details=details))).text
    assert "position by odometry: 51.7 m driven; its error grows with the distance" in words
    assert "oldest part of a sample: GNSS<, 49 ms" in words
    for other in (None, LiveDetails(link=LinkDetails(state="UP"), part_ages_s={})):
        words = _PageText(banner_html(replace(view(driving()), details=other))).text
        assert "odometry" not in words
        assert "oldest" not in words


@pytest.mark.parametrize("state", list(ControllerState))
def test_the_banner_names_state_and_reason(state: ControllerState) -> None:
    content = banner_html(view(driving(controller_state=state, reason=Reason.DEVIATION)))
    words = _PageText(content).text
    assert state.name in words
    assert "DEVIATION" in words
    assert f'data-state="{state.name}" data-reason="DEVIATION" data-stale="false"' in content


def test_engaged_stopping_fault_shadow_and_old_differ_in_colour() -> None:
    states = (ControllerState.ENGAGED, ControllerState.STOPPING, ControllerState.FAULT, ControllerState.SHADOW)
    views = [view(driving(controller_state=s)) for s in states] + [view(driving(), age_s=1.0)]
    assert len({banner_html(v).split("background:")[1][:7] for v in views}) == 5


@pytest.mark.parametrize(("left_ns", "when"), [(2_140_000_000, "in 2.1 s at the earliest"), (0, "at standstill")])
def test_the_banner_shows_the_driver_when_to_take_over(left_ns: int, when: str) -> None:
    shown = driving(handover_pending=True, handover_in_ns=left_ns)
    assert f"TAKE OVER control is returned {when}" in _PageText(banner_html(view(shown))).text
    assert "TAKE OVER" not in _PageText(banner_html(view(shown, age_s=1.0))).text
    assert "TAKE OVER" not in _PageText(banner_html(view(driving(handover_in_ns=left_ns)))).text


def test_old_data_is_called_old() -> None:
    words = _PageText(banner_html(view(driving(), age_s=1.2))).text
    assert "no data for 1.2 s" in words
    assert "ENGAGED" in words


@pytest.mark.parametrize(
    ("writer_state", "words"),
    [(WriterState.ENDED, "LOOP ENDED"), (WriterState.DEAD, "LOOP GONE"), (WriterState.ABSENT, "NO LOOP")],
)
def test_a_loop_that_is_gone_is_called_gone(writer_state: WriterState, words: str) -> None:
    gone = _PageText(banner_html(view(driving(), writer_state=writer_state))).text
    assert gone.startswith(words)
    assert "last known:  ENGAGED" in gone
    assert "no data for 0.0 s" in gone
    assert words in _PageText(banner_html(view(None, writer_state=writer_state))).text


def test_codes_that_this_version_does_not_know_are_shown_as_numbers() -> None:
    words = _PageText(banner_html(view(driving(controller_state=77, reason=-3)))).text
    assert "ControllerState 77" in words
    assert "Reason -3" in words


def test_a_value_that_was_never_received_has_no_figure() -> None:
    nothing = Snapshot(NS_PER_S, ControllerState.STARTING, Reason.NOT_ENGAGED)
    assert "0.00 m" not in _PageText(numbers_html(view(nothing))).text


@pytest.mark.parametrize(("gear", "shown"), [(Gear.REVERSE, "gear REVERSE"), (Gear.NO_REQUEST, "gear –")])
def test_an_unreported_gear_is_shown_as_a_dash(gear: Gear, shown: str) -> None:
    words = _PageText(numbers_html(view(driving(has_status=True, gear=gear)))).text
    assert shown in " ".join(words.split())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_impossible_numbers_are_named_not_drawn(bad: float) -> None:
    content = whole_page(view(driving(x_m=bad, y_m=bad, heading_rad=bad, speed_mps=bad)))
    assert "out of range" in content
    legend_html(View(now_ns=0, address="a", writer_state=WriterState.LIVE, trajectory=path(speed_mps=bad)))


@given(stamp_ns=st.integers(-(2**63), 2**63 - 1), numbers=st.integers(-(2**63), 2**63 - 1))
def test_any_stamps_and_counters_can_be_shown(stamp_ns: int, numbers: int) -> None:
    whole_page(view(driving(published_ns=stamp_ns, stamp_ns=stamp_ns, samples=numbers, latency_ns=numbers, sent=True)))


def test_trajectory_and_vehicle_in_different_frames_are_not_drawn_together_but_named() -> None:
    words = _PageText(banner_html(view(driving(frame_id="odom"), text="map"))).text
    assert "trajectory in frame map, vehicle in odom" in words


def test_counters_without_end_are_cut() -> None:
    many = View(
        now_ns=0,
        address="a",
        writer_state=WriterState.LIVE,
        details=LiveDetails(link=LinkDetails(state="UP"), drops={str(k): k for k in range(5000)}),
    )
    assert "more, not shown" in counters_html(many)
    assert counters_html(many).count("<tr>") <= 101


@pytest.mark.parametrize("state", ["DEGRADED", "DOWN", "GONE", "RECOVERING", "<b>"])
def test_a_link_that_is_not_up_is_shown_in_the_banner(state: str) -> None:
    shown = banner_html(replace(view(Snapshot(0, 3, 0)), details=LiveDetails(link=LinkDetails(state=state))))
    assert f"link {html.escape(state)}" in shown


def test_the_banner_has_the_bus_load_and_nothing_about_a_link_that_is_up() -> None:
    link = LinkDetails(state="UP", load_percent=14.6, frames_per_s=612.0, rates_hz={})
    shown = banner_html(replace(view(Snapshot(0, 3, 0)), details=LiveDetails(link=link)))
    assert "bus load 14.6 % · 612 frames/s" in shown
    assert 'id="link"' not in shown


def test_of_several_buses_the_load_of_each_is_shown() -> None:
    loads = {"vehicle": 14.6, "ins": 20.0}
    link = LinkDetails(state="UP", load_percent=20.0, loads_percent=loads, frames_per_s=612.0, rates_hz={})
    shown = banner_html(replace(view(Snapshot(0, 3, 0)), details=LiveDetails(link=link)))
    assert "bus load vehicle 14.6 %, ins 20.0 % · 612 frames/s" in shown


def test_a_link_that_is_not_up_is_shown_with_its_reason() -> None:
    link = LinkDetails(state="DOWN", why="bus ins: can1: <Network> is down")
    shown = banner_html(replace(view(Snapshot(0, 3, 0)), details=LiveDetails(link=link)))
    assert ">link DOWN: bus ins: can1: &lt;Network&gt; is down</div>" in shown


def test_every_number_and_curve_of_the_page_shows_the_field_that_it_names() -> None:
    fields = {name: float(place) for place, name in enumerate(Snapshot._fields, 1)}
    fields |= dict.fromkeys(
        (name for name in fields if name.startswith("has_") or name in ("sent", "handover_pending")), 1
    )
    snapshot = Snapshot(**fields)._replace(  # type: ignore[arg-type]
        reason=Reason.NOMINAL,
        spatial_index=91,
        temporal_index=92,
        commands=93,
        drops=94,
        deadline_misses=95,
        frame_id="odom",
        gear=Gear.DRIVE,
    )
    shown = dict(re.findall(r'id="n-([a-z-]+)"[^>]*>([^<]*)<', numbers_html(view(snapshot))))
    assert shown["x"] == f"{fields['x_m']:.2f} m"
    assert shown["y"] == f"{fields['y_m']:.2f} m"
    assert shown["heading"] == f"{math.degrees(fields['heading_rad']):.1f} °"
    assert shown["speed"] == f"{fields['speed_mps']:.2f} m/s"
    assert (shown["gear"], shown["frame"]) == ("DRIVE", "odom")
    assert (shown["spatial-ref"], shown["temporal-ref"]) == ("91 / 1", "92 / 1")
    assert shown["lateral-error"] == f"{fields['lateral_error_m']:.3f} m"
    assert shown["heading-error"] == f"{math.degrees(fields['heading_error_rad']):.2f} °"
    assert (shown["commands"], shown["frames-dropped"], shown["deadlines-missed"]) == ("93", "94", "95")
    recent = RecentSnapshots(length_s=1.0)
    recent.extend([snapshot])
    rows = recent.between(0, snapshot.published_ns)
    curves = {(plot.title, curve.label): float(curve.read(rows)[0]) for plot in PLOTS for curve in plot.curves}
    assert curves == {
        ("Front wheels, ° (left positive)", "limited"): math.degrees(fields["sent_front_wheel_angle_rad"]),
        ("Acceleration, m/s²", "limited"): fields["sent_accel_mps2"],
        ("Speed, m/s", "reference"): fields["reference_speed_mps"],
        ("Speed, m/s", "vehicle"): fields["speed_mps"],
        ("Lateral error, m (left positive)", "vehicle"): fields["lateral_error_m"],
        ("Heading error, ° (left positive)", "vehicle"): math.degrees(fields["heading_error_rad"]),
        ("Front wheels, ° (left positive)", "requested"): math.degrees(fields["requested_front_wheel_angle_rad"]),
        ("Front wheels, ° (left positive)", "sent"): math.degrees(fields["sent_front_wheel_angle_rad"]),
        ("Front wheels, ° (left positive)", "vehicle"): math.degrees(fields["front_wheel_angle_rad"]),
        ("Acceleration, m/s²", "requested"): fields["requested_accel_mps2"],
        ("Acceleration, m/s²", "sent"): fields["sent_accel_mps2"],
        ("Acceleration, m/s²", "vehicle"): fields["accel_mps2"],
    }


def test_a_value_that_rounds_to_zero_has_no_sign() -> None:
    small = driving(heading_rad=-1e-5, x_m=-1e-4, has_reference=True, heading_error_rad=-1e-6, lateral_error_m=-1e-5)
    words = _PageText(numbers_html(view(small))).text
    assert "0.00 m" in words
    assert "-0" not in words


def test_a_rate_that_is_not_known_is_a_dash_and_not_zero() -> None:
    words = _PageText(banner_html(view(driving()))).text
    assert "samples/s –" in words
    assert "commands/s –" in words


def test_what_the_loop_limited_is_shown_as_soon_as_it_limits() -> None:
    link = LinkDetails(state="UP")
    counted = LiveDetails(link=link, limited={"front_wheel_angle": 460, "<b>": 3, "accel": 0})
    words = _PageText(numbers_html(replace(view(driving()), details=counted))).text
    assert "commands limited: front_wheel_angle 460, <b> 3 " in words
    none = LiveDetails(link=link, limited={"accel": 0})
    assert "limited" not in numbers_html(replace(view(driving()), details=none))


def test_the_latency_of_all_commands_is_shown_with_its_percentiles() -> None:
    recent = RecentSnapshots(length_s=10.0)
    assert "no command was sent" in latency_html(recent)
    latencies_ms = [0.3] * 94 + [3.0] * 5 + [30.0]
    recent.extend(
        driving(published_ns=NS_PER_S + k * 10_000_000, sent=True, latency_ns=round(ms * 1e6))
        for k, ms in enumerate(latencies_ms)
    )
    recent.extend([driving(published_ns=3 * NS_PER_S, latency_ns=10**9)])  # nothing was sent
    words = " ".join(_PageText(latency_html(recent)).text.split())
    assert "100 commands of the last 2 s" in words
    assert "p50 0.30 ms p95 3.00 ms p99 3.27 ms max 30.00 ms" in words
    assert "0.2 … 0.5 ms 94" in words
    assert "20 … 50 ms 1 " in words


def test_events_are_listed_newest_first_with_time_phase_and_text() -> None:
    bad = "<b onclick=x>"
    events = [
        LoopEvent(number=1, at_ns=NS_PER_S, kind=EventKind.STOP, name="DEVIATION", phase=Phase.BEGAN, text="stopped"),
        LoopEvent(number=2, at_ns=2_345_600_000, kind=EventKind.TRAJECTORY, name=bad, text=bad),
    ]
    content = events_html(events, 3600 * NS_PER_S)
    assert bad not in content
    words = " ".join(_PageText(content).text.split())
    assert words.endswith(f"01:00:02.345 trajectory {bad} {bad} 01:00:01.000 stop DEVIATION began stopped")
    assert "no event yet" in events_html([], 0)


def test_of_many_events_the_newest_hundred_are_shown() -> None:
    many = [LoopEvent(number=k, at_ns=k, kind=EventKind.LINK, name=f"number {k} ") for k in range(1, 301)]
    content = events_html(many, 0)
    assert content.count("vi-event") == 100
    assert "100 events of 300" in content
    assert "number 300 " in content
    assert "number 200 " not in content
