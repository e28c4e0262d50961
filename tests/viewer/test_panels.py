"""The words of the page: right, and only words."""

import html
import math
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Reason
from vehicle_iface.runtime.telemetry import DrawnTrajectory, SessionInfo, Snapshot, WriterState
from vehicle_iface.status import ControllerState, Gear
from vehicle_iface.units import NS_PER_S
from viewer import panels
from viewer.feed import View


class _Words(HTMLParser):
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
    snapshot: Snapshot | None, *, text: str = "plain", link: WriterState = WriterState.LIVE, age_s: float = 0.0
) -> View:
    return View(
        now_ns=NS_PER_S + round(age_s * NS_PER_S),
        address=text,
        link=link,
        problem=text,
        info=SessionInfo(channel=text, bus=text, bus_hint=text, profile=text, route=text, arming=text),
        snapshot=snapshot,
        trajectory=path(frame_id=text),
        details={text: {text: text}, "list": [text]},
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
    return "".join((panels.banner_html(of), panels.numbers_html(of), panels.legend_html(of), panels.details_html(of)))


def driving(**changes: object) -> Snapshot:
    return Snapshot(NS_PER_S, ControllerState.ENGAGED, Reason.NOMINAL, has_state=True, stamp_ns=NS_PER_S)._replace(
        **changes  # type: ignore[arg-type]
    )


@given(
    text=st.text(st.characters(codec="utf-8"), min_size=1) | st.sampled_from(("<b>", "'\"><script>x</script>", "&lt;"))
)
@pytest.mark.parametrize("link", list(WriterState))
def test_no_text_becomes_markup(text: str, link: WriterState) -> None:
    for snapshot in (None, driving(frame_id="?" + text)):
        expected = _Words(whole_page(view(snapshot, link=link)))
        assert _Words(whole_page(view(snapshot, text=text, link=link))).tags == expected.tags


def test_markup_is_shown_as_it_was_written() -> None:
    words = _Words(panels.banner_html(view(driving(), text="<b onclick=x>&amp;")))
    assert words.text.count("<b onclick=x>&amp;") >= 4


def test_long_texts_are_cut_and_lines_joined() -> None:
    assert len(panels.plain("x" * 10_000)) < 200
    assert "\n" not in panels.plain("a\nb")


def test_a_shadow_says_how_far_another_commander_is_from_it() -> None:
    found = {"compared": 812, "accel_mps2": {"p95": 0.0204}, "front_wheel_angle_rad": {"p95": 0.00031}}
    of = view(driving(controller_state=ControllerState.SHADOW))
    told = panels.banner_html(replace(of, details={"shadow": found}))
    assert "another commander: 812 commands, 95 % within 0.020 m/s², 0.0003 rad of ours" in _Words(told).text
    for other in ({}, found | {"compared": 0}, found | {"accel_mps2": "<b>"}, {"compared": "<b>"}, "<b>"):
        assert "another commander" not in panels.banner_html(replace(of, details={"shadow": other}))


@pytest.mark.parametrize("state", list(ControllerState))
def test_the_banner_names_state_and_reason(state: ControllerState) -> None:
    content = panels.banner_html(view(driving(controller_state=state, reason=Reason.DEVIATION)))
    words = _Words(content).text
    assert state.name in words
    assert "DEVIATION" in words
    assert f'data-state="{state.name}" data-reason="DEVIATION" data-stale="false"' in content


def test_engaged_stopping_fault_shadow_and_old_differ_in_colour() -> None:
    states = (ControllerState.ENGAGED, ControllerState.STOPPING, ControllerState.FAULT, ControllerState.SHADOW)
    views = [view(driving(controller_state=s)) for s in states] + [view(driving(), age_s=1.0)]
    assert len({panels.banner_html(v).split("background:")[1][:7] for v in views}) == 5


@pytest.mark.parametrize(("left_ns", "when"), [(2_140_000_000, "in 2.1 s at the earliest"), (0, "at standstill")])
def test_who_has_to_take_over_is_told_so(left_ns: int, when: str) -> None:
    shown = driving(hands_over=True, handover_ns=left_ns)
    assert f"TAKE OVER: control is given back {when}" in _Words(panels.banner_html(view(shown))).text
    assert "TAKE OVER" not in _Words(panels.banner_html(view(shown, age_s=1.0))).text
    assert "TAKE OVER" not in _Words(panels.banner_html(view(driving(handover_ns=left_ns)))).text


def test_old_data_is_called_old() -> None:
    words = _Words(panels.banner_html(view(driving(), age_s=1.2))).text
    assert "no data for 1.2 s" in words
    assert "ENGAGED" in words


@pytest.mark.parametrize(
    ("link", "words"),
    [(WriterState.ENDED, "LOOP ENDED"), (WriterState.DEAD, "LOOP GONE"), (WriterState.ABSENT, "NO LOOP")],
)
def test_a_loop_that_is_gone_is_called_gone(link: WriterState, words: str) -> None:
    assert f"{words}: no data for 0.0 s" in _Words(panels.banner_html(view(driving(), link=link))).text
    assert words in _Words(panels.banner_html(view(None, link=link))).text


def test_codes_that_this_version_does_not_know_are_shown_as_numbers() -> None:
    words = _Words(panels.banner_html(view(driving(controller_state=77, reason=-3)))).text
    assert "ControllerState 77" in words
    assert "Reason -3" in words


def test_what_was_never_received_has_no_figure() -> None:
    nothing = Snapshot(NS_PER_S, ControllerState.STARTING, Reason.NOT_ENGAGED)
    assert "0.00 m" not in _Words(panels.numbers_html(view(nothing))).text


@pytest.mark.parametrize(("gear", "shown"), [(Gear.REVERSE, "gear REVERSE"), (Gear.NO_REQUEST, "gear –")])
def test_a_vehicle_that_does_not_say_its_gear_has_a_dash_for_it(gear: Gear, shown: str) -> None:
    words = _Words(panels.numbers_html(view(driving(has_status=True, gear=gear)))).text
    assert shown in " ".join(words.split())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_impossible_numbers_are_named_not_drawn(bad: float) -> None:
    content = whole_page(view(driving(x_m=bad, y_m=bad, heading_rad=bad, speed_mps=bad)))
    assert "not a number to show" in content
    panels.legend_html(View(now_ns=0, address="a", link=WriterState.LIVE, trajectory=path(speed_mps=bad)))


@given(stamp_ns=st.integers(-(2**63), 2**63 - 1), numbers=st.integers(-(2**63), 2**63 - 1))
def test_any_stamps_and_counters_can_be_shown(stamp_ns: int, numbers: int) -> None:
    whole_page(view(driving(published_ns=stamp_ns, stamp_ns=stamp_ns, samples=numbers, latency_ns=numbers, sent=True)))


def test_trajectory_and_vehicle_in_different_frames_are_not_drawn_together_and_it_says_so() -> None:
    words = _Words(panels.banner_html(view(driving(frame_id="odom"), text="map"))).text
    assert "trajectory in frame map, vehicle in odom" in words


def test_counters_without_end_are_cut() -> None:
    many = View(now_ns=0, address="a", link=WriterState.LIVE, details={str(k): {"x": k} for k in range(5000)})
    assert "more than can be shown" in panels.details_html(many)
    assert panels.details_html(many).count("<tr>") <= 101


@pytest.mark.parametrize("state", ["DEGRADED", "DOWN", "GONE", "RECOVERING", "<b>"])
def test_a_link_that_is_not_up_is_said_in_the_banner(state: str) -> None:
    shown = panels.banner_html(replace(view(Snapshot(0, 3, 0)), details={"link": {"state": state}}))
    assert f"link {html.escape(state)}" in shown


def test_the_banner_has_the_bus_load_and_nothing_about_a_link_that_is_up() -> None:
    link = {"state": "UP", "load_percent": 14.6, "frames_per_s": 612.0, "rates_hz": {}}
    shown = panels.banner_html(replace(view(Snapshot(0, 3, 0)), details={"link": link}))
    assert "bus load 14.6 % · 612 frames/s" in shown
    assert 'id="link"' not in shown
