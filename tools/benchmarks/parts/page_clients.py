"""Pages of the `pages` benchmark, which read and draw nothing: `python -m benchmarks.parts.page_clients URL COUNT`.

Prints a line when all are connected, and on SIGUSR1 how many bytes they have received.
"""

import asyncio
import signal
import sys

import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol


async def main(url: str, count: int) -> None:
    """Read until the process is ended."""
    pages = [await _open(url) for _ in range(count)]
    received = [0] * count
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, lambda: print(sum(received), flush=True))
    print("connected", flush=True)
    await asyncio.gather(*(_read(page, received, number) for number, page in enumerate(pages)))


async def _open(url: str) -> ClientConnection:
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    return await connect(url.replace("http", "ws", 1), subprotocols=[protocol], max_size=None, compression=None)


async def _read(page: ClientConnection, received: list[int], number: int) -> None:
    async for message in page:
        received[number] += len(message)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
