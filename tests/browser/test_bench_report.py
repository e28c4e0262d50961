"""The bench's report in a real browser: needs no network, filters, searches, zooms, and runs nothing but itself."""

import re
from collections.abc import Iterator
from pathlib import Path

import example_run
import msgspec
import pytest
from hil_bench.report import html, over_time
from hil_bench.result import Run
from playwright.sync_api import BrowserContext, Locator, Page, expect

from .waiting import wait_until

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def quiet_page(page: Page) -> Iterator[Page]:
    """Asks for nothing but the page itself, and has nothing to complain about."""
    asked: list[str] = []
    complaints: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    yield page
    assert [address for address in asked if not address.startswith(("file:", "data:"))] == []
    assert complaints == []


@pytest.fixture
def run() -> Run:
    return example_run.run()


def rows(page: Page) -> int:
    return page.locator("table.cases tbody tr:visible").count()


def test_the_cases_are_filtered_by_verdict_and_tag_and_searched(quiet_page: Page, run: Run, tmp_path: Path) -> None:
    quiet_page.goto(html.write(run, tmp_path, example_run.run(slower=0.7)).as_uri())
    expect(quiet_page.get_by_role("heading", level=1)).to_have_text("✕ FAIL")
    expect(quiet_page.locator("#shown")).to_have_text("65 of 65 cases")
    quiet_page.get_by_role("button", name="NOT EXECUTED").click()
    assert rows(quiet_page) == 2
    quiet_page.get_by_role("button", name="All", exact=True).click()
    quiet_page.get_by_label("Tag").select_option("measurement")
    assert rows(quiet_page) == 5
    quiet_page.get_by_label("Search").fill("LATENCY")
    expect(quiet_page.locator("#shown")).to_have_text("1 of 65 cases")
    assert quiet_page.locator("details.case:visible").count() == 1


def test_a_case_in_the_table_links_to_its_details(quiet_page: Page, run: Run, tmp_path: Path) -> None:
    quiet_page.goto(html.write(run, tmp_path).as_uri())
    assert quiet_page.locator("details.case[open]").count() == 1
    quiet_page.get_by_role("link", name="silence_repeated").click()
    expect(quiet_page.get_by_text("20 repetitions; the one closest to a limit")).to_be_in_viewport()
    quiet_page.get_by_role("button", name="Open all").click()
    assert quiet_page.locator("details.case[open]").count() == 65


@pytest.mark.parametrize("width", [360, 760, 1600])
def test_no_width_makes_the_page_scroll_sideways(width: int, quiet_page: Page, run: Run, tmp_path: Path) -> None:
    text = "x" * 3000
    worst = msgspec.structs.replace(run.cases[0], name=text, why=text, fault=text, proves=text, tags=[text])
    quiet_page.set_viewport_size({"width": width, "height": 700})
    quiet_page.goto(html.write(example_run.run_of([worst, *run.cases[1:12]]), tmp_path).as_uri())
    quiet_page.get_by_role("button", name="Open all").click()
    assert quiet_page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth") == 0


def test_markup_in_a_result_neither_runs_nor_shows_as_markup(page: Page, run: Run, tmp_path: Path) -> None:
    text = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"
    hostile = msgspec.structs.replace(run.cases[0], name=text, why=text, injected=text, proves=text)
    page.goto(html.write(example_run.run_of([hostile]), tmp_path).as_uri())
    page.get_by_role("button", name="Open all").click()
    expect(page.locator("details.case summary b")).to_have_text(text)
    assert page.locator("img").count() == 0
    assert "owned" not in page.title()


def test_script_that_escapes_the_escaping_is_blocked(page: Page, run: Run, tmp_path: Path) -> None:
    written = html.write(run, tmp_path)
    text = written.read_text(encoding="utf-8")
    seeded = "<script>document.title='owned'</script><b onclick=\"document.title='owned'\">press</b></body>"
    written.write_text(text.replace("</body>", seeded), encoding="utf-8")
    page.goto(written.as_uri())
    page.locator("b", has_text="press").click()
    assert "owned" not in page.title()


def failed_case(page: Page) -> Locator:
    return page.locator("details.case[open] .over-time")


def drag(page: Page, field: Locator, begin: float, end: float) -> None:
    """From one share of a plot's width to another."""
    field.scroll_into_view_if_needed()
    box = field.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + begin * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], box["y"] + 20, steps=3)
    page.mouse.up()


def seen_from_to(figure: Locator) -> list[float]:
    """What share of the case every plot shows; all the same."""
    boxes = figure.locator("svg.time").evaluate_all("all => all.map(one => one.getAttribute('viewBox'))")
    assert len(boxes) == 3
    assert len(set(boxes)) == 1
    left, _, width, _ = map(float, boxes[0].split())
    return [round(left / over_time.WIDTH, 2), round((left + width) / over_time.WIDTH, 2)]


def test_a_drag_zooms_all_plots_of_a_case_at_once_and_a_button_shows_the_whole(
    quiet_page: Page, run: Run, tmp_path: Path
) -> None:
    quiet_page.goto(html.write(run, tmp_path).as_uri())
    figure = failed_case(quiet_page)
    expect(figure.get_by_role("button", name="Whole case")).to_be_disabled()
    drag(quiet_page, figure.locator(".field").first, 0.5, 0.6)
    assert seen_from_to(figure) == [0.5, 0.6]
    assert figure.locator(".ticks .x").all_text_contents()[:2] == ["4.0 s", "4.1 s"]
    expect(figure.locator(".dot.of-injection")).to_be_visible()
    expect(figure.locator(".dot.of-standstill")).to_be_hidden()
    figure.get_by_role("button", name="Whole case").click()
    assert seen_from_to(figure) == [0.0, 1.0]
    expect(figure.locator(".dot.of-standstill")).to_be_visible()


def test_an_event_is_shown_by_a_click_and_the_wheel_zooms_with_ctrl_only(
    quiet_page: Page, run: Run, tmp_path: Path
) -> None:
    quiet_page.goto(html.write(run, tmp_path).as_uri())
    figure = failed_case(quiet_page)
    figure.locator("li.of-injection").click()
    begin, end = seen_from_to(figure)
    assert begin < 4.0 / 7.99 < end
    assert end - begin == pytest.approx(1.0 / 7.99, abs=0.02)
    figure.locator(".field").nth(1).hover()
    quiet_page.mouse.wheel(0, 50)
    assert seen_from_to(figure) == [begin, end]
    figure.locator(".field").nth(1).hover()
    quiet_page.keyboard.down("Control")
    quiet_page.mouse.wheel(0, -300)
    quiet_page.keyboard.up("Control")
    wait_until(
        quiet_page,
        "width => document.querySelector('details.case[open] svg.time').viewBox.baseVal.width < width",
        arg=(end - begin) * over_time.WIDTH * 0.95,
    )


def test_the_values_under_the_cursor_are_those_of_the_curves(quiet_page: Page, run: Run, tmp_path: Path) -> None:
    quiet_page.goto(html.write(run, tmp_path).as_uri())
    figure = failed_case(quiet_page)
    speed = figure.locator(".row", has_text="Speed")
    speed.scroll_into_view_if_needed()
    box = speed.locator(".field").bounding_box()
    assert box is not None
    expect(speed.locator("output")).to_be_hidden()
    quiet_page.mouse.move(box["x"] + box["width"] * 2.0 / 7.99, box["y"] + 30)
    expect(speed.locator("output")).to_have_text(re.compile(r"3\.(19|2|21)"))  # it accelerates by 1.6 m/s²
    expect(figure.locator(".now")).to_have_text(re.compile(r"^(1\.99|2\.00)\d s \(−2\.0[01] s\)$"))
    quiet_page.mouse.move(box["x"] + box["width"] / 2, box["y"] - 2000)
    expect(figure.locator(".now")).to_be_hidden()


def test_without_scripts_the_plots_have_their_axis_and_no_dead_buttons(
    chromium: BrowserContext, run: Run, tmp_path: Path
) -> None:
    written = html.write(run, tmp_path)
    text = written.read_text(encoding="utf-8")
    written.write_text(re.sub(r"<script>.*</script>", "", text, flags=re.DOTALL), encoding="utf-8")
    page = chromium.new_page()
    page.goto(written.as_uri())
    figure = failed_case(page)
    expect(figure.locator(".ticks .x").first).to_have_text("0 s")
    assert figure.get_by_role("button").count() == 0
    page.close()
