"""The frames of a walk as a candump log."""

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from vehicle_iface.bus.raw_socket import CANFD_BRS, EFF_FLAG, RTR_FLAG
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame
from vehicle_iface.recorder.frame_tap import format_frame


class FrameLog:
    """Writes frames as `candump -L` does. `ConfigError` when that fails, and where the file exists already."""

    def __init__(self, path: Path, channels: Iterable[str], *, wall_offset_ns: int) -> None:
        """`channels` are those of the buses in their order; `wall_offset_ns` is the wall clock's time less the
        monotonic clock's."""
        self.path, self.count = path, 0
        self.channels = [channel.replace(" ", "_") or "can" for channel in channels]
        self._offset_ns = wall_offset_ns
        try:
            self._file = open(path, "xb")  # noqa: SIM115  # closed by __exit__
        except OSError as error:
            raise self._fault(error) from None

    def write(self, frames: Sequence[CanFrame]) -> None:
        """Append the frames."""
        self.count += len(frames)
        try:
            self._file.writelines(self._format(frame) for frame in frames)
        except OSError as error:
            raise self._fault(error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None) -> None:
        try:
            self._file.close()
        except OSError as error:
            if kind is None:
                raise self._fault(error) from None
        if not self.count:
            with suppress(OSError):
                os.unlink(self.path)  # nothing to review, and nothing in the way of the next walk

    def _format(self, frame: CanFrame) -> bytes:
        word = frame.can_id | (EFF_FLAG if frame.is_extended else 0) | (RTR_FLAG if frame.is_remote else 0)
        packet = (word, frame.data, frame.is_fd, frame.stamp_ns + self._offset_ns, 0, False)
        return format_frame(self.channels[frame.bus], packet, CANFD_BRS if frame.is_fd else 0)

    def _fault(self, error: OSError) -> ConfigError:
        return ConfigError(f"--record {self.path}: cannot be written: {error.strerror}")
