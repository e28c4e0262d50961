"""Access control of the viewer: who may connect, and which messages are handled.

viser itself accepts every client, checks no Origin, takes messages of 50 MB, and lets any client upload files, press
any button and request a public tunnel. This module binds the socket and checks each request before viser handles it.
Of a browser's messages only its camera and its own controls are handled: the buttons of the camera, the filter of the
signals, the time of its plots, and what it remembers of them. They change nothing for another browser. The page of a
recording has more controls, for its own place in it; no loop is behind it.

This relies on private names of exactly viser 1.1.1; `tests/viewer/test_access.py` fails when they change.
"""

from __future__ import annotations

import contextlib
import hmac
import http
import io
import ipaddress
import logging
import socket
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from viser import _messages as messages
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from vehicle_iface.errors import ConfigError
from vehicle_iface_viewer.addresses import bracket, find_own_names, format_url, is_lan_name
from vehicle_iface_viewer.token import require_sound_token

MAX_MESSAGE_BYTES = 16384
"""A camera message has about 300 bytes."""
MAX_CLIENTS = 64
"""Concurrent browsers; each costs memory and time in every update."""

_TIMEOUT_S = 2.0
_COOKIE = "vehicle_iface_token"
# The page loads nothing from, and sends nothing to, other origins, and no other page may frame it. viser compiles
# WebAssembly and creates scripts and workers at run time, hence the exceptions.
_POLICY = (
    "default-src 'self' blob: data:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'none'"
)
_TITLE = b"<title>Viser</title>"
_OUR_TITLE = b"<title>vehicle-iface</title>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejection:
    """Why a request is rejected, and what to do instead."""

    status: http.HTTPStatus
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Where the viewer listens and which clients it accepts.

    Raises `ConfigError` for an address that other machines can reach, unless `allow_remote` and a token are given.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    """0: any free port."""
    token: str | None = None
    """A browser sends it once, as `?token=…`, and then as a cookie."""
    allow_remote: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"--port {self.port}: must be within 0 … 65535")
        if self.token is not None:
            require_sound_token(self.token)
        if not self.is_local and not (self.allow_remote and self.token):
            raise ConfigError(
                f"--host {self.host}: others could watch; only this machine's own address (127.0.0.1) is allowed "
                "without --allow-remote and --token-file"
            )

    @property
    def is_local(self) -> bool:
        """Whether only this machine can connect."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def find_rejection(self, request: Request) -> Rejection | None:
        """Return why this request is rejected; None accepts it."""
        host = request.headers.get_all("Host")
        origin = request.headers.get_all("Origin")
        if len(host) != 1 or not self._is_own_host(host[0]):
            words = f"{_quote(host)} is no name of this page; {self._describe_names()}"
            return Rejection(status=http.HTTPStatus.FORBIDDEN, reason=words)
        # Only browsers send an Origin, and every browser does when it opens a websocket; a page of another origin
        # cannot omit or forge it.
        if origin and origin != [f"http://{host[0]}"]:
            words = f"a page of {_quote(origin)} may not read this one; open {_quote(['http://' + host[0]])} itself"
            return Rejection(status=http.HTTPStatus.FORBIDDEN, reason=words)
        if self.token is not None and not self._has_token(request):
            words = "the token is missing or wrong; open the address that the viewer printed, with ?token=… at its end"
            return Rejection(status=http.HTTPStatus.UNAUTHORIZED, reason=words)
        return None

    def _is_own_host(self, host: str) -> bool:
        """Return whether `host` names this server. Any other name that resolves to it is DNS rebinding.

        The port may be another one: `ssh -L` and containers forward from any. No attack depends on it, as the Origin
        must have the same.
        """
        try:
            parts = urlsplit(f"//{host}")
            name, _ = parts.hostname or "", parts.port
        except ValueError:
            return False
        if name in {"localhost", self.host.lower()}:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return not self.is_local and is_lan_name(name)
        return address.is_loopback or not self.is_local

    def _describe_names(self) -> str:
        if not self.is_local:
            return "open it by an IP address, its machine's host name, a name without a dot, or one that ends in .local"
        tunnel = f"ssh -L 9000:{bracket(self.host)}:{self.port} MACHINE"
        return (
            f"open {format_url(self.host, self.port)} on its machine, or http://127.0.0.1:9000/ after `{tunnel}`; "
            "any port will do"
        )

    def _has_token(self, request: Request) -> bool:
        offered = [*parse_qs(request.path.partition("?")[2]).get("token", ())]
        with contextlib.suppress(CookieError):
            cookies = SimpleCookie("; ".join(request.headers.get_all("Cookie")))
            offered += [cookies[_COOKIE].value] if _COOKIE in cookies else []
        expected = (self.token or "").encode()
        return any(hmac.compare_digest(each.encode(errors="replace"), expected) for each in offered)


def open_server(access: Access) -> viser.ViserServer:
    """Start a viser server with this access control. Raises `ConfigError` when it cannot listen."""
    listener = _open_listener(access)
    access = Access(
        host=access.host,
        port=listener.getsockname()[1],
        token=access.token,
        allow_remote=access.allow_remote,
    )
    # It logs a traceback for each client that sends garbage, with which others could fill a disk.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    if not access.is_local:
        find_own_names()  # here, where it delays no request
    request_filter = _RequestFilter(access)
    with _patched_serve(listener, request_filter), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=access.host, port=access.port, verbose=False)
    _drop_messages(server)
    request_filter.attach(server)
    return server


def handle_checkbox(client: viser.ClientHandle, uuid: str, on_change: Callable[[bool], None]) -> None:
    """Call `on_change` with the new value of one checkbox of this client; all else is still ignored."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid == uuid and isinstance(value, bool):
            on_change(value)

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_slider(
    client: viser.ClientHandle, uuid: str, lowest: float, highest: float, on_change: Callable[[float], None]
) -> None:
    """Call `on_change` with the new value of one slider of this client, within its range."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid != uuid or isinstance(value, bool) or not isinstance(value, int | float):
            return
        if lowest <= value <= highest:  # false for NaN
            on_change(float(value))

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_text(client: viser.ClientHandle, uuid: str, longest: int, on_change: Callable[[str], None]) -> None:
    """Call `on_change` with the new text of one field of this client, if it has at most `longest` characters."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid == uuid and isinstance(value, str) and len(value) <= longest:
            on_change(value)

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_key(client: viser.ClientHandle, label: str, key: messages.HotkeyKey, on_press: Callable[[], None]) -> None:
    """Call `on_press` when this client presses `key` outside of a text field, or chooses `label` in its palette."""
    uuid = client.gui.add_command(label, hotkey=key)._impl.uuid

    def on_trigger(_: int, message: Any) -> None:
        if message.uuid == uuid:
            on_press()

    client._websock_connection.register_handler(messages.CommandTriggerMessage, on_trigger)


class _RequestFilter:
    """Checks each request before viser handles it."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._server: viser.ViserServer | None = None

    def attach(self, server: viser.ViserServer) -> None:
        """Accept requests from now on, for this server."""
        self._server = server

    def wrap(self, inner: Callable[[Any, Request], Response | None]) -> Callable[[Any, Request], Response | None]:
        """viser's `process_request`, behind this filter."""

        def process_request(connection: Any, request: Request) -> Response | None:
            rejection = self._access.find_rejection(request) or self._find_overload(request)
            response: Response | None
            if rejection is not None:
                response = connection.respond(rejection.status, f"{rejection.status.value}: {rejection.reason}\n")
            else:
                response = self._respond(inner, connection, request)
            if response is not None:
                _restrict(response.headers)
            return response

        return process_request

    def _find_overload(self, request: Request) -> Rejection | None:
        status = http.HTTPStatus.SERVICE_UNAVAILABLE
        if self._server is None:
            return Rejection(status=status, reason="the viewer is starting; reload the page")
        clients = self._server._websock_server._client_state_from_id
        if "Upgrade" in request.headers and len(clients) >= MAX_CLIENTS:
            return Rejection(status=status, reason=f"{MAX_CLIENTS} browsers watch already, the maximum; close one")
        return None

    def _respond(self, inner: Any, connection: Any, request: Request) -> Response | None:
        if request.headers.get_all("Upgrade") == ["websocket"]:
            return None
        path = request.path.partition("?")[0]
        response: Response
        if path == "/favicon.ico":  # the page has its icon within; browsers ask all the same
            response = Response(http.HTTPStatus.NO_CONTENT, "No Content", Headers())
        elif path != "/":  # not left to viser, which reads files by this name
            words = f"404: nothing is at {_quote([path])}; the page is at /\n"
            response = connection.respond(http.HTTPStatus.NOT_FOUND, words)
        else:
            response = _read_page(inner, connection)
        if self._access.token is not None:
            response.headers["Set-Cookie"] = f"{_COOKIE}={self._access.token}; HttpOnly; SameSite=Strict; Path=/"
        return response


def _restrict(headers: Headers) -> None:
    headers["Content-Security-Policy"] = _POLICY
    headers["X-Content-Type-Options"] = "nosniff"
    headers["Referrer-Policy"] = "no-referrer"
    headers["Cache-Control"] = "no-store"


def _quote(values: Sequence[str]) -> str:
    """Return what a client sent for a text: ASCII, and short."""
    return ascii(", ".join(values))[:100]


def _read_page(inner: Any, connection: Any) -> Response:
    """Return viser's page under our title: uncompressed, as the request has no Accept-Encoding."""
    response: Response = inner(connection, Request("/", Headers()))
    body = (response.body or b"").replace(_TITLE, _OUR_TITLE, 1)
    headers = Headers(response.headers)
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(body))
    return Response(response.status_code, response.reason_phrase, headers, body)


def _open_listener(access: Access) -> socket.socket:
    """Listen at exactly the requested port: viser alone would silently take the next one."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            access.host, access.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise ConfigError(f"--host {access.host}: {error.strerror}") from None
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"--port {access.port} on {access.host}: {error.strerror}; end what uses it, or choose another --port"
        ) from None
    return listener


@contextlib.contextmanager
def _patched_serve(listener: socket.socket, request_filter: _RequestFilter) -> Iterator[None]:
    """While viser starts, its call of websockets' `serve` gets this module's socket, limits and request filter."""
    module = websockets.asyncio.server
    original = module.serve

    def serve(handler: Any, *_: Any, **options: Any) -> Any:
        options["max_size"] = MAX_MESSAGE_BYTES
        options["max_queue"] = 4
        # Browsers connect in advance without sending anything; neither that nor a hung page may delay the end.
        options["open_timeout"] = options["close_timeout"] = _TIMEOUT_S
        options["server_header"] = None
        options["process_request"] = request_filter.wrap(options["process_request"])
        return original(handler, sock=listener, **options)

    module.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        module.serve = original  # type: ignore[misc]


def _drop_messages(server: viser.ViserServer) -> None:
    """Unregister all of viser's message handlers except the one for a client's camera."""
    inner = server._websock_server
    inner._incoming_handlers.clear()

    def drop_client_messages(connection: Any) -> None:
        handlers = connection._incoming_handlers
        for kind in [kind for kind in handlers if kind is not messages.ViewerCameraMessage]:
            del handlers[kind]

    # Runs after viser's own callback, which registers the client's handlers, and before its first message is read.
    inner.on_client_connect(drop_client_messages)
