"""A process that attacks a page: `hostile_client.py PORT TOKEN`. It ends when it has tried everything.

It prints a line for each rejection that it sees. Websocket messages are msgpack, as viser's own page sends them.
"""

import contextlib
import http.client
import sys

import msgspec
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

LONG_BYTES = 5_000_000
FLOOD = 700
FOREIGN = {"another host name": {"Host": "evil.example"}, "a foreign Origin": {"Origin": "http://evil.example"}}
HOSTILE = [
    {"type": "GuiUpdateMessage", "uuid": "box", "updates": {"value": True}},
    {"type": "GuiRemoveMessage", "uuid": "box"},
    {"type": "RemoveSceneNodeMessage", "name": "/"},
    {"type": "ResetGuiMessage"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "box", "transfer_uuid": "1", "filename": "x"},
    {"type": "ShareUrlRequest"},
    {"type": "ThereIsNoSuchMessage"},
]
SENSELESS: list[str | bytes] = [b"\xc1", b"\x91" * 10_000, b"", "text", b"\0" * LONG_BYTES]


def main(port: str, token: str) -> None:
    """Try all attacks, one after the other."""
    for what, headers in FOREIGN.items():
        print(f"{what}: {status(port, token, headers)}", flush=True)
    print(f"no token: {status(port, '', {})}", flush=True)
    with contextlib.suppress(InvalidStatus):
        joined(port, "").close()
        print("joined without a token", flush=True)
    for message in SENSELESS:
        with joined(port, token) as client, contextlib.suppress(ConnectionClosed):
            client.send(message)
            client.recv(timeout=1.0)
    with joined(port, token) as client, contextlib.suppress(ConnectionClosed):
        for i in range(FLOOD):
            client.send(msgspec.msgpack.encode(HOSTILE[i % len(HOSTILE)]))
    print("done", flush=True)


def status(port: str, token: str, headers: dict[str, str]) -> int:
    """Return the HTTP status of a request for the page with these headers."""
    connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=10.0)
    with contextlib.closing(connection):
        connection.request("GET", f"/?token={token}", headers=headers)
        return connection.getresponse().status


def joined(port: str, token: str) -> ClientConnection:
    """Open a websocket as the page does."""
    address = f"ws://127.0.0.1:{port}/?token={token}"
    return connect(address, max_size=None, compression=None, subprotocols=[Subprotocol("viser-v1.1.1")])


if __name__ == "__main__":
    main(*sys.argv[1:])
