"""The plots: what they show, in which range, and where they show nothing."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from viser import uplot

from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import DrivingLimits, SessionInfo, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S, ns_from_s
from vehicle_iface_viewer.access import Access, open_server
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels import plots as module
from vehicle_iface_viewer.panels.plots import PLOTS, Plots

TITLES = [plot.title.partition(",")[0] for plot in PLOTS]
LIMITS = DrivingLimits(speed_max_mps=8.0, accel_min_mps2=-5.0, accel_max_mps2=2.0, front_wheel_angle_rad=0.5)
INFO = SessionInfo(channel="vcan0", bus="SocketCAN vcan0", limits=LIMITS)


class Page:
    """Plots, and what was last sent to the page."""

    def __init__(self, plots: Plots) -> None:
        self.plots = plots
        self.curves: dict[str, list[list[float]]] = {}
        self.ago_s: list[float] = []

    def show(self, at_s: float, snapshot: Snapshot | None = None, *, session: int = 1) -> None:
        now_ns = ns_from_s(at_s)
        self.plots.extend(
            View(
                now_ns=now_ns,
                address="a",
                writer_state=WriterState.LIVE,
                session=session,
                info=INFO,
                snapshot=snapshot and snapshot._replace(published_ns=now_ns),
            )
        )
        self.plots.send(0)
        self.plots.send(1)

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
    shown = Page(Plots(server.gui))

    def note(handle: object, ago_s: np.ndarray, values: np.ndarray, _: int) -> None:
        title = TITLES[[id(each) for each in shown.plots._handles].index(id(handle))]
        shown.curves[title], shown.ago_s = values.tolist(), ago_s.tolist()

    monkeypatch.setattr(module, "_send_curves", note)
    yield shown
    server.stop()


def driving(**changes: object) -> Snapshot:
    return Snapshot(NS_PER_S, ControllerState.SHADOW, 0, has_state=True)._replace(
        **changes  # type: ignore[arg-type]
    )


def test_the_ranges_are_the_limits_of_the_profile(page: Page) -> None:
    page.show(1.0, driving(speed_mps=3.0))
    assert page.range("Speed") == (0.0, 8.0)
    assert page.range("Acceleration") == (-5.0, 2.0)
    assert page.range("Front wheels") == (round(-math.degrees(0.5), 6), round(math.degrees(0.5), 6))
    assert page.range("Lateral error") == (-1.0, 1.0)
    assert page.range("Heading error") == (round(-math.degrees(0.2), 6), round(math.degrees(0.2), 6))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_a_value_that_cannot_be_drawn_is_a_gap(page: Page, bad: float) -> None:
    page.show(1.0, driving(speed_mps=bad))
    assert math.isnan(page.curves["Speed"][1][-1])


def test_without_a_reference_its_curve_has_a_gap(page: Page) -> None:
    for k, known in enumerate((True, False, True)):
        page.show(1.0 + k / 5, driving(has_reference=known, lateral_error_m=0.25))
    (lateral,) = page.curves["Lateral error"]
    assert lateral == pytest.approx([0.25, math.nan, 0.25], nan_ok=True)


def test_between_data_half_a_second_apart_is_a_gap(page: Page) -> None:
    for at_s in (1.0, 1.5, 2.1):
        page.show(at_s, driving(speed_mps=3.0))
    assert page.curves["Speed"][1] == pytest.approx([3.0, 3.0, math.nan, 3.0], nan_ok=True)
    assert page.ago_s == pytest.approx([-1.1, -0.6, 0.0, 0.0], abs=1e-6)


def test_a_new_session_empties_the_plots(page: Page) -> None:
    page.show(1.0, driving(speed_mps=3.0))
    page.show(2.0, None, session=2)
    assert page.curves["Speed"] == [[], []]


def test_after_a_jump_in_a_recording_the_plots_are_filled_with_what_was_before(page: Page) -> None:
    def history(begin_ns: int, end_ns: int, step_ns: int) -> list[Snapshot]:
        times = range(end_ns, begin_ns, -step_ns)
        return [driving(speed_mps=2.0, published_ns=at_ns) for at_ns in reversed(times)]

    page.plots._history = history
    page.show(30.0, driving(speed_mps=2.0))
    assert page.curves["Speed"][1] == [2.0] * 200
    page.show(60.0, driving(speed_mps=2.0), session=2)
    assert page.curves["Speed"][1] == [2.0] * 200
    assert page.ago_s[0] == pytest.approx(-19.9)


def test_a_gap_is_sent_as_null() -> None:
    sent = []

    class _Handle:
        def _queue_update(self, name: str, value: tuple[list[float | None], ...]) -> None:
            sent.append((name, value))

    module._send_curves(_Handle(), np.array([-1.0, 0.0]), np.array([[2.0, math.nan]]), 7)  # type: ignore[arg-type]
    assert sent == [("data", ([-1.0, 0.0], [2.0, None], [None, 7]))]
