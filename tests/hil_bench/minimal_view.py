#!/usr/bin/env python3
"""Shows the minimal controller's drive to browsers: `minimal_view.py PORT`, until SIGTERM; `View` is the other end.

A page of its own process, which is told of each pair by datagrams: nobody's browser holds the controller up.
"""

import asyncio
import socket
import sys

PATIENCE_S = 5.0
BUFFER_BYTES = 4608
"""So little is under way that whoever waits for a page that stands still waits at once."""


def name_of(port: int) -> str:
    """Where a page at this port is told of pairs: a name without a file."""
    return f"\0minimal-view-{port}"


class View:
    """The controller's end. What the page does not take is lost; where it `blocks`, it is waited for.

    Where the view `matters`, it is an `OSError` that there is no page.
    """

    def __init__(self, port: int, *, blocks: bool, matters: bool) -> None:
        self._name, self._matters = name_of(port), matters
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket.setblocking(blocks)
        self._was_seen = False
        self.lost = 0

    def show(self, *values: float) -> None:
        """One pair, or nothing."""
        try:
            self._socket.sendto(",".join(f"{value:.6f}" for value in values).encode(), self._name)
            self._was_seen = True
        except BlockingIOError:
            self.lost += 1
        except ConnectionRefusedError:
            self.lost += 1
            if self._matters and self._was_seen:
                raise

    def close(self) -> None:
        """Nothing more is shown."""
        self._socket.close()


class _Newest(asyncio.DatagramProtocol):
    """What was told last."""

    def __init__(self) -> None:
        self.text = b""

    def datagram_received(self, data: bytes, _address: object) -> None:
        """Takes the place of the one before."""
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
    """One that was killed may still be on its way out."""
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
