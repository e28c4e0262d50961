"""The bench's report in a real browser: opens without a network, filters, searches, and runs nothing but itself."""

from collections.abc import Iterator
from pathlib import Path

import example_run
import msgspec
import pytest
from hil_bench.report import html
from hil_bench.result import Run
from playwright.sync_api import Page, expect

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
