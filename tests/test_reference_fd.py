"""The reference vehicle on CAN FD: the same vehicle, one frame a sample and one frame a command."""

import math
from collections.abc import Iterable
from functools import cache
from itertools import pairwise
from pathlib import Path

import cantools
import pytest
from cantools.database import Message
from cantools.database.can import Database
from vehicle_bus_contract.judge import Sample, lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS, DecodedFrame, Frame
from vehicle_bus_contract.reference_fd import COUNTERS, LAYOUT, checksum, crc16, intact, pack

from tests.harness import START_NS, Clock, pure_pursuit
from vehicle_iface import compose
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.safety.modes import Mode
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.embedded import EmbeddedBus
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.units import ns_from_s

ROOT = Path(__file__).parents[1]

LATERAL_LIMIT_M = 0.3
SENDERS = {
    "COMMAND": ("CONTROLLER", 10),
    "BODY_COMMAND": ("CONTROLLER", 100),
    "VEHICLE_STATUS": ("VEHICLE", 20),
    "STATE": ("VEHICLE", 10),
    "CONTROLLER_STATUS": ("CONTROLLER", 100),
}
RENAMED = {"COMMAND": ("DRIVE_COMMAND", "STEER_COMMAND"), "STATE": ("POSE", "MOTION", "CHASSIS", "VEHICLE_STATUS")}
"""Where the classical vehicle has the signals of a message."""


@cache
def database() -> VehicleDatabase:
    return load_database(load_profile("reference_fd"))


def dbc(name: str) -> dict[str, Message]:
    loaded = cantools.database.load_file(ROOT / "dbc" / f"{name}.dbc", strict=True)
    assert isinstance(loaded, Database)
    return {message.name: message for message in loaded.messages}


FD, CLASSICAL = dbc("reference_fd"), dbc("reference")


class Line(EmbeddedBus):
    """The embedded bus with a record of what went over it, taken apart by the contract."""

    def __init__(self, vehicle: SimulatedVehicle, clock: Clock) -> None:
        super().__init__(vehicle, clock.now_ns, clock.sleep_until)
        self.clock = clock
        self.received: list[DecodedFrame] = []
        self.sent: list[DecodedFrame] = []
        self.cut: set[str] = set()

    def drain(self) -> list[CanFrame]:
        frames = super().drain()
        decoded = [self._decode(frame) for frame in frames]
        self.received += decoded
        return [frame for frame, content in zip(frames, decoded, strict=True) if content.name not in self.cut]

    def send(self, *frames: CanFrame) -> int:
        self.sent += [self._decode(frame) for frame in frames]
        return super().send(*frames)

    def _decode(self, frame: CanFrame) -> DecodedFrame:
        assert frame.is_fd
        assert not any((frame.is_extended, frame.is_remote, frame.is_error))
        decoded = intact(Frame(self.clock.t_ns, frame.can_id, frame.data, is_fd=True))
        assert decoded is not None
        return decoded


class Drive:
    """Loop and vehicle in virtual time along the figure of eight."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.route = make_route("figure8")
        x_m, y_m, heading_rad = self.route.start
        start = BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        self.vehicle = simulated_vehicle(database(), start_ns=START_NS, start=start)
        self.line = Line(self.vehicle, self.clock)
        self.loop: Loop = compose.build_loop(
            database=database(),
            open_bus=lambda: self.line,
            controller=pure_pursuit(),
            source=RecedingRoute(self.route),
            telemetry=None,
            armed=True,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )

    def run_s(self, seconds: float) -> "Drive":
        end_ns = self.clock.t_ns + ns_from_s(seconds)
        while self.clock.t_ns < end_ns and not self.loop.shutdown.is_done:
            self.loop.step()
        return self

    def sent(self, name: str, since: int = 0) -> list[DecodedFrame]:
        return [decoded for decoded in self.line.sent[since:] if decoded.name == name]

    def received(self, name: str) -> list[DecodedFrame]:
        return [decoded for decoded in self.line.received if decoded.name == name]

    @property
    def mode(self) -> Mode:
        return self.loop._engagement.mode


@pytest.fixture(scope="module")
def minute() -> Drive:
    """A minute of the figure of eight; nothing is done to it afterwards."""
    return Drive().run_s(60.0)


def steps(decoded: Iterable[DecodedFrame]) -> set[int]:
    counters = [one.counter for one in decoded]
    return {(after - before) % COUNTERS for before, after in pairwise(counters)}


# The DBC


def test_the_check_value_of_the_checksum_is_the_catalogues() -> None:
    assert crc16(b"123456789") == 0x29B1


def test_there_are_these_messages_and_no_others_and_all_are_fd_frames() -> None:
    found = {name: (message.senders[0], message.cycle_time) for name, message in FD.items()}
    assert found == SENDERS
    assert {name: (message.frame_id, message.length) for name, message in FD.items()} == {
        name: (can_id, size) for name, (can_id, size, _) in LAYOUT.items()
    }
    assert all(message.is_fd and not message.is_extended_frame for message in FD.values())


@pytest.mark.parametrize("name", LAYOUT)
def test_each_signal_lies_at_the_contracts_place(name: str) -> None:
    found = {
        signal.name: (signal.start, signal.length, signal.is_signed, float(signal.scale))
        for signal in FD[name].signals
        if signal.byte_order == "little_endian" and signal.offset == 0
    }
    assert found == {"CRC": (0, 16, False, 1.0)} | dict(LAYOUT[name][2])


@pytest.mark.parametrize("name", LAYOUT)
def test_a_signal_means_what_it_means_on_the_classical_bus(name: str) -> None:
    for signal in FD[name].signals:
        if signal.name in ("CRC", "COUNTER"):
            continue
        places = (CLASSICAL[other] for other in RENAMED.get(name, (name,)))
        twin = next(found for message in places for found in message.signals if found.name == signal.name)
        assert (signal.unit, signal.choices, signal.comment) == (twin.unit, twin.choices, twin.comment) or (
            signal.name.startswith("POS_") and signal.unit == twin.unit
        )
        assert signal.minimum is not None
        assert signal.maximum is not None
        assert twin.minimum is not None
        assert twin.maximum is not None
        assert signal.minimum <= twin.minimum
        assert signal.maximum >= twin.maximum


def test_every_message_states_its_protection() -> None:
    for message in FD.values():
        assert message.dbc is not None
        assert message.dbc.attributes["E2EDataId"].value == message.frame_id
        assert message.dbc.attributes["E2EProfile"].value == 5


def test_the_vehicle_is_the_same_one() -> None:
    ours, theirs = load_profile("reference_fd"), load_profile("reference")
    assert ours.geometry == theirs.geometry
    assert ours.limits == theirs.limits
    assert ours.timing == theirs.timing
    assert ours.behavior == theirs.behavior


def test_utm_coordinates_fit() -> None:
    northing = FD["STATE"].get_signal_by_name("POS_Y")
    assert northing.maximum is not None
    assert northing.maximum > 10_000_000.0


# The frames


def test_a_sample_is_one_frame_and_a_command_is_one_frame() -> None:
    assert [message.name for message in database().sample] == ["STATE"]
    assert [message.name for message in database().commands] == ["COMMAND"]
    assert all(message.is_fd for message in (*database().received, *database().sent))


def test_a_frame_written_from_the_contract_is_read() -> None:
    decoder = Decoder(database().received)
    assembler = build_state_assembler(database())
    can_id, data = pack(
        "STATE", 7, POSE_FRAME=1, POSE_VALID=1, POS_X=-123.455, POS_Y=5_400_000.005, HEADING=-3.1, SPEED=-1.5,
        YAW_RATE=-0.25, ACCEL=0.75, LATERAL_SPEED=-0.125, FRONT_WHEEL_ANGLE=0.3, REAR_WHEEL_ANGLE=-0.05,
    )  # fmt: skip
    received = decoder.decode(CanFrame(can_id, data, START_NS, is_fd=True))
    assert received is not None
    assert received.counter == 7
    sample = assembler.take(received)
    assert sample is not None
    state = sample.state
    assert (state.frame_id, sample.pose_valid) == ("map", True)
    found = (state.x_m, state.y_m, state.heading_rad, state.speed_mps, state.yaw_rate_radps, state.accel_mps2)
    assert found == pytest.approx((-123.455, 5_400_000.005, -3.1, -1.5, -0.25, 0.75))
    rest = (state.lateral_speed_mps, state.front_wheel_angle_rad, state.rear_wheel_angle_rad)
    assert rest == pytest.approx((-0.125, 0.3, -0.05))


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda frame: frame._replace(is_fd=False, data=frame.data[:8]), DropCause.WRONG_TYPE),
        (lambda frame: frame._replace(data=frame.data[:24]), DropCause.WRONG_LENGTH),
        (lambda frame: frame._replace(data=frame.data + bytes(16)), DropCause.WRONG_LENGTH),
        (lambda frame: frame._replace(data=frame.data[:31] + b"\x01"), DropCause.BAD_CRC),
        (lambda frame: frame._replace(data=frame.data[:2] + b"\x09" + frame.data[3:]), DropCause.BAD_CRC),
        (lambda frame: frame._replace(is_extended=True), DropCause.WRONG_TYPE),
        (lambda frame: frame._replace(is_remote=True), DropCause.WRONG_TYPE),
    ],
)  # fmt: skip
def test_a_frame_that_is_not_whole_is_dropped(change, cause) -> None:  # type: ignore[no-untyped-def]
    decoder = Decoder(database().received)
    can_id, data = pack("STATE", 8, POS_X=1.0)
    assert decoder.decode(change(CanFrame(can_id, data, START_NS, is_fd=True))) is None
    assert decoder.drops == {(cause, "STATE"): 1}


def test_another_messages_data_id_is_a_wrong_checksum() -> None:
    decoder = Decoder(database().received)
    _, data = pack("STATE", 8, POS_X=1.0)
    wrong = checksum(0x111, data).to_bytes(2, "little") + data[2:]
    assert decoder.decode(CanFrame(0x110, wrong, START_NS, is_fd=True)) is None
    assert decoder.drops == {(DropCause.BAD_CRC, "STATE"): 1}


# The closed loop


def test_the_figure_of_eight_is_driven_within_30_cm(minute: Drive) -> None:
    samples = [
        Sample(decoded.stamp_ns, decoded["POS_X"], decoded["POS_Y"], decoded["HEADING"], decoded["SPEED"])
        for decoded in minute.received("STATE")
    ]
    errors_m = lateral_errors_m(samples, minute.route.x_m.tolist(), minute.route.y_m.tolist())
    assert max(errors_m) < LATERAL_LIMIT_M
    assert sum(sample.speed_mps for sample in samples) * 0.01 > minute.route.length_m
    assert minute.mode is Mode.ENGAGED


def test_each_sample_is_answered_by_one_command(minute: Drive) -> None:
    commands = minute.sent("COMMAND")
    begun_ns = commands[0].stamp_ns
    assert [decoded.stamp_ns for decoded in commands] == [
        decoded.stamp_ns for decoded in minute.received("STATE") if decoded.stamp_ns >= begun_ns
    ]
    assert {(decoded["ENABLE"], decoded.reason) for decoded in commands} == {(0, "NOT_ENGAGED"), (1, "NOMINAL")}
    assert sum(decoded["ENABLE"] for decoded in commands) > 0.98 * len(commands)


def test_every_counter_steps_by_one_all_256_round(minute: Drive) -> None:
    for name in LAYOUT:
        decoded = minute.sent(name) if SENDERS[name][0] == "CONTROLLER" else minute.received(name)
        assert steps(decoded) == {1}
    assert {decoded.counter for decoded in minute.sent("COMMAND")} == set(range(COUNTERS))


def test_lost_samples_stop_the_vehicle_and_what_comes_later_is_driven_by_again() -> None:
    drive = Drive().run_s(4.0)
    assert drive.vehicle.state.speed_mps > 1.0
    drive.line.cut.add("STATE")
    since = len(drive.line.sent)
    drive.run_s(0.2)
    stop = drive.sent("COMMAND", since)[-1]
    assert (stop["ENABLE"], stop["SAFE_STOP"], stop.reason) == (1, 1, "STATE_STALE")
    drive.line.cut.clear()
    drive.run_s(0.5)
    assert drive.sent("COMMAND")[-1].reason == "NOMINAL"
    assert drive.vehicle.mode.value == AUTONOMOUS


@pytest.mark.parametrize("orders", ["brake 1", "throttle 1", "steer 4.0"])
def test_a_driver_who_acts_takes_over(orders: str) -> None:
    drive = Drive().run_s(3.0)
    assert drive.vehicle.mode.value == AUTONOMOUS
    since = len(drive.line.sent)
    assert execute(drive.vehicle, orders) == "ok"
    drive.run_s(0.5)
    assert drive.sent("COMMAND", since)[-1]["ENABLE"] == 0
    assert math.isclose(drive.received("VEHICLE_STATUS")[-1]["DRIVER_STEER_TORQUE"], 4.0 * orders.startswith("steer"))
