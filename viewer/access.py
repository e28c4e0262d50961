"""Who may connect to the viewer, and what they may say to it.

viser itself listens to everybody, checks no Origin, takes messages of 50 MB, and lets any client upload files, press
any button and ask for a public tunnel. Here the socket is bound by this module, each request is judged before viser
sees it, and of all messages of a browser only two are heard: where its camera is, and the one switch of the page. The
page of a recording has three more controls; behind it there is no loop.

This leans on private names of exactly viser 1.1.1; `tests/viewer/test_access.py` says so when they change.
"""

from __future__ import annotations

import contextlib
import hmac
import http
import io
import ipaddress
import logging
import socket
from collections.abc import Callable, Iterator
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

MAX_MESSAGE_BYTES = 16384
"""A camera message has about 300 bytes."""
MAX_CLIENTS = 64
"""Browsers at a time; each costs memory and a share of every update."""
MIN_TOKEN_LENGTH = 16

_PATIENCE_S = 2.0
_COOKIE = "vehicle_iface_token"
# Nothing from elsewhere is loaded, sent to, or allowed to frame the page. viser compiles its own WebAssembly and
# builds its scripts and workers on the fly, hence the exceptions.
_POLICY = (
    "default-src 'self' blob: data:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'none'"
)
_TITLE = b"<title>Viser</title>"
_OUR_TITLE = b"<title>vehicle-iface</title>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Where the viewer listens and whom it lets in.

    Raises `ConfigError` for an address that is not of this machine alone, unless `allow_remote` and a token are given.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    """0 takes any free one."""
    token: str | None = None
    """What a browser has to show once, as `?token=…`; it keeps it as a cookie."""
    allow_remote: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"--port {self.port}: must be within 0 … 65535")
        if self.token is not None and len(self.token) < MIN_TOKEN_LENGTH:
            raise ConfigError(
                f"--token of {len(self.token)} characters: at least {MIN_TOKEN_LENGTH}; "
                "`openssl rand -hex 16` makes a good one"
            )
        if not self.is_local and not (self.allow_remote and self.token):
            raise ConfigError(
                f"--host {self.host}: others could watch; only this machine's own address (127.0.0.1) is allowed "
                "without --allow-remote and --token"
            )

    @property
    def is_local(self) -> bool:
        """Whether nobody but this machine can connect."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def refusal(self, request: Request) -> http.HTTPStatus | None:
        """Why this request is turned away; None lets it in."""
        host = request.headers.get_all("Host")
        origin = request.headers.get_all("Origin")
        if len(host) != 1 or not self._knows(host[0]):
            return http.HTTPStatus.FORBIDDEN
        # Only browsers send an Origin, and every browser does when it opens a websocket; a page from elsewhere
        # cannot leave it out or forge it.
        if origin and origin != [f"http://{host[0]}"]:
            return http.HTTPStatus.FORBIDDEN
        if self.token is not None and not self._shown(request):
            return http.HTTPStatus.UNAUTHORIZED
        return None

    def _knows(self, host: str) -> bool:
        """Whether `host` is a name that we are meant by: a foreign name resolved to us is an attack on the browser."""
        try:
            parts = urlsplit(f"//{host}")
            name, port = parts.hostname or "", parts.port or 80
        except ValueError:
            return False
        if self.port and port != self.port:
            return False
        if name in {"localhost", self.host}:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return not self.is_local and name in {socket.gethostname(), socket.getfqdn()}
        return address.is_loopback or not self.is_local

    def _shown(self, request: Request) -> bool:
        offered = [*parse_qs(urlsplit(request.path).query).get("token", ())]
        with contextlib.suppress(CookieError):
            cookies = SimpleCookie("; ".join(request.headers.get_all("Cookie")))
            offered += [cookies[_COOKIE].value] if _COOKIE in cookies else []
        wanted = (self.token or "").encode()
        return any(hmac.compare_digest(each.encode(errors="replace"), wanted) for each in offered)


def open_server(access: Access) -> viser.ViserServer:
    """A viser server that listens where `access` says, to whom it says. Raises `ConfigError` when it cannot."""
    listener = _listener(access)
    access = Access(
        host=access.host,
        port=listener.getsockname()[1],
        token=access.token,
        allow_remote=access.allow_remote,
    )
    # Its log is one traceback for each client that talks nonsense: a way to fill a disk from outside.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    gate = _Gate(access)
    with _guarded_serve(listener, gate), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=access.host, port=access.port, verbose=False)
    _silence(server)
    gate.open_for(server)
    return server


def allow_switch(client: viser.ClientHandle, uuid: str, changed: Callable[[bool], None]) -> None:
    """Hear one checkbox of this client: `changed` is called with its new value, all else is still ignored."""

    def judged(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid == uuid and isinstance(value, bool):
            changed(value)

    client._websock_connection.register_handler(messages.GuiUpdateMessage, judged)


def allow_number(
    client: viser.ClientHandle, uuid: str, lowest: float, highest: float, changed: Callable[[float], None]
) -> None:
    """Hear one slider of this client in the same way, within its range."""

    def judged(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid != uuid or isinstance(value, bool) or not isinstance(value, int | float):
            return
        if lowest <= value <= highest:  # NaN is not
            changed(float(value))

    client._websock_connection.register_handler(messages.GuiUpdateMessage, judged)


class _Gate:
    """Judges each request before viser sees it."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._server: viser.ViserServer | None = None

    def open_for(self, server: viser.ViserServer) -> None:
        self._server = server

    def wrap(self, inner: Callable[[Any, Request], Response | None]) -> Callable[[Any, Request], Response | None]:
        def process_request(connection: Any, request: Request) -> Response | None:
            refusal = self._access.refusal(request)
            if refusal is None and self._is_busy(request):
                refusal = http.HTTPStatus.SERVICE_UNAVAILABLE
            if refusal is not None:
                response: Response = connection.respond(refusal, f"{refusal.value} {refusal.phrase}\n")
                return response
            return self._answered(inner, connection, request)

        return process_request

    def _is_busy(self, request: Request) -> bool:
        """Whether it is too early, or there are too many browsers for one more."""
        if self._server is None:
            return True
        clients = self._server._websock_server._client_state_from_id
        return "Upgrade" in request.headers and len(clients) >= MAX_CLIENTS

    def _answered(self, inner: Any, connection: Any, request: Request) -> Response | None:
        is_page = urlsplit(request.path).path == "/"
        if is_page and "Accept-Encoding" in request.headers:
            del request.headers["Accept-Encoding"]  # the title is changed below, in plain text
        response: Response | None = inner(connection, request)
        if response is None:
            return None
        body = response.body.replace(_TITLE, _OUR_TITLE, 1) if is_page and response.body else response.body
        headers = Headers(response.headers)
        del headers["Content-Length"]
        headers["Content-Length"] = str(len(body or b""))
        headers["Content-Security-Policy"] = _POLICY
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"
        headers["Cache-Control"] = "no-store"
        if self._access.token is not None:
            headers["Set-Cookie"] = f"{_COOKIE}={self._access.token}; HttpOnly; SameSite=Strict; Path=/"
        return Response(response.status_code, response.reason_phrase, headers, body)


def _listener(access: Access) -> socket.socket:
    """A listening socket at exactly the port asked for: viser alone would silently take the next one."""
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
def _guarded_serve(listener: socket.socket, gate: _Gate) -> Iterator[None]:
    """While viser starts, its call of websockets' `serve` gets our socket, our limits and our gate."""
    module = websockets.asyncio.server
    original = module.serve

    def serve(handler: Any, *_: Any, **options: Any) -> Any:
        options["max_size"] = MAX_MESSAGE_BYTES
        options["max_queue"] = 4
        # Browsers connect in advance and then say nothing; neither that nor a page that hangs may hold up the end.
        options["open_timeout"] = options["close_timeout"] = _PATIENCE_S
        options["server_header"] = None
        options["process_request"] = gate.wrap(options["process_request"])
        return original(handler, sock=listener, **options)

    module.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        module.serve = original  # type: ignore[misc]


def _silence(server: viser.ViserServer) -> None:
    """Unregister all that viser would do on behalf of a client, but for learning where its camera is."""
    inner = server._websock_server
    inner._incoming_handlers.clear()

    def silence_client(connection: Any) -> None:
        handlers = connection._incoming_handlers
        for kind in [kind for kind in handlers if kind is not messages.ViewerCameraMessage]:
            del handlers[kind]

    # Runs after viser's own callback, which registers the client's handlers, and before its first message is read.
    inner.on_client_connect(silence_client)
