"""Requests to the viewer: path and headers of whoever connects.

Each line is one: the path first, then `Name: value`.
Law: a request is let in or refused with a status; nobody comes in without the token, or by a foreign name.
"""

from collections.abc import Iterator
from urllib.parse import unquote_plus

from websockets.datastructures import Headers
from websockets.exceptions import WebSocketException
from websockets.http11 import Request

from vehicle_iface_viewer.access import Access

LENGTH = 512
_TOKEN = "0123456789abcdef"
_DROPPED = dict.fromkeys(map(ord, "\t\r\n"))
"""What urllib leaves out of an address (WHATWG URL, 4.4)."""
_ACCESSES = (
    Access(port=8080),
    Access(port=8080, token=_TOKEN),
    Access(host="0.0.0.0", port=8080, token=_TOKEN, allow_remote=True),
)


def run(data: bytes) -> None:
    path, *lines = data.decode("ascii", "surrogateescape").split("\n")
    headers = Headers()
    for line in lines:
        name, _, value = line.partition(":")
        try:
            headers[name.strip()] = value.strip()
        except WebSocketException:  # refused before anybody looks at it
            return
    for access in _ACCESSES:
        rejection = access.find_rejection(Request(path, headers))
        assert rejection is None or (rejection.status in (401, 403) and rejection.reason.isprintable())
        if rejection is None:
            shown = unquote_plus("".join([path, *headers.get_all("Cookie")])).translate(_DROPPED)
            assert access.token is None or _TOKEN in shown or "\\" in shown
            host = headers["Host"].lower().translate(_DROPPED)
            assert not access.is_local or any(name in host for name in ("localhost", "127.", "1]"))


def seeds() -> Iterator[bytes]:
    yield b"/\nHost: 127.0.0.1:8080"
    yield b"/\nHost: localhost:8080\nOrigin: http://localhost:8080\nCookie: vehicle_iface_token=" + _TOKEN.encode()
    yield b"/?token=" + _TOKEN.encode() + b"\nHost: [::1]:8080"
    yield b'/?token=x\nHost: evil.example:8080\nOrigin: http://evil.example:8080\nCookie: a=b; c="d"'
