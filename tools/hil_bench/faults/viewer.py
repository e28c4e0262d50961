"""Faults of a viewer beside the device: it is stopped, killed or flooded."""

import errno
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from hil_bench.faults.base import Injection, NotApplicableError
from hil_bench.places import PACKAGE
from hil_bench.process import Process
from hil_bench.rig import Rig

START_S = 60.0


def with_viewer(fault: Callable[[Rig, Process], AbstractContextManager[None]]) -> Injection:
    """Start a viewer, wait until it serves its page, then begin `fault`."""

    @contextmanager
    def inject(rig: Rig) -> Iterator[None]:
        viewer = rig.start_process(rig.viewer)
        try:
            _wait_for_page(rig, viewer)
            rig.mark_injection()
            with fault(rig, viewer):
                yield
        finally:
            rig.stop_process(viewer)

    return inject


@contextmanager
def pause_viewer(_rig: Rig, viewer: Process) -> Iterator[None]:
    """Stop it by SIGSTOP, and continue it at the end."""
    viewer.send(signal.SIGSTOP)
    yield
    viewer.send(signal.SIGCONT)
    _require_alive(viewer, "the viewer")


@contextmanager
def kill_viewer(rig: Rig, viewer: Process) -> Iterator[None]:
    """Kill it, and start another one in its place."""
    viewer.send(signal.SIGKILL)
    another = rig.start_process(rig.viewer)
    try:
        _wait_for_page(rig, another)
        yield
        _require_alive(another, "the second viewer")
    finally:
        rig.stop_process(another)


@contextmanager
def flood_viewer(rig: Rig, viewer: Process) -> Iterator[None]:
    """Connect browsers that request everything, read nothing and send garbage."""
    browsers = rig.start_process([sys.executable, str(PACKAGE / "browsers.py"), rig.placeholders["port"]])
    try:
        yield
        _require_alive(browsers, "the process that floods it")
        _require_alive(viewer, "the viewer")
    finally:
        rig.stop_process(browsers)


def _wait_for_page(rig: Rig, viewer: Process) -> None:
    port = int(rig.placeholders["port"])
    rig.wait_for(lambda: _is_served(port) or not viewer.is_alive, START_S, "the viewer to answer")
    _require_alive(viewer, "the viewer")
    if not _is_served(port):
        raise NotApplicableError("the viewer does not answer")


def _require_alive(process: Process, name: str) -> None:
    if not process.is_alive:
        raise NotApplicableError(f"{name} has ended; see its output")


def _is_served(port: int) -> bool:
    with socket.socket() as page:
        page.setblocking(False)
        page.connect_ex(("127.0.0.1", port))
        return page.connect_ex(("127.0.0.1", port)) in (0, errno.EISCONN)
