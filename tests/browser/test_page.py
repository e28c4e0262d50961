"""The page in a real browser: what a person would see, and what none may do."""

import os
import re
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from playwright.sync_api import Page, Request, expect

from vehicle_iface.process import module_command
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.cameras import Look
from vehicle_iface_viewer.live import LiveVisitor

from .processes import Publisher, Replay, Viewer
from .recording import STOP_S, write_recording
from .strip import click_strip
from .tunnel import open_tunnel
from .waiting import wait_until

Start = Callable[..., Publisher]
HOSTILE = "<img src=x onerror=\"document.title='owned'\"><b>bold</b> & [link](http://evil.example) `code`"


@pytest.fixture
def app(address: str) -> Iterator[App]:
    """A viewer in this process, to look into."""
    app = App(Access(port=0), address)
    wanted = threading.Event()
    wanted.set()
    thread = threading.Thread(target=app.run, args=(wanted.is_set,))
    thread.start()
    yield app
    wanted.clear()
    thread.join()
    app.close()


def banner(page: Page, state: str, reason: str, *, stale: bool = False) -> None:
    """Wait until the banner says so."""
    expect(page.locator("#state")).to_have_text(state)
    expect(page.locator("#reason")).to_have_text(reason)
    expect(page.locator("#banner")).to_have_attribute("data-stale", str(stale).lower())


def number(page: Page, name: str) -> float:
    """A figure of the table of numbers."""
    found = re.match(r"-?\d+(\.\d+)?", page.locator(f"#n-{name}").inner_text())
    assert found is not None
    return float(found[0])


def differs(page: Page, name: str, old: float) -> None:
    """Wait until a figure has changed."""
    wait_until(page, "([id, old]) => parseFloat(document.getElementById(id).innerText) !== old", arg=[f"n-{name}", old])


def test_the_page_follows_the_loop_through_stop_death_and_restart(publish: Start, viewer: Viewer, page: Page) -> None:
    page.goto(viewer.url)
    expect(page.locator("#headline")).to_have_text("NO LOOP")
    first = publish()
    banner(page, "ENGAGED", "NOMINAL")
    for name in ("x", "spatial-ref", "temporal-ref"):
        differs(page, name, number(page, name))
    assert number(page, "temporal-ref") >= number(page, "spatial-ref")
    first.order("stale")
    banner(page, "STOPPING", "STATE_STALE")
    expect(page.locator("#banner")).to_contain_text(re.compile(r"state age\s*\d{4,} ms"))
    first.end(signal.SIGKILL)
    banner(page, "STOPPING", "STATE_STALE", stale=True)
    expect(page.locator("#stale")).to_contain_text(re.compile(r"^no data for \d+\.\d s"))
    expect(page.locator("#headline")).to_have_text("LOOP GONE")
    publish("--route", "second")
    banner(page, "ENGAGED", "NOMINAL")
    expect(page.locator("#banner")).to_contain_text("route second")


def test_a_loop_that_is_silent_or_has_ended_greys_the_page(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    loop.order("freeze")
    banner(page, "ENGAGED", "NOMINAL", stale=True)
    expect(page.locator("#stale")).to_contain_text(re.compile(r"^no data for"))
    loop.order("quit")
    expect(page.locator("#headline")).to_have_text("LOOP ENDED")


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_whose_viewer_stops_says_that_it_is_frozen(
    publish: Start, viewer: Viewer, page: Page, number: int
) -> None:
    publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    cover = page.get_by_text("THIS PAGE IS FROZEN")
    expect(cover).to_be_hidden()
    viewer.send(number)
    expect(cover).to_be_visible()
    covered = page.evaluate("""() => {
        const box = document.getElementById("frozen").getBoundingClientRect();
        const banner = document.getElementById("banner").getBoundingClientRect();
        return box.left <= banner.left && box.right >= banner.right
            && box.top <= banner.top && box.bottom >= banner.bottom;
    }""")
    assert covered
    if number == signal.SIGSTOP:
        viewer.send(signal.SIGCONT)
        expect(cover).to_be_hidden()


def test_a_page_without_a_loop_is_updated_and_not_frozen(viewer: Viewer, page: Page) -> None:
    page.goto(viewer.url)
    cover = page.locator("#frozen")
    before = cover.get_attribute("data-number")
    wait_until(page, "old => document.getElementById('frozen').dataset.number - old > 20", arg=before)
    expect(cover).to_be_hidden()


def test_on_a_phone_nothing_of_the_panel_is_cut_off(publish: Start, viewer: Viewer, page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    outside = """() => [...document.querySelectorAll("#banner *, #numbers td, #legend *")].filter(each => {
        const box = each.getBoundingClientRect(); return box.left < 0 || box.right > 390; }).length"""
    wait_until(page, f"() => document.querySelector('#numbers td') && ({outside})() === 0")
    wait_until(page, "() => document.querySelector('#banner').getBoundingClientRect().width > 350")
    drawn = """() => {
        const box = document.querySelector(".vi-phone .vi-map use[href='#vi-moving']").getBoundingClientRect();
        return box.left > 0 && box.right < 390 && box.width > 5; }"""
    wait_until(page, drawn)


def test_fault_and_shadow_are_named(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish("--arming", "shadow")
    page.goto(viewer.url)
    loop.order("shadow")
    banner(page, "SHADOW", "NOT_ENGAGED")
    expect(page.locator("#bus")).to_contain_text("shadow")
    loop.order("fault")
    banner(page, "FAULT", "DEVIATION")


def test_an_override_is_no_longer_armed_and_has_the_way_on(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    loop.order("override")
    banner(page, "STANDBY", "DRIVER_OVERRIDE")
    expect(page.locator("#headline")).to_have_text("DRIVER DRIVES")
    expect(page.locator("#bus")).to_contain_text("not armed any more")
    expect(page.locator("#way-on")).to_contain_text(f"arm again: kill -USR1 {loop.pid}")
    loop.order("broken")
    expect(page.locator("#vehicle-fault")).to_have_text("VEHICLE: FAULT")


def test_the_request_to_take_over_is_large_and_of_its_own_colour(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    loop.order("ending")
    banner(page, "STOPPING", "SHUTDOWN")
    request = page.locator("#handover")
    expect(request).to_contain_text("TAKE OVER")
    # Each in one call: an update replaces the element.
    height = "document.querySelector('#handover div').getBoundingClientRect().height"
    wait_until(page, f"() => {height} >= 50")
    colour = "getComputedStyle(document.querySelector('#handover')).backgroundColor"
    wait_until(page, f"() => {colour} === 'rgb(255, 230, 0)'")
    loop.order("engaged")
    expect(request).to_have_count(0)


def test_markup_in_names_is_shown_as_text(publish: Start, viewer: Viewer, page: Page) -> None:
    publish("--bus", HOSTILE, "--hint", HOSTILE, "--route", HOSTILE)
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    assert page.locator("#banner").inner_text().count(HOSTILE) == 3
    assert page.locator("#banner img, #bus b:has-text('bold')").count() == 0
    assert page.title() == "vehicle-iface"


def test_positions_that_cannot_be_drawn_leave_the_page_alive(publish: Start, viewer: Viewer, page: Page) -> None:
    loop = publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    loop.order("huge")
    expect(page.locator("#n-x")).to_have_text("out of range")
    loop.order("engaged")
    expect(page.locator("#n-x")).to_have_text(re.compile(r"\d m$"))
    differs(page, "x", number(page, "x"))


def test_the_page_requests_nothing_from_other_hosts(publish: Start, viewer: Viewer, page: Page) -> None:
    asked: list[str] = []

    def note(request: Request) -> None:
        asked.append(request.url)

    page.on("request", note)
    publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    differs(page, "x", number(page, "x"))
    own = (viewer.url, viewer.url.replace("http", "ws"), "data:", "blob:")
    assert [url for url in asked if not url.startswith(own)] == []


def test_without_a_gpu_there_is_a_map_and_the_picture_on_demand(publish: Start, viewer: Viewer, page: Page) -> None:
    publish()
    page.goto(viewer.url)
    banner(page, "ENGAGED", "NOMINAL")
    for words in ("speed, m/s", "spatial ref", "temporal ref", "look-ahead", "grid 1 m, bold 10 m"):
        expect(page.locator("#legend")).to_contain_text(words)
    expect(page.locator(".uplot")).to_have_count(6)
    expect(page.get_by_text("Share")).to_have_count(0)
    expect(page.locator("#no-gpu")).to_be_visible()
    expect(page.locator("#big-map .vi-map")).to_be_visible()
    page.get_by_role("button", name="3-D", exact=True).click()
    expect(page.locator("#big-map")).to_have_count(0)
    wait_until(page, "() => document.querySelector('canvas[data-engine]').clientWidth > 200")
    canvas = page.locator("canvas").first
    assert len(canvas.screenshot()) > 10_000  # an empty ground compresses to far less


@pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")  # as the program does
def test_a_browser_chooses_its_camera_with_buttons_and_keys(publish: Start, app: App, page: Page) -> None:
    page.set_viewport_size({"width": 820, "height": 700})  # the panels, and little of the picture
    publish()
    page.goto(f"http://127.0.0.1:{app.port}/?picture=3-D")
    banner(page, "ENGAGED", "NOMINAL")
    while not app._visitors:
        page.wait_for_timeout(20)
    (visitor,) = app._visitors.values()
    assert isinstance(visitor, LiveVisitor)
    assert visitor.browser is not None
    camera = visitor.browser.camera

    def wait_for(look: Look) -> None:
        expect(page.get_by_role("button", name=f"● {look}", exact=True)).to_be_visible()
        assert camera._view is look

    wait_for(Look.FOLLOW)
    page.keyboard.press("f")
    wait_for(Look.STAY)
    app_tick, kept = page.locator("#n-x").inner_text(), tuple(camera._frame.position)
    expect(page.locator("#n-x")).not_to_have_text(app_tick)
    assert tuple(camera._frame.position) == kept
    page.get_by_role("button", name="Chase", exact=True).click()
    wait_for(Look.CHASE)
    while tuple(camera._frame.position) == kept:
        page.wait_for_timeout(20)
    for key, look in (("t", Look.TOP), ("r", Look.FIT), ("c", Look.CHASE), ("f", Look.FOLLOW)):
        page.keyboard.press(key)
        wait_for(look)


def test_two_pages_see_the_same_drive(publish: Start, viewer: Viewer, page: Page) -> None:
    other = page.context.new_page()
    publish()
    for each in (page, other):
        each.goto(viewer.url)
        banner(each, "ENGAGED", "NOMINAL")
    other.close()
    differs(page, "x", number(page, "x"))


def test_of_two_loops_the_page_shows_the_chosen_one_by_its_name(page: Page) -> None:
    names = [f"test-{os.getpid()}-{name}" for name in ("car", "truck")]
    with ExitStack() as opened:
        loops = [opened.enter_context(closing(Publisher(name))) for name in names]
        loops[1].order("shadow")
        viewer = opened.enter_context(closing(Viewer(None)))
        page.goto(viewer.url)
        page.get_by_role("link", name=names[1]).click()
        banner(page, "SHADOW", "NOT_ENGAGED")
        expect(page).to_have_url(re.compile(rf"[?&]loop={names[1]}\b"))
        expect(page.locator("#loop > b")).to_have_text(names[1])
        expect(page.locator(".vi-loop").filter(has_text=names[0])).to_contain_text("DRIVING")


def test_the_page_is_shown_through_a_tunnel_from_another_port(publish: Start, viewer: Viewer, page: Page) -> None:
    publish()
    with open_tunnel(int(viewer.url.rstrip("/").rsplit(":", 1)[1])) as port:
        for host in ("localhost", "127.0.0.1"):
            page.goto(f"http://{host}:{port}/")
            banner(page, "ENGAGED", "NOMINAL")
            differs(page, "x", number(page, "x"))


def test_a_browser_that_the_viewer_opens_gets_the_token_and_not_in_its_command_line(
    publish: Start, address: str, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish()
    script, asked = tmp_path / "browser", tmp_path / "asked"
    script.write_text(f'#!/bin/sh\nprintf %s "$*" > {asked}.new && mv {asked}.new {asked}\n')
    script.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(script))
    monkeypatch.setenv("VEHICLE_IFACE_TOKEN", "0123456789abcdef+/=&")
    viewer = Viewer(address, "--open")
    try:
        while not asked.exists():
            page.wait_for_timeout(20)
        opened = asked.read_text()
        file = Path(opened.removeprefix("file://"))
        assert file.stat().st_mode & 0o077 == 0
        page.goto(opened)
        page.wait_for_url(viewer.url)
        banner(page, "ENGAGED", "NOMINAL")
    finally:
        viewer.close()
    assert not file.exists()


def test_a_page_from_elsewhere_cannot_listen(publish: Start, viewer: Viewer, page: Page) -> None:
    publish()
    socket_url = viewer.url.replace("http", "ws")
    page.route(
        "http://elsewhere.example/", lambda route: route.fulfill(body="<p>elsewhere</p>", content_type="text/html")
    )
    page.goto("http://elsewhere.example/")
    attempt = """url => new Promise(done => {
        const socket = new WebSocket(url, "viser-v1.1.1");
        socket.onopen = () => done("open"); socket.onerror = () => done("refused");
    })"""
    assert page.evaluate(attempt, socket_url) == "refused"
    frame = """url => new Promise(done => {
        const frame = document.createElement("iframe");
        frame.onload = () => done(frame.contentDocument === null);
        frame.src = url;
        document.body.append(frame);
    })"""
    assert page.evaluate(frame, viewer.url)
    assert all(each.locator("#banner").count() == 0 for each in page.frames)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_viewer_prints_its_source_and_ends_on_a_signal(viewer: Viewer, address: str, number: int) -> None:
    assert re.fullmatch(rf"viewer: http://127\.0\.0\.1:\d+/  \(telemetry '{address}': {address}\)\n", viewer.greeting)
    assert viewer.end(number) == (0, "viewer: ended\n")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--host", "0.0.0.0"], "--host 0.0.0.0: others could watch"),
        (["--host", "0.0.0.0", "--allow-remote", "--token-file", "/missing"], "--token-file /missing: No such file"),
        (["--connect", "no such name"], "telemetry address 'no such name'"),
        (["--connect", "absent", "--port", "99999"], "--port 99999"),
    ],
)
def test_options_that_do_not_fit_are_refused_in_one_line(options: list[str], words: str) -> None:
    done = run("vehicle_iface_viewer", *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_taken_port_is_refused_by_its_number(viewer: Viewer, address: str) -> None:
    port = viewer.url.rstrip("/").rsplit(":", 1)[1]
    done = run("vehicle_iface_viewer", "--connect", address, "--port", port)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"--port {port} on 127.0.0.1" in done.stderr


def run(module: str, *options: str) -> subprocess.CompletedProcess[str]:
    command, environment = module_command(module)
    return subprocess.run(
        [*command, *options], env=environment, capture_output=True, text=True, timeout=60, check=False
    )


def test_a_recording_is_marked_as_such_and_can_be_paused_and_wound_back(page: Page, tmp_path: Path) -> None:
    replay = Replay(write_recording(tmp_path / "drive"), "--from", "1", "--speed", "0.1")
    page.set_viewport_size({"width": 820, "height": 700})  # the panels, and little of the picture
    try:
        page.goto(replay.url)
        shown = page.locator("#recording")
        expect(shown).to_contain_text("RECORDING, NOT LIVE")
        banner(page, "ENGAGED", "NOMINAL")
        expect(page.locator("#events")).to_contain_text("mode ENGAGED")  # the open tab, as there are no frames
        page.get_by_role("tab", name="Signals").click()
        expect(page.locator("#no-frames")).to_contain_text("No frames were recorded")
        page.get_by_label("Pause").click(force=True)
        expect(shown).to_contain_text("paused")
        page.get_by_role("slider").first.press("End")
        expect(shown).to_contain_text("at its end")
        page.get_by_role("slider").first.press("Home")
        expect(shown).to_contain_text("0.0 s of")
        click_strip(page, "drive", 0.5)
        expect(shown).to_contain_text(re.compile(r"(5\.[6-9]|6\.[0-4]) s of"))
        page.get_by_role("slider").first.press("Home")
        expect(shown).to_contain_text("0.0 s of")
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        expect(shown).to_contain_text("0.2 s of")
        page.keyboard.press("ArrowLeft")
        expect(shown).to_contain_text("0.1 s of")
        page.keyboard.press("Space")
        expect(shown).to_contain_text("speed ×0.1")
        page.keyboard.press("Space")
        expect(shown).to_contain_text("paused")
        expect(page.locator(".vi-map .vi-mark").first).to_be_attached()  # of the whole drive, also of what comes
        place = page.locator("#n-x").inner_text()
        page.keyboard.press("ArrowDown")
        expect(page.locator("#n-x")).not_to_have_text(place)
        expect(shown).to_contain_text(f"{STOP_S - 1.0:.1f} s of")
        page.keyboard.press("b")
        expect(shown).to_contain_text("0.0 s of")  # before ENGAGED
        with page.context.new_page() as other:
            other.set_viewport_size({"width": 820, "height": 700})
            other.goto(replay.url)
            expect(other.locator("#recording")).to_contain_text("speed ×0.1")
            other.keyboard.press("PageUp")
            expect(other.locator("#recording")).to_contain_text("speed ×0.25")
            other.get_by_role("button", name="Stop ▶").click()
            expect(other.get_by_role("button", name="● ¼×")).to_be_visible()
            expect(other.locator("#recording")).to_contain_text(re.compile(r"([89]|1\d)\.\d s of"))
            expect(shown).to_contain_text("0.0 s of 12.0 s · paused")
    finally:
        replay.close()
