"""Convert between the simulated vehicle's fields and the frames of its profile, from the vehicle's side.

Messages that the program receives are sent here, and messages that it sends are received.
"""

from collections.abc import Iterator, Mapping

from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import VehicleDatabase
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.errors import InvalidValueError, SignalError
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import Profile
from vehicle_iface.sim.command_forms import build_interpreter
from vehicle_iface.sim.demands import Demands
from vehicle_iface.sim.model import BicycleParameters, BicycleState
from vehicle_iface.sim.parameters import SimulationParameters
from vehicle_iface.sim.report import ReceivedMessage, VehicleReport
from vehicle_iface.sim.report_writer import ReportWriter
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.units import ns_from_s


class ProfileWire:
    """Encoder and decoder for the vehicle of one profile."""

    def __init__(self, database: VehicleDatabase) -> None:
        timing, periods_s = database.profile.timing, database.profile.command.periods
        self.command_periods_ns: Mapping[str, int] = {
            message.name: ns_from_s(periods_s.get(message.name, timing.command_period_s))
            for message in database.commands
        }
        self.sample = tuple(message.name for message in database.sample)
        self.periods_ns: Mapping[str, int] = dict(_periods_ns(database))
        names = {name: number for number, name in database.frames.items()}
        self.frame_ids: Mapping[str, int] = names or {database.profile.state.frame_id: 0}
        self.requests_gear = any("gear_request" in message.fields for message in database.commands)
        self.demands = Demands(database)
        read = (*database.commands, *database.sends)
        self._read = {message.name: message for message in read}
        self._names: Mapping[tuple[int, bool, int], str] = {message.key: message.name for message in read}
        self._ids = {message.key for message in (*database.received, *database.sent)}
        self._decoder = Decoder(read)
        self._encoder = Encoder(database.received)
        self._writer = ReportWriter(
            database,
            self.demands.handshakes,
            override_torque_nm=database.profile.limits.driver_steer_torque_nm,
        )
        self._expressible: dict[str, tuple[Value, ...]] = {}

    def find_name(self, frame: CanFrame) -> str | None:
        """Return the message with the frame's identifier; None where the program does not send it."""
        return self._names.get((frame.can_id, frame.is_extended, frame.bus))

    def is_known(self, frame: CanFrame) -> bool:
        """Return whether the frame has an identifier of the profile."""
        return (frame.can_id, frame.is_extended, frame.bus) in self._ids

    def read(self, frame: CanFrame) -> ReceivedMessage | None:
        """Decode the message in the frame; None when it is damaged, out of sequence or invalid."""
        received = self._decoder.decode(frame)
        if received is None:
            return None
        message, values = self._read[received.name], received.values
        return ReceivedMessage(
            received.name,
            {field: value for field, value in zip(message.fields, values, strict=True) if field and value is not None},
            {
                name: view.to_wire(value)
                for name, view, field, value in zip(
                    message.codec.names, message.signals, message.fields, values, strict=True
                )
                if not field and value is not None
            },
        )

    def write(self, message: str, report: VehicleReport) -> CanFrame:
        """Encode the next frame of `message`.

        A report with a number beyond its signal's range repeats the last one within it: the sensor is at its limit.
        Raises `SignalError`, or `InvalidValueError` for a place, when there was none yet.
        """
        try:
            values = self._writer.values_of(message, report)
            frame = self._encoder.encode_values(message, values)
            self._expressible[message] = values
        except (SignalError, InvalidValueError):
            if message not in self._expressible:
                raise
            frame = self._encoder.encode_values(message, self._expressible[message])
        self._encoder.commit((frame,))
        return frame


def simulated_vehicle(
    database: VehicleDatabase,
    *,
    start_ns: int,
    start: BicycleState | None = None,
    mode: VehicleMode = VehicleMode.READY,
    gear: Gear | None = None,
    frame_id: str | None = None,
) -> SimulatedVehicle:
    """Build a vehicle as the database's profile describes it; `frame_id` is that of its pose, map where possible.

    Raises `InvalidValueError` for a frame of reference that its bus has no number for, and `ConfigError` for conditions
    that no values fulfil. A start that the bus cannot express is a `SignalError` of the first `advance`.
    """
    profile, wire = database.profile, ProfileWire(database)
    if frame_id is None:
        frame_id = "map" if "map" in wire.frame_ids else next(iter(wire.frame_ids))
    return SimulatedVehicle(
        wire,
        start_ns=start_ns,
        start=start,
        car=BicycleParameters(
            wheelbase_m=profile.geometry.wheelbase_m,
            rear_wheel_angle_limit_rad=profile.limits.rear_wheel_angle_rad,
        ),
        parameters=_parameters(profile, wire),
        mode=mode,
        gear=gear,
        frame_id=frame_id,
        interpret=build_interpreter(database),
    )


def _parameters(profile: Profile, wire: ProfileWire) -> SimulationParameters:
    limits = profile.limits
    return SimulationParameters(
        shortest_period_ns=min(wire.periods_ns.values()),
        gear_change_speed_mps=limits.gear_change_speed_mps,
        override_torque_nm=limits.driver_steer_torque_nm,
    )


def _periods_ns(database: VehicleDatabase) -> Iterator[tuple[str, int]]:
    """Return the period of each message that the vehicle sends; the message that completes a sample is last."""
    timing, state = database.profile.timing, database.profile.state
    for message in (*database.status, *database.auxiliary):
        yield message.name, ns_from_s(message.cycle_s or timing.status_period_s)
    trigger = state.trigger or database.sample[0].name
    sample = list(database.sample)
    if not database.is_counted:
        sample.sort(key=lambda message: message.name == trigger)
    for message in sample:
        is_free = not database.is_counted and message.name != trigger
        yield message.name, ns_from_s((message.cycle_s if is_free else None) or timing.sample_period_s)
