"""Who may watch, and that nobody can do more than watch."""

import contextlib
import http.client
import socket
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
import viser
import websockets.asyncio.server
from viser import _messages
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.http11 import Request
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from vehicle_iface.errors import ConfigError
from vehicle_iface_viewer import serving
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.serving import MAX_MESSAGE_BYTES, open_server

TOKEN = "0123456789abcdef"


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    opened = open_server(Access(port=0))
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def guarded() -> Iterator[viser.ViserServer]:
    opened = open_server(Access(port=0, token=TOKEN))
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def remote() -> Iterator[viser.ViserServer]:
    """One that other machines can reach."""
    opened = open_server(Access(host="0.0.0.0", port=0, allow_remote=True, token=TOKEN))
    yield opened
    opened.stop()


def status(server: viser.ViserServer, path: str = "/", **headers: str) -> http.client.HTTPResponse:
    """The answer to one request; `Host` as given, once."""
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
    with contextlib.closing(connection):
        connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
        connection.putheader("Host", headers.pop("Host", f"127.0.0.1:{server.get_port()}"))
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        response = connection.getresponse()
        response.body = response.read()  # type: ignore[attr-defined]
        return response


def joined(server: viser.ViserServer, host: str = "", **options: Any) -> ClientConnection:
    """A client of viser's own protocol; `host` as it stands in its address, which a tunnel can make differ."""
    sock = socket.create_connection(("127.0.0.1", server.get_port()), timeout=10)
    try:
        return connect(
            f"ws://{host or f'127.0.0.1:{server.get_port()}'}/",
            sock=sock,
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            compression=None,
            **options,
        )
    except InvalidStatus:
        sock.close()
        raise


def packed(message: _messages.Message) -> bytes:
    return msgspec.msgpack.encode(message.as_serializable_dict([]))


def camera() -> _messages.ViewerCameraMessage:
    return _messages.ViewerCameraMessage(
        wxyz=(1.0, 0.0, 0.0, 0.0),
        position=(1.0, 0.0, 0.0),
        fov=1.0,
        near=0.1,
        far=100.0,
        image_height=100,
        image_width=100,
        look_at=(0.0, 0.0, 0.0),
        up_direction=(0.0, 0.0, 1.0),
    )


def test_the_private_names_that_access_leans_on_are_those_of_viser_1_1_1(server: viser.ViserServer) -> None:
    assert viser.__version__ == "1.1.1"
    inner = server._websock_server
    assert isinstance(inner._incoming_handlers, dict)
    assert isinstance(inner._client_state_from_id, dict)
    assert callable(inner.on_client_connect)
    assert {"uuid", "updates"} <= set(_messages.GuiUpdateMessage.__annotations__)
    assert issubclass(_messages.ViewerCameraMessage, _messages.Message)
    box = server.gui.add_checkbox("box", initial_value=False)
    assert isinstance(box._impl.uuid, str)
    box.remove()


def test_websockets_is_as_before_once_the_server_runs(server: viser.ViserServer) -> None:
    assert server.get_port() > 0
    assert websockets.asyncio.server.serve.__module__ == "websockets.asyncio.server"


def test_the_page_is_served_with_a_policy_and_our_title(server: viser.ViserServer) -> None:
    response = status(server)
    assert response.status == 200
    assert b"<title>vehicle-iface</title>" in response.body  # type: ignore[attr-defined]
    assert "frame-ancestors 'none'" in (response.getheader("Content-Security-Policy") or "")
    assert response.getheader("X-Content-Type-Options") == "nosniff"
    assert response.getheader("Server") is None


@pytest.mark.parametrize(
    "path", ["/missing", "/index.html/x", "/../etc/passwd", "/%2e%2e/x", "//[x", "/\\x", "/%00", "/" + 300 * "x", "x"]
)
def test_an_unknown_path_answers_404_and_names_the_page(server: viser.ViserServer, path: str) -> None:
    response = status(server, f"{path}?token=1", Accept_Encoding="gzip")
    assert response.status == 404
    assert response.body.endswith(b"; the page is at /\n")  # type: ignore[attr-defined]
    assert response.getheader("Content-Type") == "text/plain; charset=utf-8"
    assert response.getheader("X-Content-Type-Options") == "nosniff"


def test_a_request_for_an_icon_is_answered_with_no_content(server: viser.ViserServer) -> None:
    response = status(server, "/favicon.ico")
    assert (response.status, response.body) == (204, b"")  # type: ignore[attr-defined]


def test_an_unknown_path_needs_the_token_as_the_page_does(guarded: viser.ViserServer) -> None:
    assert [status(guarded, path).status for path in ("/missing", "/favicon.ico", "//[x")] == [401] * 3
    assert status(guarded, f"/missing?token={TOKEN}").status == 404


def test_a_repeated_upgrade_header_opens_no_websocket(server: viser.ViserServer) -> None:
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)) as connection:
        connection.putrequest("GET", "/")
        connection.putheader("Upgrade", "websocket")
        connection.putheader("Upgrade", "websocket")
        connection.endheaders()
        assert connection.getresponse().status == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:{port}",
        "evil.example:80",
        "127.0.0.1.evil.example",
        "localhost.evil.example:{port}",
        "car.local:{port}",
        "192.0.2.1:{port}",
        "127.0.0.1:99999",
        "localhost:x",
        "",
        "[::",
    ],
)
def test_a_foreign_host_name_is_forbidden(server: viser.ViserServer, host: str) -> None:
    host = host.format(port=server.get_port())
    response = status(server, Host=host)
    assert response.status == 403
    assert response.body.decode() == (  # type: ignore[attr-defined]
        f"403: '{host}' is no name of this page; open http://127.0.0.1:{server.get_port()}/ on its machine, or "
        f"http://127.0.0.1:9000/ after `ssh -L 9000:127.0.0.1:{server.get_port()} MACHINE`; any port will do\n"
    )
    assert response.getheader("X-Content-Type-Options") == "nosniff"


def test_a_host_name_given_twice_is_forbidden() -> None:
    twice = Headers([("Host", "localhost:8080"), ("Host", "localhost:8080")])
    rejection = Access().find_rejection(Request("/", twice))
    assert rejection is not None
    assert rejection.status == 403


@pytest.mark.parametrize("host", ["localhost:{port}", "127.0.0.1:{port}", "LOCALHOST:{port}", "[::1]:{port}"])
def test_names_of_this_machine_are_served(server: viser.ViserServer, host: str) -> None:
    assert status(server, Host=host.format(port=server.get_port())).status == 200


@pytest.mark.parametrize("host", ["127.0.0.1:9000", "localhost:9000", "localhost", "[::1]:1"])
def test_a_tunnel_from_any_port_shows_the_page_and_its_websocket(server: viser.ViserServer, host: str) -> None:
    assert status(server, Host=host, Origin=f"http://{host}").status == 200
    with joined(server, host, additional_headers={"Origin": f"http://{host}"}) as client:
        assert client.recv(timeout=10)


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "https://127.0.0.1:{port}",
        "http://127.0.0.1:1",
        "http://localhost:{port}",
        "http://127.0.0.1:{port}.evil.example",
        "file://",
        "",
    ],
)
def test_a_foreign_origin_is_forbidden(server: viser.ViserServer, origin: str) -> None:
    origin = origin.format(port=server.get_port())
    response = status(server, Origin=origin)
    assert response.status == 403
    assert response.body.decode() == (  # type: ignore[attr-defined]
        f"403: a page of '{origin}' may not read this one; open 'http://127.0.0.1:{server.get_port()}' itself\n"
    )
    with pytest.raises(InvalidStatus) as refused:
        joined(server, additional_headers={"Origin": origin})
    assert refused.value.response.status_code == 403


def test_through_a_tunnel_a_page_of_another_port_is_forbidden(server: viser.ViserServer) -> None:
    for origin in (f"http://localhost:{server.get_port()}", "http://localhost:9001", "http://evil.example:9000"):
        with pytest.raises(InvalidStatus) as refused:
            joined(server, "localhost:9000", additional_headers={"Origin": origin})
        assert refused.value.response.status_code == 403


def test_one_browser_more_than_the_maximum_is_refused_with_the_number(
    server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "MAX_CLIENTS", 1)
    with joined(server) as client:
        wait_for_answer(client)
        with pytest.raises(InvalidStatus) as refused:
            joined(server)
    assert refused.value.response.status_code == 503
    assert refused.value.response.body == b"503: 1 browsers watch already, the maximum; close one\n"


def test_our_own_page_may_open_a_websocket(server: viser.ViserServer) -> None:
    with joined(server, additional_headers={"Origin": f"http://127.0.0.1:{server.get_port()}"}) as client:
        assert client.recv(timeout=10)


def test_no_token_is_unauthorized(guarded: viser.ViserServer) -> None:
    response = status(guarded)
    assert response.status == 401
    assert b"the token is missing or wrong; open the address that" in response.body  # type: ignore[attr-defined]
    assert status(guarded, "/?token=wrong").status == 401
    assert status(guarded, Cookie="vehicle_iface_token=wrong").status == 401
    assert status(guarded, Cookie="a[=b;;=,").status == 401
    with pytest.raises(InvalidStatus) as refused:
        joined(guarded)
    assert refused.value.response.status_code == 401


def test_a_token_shown_once_is_kept_as_a_cookie(guarded: viser.ViserServer) -> None:
    response = status(guarded, f"/?token={TOKEN}")
    assert response.status == 200
    cookie = response.getheader("Set-Cookie") or ""
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    kept = cookie.split(";")[0]
    assert status(guarded, Cookie=kept).status == 200
    with joined(guarded, additional_headers={"Cookie": kept}) as client:
        assert client.recv(timeout=10)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::", "example.org"])
def test_another_address_needs_a_flag_and_a_token(host: str) -> None:
    for options in ({}, {"allow_remote": True}, {"token": TOKEN}):
        with pytest.raises(ConfigError, match=r"others could watch; .*--allow-remote and --token-file"):
            Access(host=host, **options)
    assert not Access(host=host, allow_remote=True, token=TOKEN).is_local


@pytest.mark.parametrize(
    "host", ["car.local:{port}", "car.local:9000", "car:{port}", "192.0.2.7:9000", "[2001:db8::7]:9000", "{own}"]
)
def test_names_that_only_a_local_network_gives_show_a_remote_page_with_the_token(
    remote: viser.ViserServer, host: str
) -> None:
    host = host.format(port=remote.get_port(), own=socket.gethostname().lower())
    response = status(remote, f"/?token={TOKEN}", Host=host)
    assert response.status == 200
    cookie = (response.getheader("Set-Cookie") or "").split(";")[0]
    with joined(remote, host, additional_headers={"Cookie": cookie, "Origin": f"http://{host}"}) as client:
        assert client.recv(timeout=10)
    assert status(remote, f"/?token={TOKEN}", Host=host.upper()).status == 200
    assert status(remote, "/", Host=host).status == 401


@pytest.mark.parametrize("host", ["rebound.example:{port}", "car.local.evil.example:{port}", ".:{port}", ""])
def test_a_remote_page_is_forbidden_under_a_public_name(remote: viser.ViserServer, host: str) -> None:
    response = status(remote, f"/?token={TOKEN}", Host=host.format(port=remote.get_port()))
    assert response.status == 403
    assert b"is no name of this page; open it by an IP address" in response.body  # type: ignore[attr-defined]
    assert TOKEN.encode() not in response.body  # type: ignore[attr-defined]


def test_a_short_token_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 16"):
        Access(token="short")


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_is_none_is_refused(port: int) -> None:
    with pytest.raises(ConfigError, match=f"--port {port}: must be within"):
        Access(port=port)


def test_a_taken_port_is_refused_by_name() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"--port {port} on 127\.0\.0\.1: .*in use; .*another --port"):
            open_server(Access(port=port))


def test_of_a_clients_messages_only_the_camera_is_handled(server: viser.ViserServer) -> None:
    box = server.gui.add_checkbox("box", initial_value=False)
    hostile = (
        _messages.GuiUpdateMessage(box._impl.uuid, {"value": True}),
        _messages.GuiRemoveMessage(box._impl.uuid),
        _messages.ShareUrlRequest(),
        _messages.FileTransferStartUpload(box._impl.uuid, "u", "n", "m", 1, 2**40),
        _messages.ResetGuiMessage(),
    )
    with joined(server) as client:
        for message in hostile:
            client.send(packed(message))
        client.send(packed(camera()))
        wait_for_client(server, client)
        for message in hostile:
            client.send(packed(message))
        (handle,) = server.get_clients().values()
        assert set(handle._websock_connection._incoming_handlers) == {_messages.ViewerCameraMessage}
        client.send(b"\xc1")  # closes the connection, once all before it was read
        wait_until_closed(client)
    assert box.value is False
    assert server._share_tunnel is None
    assert server._websock_server._incoming_handlers == {}
    assert handle.gui._current_file_upload_states == server.gui._current_file_upload_states == {}
    box.remove()


def test_too_long_and_senseless_messages_close_that_client_alone(server: viser.ViserServer) -> None:
    with joined(server) as bystander:
        bystander.recv(timeout=10)
        too_long = packed(_messages.GuiUpdateMessage("box", {"value": "x" * MAX_MESSAGE_BYTES}))
        longer_than_any = packed(_messages.GuiUpdateMessage("box", {"value": "x" * 100_000}))
        for senseless in (too_long, longer_than_any, bytes(50_000_000), b"\xc1", b"\x91" * 10_000, b"", "text"):
            with joined(server) as client:
                with contextlib.suppress(ConnectionClosed):  # of the longest not all is taken
                    client.send(senseless)
                wait_until_closed(client)
        wait_for_answer(bystander)
    assert status(server).status == 200


def test_a_silent_connection_does_not_delay_the_end() -> None:
    server = open_server(Access(port=0))
    with socket.create_connection(("127.0.0.1", server.get_port())), joined(server) as client:
        client.recv(timeout=10)
        server.stop()
    thread = server._websock_server._server_thread
    assert thread is not None
    assert not thread.is_alive()


def wait_for_client(server: viser.ViserServer, client: Connection) -> None:
    """Until the server has received the client's camera."""
    while not server.get_clients():
        wait_for_answer(client)


def wait_until_closed(client: Connection) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            client.recv(timeout=10)


def wait_for_answer(client: Connection) -> None:
    """Until the server has answered a ping, having read what was sent before it."""
    assert client.ping().wait(timeout=10)
