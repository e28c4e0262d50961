"""A local port that leads to another one, as `ssh -L` opens it."""

import contextlib
import socket
import socketserver
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def open_tunnel(target_port: int) -> Iterator[int]:
    """Forward a free local port to `target_port`; gives its number."""

    class Forward(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            with socket.create_connection(("127.0.0.1", target_port)) as target:
                threading.Thread(target=_copy, args=(target, self.request), daemon=True).start()
                _copy(self.request, target)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Forward, bind_and_activate=True) as server:
        server.daemon_threads = True
        server.block_on_close = False
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_address[1]
        server.shutdown()


def _copy(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(65536):
            sink.sendall(data)
    for each in (source, sink):
        with contextlib.suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)
