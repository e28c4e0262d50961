"""The scripts of `browser_memory`, on a page that has only what they read of viser's."""

from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qs

from playwright.sync_api import Page, Route, expect

from vehicle_iface_viewer import browser_memory
from vehicle_iface_viewer.panels.style import STYLE

from .waiting import wait_until

URL = "http://page.example/"
PAGE = f"""<!doctype html>{STYLE}<div data-dock-root>
<div id="area" style="position: absolute; top: 0; left: 300px; width: 500px; height: 400px">
  <canvas data-engine="three.js"></canvas>
</div>
<div data-dock-region="left" style="width: 300px">
  <div data-dock-tab role="tab" aria-selected="true">Signals</div><div data-dock-tab role="tab">Events</div>
</div>
<div data-dock-region="right" style="width: 400px"></div></div>
<div class="mantine-Notification-root">Software WebGL rendering detected
  <button onclick="this.parentElement.remove()">x</button></div>
<script>
const choose = tab => document.querySelectorAll("[role=tab]").forEach(each => each.ariaSelected = each === tab);
for (const tab of document.querySelectorAll("[role=tab]")) {{
    tab.onclick = () => choose(tab);
    tab.onkeydown = event => event.key === "Enter" && choose(tab);
}}
const widen = (side, px) => document.querySelector(`[data-dock-region=${{side}}]`).style.width = `${{px}}px`;
</script>"""
NAMES = ("theme", "left", "right", "tab")


class Client:
    """Runs in the page what a client would be told to."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._websock_connection = self
        self.local_storage = SimpleNamespace(
            set_item=lambda key, value: page.evaluate(
                "([k, v]) => localStorage.setItem(k, v)", [f"viser-user:{key}", value]
            )
        )

    def register_handler(self, *_: object) -> None: ...

    def queue_message(self, message: Any) -> None:
        if hasattr(message, "source"):
            self._page.evaluate("source => new Function(source)()", message.source)


def stored(page: Page, key: str) -> dict[str, list[str]]:
    return parse_qs(page.evaluate("key => localStorage.getItem(key) ?? ''", f"viser-user:{key}"))


def test_the_layout_that_the_user_has_left_is_kept_answered_and_forgotten(page: Page) -> None:
    def answer(route: Route) -> None:
        route.fulfill(body=PAGE, content_type="text/html; charset=utf-8")

    page.route(f"{URL}**", answer)
    page.goto(f"{URL}?loop=a&theme=dark")
    client: Any = Client(page)
    browser_memory.keep_layout(client, ["Signals", "Events"], "Events")
    events = page.get_by_role("tab", name="Events")
    expect(events).to_have_attribute("aria-selected", "true")
    page.evaluate("widen('right', 500)")  # not by the user: the window has become wider
    box = page.locator("[data-dock-region=left]").bounding_box()
    assert box is not None
    page.mouse.move(600, 300)
    page.mouse.down()
    page.evaluate("widen('left', 370)")
    page.mouse.up()
    wait_until(page, "() => location.search === '?loop=a&theme=dark&left=370&tab=Events'")
    assert stored(page, "layout") == {"left": ["370"], "tab": ["Events"]}
    browser_memory.remember(client, {"theme": "light"})
    page.goto(f"{URL}?left=410&unknown=1")
    browser_memory.ask(client, NAMES, lambda _: None)
    expected = {"theme": ["light"], "left": ["410"], "tab": ["Events"], "draws": ["software"], "prefers": ["light"]}
    assert stored(page, "page-now") == expected
    browser_memory.forget(client, NAMES)
    page.wait_for_url(f"{URL}?unknown=1")
    assert (stored(page, "page"), stored(page, "layout")) == ({}, {})


def test_a_map_in_the_middle_is_as_large_as_the_picture(page: Page) -> None:
    page.route(f"{URL}**", lambda route: route.fulfill(body=PAGE, content_type="text/html; charset=utf-8"))
    page.goto(URL)
    client: Any = Client(page)
    browser_memory.keep_layout(client, ["Signals"], "")
    page.evaluate("""() => document.body.insertAdjacentHTML("beforeend",
        '<div id="big-map"><div class="vi-note" id="no-gpu">no GPU</div><svg class="vi-map"></svg></div>')""")
    box = "document.querySelector('#big-map').getBoundingClientRect()"
    wait_until(page, f"() => {box}.left === 300 && {box}.width === 500")
    expect(page.get_by_text("Software WebGL")).to_have_count(0)
    page.evaluate("document.querySelector('#area').style.width = '350px'")
    wait_until(page, f"() => {box}.width === 350")
