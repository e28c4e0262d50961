"""`python -m vehicle_iface_viewer`: serves the page until it is interrupted."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from vehicle_iface.command_line import ArgumentParser, HelpFormatter, make_output_safe
from vehicle_iface.errors import ConfigError
from vehicle_iface.telemetry import telemetry_path
from vehicle_iface.telemetry.running import find_running_loops
from vehicle_iface_viewer.access import Access
from vehicle_iface_viewer.access_token import TOKEN_VARIABLE, opened_in_browser, read_token
from vehicle_iface_viewer.addresses import find_reachable_host, format_url
from vehicle_iface_viewer.app import App
from vehicle_iface_viewer.bus_table.recorded import RecordedBusTable
from vehicle_iface_viewer.bus_table.source import BusTableSource, ListenerProcess
from vehicle_iface_viewer.loops import list_loops
from vehicle_iface_viewer.playback import SPEEDS, Playback

_TOKEN_WARNING = (
    "--token shows the secret to every user of this machine (`ps`), and will be rejected in the next version; "
    f"give it with --token-file FILE, or in the environment variable {TOKEN_VARIABLE}"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the page until SIGINT or SIGTERM. Exit status 0, or 2 for an invalid option."""
    make_output_safe()
    options = _build_parser().parse_args(arguments)
    if options.list:
        loops = find_running_loops()
        print(list_loops(loops) if loops else "viewer: no loop is running")
        return 0
    try:
        if options.token is not None:
            print(f"viewer: warning: {_TOKEN_WARNING}", file=sys.stderr)
        token = options.token if options.token is not None else read_token(options.token_file)
        access = Access(host=options.host, port=options.port, token=token, allow_remote=options.allow_remote)
        source, shown = _open_source(options)
        app = App(access, source, _open_bus_table(options, source))
    except ConfigError as error:
        print(f"viewer: {error}", file=sys.stderr)
        return 2
    # A browser may disconnect between being listed and being sent to; that is no reason for a warning.
    warnings.filterwarnings("ignore", message=r"Queued a \w+ on a closed connection")
    stop = _StopFlag()
    url = format_url(find_reachable_host(options.host), app.port, token)
    print(f"viewer: {url}  ({shown})", flush=True)
    browser = opened_in_browser(url, is_secret=token is not None) if options.open else contextlib.nullcontext()
    try:
        with browser:
            app.run(lambda: not stop.is_set)
    finally:
        # viser prints a line of its own.
        with contextlib.redirect_stdout(io.StringIO()):
            app.close()
    print("viewer: ended", flush=True)
    return 0


def _open_source(options: argparse.Namespace) -> tuple[str | Playback | None, str]:
    """Return the source of the page, and its description."""
    if options.recording is None and options.connect is not None:
        return options.connect, f"telemetry {options.connect!r}: {telemetry_path(options.connect)}"
    if options.recording is None:
        return None, _describe_loops()
    if options.connect is not None:
        raise ConfigError("--connect is for a running loop: leave it out, or the recording")
    if not SPEEDS[0] <= options.speed <= SPEEDS[1]:
        raise ConfigError(f"--speed {options.speed:g}: must be within {SPEEDS[0]:g} … {SPEEDS[1]:g}")
    begin_s: float = getattr(options, "from")
    playback = Playback(options.recording, speed=options.speed, begin_s=begin_s)
    if not 0.0 <= begin_s <= playback.length_s:
        raise ConfigError(f"--from {begin_s:g}: must be within 0 … {playback.length_s:.1f}, what was recorded")
    return playback, f"recording {options.recording}, {playback.length_s:.1f} s"


def _describe_loops() -> str:
    names = [loop.address for loop in find_running_loops()]
    if len(names) == 1:
        return f"loop {names[0]!r}"
    return f"{len(names)} loops: choose one on the page" if names else "no loop is running yet"


def _open_bus_table(options: argparse.Namespace, source: str | Playback | None) -> BusTableSource:
    if isinstance(source, Playback):
        return RecordedBusTable(options.recording, source.wall_offset_ns, options.profile)
    return ListenerProcess(options.profile)


class _StopFlag:
    """Set by the first SIGINT or SIGTERM; a second SIGINT ends the program immediately."""

    def __init__(self) -> None:
        self.is_set = False
        signal.signal(signal.SIGINT, self._set)
        signal.signal(signal.SIGTERM, self._set)

    def _set(self, _number: int, _frame: FrameType | None) -> None:
        self.is_set = True
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _build_parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        prog="vehicle-iface view",
        description="Show a running loop in the browser, or play back a drive that was recorded with `run --record`. "
        "The viewer only reads telemetry: it cannot influence the loop.",
        formatter_class=HelpFormatter,
    )
    parser.add_argument("recording", nargs="?", metavar="RECORDING", help="folder of a recorded drive to play back")
    parser.add_argument(
        "--connect",
        metavar="ADDRESS",
        help="telemetry to show: a name, or a path with a '/'; without it, the loop that is running; "
        "the page offers all where there are several",
    )
    parser.add_argument("--list", action="store_true", help="print the running loops, and exit")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="playback speed of a recording, 0.1 … 10; 1 is real time"
    )
    parser.add_argument(
        "--from", type=float, default=0.0, metavar="S", help="start the playback S seconds after its beginning"
    )
    parser.add_argument(
        "--profile",
        metavar="FILE",
        help="profile of the loop, as for `run`, to decode all messages of its buses; not needed for one that is "
        "shipped with the program, nor for a recording, which has a copy",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument("--port", type=int, default=8080, help="TCP port to listen on; 0: any free port")
    parser.add_argument("--open", action="store_true", help="open the page in this machine's browser")
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="accept other machines; requires a token, and the connection is not encrypted",
    )
    token = parser.add_mutually_exclusive_group()
    token.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="file that only you can read, with the secret of at least 16 characters that a browser must send; "
        f"without it, the environment variable {TOKEN_VARIABLE}",
    )
    token.add_argument("--token", help="deprecated, as other users see it; use --token-file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
