"""A log, decoded by a profile into one series for each field, each value at the time of its own message.

Values out of range and frames with wrong checksums are kept: a profile that is wrong about them is under review.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from vehicle_iface.codec.binding import SENT_ROLES, Binding
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase, build_database, load_binding
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.expressions import Place, condition_expression, field_expression, place_of
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import unchecked_frame
from vehicle_iface.logs.frames import Bytes
from vehicle_iface.pose import PoseInputs
from vehicle_iface.pose.build import build_pose_source
from vehicle_iface.profile import Profile
from vehicle_iface.profile.forms import FieldForm, signals_of, value_of
from vehicle_iface.profile.state_pose import POSE_SIGNALS, Mount
from vehicle_iface.review.log_frames import ANY_CHANNEL, LogChannels, LoggedFrame, Progress, read_frames
from vehicle_iface.row import Row
from vehicle_iface.trajectory import FloatArray
from vehicle_iface.units import NS_PER_S

NOT_MEASURED = ("pose_frame", "pose_valid")
POSITION = "position"
"""Name in findings of the fields x_m and y_m, or latitude and longitude, together."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """The values of one field, in its unit."""

    field: str
    signals: tuple[str, ...]
    """MESSAGE.SIGNAL of each signal that carries it."""
    times_s: FloatArray
    """(n,) Since the first frame of the profile."""
    values: FloatArray
    """(n,); (n, 2) of a position."""

    @property
    def message(self) -> str:
        """Message whose arrival gives the times of the values."""
        return self.signals[0].partition(".")[0]

    @property
    def label(self) -> str:
        """Names of its signals, for a person."""
        return join_signals(self.signals)


def join_signals(signals: Sequence[str]) -> str:
    """Join names of signals, MESSAGE.SIGNAL each, for a person."""
    messages = [dotted.partition(".")[0] for dotted in signals]
    if len(signals) > 1 and len(set(messages)) == 1:
        return f"{messages[0]}.{'/'.join(dotted.partition('.')[2] for dotted in signals)}"
    return " and ".join(signals)


class Reading(NamedTuple):
    """The newest value of a field."""

    time_s: float
    """Since the first frame."""
    value: object
    """A number; of the position x and y in m."""


@dataclass(slots=True)
class MessageFrames:
    """All frames of one message."""

    times_s: list[float] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)
    wrong_lengths: int = 0
    out_of_range: int = 0
    example: str = ""
    """First value out of range."""

    def data(self) -> Bytes:
        """(n, length) payloads of the frames of the right length."""
        return np.frombuffer(b"".join(self.payloads), np.uint8).reshape(len(self.payloads), -1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedDrive:
    """The content of a log for a profile's vehicle."""

    binding: Binding
    database: VehicleDatabase
    state: Mapping[str, Series]
    """Series by field; the position under `POSITION`."""
    commands: Mapping[str, Series]
    frames: Mapping[str, MessageFrames]
    """Frames of every bound message, also one that was never received."""
    duration_s: float


def read_drive(
    path: Path, profile: Profile, *, channels: LogChannels = ANY_CHANNEL, progress: Progress | None = None
) -> RecordedDrive:
    """Read the drive in a log. `ConfigError` when profile, DBC or log is unusable, or none of its messages is found."""
    binding = load_binding(profile)
    database = build_database(binding)
    reader = DriveReader(binding, database)
    for frame in read_frames(path, (*database.received, *database.sent), channels=channels, progress=progress):
        reader.take(frame)
    return reader.result()


class DriveReader:
    """Decodes frames in the order of the log."""

    def __init__(self, binding: Binding, database: VehicleDatabase) -> None:
        self._binding, self._database = binding, database
        messages = (*database.received, *database.sent)
        self._bound = {message.name: message for message in messages}
        raw = [replace(m, from_wire=(None,) * len(m.codec.names), protection=None) for m in messages]
        self._decoder = Decoder(raw)
        self._lenient = Decoder(replace(message, codec=_build_lenient_codec(binding, message)) for message in raw)
        self._columns = {f"{m.name}.{name}": 0 for m in messages for name in m.codec.names}
        self._columns = {dotted: column for column, dotted in enumerate(self._columns)}
        self._first_columns = {
            m.name: self._columns[f"{m.name}.{m.codec.names[0]}"] if m.codec.names else 0 for m in messages
        }
        self._row: Row = [None] * len(self._columns)
        self._outputs: dict[str, list[_Output]] = {name: [] for name in self._bound}
        self.frames = {name: MessageFrames() for name in self._bound}
        self._first_ns: int | None = None
        self._last_s = 0.0
        self._state = self._build_state_outputs()
        self._commands = self._build_command_outputs()

    def take(self, frame: LoggedFrame) -> None:
        """Decode one frame, and record the fields that it carries."""
        message = self._bound[frame.name]
        if self._first_ns is None:
            self._first_ns = frame.stamp_ns
        time_s = (frame.stamp_ns - self._first_ns) / NS_PER_S
        self._last_s = max(self._last_s, time_s)
        frames = self.frames[frame.name]
        can_id, is_extended, bus = message.key
        can = unchecked_frame((can_id, frame.data, frame.stamp_ns, is_extended, False, message.is_fd, False, bus))
        received = self._decoder.decode(can)
        if received is None:
            received = self._lenient.decode(can)
            if received is None:
                frames.wrong_lengths += 1
                return
            frames.out_of_range += 1
            frames.example = frames.example or _explain_refusal(message, frame.data)
        frames.times_s.append(time_s)
        frames.payloads.append(frame.data)
        first, values, row = self._first_columns[frame.name], received.values, self._row
        is_whole = None not in values
        for column, value in enumerate(values, first):
            if value is not None:
                row[column] = value
        for output in self._outputs[frame.name]:
            if is_whole or values[output.column - first] is not None:
                output.take(time_s, frame.stamp_ns, row)

    @property
    def labels(self) -> Mapping[str, str]:
        """The signals of each bound field of the state, for a person."""
        return {output.name: join_signals(output.signals) for output in self._state}

    @property
    def first_ns(self) -> int | None:
        """The stamp of the first frame."""
        return self._first_ns

    def read_newest(self) -> dict[str, Reading]:
        """Return the newest value of each received field of the state."""
        return {one.name: Reading(one.times_s[-1], one.values[-1]) for one in self._state if one.times_s}

    def result(self) -> RecordedDrive:
        return RecordedDrive(
            binding=self._binding,
            database=self._database,
            state={output.name: output.series() for output in self._state if output.times_s},
            commands={output.name: output.series() for output in self._commands if output.times_s},
            frames=self.frames,
            duration_s=self._last_s,
        )

    def _find(self, dotted: str) -> Place:
        return place_of(self._columns[dotted], self._binding.view(dotted))

    def _build_state_outputs(self) -> "list[_Output]":
        state = self._binding.profile.state
        forms = {name: getattr(state.signals, name) for name in state.signals.__struct_fields__}
        bound = {name: form for name, form in forms.items() if form is not None and name not in NOT_MEASURED}
        outputs = [
            self._build_output(name, form) for name, form in bound.items() if name not in (*POSE_SIGNALS, *NOT_MEASURED)
        ]
        if "heading_rad" in bound:
            turn_rad = state.pose.mount.heading_rad
            source = field_expression(bound["heading_rad"], self._find)
            outputs.append(self._add_output("heading_rad", bound["heading_rad"], _compile(f"{source} - {turn_rad!r}")))
        place = bound.get("x_m", bound.get("latitude_deg"))
        if place is not None:
            other = bound["y_m"] if "x_m" in bound else bound["longitude_deg"]
            outputs.append(self._add_output(POSITION, place, self._build_locate(bound), more=tuple(_signals(other))))
        return outputs

    def _build_locate(self, bound: Mapping[str, FieldForm | str]) -> "_Read":
        """Build the position of the sensor; `Kinematics` corrects for its mount once the heading is verified."""
        profile = self._binding.profile
        pose, signals = profile.state.pose, profile.state.signals
        places = [name for name in POSE_SIGNALS if name in bound and name != "heading_rad"]
        terms = ", ".join(f"{name}={field_expression(bound[name], self._find)}" for name in places)
        at_sensor = msgspec.structs.replace(profile.state, pose=msgspec.structs.replace(pose, mount=Mount()))
        source = build_pose_source(msgspec.structs.replace(profile, state=at_sensor))
        read = _compile(f"PoseInputs({terms}, heading_rad=0.0)")
        conditions = [f"s[{self._columns[signals.pose_valid]}] not in (0, None)"] if signals.pose_valid else []
        conditions += [condition_expression(pose.valid, self._find)] if pose.valid is not None else []
        is_valid = _compile(" and ".join(conditions) or "True")

        def locate(row: Row, stamp_ns: int) -> object:
            values = read(row, stamp_ns) if is_valid(row, stamp_ns) else None
            found = source.resolve(stamp_ns, values) if isinstance(values, PoseInputs) else None
            return (found.x_m, found.y_m) if found is not None else None

        return locate

    def _build_command_outputs(self) -> "list[_Output]":
        signals = self._binding.sections["command"]
        measured = (name for name in signals if name == "enable" or name.rpartition("_")[2] in ("mps", "mps2", "rad"))
        return [self._build_output(name, signals[name][0]) for name in measured]

    def _build_output(self, name: str, form: FieldForm | str) -> "_Output":
        return self._add_output(name, form, _compile(field_expression(form, self._find)))

    def _add_output(self, name: str, form: FieldForm | str, read: "_Read", more: tuple[str, ...] = ()) -> "_Output":
        signals = (*_signals(form), *more)
        output = _Output(name, signals, self._columns[signals[0]], read)
        self._outputs[signals[0].partition(".")[0]].append(output)
        return output


_Read = Callable[[Row, int], object]
"""Row and stamp → the value; None where there is none."""


@dataclass(slots=True)
class _Output:
    """Gathers one field."""

    name: str
    signals: tuple[str, ...]
    column: int
    """Column of the signal whose arrival updates the field."""
    read: _Read
    times_s: list[float] = field(default_factory=list)
    values: list[object] = field(default_factory=list)

    def take(self, time_s: float, stamp_ns: int, row: Row) -> None:
        try:
            value = self.read(row, stamp_ns)
        except TypeError:  # a part of it has no value
            return
        if value is not None:
            self.times_s.append(time_s)
            self.values.append(value)

    def series(self) -> Series:
        """Return the series in the order of time, one value for each time."""
        times_s, values = np.array(self.times_s), np.array(self.values, np.float64)
        times_s, order = np.unique(times_s, return_index=True)
        values = values[order]
        if self.name == "heading_rad":
            values = np.unwrap(values)
        return Series(field=self.name, signals=self.signals, times_s=times_s, values=values)


def _build_lenient_codec(binding: Binding, message: BoundMessage) -> MessageCodec:
    """Build a codec that decodes the message regardless of ranges and names."""
    used = binding.signals_used(message.name)
    return MessageCodec(
        binding.messages[message.name],
        checked=False,
        only=used,
        rules={signal: binding.view(f"{message.name}.{signal}").rules for signal in used},
        base=bytes(message.length) if message.role in SENT_ROLES else None,
    )


def _explain_refusal(message: BoundMessage, data: bytes) -> str:
    try:
        message.codec.decode(data)
    except SignalError as error:
        return str(error)
    return ""


def _signals(form: FieldForm | str) -> Iterator[str]:
    return signals_of(value_of(form))


def _compile(source: str) -> _Read:
    read: _Read = eval(compile(f"lambda s, _: {source}", "<field>", "eval"), {"PoseInputs": PoseInputs})
    return read
