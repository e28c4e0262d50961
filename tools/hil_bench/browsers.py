"""Browsers that request everything, read nothing and send garbage: `python browsers.py PORT`, until SIGTERM.

They also end when the parent ends.
"""

import os
import random
import socket
import sys
import time
from contextlib import suppress

PAGES = 20
PERIOD_S = 0.05
REQUESTS = (
    b"GET / HTTP/1.1\r\nHost: localhost:%d\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
)


def main() -> None:
    port, parent, chance = int(sys.argv[1]), os.getppid(), random.Random(0)
    pages: list[socket.socket] = []
    while os.getppid() == parent:
        if len(pages) < PAGES:
            with suppress(OSError):  # refused now; tried again in the next period
                page = socket.create_connection(("127.0.0.1", port), timeout=1.0)
                pages.append(page)
                page.setblocking(False)
                page.send(REQUESTS[len(pages) % len(REQUESTS)] % port)
        for page in pages.copy():
            try:
                page.send(chance.randbytes(1000))
            except BlockingIOError:
                continue  # the server does not read
            except OSError:
                pages.remove(page)  # closed by the server; another one is opened
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main()
