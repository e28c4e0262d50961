"""The values on the bus at one moment, decoded by the profile under review."""

from collections.abc import Mapping
from dataclasses import dataclass

from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.database import VehicleDatabase, find_masked
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.frame import CanFrame, FrameKey
from vehicle_iface.review.log_frames import LoggedFrame
from vehicle_iface.review.series import POSITION, DriveReader
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.status import VehicleStatus
from vehicle_iface.units import s_from_ns

MAX_AGE_S = 1.0
"""Age beyond which a value counts as missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """The newest values, none of them older than `MAX_AGE_S`."""

    time_s: float
    numbers: Mapping[str, float]
    """Fields of the state, and the driver's torque, in their units."""
    place_m: tuple[float, float] | None = None
    status: VehicleStatus | None = None


class Readings:
    """Decodes frames as `review` does, whatever checksums and ranges say; the status as the loop does."""

    def __init__(self, binding: Binding, database: VehicleDatabase) -> None:
        self._motion = DriveReader(binding, database)
        self._decoder = Decoder(database.received)
        self._assembler = build_state_assembler(database)
        messages = (*database.received, *database.sent)
        self._names = {one.key: one.name for one in messages}
        self._masked = [one for one in messages if one.is_masked]
        self.labels = self._motion.labels
        """Signals of each bound field of the state."""

    def take(self, frame: CanFrame) -> None:
        """Decode a frame of any node."""
        name = self._find_name(frame)
        if name is None or frame.is_remote or frame.is_error:
            return
        self._motion.take(LoggedFrame(name, frame.stamp_ns, frame.data))
        received = self._decoder.decode(frame)
        if received is not None:
            self._assembler.take(received)

    def read(self, now_ns: int) -> Moment:
        """Return the newest values."""
        time_s = s_from_ns(now_ns - (self._motion.first_ns or now_ns))
        fresh = {
            name: reading.value
            for name, reading in self._motion.read_newest().items()
            if time_s - reading.time_s <= MAX_AGE_S
        }
        place, status = fresh.pop(POSITION, None), self._assembler.status
        if status is not None and s_from_ns(now_ns - status.stamp_ns) > MAX_AGE_S:
            status = None
        numbers = {name: float(value) for name, value in fresh.items() if isinstance(value, float | int)}
        if status is not None:
            numbers["driver_steer_torque_nm"] = status.driver_steer_torque_nm
        return Moment(
            time_s=time_s,
            numbers=numbers,
            place_m=(float(place[0]), float(place[1])) if isinstance(place, tuple) else None,
            status=status,
        )

    def _find_name(self, frame: CanFrame) -> str | None:
        name = self._names.get(FrameKey(frame.can_id, frame.is_extended, frame.bus))
        if name is not None or not frame.is_extended:
            return name
        message = find_masked(self._masked, frame.can_id, frame.bus)
        return None if message is None else message.name
