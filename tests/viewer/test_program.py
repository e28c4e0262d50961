"""The viewer as a program: what it prints, and what a browser gets at the address that it prints."""

import http.client
import ipaddress
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.browser.processes import Viewer

from .test_access_token import TOKEN, write_token


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


def test_a_viewer_for_other_machines_prints_an_address_that_opens_the_page(tmp_path: Path) -> None:
    file = write_token(tmp_path / "token")
    options = ("--host", "0.0.0.0", "--allow-remote", "--token-file", str(file))
    viewer = Viewer(str(tmp_path / "loop"), *options)
    try:
        assert not ipaddress.ip_address(urlsplit(viewer.url).hostname or "").is_unspecified
        assert viewer.url.endswith(f"/?token={TOKEN}")
        assert fetch(viewer.url)[0] == 200
        assert fetch(viewer.url.partition("?")[0])[0] == 401
        assert is_in_no_command_line(viewer, TOKEN)
    finally:
        viewer.close()


def test_a_token_in_the_environment_guards_the_page_and_is_in_no_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VEHICLE_IFACE_TOKEN", TOKEN)
    viewer = Viewer(str(tmp_path / "loop"))
    try:
        assert fetch(viewer.url)[0] == 200
        assert fetch(viewer.url.partition("?")[0])[0] == 401
        assert is_in_no_command_line(viewer, TOKEN)
    finally:
        viewer.close()


def test_a_token_as_an_argument_still_works_with_a_warning_that_names_the_file(tmp_path: Path) -> None:
    viewer = Viewer(str(tmp_path / "loop"), "--token", TOKEN)
    try:
        assert viewer.greeting.startswith("viewer: warning: --token shows the secret to every user")
        assert "--token-file FILE" in viewer.greeting
        url = viewer.read_line().split()[1]
        assert url.endswith(f"/?token={TOKEN}")
        assert fetch(url)[0] == 200
        assert not is_in_no_command_line(viewer, TOKEN)
    finally:
        viewer.close()


def is_in_no_command_line(viewer: Viewer, secret: str) -> bool:
    """Return whether `ps` shows the secret in none of the viewer's processes."""
    return not any(secret.encode() in Path(f"/proc/{pid}/cmdline").read_bytes() for pid in family(viewer.pid))


def family(pid: int) -> list[int]:
    """The process and all that it has started."""
    children = [
        int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()
    ]
    return [pid, *(one for child in children for one in family(child))]
