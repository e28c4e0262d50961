"""The plots in a real browser: the pixels of their curves."""

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from .contrast import read_contrasts
from .processes import Publisher, Viewer
from .strip import click_strip
from .waiting import wait_until

Start = Callable[..., Publisher]
_COLUMNS = """([title, red, green, blue]) => {
    const plot = [...document.querySelectorAll(".uplot")].find(
        each => each.querySelector(".u-title").innerText.startsWith(title));
    if (!plot) return "";
    const canvas = plot.querySelector("canvas"), pixels = canvas.width && canvas.getContext("2d").getImageData(
        0, 0, canvas.width, canvas.height).data;
    let columns = "";
    for (let x = 0; x < canvas.width; x++) {
        let drawn = false;
        for (let y = 0; y < canvas.height && !drawn; y++) {
            const at = 4 * (y * canvas.width + x);
            drawn = Math.abs(pixels[at] - red) + Math.abs(pixels[at + 1] - green)
                + Math.abs(pixels[at + 2] - blue) < 90 && pixels[at + 3] > 60;
        }
        columns += drawn ? "x" : ".";
    }
    return columns;
}"""
"""One character for each column of pixels of a plot: whether a curve of this colour is drawn there."""
REQUESTED = (0xC9, 0x7A, 0x00)
VEHICLE, LATERAL, HEADING, LIMIT = (0x22, 0x8B, 0xE6), (0x0C, 0xA6, 0x78), (0x97, 0x75, 0xFA), (0xF0, 0x3E, 0x3E)


@pytest.fixture(autouse=True)
def small(page: Page) -> None:
    """The plots need no large picture beside them."""
    page.set_viewport_size({"width": 760, "height": 800})


def wait_for_columns(page: Page, title: str, color: tuple[int, int, int], pattern: str) -> None:
    """Wait until the columns of a curve match the regular expression."""
    wait_until(
        page,
        f"([pattern, ...of]) => new RegExp(pattern).test(({_COLUMNS})(of))",
        arg=[pattern, title, *color],
        polling=300,  # reading pixels in each frame of a busy machine would stop the page
    )


_AT_CURSOR = """() => Object.values(window.__viserTestpoints.uplots).map(({chart}) => [
    chart.root.querySelector(".u-title").innerText, chart.cursor.left, chart.legend.values[0]?._ ?? "",
    chart.legend.values.slice(1, -3).map(value => value._ ?? "").join(" ")])"""
"""Of each plot: title, place of its cursor in pixels, time and values at it."""


def choose(page: Page, label: str, option: str) -> None:
    """Choose from a list that can be searched."""
    page.get_by_label(label, exact=True).first.fill(option)
    page.get_by_role("option", name=option, exact=True).click()


def test_in_a_run_that_sends_nothing_no_plot_is_empty_and_one_cursor_reads_all(
    publish: Start, viewer: Viewer, page: Page
) -> None:
    loop = publish("--arming", "shadow")
    loop.order("shadow")
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    for title, color in (
        ("Speed", VEHICLE),
        ("Lateral", LATERAL),
        ("Heading", HEADING),
        ("Front wheels", VEHICLE),
        ("Acceleration", VEHICLE),
    ):
        wait_for_columns(page, title, color, "x{8}")
    choose(page, "Free plot", "heading error, °")
    wait_for_columns(page, "Free plot", VEHICLE, "x{8}")
    over = page.locator(".uplot .u-over").nth(1)
    over.evaluate("plot => plot.scrollIntoView()")
    box = over.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.97 * box["width"], box["y"] + 20)
    wait_until(
        page,
        f"""() => ({_AT_CURSOR})().every(([_, left, time_s, values]) =>
        left > 0 && time_s < 0 && time_s > -1.5 && /[0-9]/.test(values))""",
    )
    read = {row[3] for row in page.evaluate(_AT_CURSOR) if str(row[0]).startswith(("Heading", "Free"))}
    assert {bool(re.fullmatch(r"-?[0-9.]+", each)) for each in read} == {True}


def test_a_time_without_a_reference_is_a_gap_in_its_curves_only(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish("--arming", "shadow")
    loop.order("shadow")
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    wait_for_columns(page, "Lateral", LATERAL, "x{8}")
    loop.order("lost")
    expect(page.locator("#n-lateral-error")).to_have_text("–")
    wait_for_columns(page, "Lateral", LATERAL, "x{2}[.]{60}")
    loop.order("shadow")
    wait_for_columns(page, "Lateral", LATERAL, "x{2}[.]{20,}x{2}")
    # On a busy machine the publisher may be late, and the speed has gaps as well, but not this one.
    counts = f"of => ({_COLUMNS})(of).replaceAll('.', '').length"
    speed, lateral = (page.evaluate(counts, of) for of in (["Speed", *VEHICLE], ["Lateral", *LATERAL]))
    assert speed > lateral + 20


def test_a_third_of_a_second_without_data_is_a_gap(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    wait_for_columns(page, "Speed", VEHICLE, "x{8}")
    loop.order("freeze")
    page.wait_for_timeout(330)
    loop.order("engaged")
    wait_for_columns(page, "Speed", VEHICLE, "x{2}[.]{3,9}x{2}")


def test_the_limits_are_drawn_across_the_whole_window(publish: Start, viewer: Viewer, page: Page) -> None:
    publish()
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    for title in ("Speed", "Lateral", "Front wheels", "Acceleration"):
        wait_for_columns(page, title, LIMIT, "x{4}.*x{4}.{0,40}$")
    wait_until(page, f"of => /^[.]+$/.test(({_COLUMNS})(of))", arg=["Heading", *LIMIT])


_RANGES = """() => Object.values(window.__viserTestpoints.uplots).filter(
    ({chart}) => chart.root.querySelector(".u-title").innerText !== "Free plot").map(({chart}) => [
    chart.scales.y.min.toFixed(1), chart.scales.y.max.toFixed(1), (chart.axes[0]._values ?? []).join(" "),
].join(", "))"""
SECONDS = "-20 -15 -10 -5 0"


def test_the_ranges_are_the_limits_and_both_axes_have_labels(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    wait_for_columns(page, "Speed", VEHICLE, "x{8}")
    limits = ["-1.0, 21.0", "-1.1, 1.1", "-12.6, 12.6", "-37.8, 37.8", "-6.5, 3.5"]
    expected = sorted(f"{each}, {SECONDS}" for each in limits)
    wait_until(page, f"expected => ({_RANGES})().sort().join() === expected", arg=",".join(expected))
    loop.order("fast")
    wait_for_columns(page, "Speed", VEHICLE, "x{8}")
    wait_until(page, f"() => ({_RANGES})().some(each => /^-1.0, 3[0-9]/.test(each))")


def test_plots_can_be_paused_and_look_back_while_the_head_stays_live(
    publish: Start, viewer: Viewer, page: Page
) -> None:
    loop = publish()
    page.goto(viewer.url)
    expect(page.locator(".uplot")).to_have_count(6)
    wait_for_columns(page, "Speed", VEHICLE, "x{8}")
    page.get_by_label("Pause plots").click(force=True)
    past = page.locator("#past")
    expect(past).to_contain_text("all else is live")
    expect(past).to_contain_text("ENGAGED · NOMINAL")
    loop.order("fault")
    expect(page.locator("#state")).to_have_text("FAULT")
    expect(past).to_contain_text("ENGAGED · NOMINAL")
    page.get_by_label("Pause plots").click(force=True)
    expect(past).to_have_count(0)
    page.get_by_role("slider").last.press("Home")
    expect(past).to_contain_text("PLOTS END 600.0 s AGO")
    expect(past).to_contain_text("nothing is kept of that time")
    expect(page.locator("#strip-recent path")).to_have_count(3)  # engaged, fault, dropped
    click_strip(page, "recent", 0.9)
    expect(past).to_contain_text(re.compile(r"PLOTS END [23]\.\d s AGO"))
    page.get_by_role("slider").last.press("End")
    expect(past).to_have_count(0)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("p")
    expect(page.get_by_label("Pause plots")).to_be_checked()
    expect(past).to_contain_text("PLOTS END")
    page.keyboard.press("p")
    expect(past).to_have_count(0)


def test_light_and_dark_are_legible_remembered_and_in_the_address(publish: Start, viewer: Viewer, page: Page) -> None:
    publish()
    page.goto(viewer.url)
    expect(page.locator("#numbers")).to_contain_text("temporal ref")
    scheme = page.locator("html")
    expect(scheme).to_have_attribute("data-mantine-color-scheme", "light")  # Playwright's browser prefers it
    check_contrasts(page)
    choose(page, "Theme", "dark")
    expect(scheme).to_have_attribute("data-mantine-color-scheme", "dark")
    check_contrasts(page)
    choose(page, "Free plot", "drops")
    page.wait_for_url(re.compile(r"theme=dark&plots=20\+s&free=drops&and=none"))
    page.goto(f"{viewer.url}?theme=light&plots=120+s")
    expect(page.get_by_label("Plots", exact=True).first).to_have_value("120 s")
    expect(page.get_by_label("Free plot", exact=True).first).to_have_value("drops")
    expect(scheme).to_have_attribute("data-mantine-color-scheme", "light")


def check_contrasts(page: Page) -> None:
    page.wait_for_timeout(300)  # viser fades from one theme to the other
    texts = "#numbers td, #legend span, .vi-note, .vi-strip span, .vi-map text, label, .u-label, .u-value, .u-title"
    found = read_contrasts(page, texts)
    assert {"x", "speed, m/s", "Plots", "vehicle"} <= set(found)
    assert {text: round(contrast, 2) for text, contrast in found.items() if contrast < 4.5} == {}
