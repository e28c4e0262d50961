"""Puts the frames of a candump log back on buses, with their timing, by python-can's reader and player."""

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vehicle_iface.errors import BusError, ConfigError

if TYPE_CHECKING:
    import can

LONGEST_PAUSE_S = 60.0
"""A longer pause between two frames is shortened to this."""
SEND_TIMEOUT_S = 1.0
_ERROR_FLAG = 0x20000000
_LINE = re.compile(
    r"\(\d+\.\d+\) (?P<channel>\S+) (?P<id>[0-9A-F]{8}|[0-9A-F]{3})"
    r"#(#[0-9A-F]([0-9A-F]{2}){0,64}|([0-9A-F]{2}){0,8}|R\d?)( [RT])?",
    re.IGNORECASE,
)


@dataclass(slots=True)
class ReplayCounts:
    """What became of the lines of the log."""

    sent: int = 0
    left_out: int = 0
    """Frames that were not to be sent."""
    errors: int = 0
    """Error frames: only a controller sends them."""
    damaged: int = 0
    other_channels: int = 0


def replay_log(
    path: Path,
    interface: str,
    channels: Mapping[str, str],
    *,
    fd_channels: Iterable[str],
    leaves_out: Callable[[str, int, bool], bool],
    is_over: Callable[[], bool],
) -> ReplayCounts:
    """Send the frames of the log in `channels`, which maps the log's names to the interface's, at the times of the log.

    `leaves_out(channel, can_id, is_extended)` says which frames are not sent; `fd_channels` carry CAN FD. Raises
    `BusError` when a bus cannot be opened or takes no more frames, `ConfigError` when the log cannot be read.
    """
    import can  # 0.2 s to import
    from can.io.canutils import CanutilsLogReader

    counts, fd = ReplayCounts(), set(fd_channels)
    with ExitStack() as opened:
        try:
            text = opened.enter_context(path.open(encoding="utf-8", errors="replace"))
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
        buses = {
            name: opened.enter_context(_open(interface, channel, is_fd=channel in fd))
            for name, channel in channels.items()
        }
        reader = CanutilsLogReader(_FrameLines(text, channels, leaves_out, counts))  # type: ignore[arg-type]  # it only iterates
        for message in can.MessageSync(reader, gap=0.0, skip=LONGEST_PAUSE_S):
            if is_over():
                break
            bus = buses[str(message.channel)]
            try:
                bus.send(message, timeout=SEND_TIMEOUT_S)
            except (can.CanError, OSError) as error:
                raise BusError(
                    f"{interface} {channels[str(message.channel)]}: {error}; {counts.sent} were sent"
                ) from error
            counts.sent += 1
    return counts


def _open(interface: str, channel: str, *, is_fd: bool) -> "can.BusABC":
    import can

    try:
        return can.Bus(interface=interface, channel=channel, **({"fd": True} if is_fd else {}))  # type: ignore[arg-type]
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise BusError(f"{interface} {channel}: cannot be opened: {error}") from error


class _FrameLines(io.TextIOBase):
    """The lines of the log that are sent. python-can's reader takes most error frames for data frames."""

    def __init__(
        self,
        text: Iterable[str],
        channels: Mapping[str, str],
        leaves_out: Callable[[str, int, bool], bool],
        counts: ReplayCounts,
    ) -> None:
        self._text, self._channels, self._leaves_out, self._counts = text, channels, leaves_out, counts

    def __iter__(self) -> Iterator[str]:  # type: ignore[override]  # python-can only iterates
        counts = self._counts
        for line in self._text:
            found = _LINE.fullmatch(line.strip())
            if found is None:
                counts.damaged += bool(line.strip())
                continue
            channel, name = found["channel"], found["id"]
            can_id, is_extended = int(name, 16), len(name) > 3
            if channel not in self._channels:
                counts.other_channels += 1
            elif can_id & _ERROR_FLAG:
                counts.errors += 1
            elif self._leaves_out(channel, can_id, is_extended):
                counts.left_out += 1
            else:
                yield line
