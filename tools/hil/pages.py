"""Browsers that ask a page for everything, read nothing and send nonsense: `python pages.py PORT`, until SIGTERM.

They end with whoever started them.
"""

import os
import random
import socket
import sys
import time
from contextlib import suppress

PAGES = 20
PERIOD_S = 0.05
ASKS = (
    b"GET / HTTP/1.1\r\nHost: localhost:%d\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
)


def main() -> None:
    port, parent, dice = int(sys.argv[1]), os.getppid(), random.Random(0)
    pages: list[socket.socket] = []
    while os.getppid() == parent:
        if len(pages) < PAGES:
            with suppress(OSError):  # who will not have one now gets the next
                page = socket.create_connection(("127.0.0.1", port), timeout=1.0)
                pages.append(page)
                page.setblocking(False)
                page.send(ASKS[len(pages) % len(ASKS)] % port)
        for page in pages.copy():
            try:
                page.send(dice.randbytes(1000))
            except BlockingIOError:
                continue  # no room: nobody reads
            except OSError:
                pages.remove(page)  # closed for what it said; another one comes
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main()
