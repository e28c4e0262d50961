"""The exported page of a drive in a real browser: it asks for nothing, plays, and its values are the recording's."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.export.recorded import Recorded, mute_state, record_drive
from vehicle_iface.cli import main
from vehicle_iface.telemetry import Snapshot

from .waiting import wait_until


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Recorded]:
    """Two drives along the same path; the state of the first is missing for a while."""
    home = tmp_path_factory.mktemp("drives")
    return [record_drive(home, 6.0, name="first", act=mute_state), record_drive(home, 4.0, name="second")]


def output(page: Page, key: str, drive: int = 0) -> str:
    return page.locator(f'output[data-curve="{key}"][data-drive="{drive}"]').inner_text().replace("−", "-")


def clock(page: Page) -> float:
    return float(page.locator("#clock").inner_text().split(" / ")[0].replace("−", "-"))


def at(shown: Sequence[Snapshot], time_s: float) -> Snapshot:
    """The last snapshot that is not later."""
    return [one for one in shown if (one.published_ns - shown[0].published_ns) / 1e9 <= time_s + 1e-6][-1]


def save(page: Page, button: str, path: Path) -> bytes:
    with page.expect_download() as download:
        page.get_by_role("button", name=button).first.click()
    download.value.save_as(path)
    return path.read_bytes()


def test_a_drive_plays_from_a_file_and_shows_what_was_recorded(
    page: Page, drives: list[Recorded], tmp_path: Path
) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: asked.append(message.text))
    shown = drives[0].shown
    assert main(["export", str(drives[0].folder), "--html", str(tmp_path / "drive.html")]) == 0
    page.goto((tmp_path / "drive.html").as_uri())
    page.locator("body[data-ready]").wait_for()

    page.get_by_role("button", name="mode ENGAGED").first.click()
    engaged_s = next(
        (event.at_ns - shown[0].published_ns) / 1e9
        for event in drives[0].driven.loop.events.log.kept
        if event.name == "ENGAGED"
    )
    expect(page.locator("#clock")).to_contain_text(f"{engaged_s:.2f} /")
    expect(page.locator("#now")).to_contain_text("ENGAGED")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#clock")).to_contain_text(f"{engaged_s + 1:.2f} /")
    there = at(shown, engaged_s + 1)
    assert float(output(page, "speed_mps")) == pytest.approx(there.speed_mps, abs=0.006)
    assert float(output(page, "sent_accel_mps2")) == pytest.approx(there.sent_accel_mps2, abs=0.006)
    wheel_deg = math.degrees(there.front_wheel_angle_rad)
    assert float(output(page, "front_wheel_angle_deg")) == pytest.approx(wheel_deg, abs=0.006)
    page.get_by_role("button", name="stop STATE_STALE began stopped").click()
    expect(page.locator("#now")).to_contain_text("STOPPING")
    page.keyboard.press("ArrowRight")
    expect(page.locator('output[data-curve="speed_mps"]')).to_have_text("–")

    scene = "() => document.querySelector('#scene canvas').toDataURL()"
    page.locator("#scene canvas").scroll_into_view_if_needed()
    before = page.evaluate(scene)
    page.keyboard.press("Shift+ArrowLeft")
    wait_until(page, f"before => ({scene})() !== before", arg=before)
    moved = page.evaluate(scene)
    page.locator("#scene canvas").drag_to(page.locator("#scene canvas"), target_position={"x": 40, "y": 60})
    assert (turned := page.evaluate(scene)) != moved
    page.get_by_role("combobox", name="Camera").select_option("behind")
    assert page.evaluate(scene) not in (moved, turned)

    canvas = page.locator(".plot canvas").first
    canvas.hover(position={"x": 400, "y": 40})
    wait_until(page, "() => parseFloat(document.querySelector('#clock').textContent) > 1")
    assert float(output(page, "speed_mps")) == pytest.approx(at(shown, clock(page)).speed_mps, abs=0.03)

    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    began_s = clock(page)
    wait_until(page, f"() => parseFloat(document.querySelector('#clock').textContent) > {began_s + 0.1}")
    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Play")).to_be_visible()

    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 300, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 400, box["y"] + 30, steps=3)
    page.mouse.up()
    rows = list(csv.DictReader(io.StringIO(save(page, "Save window as CSV", tmp_path / "w.csv").decode())))
    first_s, last_s = float(rows[0]["time_s"]), float(rows[-1]["time_s"])
    within = [
        one for one in shown if first_s - 1e-4 <= (one.published_ns - shown[0].published_ns) / 1e9 <= last_s + 1e-4
    ]
    assert 50 < len(rows) < len(shown) / 2
    assert [float(row["speed_mps"]) for row in rows] == pytest.approx([one.speed_mps for one in within], abs=1e-4)
    assert save(page, "save PNG", tmp_path / "plot.png").startswith(b"\x89PNG")

    pixels = "() => document.querySelector('.plot canvas').toDataURL()"
    light = page.evaluate(pixels)
    page.emulate_media(color_scheme="dark")
    wait_until(page, f"light => ({pixels})() !== light", arg=light)
    page.emulate_media(color_scheme="dark", media="print")
    expect(page.locator("body")).to_have_css("background-color", "rgb(255, 255, 255)")
    page.emulate_media(color_scheme="light", media="screen")

    folders = [str(drive.folder) for drive in drives]
    assert main(["compare", *folders, "--html", str(tmp_path / "both.html")]) == 0
    page.goto((tmp_path / "both.html").as_uri())
    page.locator("body[data-ready]").wait_for()
    page.get_by_role("combobox", name="Horizontal axis").select_option("way")
    expect(page.locator("#clock")).to_contain_text(" m")
    page.locator(".plot canvas").first.hover(position={"x": 300, "y": 40})
    wait_until(page, "() => parseFloat(document.querySelector('#clock').textContent) > 1")
    assert output(page, "speed_mps", 0) == output(page, "speed_mps", 1) != "–"
    assert [address for address in asked if not address.startswith(("file:", "blob:"))] == []
