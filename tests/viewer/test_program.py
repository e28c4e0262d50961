"""The viewer as a program: what it prints, and what a browser gets at the address that it prints."""

import http.client
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.browser.processes import Viewer


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[Viewer]:
    opened = Viewer(str(tmp_path / "loop"))
    yield opened
    opened.close()


def fetch(url: str, **headers: str) -> tuple[int, str]:
    """Status and text of the answer to a GET request."""
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=20)
    try:
        connection.request("GET", parts._replace(scheme="", netloc="").geturl(), headers=headers)
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def test_unknown_paths_of_a_running_viewer_answer_404(viewer: Viewer) -> None:
    assert fetch(f"{viewer.url}missing") == (404, "404: nothing is at '/missing'; the page is at /\n")
    assert fetch(f"{viewer.url}favicon.ico") == (204, "")
    assert fetch(viewer.url)[0] == 200
