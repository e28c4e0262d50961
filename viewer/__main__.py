"""`python -m viewer`: the page in a browser, for as long as it is wanted."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import sys
import warnings
import webbrowser
from collections.abc import Sequence
from types import FrameType

from vehicle_iface.errors import ConfigError
from vehicle_iface.runtime.telemetry import telemetry_path
from viewer.access import Access
from viewer.app import App
from viewer.recording import SPEEDS, Recording


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the page until SIGINT or SIGTERM. 0: ended as told; 2: an option that does not fit."""
    options = _parser().parse_args(arguments)
    try:
        access = Access(host=options.host, port=options.port, token=options.token, allow_remote=options.allow_remote)
        source, shown = _source(options)
        app = App(access, source)
    except ConfigError as error:
        print(f"viewer: {error}", file=sys.stderr)
        return 2
    # A browser may leave between being found and being sent to; that needs no words.
    warnings.filterwarnings("ignore", message=r"Queued a \w+ on a closed connection")
    stop = _StopFlag()
    url = _url(options.host, app.port, options.token)
    print(f"viewer: {url}  ({shown})", flush=True)
    if options.open:
        webbrowser.open(url)
    try:
        app.run(lambda: not stop.is_set)
    finally:
        # viser reports its own end; one program, one voice.
        with contextlib.redirect_stdout(io.StringIO()):
            app.close()
    print("viewer: ended", flush=True)
    return 0


def _source(options: argparse.Namespace) -> tuple[str | Recording, str]:
    """What is shown, and that in words."""
    if options.recording is None:
        address = options.connect if options.connect is not None else "default"
        return address, f"telemetry {address!r}: {telemetry_path(address)}"
    if options.connect is not None:
        raise ConfigError("--connect is for a running loop: leave it out, or the recording")
    if not SPEEDS[0] <= options.speed <= SPEEDS[1]:
        raise ConfigError(f"--speed {options.speed:g}: must be within {SPEEDS[0]:g} … {SPEEDS[1]:g}")
    begin_s: float = getattr(options, "from")
    recording = Recording(options.recording, speed=options.speed, begin_s=begin_s)
    if not 0.0 <= begin_s <= recording.length_s:
        raise ConfigError(f"--from {begin_s:g}: must be within 0 … {recording.length_s:.1f}, what was recorded")
    return recording, f"recording {options.recording}, {recording.length_s:.1f} s"


class _StopFlag:
    """Set by the first SIGINT or SIGTERM; a second SIGINT ends at once."""

    def __init__(self) -> None:
        self.is_set = False
        signal.signal(signal.SIGINT, self._set)
        signal.signal(signal.SIGTERM, self._set)

    def _set(self, _number: int, _frame: FrameType | None) -> None:
        self.is_set = True
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _url(host: str, port: int, token: str | None) -> str:
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="viewer",
        description="Show a running loop in the browser, or a drive that `run --record` has written down. It reads the "
        "loop's telemetry and cannot answer it.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("recording", nargs="?", metavar="RECORDING", help="the folder of a drive to play back")
    parser.add_argument(
        "--connect", metavar="ADDRESS", help="telemetry to show: a name ('default'), or a path with a '/'"
    )
    parser.add_argument(
        "--speed", type=float, default=1.0, help="of a recording: multiple of the drive's own, 0.1 … 10"
    )
    parser.add_argument(
        "--from", type=float, default=0.0, metavar="S", help="of a recording: begin at that second of it"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at")
    parser.add_argument("--port", type=int, default=8080, help="TCP port to listen at; 0 takes a free one")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="let other machines in, with --token; the connection is not encrypted",
    )
    parser.add_argument("--token", default=None, help="secret of 16 characters or more that a browser must show")
    return parser


if __name__ == "__main__":
    sys.exit(main())
