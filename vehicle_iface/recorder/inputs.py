"""The inputs of a loop, pass by pass, and the lines of `inputs.log` that hold them.

A line is the number of its first pass, the number of passes, and the compressed passes in base64. Everything that the
loop learns from outside is in a pass: the clock, frames, what the bus accepted, requests, trajectories from outside.
"""

import base64
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import CanFrame, unchecked_frame
from vehicle_iface.trajectory import Trajectory

LENGTH_BYTES = 4
"""In front of each pass, little-endian: its length."""
_ARRAYS = ("x_m", "y_m", "heading_rad", "speed_mps", "accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad")

FrameFields = tuple[int, bytes, int, bool, bool, bool, bool, int]
"""The fields of a `CanFrame`."""


class SentFrames(msgspec.Struct, array_like=True, frozen=True):
    """One call of `send`."""

    frames: Sequence[FrameFields]
    accepted: int
    """Number of frames that the bus took; −1 where it was lost."""


class BusFault(msgspec.Struct, array_like=True, frozen=True):
    """A `BusError` that a call raised."""

    call: str
    number: int
    """Number of calls of its kind before it in its pass; of `wait`, of calls of `drain`."""
    is_gone: bool
    """Whether it was a `BusGoneError`."""
    text: str


class Post(msgspec.Struct, array_like=True, frozen=True):
    """A trajectory from outside."""

    call: int
    """Number of the call of `next` in its pass that returned it, from 0."""
    stamp_ns: int
    frame_id: str
    times_ns: bytes
    columns: list[bytes]

    @classmethod
    def of(cls, call: int, trajectory: Trajectory) -> "Post":
        """Pack a trajectory."""
        columns = [getattr(trajectory, name).tobytes() for name in _ARRAYS]
        times_ns = trajectory.time_from_start_ns.tobytes()
        return cls(call, trajectory.stamp_ns, trajectory.frame_id, times_ns, columns)

    def to_trajectory(self) -> Trajectory:
        """Unpack the trajectory."""
        columns = {name: np.frombuffer(column) for name, column in zip(_ARRAYS, self.columns, strict=True)}
        times_ns = np.frombuffer(self.times_ns, np.int64)
        return Trajectory(stamp_ns=self.stamp_ns, frame_id=self.frame_id, time_from_start_ns=times_ns, **columns)


class Requests(msgspec.Struct, array_like=True, frozen=True):
    """What the operator and the schedule asked for."""

    arm: bool = False
    """A request to arm was applied in this pass."""
    ends: int = 0
    """Number of requests to end that were known when this pass applied them."""
    is_due: bool = False
    """The schedule had ended before this pass."""
    scheduled_ns: int = 0
    """The planned end, where it was announced before this pass; otherwise 0."""


NO_REQUESTS = Requests()


class PassInputs(msgspec.Struct, array_like=True, omit_defaults=True):
    """All inputs of one pass, in the order of the calls of each kind."""

    number: int
    """From 0: 0 builds the loop, 1 begins, then one for each `step`."""
    clock_ns: list[int]
    received: list[Sequence[FrameFields]]
    """Of each call of `drain`."""
    sent: list[SentFrames]
    has_room: list[bool]
    requests: Requests = NO_REQUESTS
    faults: list[BusFault] = []
    events: list[tuple[str, list[str]]] = []
    """Events of the CAN controllers, with the names of their buses."""
    overflow: dict[str, int] | None = None
    """The kernel's counts of dropped frames, where they changed."""
    posts: list[Post] = []


def to_frames(fields: Iterable[FrameFields]) -> list[CanFrame]:
    """Return the frames."""
    return [unchecked_frame(one) for one in fields]


def split_passes(buffer: bytearray) -> list[bytes]:
    """Take the complete passes out of what came through the pipe."""
    passes: list[bytes] = []
    at = 0
    while len(buffer) - at >= LENGTH_BYTES:
        end = at + LENGTH_BYTES + int.from_bytes(buffer[at : at + LENGTH_BYTES], "little")
        if len(buffer) < end:
            break
        passes.append(bytes(buffer[at:end]))
        at = end
    del buffer[:at]
    return passes


def format_block(passes: list[bytes]) -> bytes:
    """Format a line of `inputs.log` from passes with their lengths."""
    first = decode_pass(passes[0][LENGTH_BYTES:]).number
    return b"%d %d %b\n" % (first, len(passes), base64.b64encode(zlib.compress(b"".join(passes), 6)))


def read_inputs(path: Path) -> Iterator[PassInputs]:
    """Read all passes, in order; `ConfigError` when the file cannot be read. A damaged or partial line is left out."""
    try:
        with path.open("rb") as file:
            for line in file:
                yield from _read_block(line)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; `run --record` writes it") from None


def _read_block(line: bytes) -> list[PassInputs]:
    try:
        _, _, text = line.split()
        raw = bytearray(zlib.decompress(base64.b64decode(text, validate=True)))
        return [decode_pass(one[LENGTH_BYTES:]) for one in split_passes(raw)]
    except (ValueError, zlib.error, msgspec.MsgspecError):
        return []


_decoder = msgspec.msgpack.Decoder(PassInputs)
_encoder = msgspec.msgpack.Encoder()


def decode_pass(raw: bytes) -> PassInputs:
    """Decode a pass. Raises `MsgspecError` when it is damaged."""
    return _decoder.decode(raw)


def encode_pass(inputs: PassInputs) -> bytes:
    """Encode a pass, with its length in front."""
    raw = _encoder.encode(inputs)
    return len(raw).to_bytes(LENGTH_BYTES, "little") + raw
