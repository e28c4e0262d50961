"""The plots: what they show, in which range, and where they show nothing."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
import viser
from viser import uplot

from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import DrivingLimits, SessionInfo, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels import plots as module
from vehicle_iface_viewer.panels.plot_frame import send_curves
from vehicle_iface_viewer.panels.plots import PLOTS, Plots
from vehicle_iface_viewer.recent import RecentSnapshots
from vehicle_iface_viewer.serving import open_server

TITLES = [plot.title.partition(",")[0] for plot in PLOTS]
LIMITS = DrivingLimits(speed_max_mps=8.0, accel_min_mps2=-5.0, accel_max_mps2=2.0, front_wheel_angle_rad=0.5)
NOW_NS = 1000 * NS_PER_S
INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0", limits=LIMITS)


class Page:
    """Plots, and what was last sent to the page."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.recent = RecentSnapshots(length_s=25.0)
        self.plots = Plots(gui, self.recent)
        self.curves: dict[str, dict[str, list[float]]] = {}
        self.lines: dict[str, tuple[float, float]] = {}
        self.times_s: list[float] = []

    def show(self, *snapshots: Snapshot, end_ns: int | None = None, window_s: float = 20.0) -> None:
        """Send all plots, with these snapshots in addition."""
        self.recent.extend(snapshots)
        view = View(now_ns=NOW_NS, address="a", writer_state=WriterState.LIVE, session=1, info=INFO)
        for turn in range(len(PLOTS)):
            self.plots.show(view, turn, end_ns=end_ns or self.recent.newest_ns, window_s=window_s)

    def note(
        self, handle: object, times_s: np.ndarray, curves: list[np.ndarray], lines: tuple[float, float], _: int
    ) -> None:
        place = [id(each) for each in self.plots._handles].index(id(handle))
        labels = [curve.label for curve in PLOTS[place].curves]
        self.curves[TITLES[place]] = dict(zip(labels, (curve.tolist() for curve in curves), strict=True))
        self.lines[TITLES[place]] = lines
        self.times_s = times_s.tolist()

    def ends(self, title: str, label: str = "vehicle") -> tuple[float, float]:
        """The first and the last known time of a curve, s."""
        values = self.curves[title][label]
        known_s = [at_s for at_s, value in zip(self.times_s, values, strict=True) if not math.isnan(value)]
        return known_s[0], known_s[-1]

    def range(self, title: str) -> tuple[float, float]:
        """The vertical range in the browser, without its margin."""
        scales: dict[str, uplot.Scale] | None = self.plots._handles[TITLES.index(title)].scales
        assert scales is not None
        soft: dict[str, dict[str, float]] = scales["y"]["range"]  # type: ignore[assignment]
        low, high = soft["min"]["soft"], soft["max"]["soft"]
        margin = (high - low) / 1.1 * 0.05
        return round(low + margin, 6), round(high - margin, 6)


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Iterator[Page]:
    server = open_server(Access(port=0))
    shown = Page(server.gui)
    monkeypatch.setattr(module, "send_curves", shown.note)
    yield shown
    server.stop()


def drive(seconds: float = 2.0, **changes: object) -> list[Snapshot]:
    """Snapshots at 100 Hz up to now."""
    count = round(seconds * 100)
    times = [NOW_NS - k * NS_PER_S // 100 for k in reversed(range(count))]
    return [
        Snapshot(at_ns, ControllerState.SHADOW, 0, has_state=True, stamp_ns=at_ns)._replace(
            **changes  # type: ignore[arg-type]
        )
        for at_ns in times
    ]


def known(values: list[float]) -> set[float]:
    return {value for value in values if not math.isnan(value)}


def test_the_ranges_are_the_limits_of_the_profile(page: Page) -> None:
    page.show(*drive(speed_mps=3.0))
    assert page.range("Speed") == (0.0, 8.0)
    assert page.range("Acceleration") == (-5.0, 2.0)
    assert page.range("Front wheels") == (round(-math.degrees(0.5), 6), round(math.degrees(0.5), 6))
    assert page.range("Lateral error") == (-1.0, 1.0)
    assert page.range("Heading error") == (round(-math.degrees(0.2), 6), round(math.degrees(0.2), 6))


def test_the_limits_are_lines_and_a_speed_of_zero_is_none(page: Page) -> None:
    page.show(*drive())
    assert page.lines["Acceleration"] == (-5.0, 2.0)
    assert page.lines["Lateral error"] == (-1.0, 1.0)
    assert page.lines["Speed"] == pytest.approx((math.nan, 8.0), nan_ok=True)
    assert all(math.isnan(line) for line in page.lines["Heading error"])


def test_where_a_command_is_not_what_was_requested_it_is_marked(page: Page) -> None:
    limited = drive(has_requested=True, sent=True, requested_accel_mps2=1.5, sent_accel_mps2=0.5)
    free = [each._replace(sent_accel_mps2=1.48) for each in limited]
    page.show(*limited[:100], *free[100:])
    marked = page.curves["Acceleration"]["limited"]
    assert known(marked) == {0.5}
    assert page.ends("Acceleration", "limited")[1] == pytest.approx(-1.0, abs=0.2)
    assert known(page.curves["Front wheels"]["limited"]) == set()


def test_a_command_that_a_stop_has_replaced_is_not_marked_as_limited(page: Page) -> None:
    page.show(*drive(has_requested=True, sent=True, requested_accel_mps2=1.5, sent_accel_mps2=-3.0, reason=2))
    assert known(page.curves["Acceleration"]["limited"]) == set()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_a_value_that_cannot_be_drawn_is_a_gap(page: Page, bad: float) -> None:
    page.show(*drive(speed_mps=3.0)[:100], *drive(speed_mps=bad)[100:])
    assert known(page.curves["Speed"]["vehicle"]) == {3.0}
    assert page.ends("Speed")[1] == pytest.approx(-1.0, abs=0.2)


def test_without_a_reference_its_curve_has_a_gap(page: Page) -> None:
    page.show(
        *(each._replace(has_reference=not 80 <= k < 110) for k, each in enumerate(drive(lateral_error_m=0.25))),
    )
    values = page.curves["Lateral error"]["vehicle"]
    assert math.isnan(values[page.times_s.index(min(page.times_s, key=lambda at_s: abs(at_s + 1.05)))])
    assert known(values) == {0.25}
    assert page.ends("Lateral error")[1] == 0.0


def test_three_tenths_of_a_second_without_data_are_a_gap(page: Page) -> None:
    all_of_it = drive(seconds=4.0, speed_mps=3.0)
    page.show(*all_of_it[:200], *all_of_it[230:])
    values = page.curves["Speed"]["vehicle"]
    first, last = (page.times_s.index(at_s) for at_s in page.ends("Speed"))
    assert any(math.isnan(value) for value in values[first:last])


def test_a_state_that_grows_old_is_not_drawn_on(page: Page) -> None:
    fresh = drive(speed_mps=3.0, has_reference=True)
    page.show(*(each._replace(stamp_ns=min(each.stamp_ns, NOW_NS - NS_PER_S)) for each in fresh))
    assert page.ends("Speed")[1] == pytest.approx(-0.9, abs=0.2)
    assert page.ends("Lateral error")[1] == pytest.approx(-0.9, abs=0.2)


def test_a_new_session_empties_the_plots(page: Page) -> None:
    page.show(*drive(speed_mps=3.0))
    page.recent.clear()
    page.show()
    assert known(page.curves["Speed"]["vehicle"]) == set()


def test_a_plot_without_new_values_is_not_sent_again(page: Page) -> None:
    page.show(*drive(speed_mps=3.0))
    page.curves.clear()
    page.show()
    assert page.curves == {}


def test_a_gap_is_sent_as_null_and_a_line_by_its_ends() -> None:
    sent = []

    class _Handle:
        def _queue_update(self, name: str, value: tuple[list[float | None], ...]) -> None:
            sent.append((name, value))

    times_s, curve = np.array([-1.0, -0.5, 0.0]), np.array([2.0, math.nan, 1.0])
    send_curves(_Handle(), times_s, [curve], (math.nan, 5.0), 7)  # type: ignore[arg-type]
    lines = [[None, None, None], [5.0, None, 5.0], [100, 100, 100]]
    assert sent == [("data", ([-1.0, -0.5, 0.0], [2.0, None, 1.0], *lines))]


def test_plots_of_the_past_end_there_and_are_of_the_chosen_length(page: Page) -> None:
    old = [each._replace(speed_mps=1.0 if k < 700 else 2.0) for k, each in enumerate(drive(10.0))]
    page.show(*old, end_ns=NOW_NS - 4 * NS_PER_S, window_s=10.0)
    assert known(page.curves["Speed"]["vehicle"]) == {1.0}
    first, last = page.ends("Speed")
    assert first == pytest.approx(-6.0, abs=0.1)
    assert last == 0.0
    scales: dict[str, uplot.Scale] | None = page.plots._handles[0].scales
    assert scales is not None
    assert scales["x"]["range"] == (-10.0, 0.0)
