#!/usr/bin/env python3
"""Shows the minimal controller's drive in browsers: `minimal_view.py PORT`, until SIGTERM. `View` is the controller's
end.

The page is a process of its own and receives each pair in a datagram, so that no browser delays the controller.
"""

import asyncio
import socket
import sys

PATIENCE_S = 5.0
BUFFER_BYTES = 4608
"""Size of the send buffer. It is so small that a controller that waits for a stopped page waits at once."""


def name_of(port: int) -> str:
    """Return the socket address of the page at this port: an abstract name without a file."""
    return f"\0minimal-view-{port}"


class View:
    """The controller's end. A pair that the page does not accept is lost; with `blocks`, sending waits instead.

    With `is_required`, sending raises `OSError` after the page has ended.
    """

    def __init__(self, port: int, *, blocks: bool, is_required: bool) -> None:
        self._name, self._is_required = name_of(port), is_required
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket.setblocking(blocks)
        self._was_seen = False
        self.lost = 0

    def show(self, *values: float) -> None:
        """Send one pair, or count it as lost."""
        try:
            self._socket.sendto(",".join(f"{value:.6f}" for value in values).encode(), self._name)
            self._was_seen = True
        except BlockingIOError:
            self.lost += 1
        except ConnectionRefusedError:
            self.lost += 1
            if self._is_required and self._was_seen:
                raise

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Newest(asyncio.DatagramProtocol):
    """Keeps the newest datagram."""

    def __init__(self) -> None:
        self.text = b""

    def datagram_received(self, data: bytes, _address: object) -> None:
        """Replace the previous datagram."""
        self.text = data


async def _serve(port: int) -> None:
    newest = _Newest()

    async def page(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await reader.readuntil(b"\r\n\r\n")
            writer.write(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n" + newest.text)
            await writer.drain()
        except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, ConnectionError):
            pass  # no browser
        finally:
            writer.close()

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(name_of(port))
        ear.setblocking(False)
        server = await asyncio.start_server(page, "127.0.0.1", port)
        await asyncio.get_running_loop().create_datagram_endpoint(lambda: newest, sock=ear)
        await server.serve_forever()


async def _serve_when_it_is_free(port: int) -> None:
    """Retry until the port is free: a killed page may still be ending."""
    deadline_s = asyncio.get_running_loop().time() + PATIENCE_S
    while True:
        try:
            await _serve(port)
        except OSError:
            if asyncio.get_running_loop().time() > deadline_s:
                raise
            await asyncio.sleep(0.05)


if __name__ == "__main__":
    asyncio.run(_serve_when_it_is_free(int(sys.argv[1])))
