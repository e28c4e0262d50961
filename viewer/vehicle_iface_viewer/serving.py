"""The viewer's server: the socket, and what is checked before viser handles a request or a message.

viser itself accepts every client, checks no Origin, takes messages of 50 MB, and lets any client upload files, press
any button and request a public tunnel. This module binds the socket and checks each request before viser handles it.
Of a browser's messages only its camera and its own controls (`controls`) are handled.

This relies on private names of exactly viser 1.1.1; `tests/viewer/test_access.py` fails when they change.
"""

from __future__ import annotations

import contextlib
import http
import io
import logging
import socket
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from viser import _messages as messages
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from vehicle_iface.errors import ConfigError
from vehicle_iface_viewer.access import COOKIE, Access, Rejection, quote
from vehicle_iface_viewer.addresses import find_own_names

MAX_MESSAGE_BYTES = 16384
"""A camera message has about 300 bytes."""
MAX_CLIENTS = 64
"""Concurrent browsers; each costs memory and time in every update."""

_TIMEOUT_S = 2.0
# The page loads nothing from, and sends nothing to, other origins, and no other page may frame it. viser compiles
# WebAssembly and creates scripts and workers at run time, hence the exceptions.
_POLICY = (
    "default-src 'self' blob: data:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'none'"
)
_FIRST_CAMERA = messages.ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(0.0, 0.0, 1.0),
    fov=1.0,
    near=0.1,
    far=1000.0,
    image_height=720,
    image_width=1280,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, 0.0, 1.0),
)
_TITLE = b"<title>Viser</title>"
_OUR_TITLE = b"<title>vehicle-iface</title>"


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
            words = f"404: nothing is at {quote([path])}; the page is at /\n"
            response = connection.respond(http.HTTPStatus.NOT_FOUND, words)
        else:
            response = _read_page(inner, connection)
        if self._access.token is not None:
            response.headers["Set-Cookie"] = f"{COOKIE}={self._access.token}; HttpOnly; SameSite=Strict; Path=/"
        return response


def _restrict(headers: Headers) -> None:
    headers["Content-Security-Policy"] = _POLICY
    headers["X-Content-Type-Options"] = "nosniff"
    headers["Referrer-Policy"] = "no-referrer"
    headers["Cache-Control"] = "no-store"


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
    """Unregister all of viser's message handlers except the one for a client's camera, and give it a first camera.

    A client counts as connected when its camera is known. A browser sends it with the first picture that it has drawn:
    without a GPU seconds later, in a hidden tab never. Its texts do not wait for that.
    """
    inner = server._websock_server
    inner._incoming_handlers.clear()

    async def prepare_client(connection: Any) -> None:
        handlers = connection._incoming_handlers
        for kind in [kind for kind in handlers if kind is not messages.ViewerCameraMessage]:
            del handlers[kind]
        for handle_camera in handlers[messages.ViewerCameraMessage]:
            await handle_camera(connection.client_id, _FIRST_CAMERA)

    # Runs after viser's own callback, which registers the client's handlers, and before its first message is read.
    inner.on_client_connect(prepare_client)
