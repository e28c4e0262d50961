"""Everything on one kernel: vcan, simulated vehicle, loop and viewer as processes, and a real browser looking."""

import math
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, sync_playwright

from tests.slow_drawing import slow_drawing
from vehicle_iface import Trajectory
from vehicle_iface.sim.driver_socket import send_line
from vehicle_iface.trajectories import Route, make_route, save_csv

from .conftest import Programs
from .observer import CHANNEL, Observer

CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
]
TELEMETRY = "end-to-end"
PATIENCE_MS = 240_000
"""One slow processor draws the page in software while the vehicle drives: what counts is that it comes, in order."""
ON_ROUTE_M = 0.3
POINTS_SEEN = 60
WAY_SEEN_M = 5.0
"""From the first place that the page shows; half a lap later the vehicle is there again."""
SPEED_MPS, SPACING_M = 2.5, 0.25
LOOK = """() => {
    const {state, reason} = document.getElementById("banner").dataset;
    const number = (key) => {
        const cell = document.getElementById(`n-${key}`);
        if (!cell && document.getElementById("numbers")) throw new Error(`the page shows no ${key}`);
        return parseFloat(cell?.textContent);
    };
    const keys = ["x", "y", "spatial-ref", "temporal-ref"];
    return [state, reason, Object.fromEntries(keys.map((key) => [key, number(key)]))];
}"""
"""All that the page shows at one moment: between two questions it would show another. No numbers before a state."""


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    """A page of a browser with a profile of its own."""
    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            str(tmp_path / "chromium"),
            executable_path=CHROMIUM,
            args=FLAGS,
            headless=True,
            viewport={"width": 320, "height": 240},
            timeout=PATIENCE_MS,
        )
        context.set_default_timeout(PATIENCE_MS)
        context.add_init_script(slow_drawing(pause_ms=2000))
        yield context.new_page()
        context.close()


@pytest.mark.timeout(1200)
def test_the_page_shows_the_vehicle_drive_its_lap_on_vcan_and_stop_when_its_state_goes_stale(
    programs: Programs, bus: Observer, page: Page, tmp_path: Path
) -> None:
    route = make_route("figure8")
    laps = tmp_path / "laps.csv"
    save_csv(laps, _laps(route, 10))
    pedals = str(tmp_path / "pedals")
    vehicle = ["sim", "--channel", CHANNEL, "--start=" + ",".join(map(str, route.start)), "--driver-socket", pedals]
    sim = programs.start(*vehicle)
    viewer = programs.start("view", "--connect", TELEMETRY, "--port", "0")
    url = viewer.wait_for_line(r"http://\S+").group()
    page.goto(f"{url}?picture=3-D")  # its drawing is slowed down, that of the map is not
    page.wait_for_selector("#banner", state="attached")

    loop = programs.start("run", "--channel", CHANNEL, "--telemetry", TELEMETRY, "--arm", "--trajectory", str(laps))
    while not (seen := _seen_driving(page)):
        sim.send_signal(signal.SIGTERM)
        sim.wait_for_end()
        sim = programs.start(*vehicle)
        sim.wait_for_line("simulated vehicle on")
        loop.send_signal(signal.SIGUSR1)
        page.wait_for_selector("#banner:not([data-state=FAULT])", state="attached")
    page.screenshot(path=str(tmp_path / "page.png"))

    places = np.array([(look["x"], look["y"]) for look in seen])
    distances = [np.hypot(route.x_m - x, route.y_m - y).min() for x, y in places]
    indices = [look["spatial-ref"] for look in seen]
    assert max(distances) < ON_ROUTE_M
    assert indices == sorted(indices)
    assert seen[-1]["temporal-ref"] > seen[0]["temporal-ref"]

    # The stop lasts half a second before the silence: too short to be sure that so slow a page ever shows it.
    muted = bus.now()
    assert send_line(pedals, "mute STATE on") == "ok"
    stop, _ = bus.wait_for("a stop", "DRIVE_COMMAND", REASON="STATE_STALE", SAFE_STOP=1, ENABLE=1, since=muted)
    page.wait_for_selector("#banner[data-state=FAULT][data-reason=STATE_STALE]", state="attached")
    bus.wait_for("the vehicle's own watchdog", "VEHICLE_STATUS", MODE=3, since=stop)


def _laps(route: Route, laps: int) -> Trajectory:
    """A trajectory of many laps at one modest speed, so that its index grows as long as anybody looks."""
    points = len(route) * laps
    return Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.round(np.arange(points) * SPACING_M / SPEED_MPS * 1e9).astype(np.int64),
        x_m=np.tile(route.x_m, laps),
        y_m=np.tile(route.y_m, laps),
        heading_rad=np.tile(route.heading_rad, laps),
        speed_mps=np.full(points, SPEED_MPS),
    )


def _seen_driving(page: Page) -> list[dict[str, float]]:
    """What the page shows from the engagement on until the vehicle is well on its way; empty when it got into trouble.

    While the browser starts, the one processor may stand still for so long that the vehicle's watchdog acts, as it
    must, and that brings it off its path. Then somebody puts it back at the start and arms again.
    """
    seen: list[dict[str, float]] = []
    while not seen or seen[-1]["spatial-ref"] < seen[0]["spatial-ref"] + POINTS_SEEN or _way_m(seen) <= WAY_SEEN_M:
        state, reason, numbers = page.evaluate(LOOK)
        if state == "FAULT" or reason == "DEVIATION":
            return []
        if state == "ENGAGED" and all(map(math.isfinite, numbers.values())):
            seen.append(numbers)
        page.wait_for_timeout(1000)
    return seen


def _way_m(seen: list[dict[str, float]]) -> float:
    """How far the vehicle was seen from its first place."""
    return max(math.hypot(look["x"] - seen[0]["x"], look["y"] - seen[0]["y"]) for look in seen)
