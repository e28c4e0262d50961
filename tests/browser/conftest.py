"""Chromium, a publisher and a viewer, each a process of its own."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, expect, sync_playwright

from tests.slow_drawing import slow_drawing

from .processes import Publisher, Viewer

CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--no-first-run",
)


@pytest.fixture
def address(tmp_path: Path) -> str:
    return str(tmp_path / "loop")


@pytest.fixture
def publish(address: str) -> Iterator[Callable[..., Publisher]]:
    started: list[Publisher] = []

    def start(*options: str) -> Publisher:
        started.append(Publisher(address, *options))
        return started[-1]

    yield start
    for publisher in started:
        publisher.close()


@pytest.fixture
def viewer(address: str) -> Iterator[Viewer]:
    opened = Viewer(address)
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BrowserContext]:
    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            str(tmp_path_factory.mktemp("profile")),
            executable_path=CHROMIUM,
            headless=True,
            args=list(ARGUMENTS),
            viewport={"width": 1100, "height": 700},
        )
        context.set_default_timeout(60_000)
        expect.set_options(timeout=60_000)  # a software-drawn picture on a busy machine is slow, not wrong
        yield context
        context.close()


@pytest.fixture
def page(chromium: BrowserContext) -> Iterator[Page]:
    """An empty page; whatever goes wrong in it fails the test."""
    opened = chromium.new_page()
    opened.add_init_script(slow_drawing(pause_ms=200))
    faults: list[str] = []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    yield opened
    opened.close()
    assert faults == []
