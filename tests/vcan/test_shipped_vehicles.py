"""Each shipped vehicle as processes of its own on a real vcan0: driven, and stopped or released for each cause in turn.

The frames are decoded by cantools from the shipped DBC, not by the program's codec.
"""

import select
import signal
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cantools
import pytest
from vehicle_bus_contract.reference import Frame
from vehicle_bus_contract.socketcan import open_socket, receive_frames

from vehicle_iface.sim.driver_socket import send_line

from .conftest import ROOT, Program, Programs
from .observer import CHANNEL, PATIENCE_S

DBC = ROOT / "dbc"
LATCHED_FAULT = 4


@dataclass(frozen=True)
class Shipped:
    """Where a vehicle's DBC shows how a drive goes; signals are MESSAGE.SIGNAL."""

    speed: str
    fast: float
    """Of that signal: it drives."""
    drive: str
    """A command above 0 while the vehicle is to be driven forwards."""
    enabled: tuple[str, int]
    """The value of a sent signal while commands are enabled."""
    sample: str
    """The message that completes a sample."""
    protected: str = ""
    """A message of the vehicle with a checksum."""
    stop_latches: bool = False
    """A vehicle that has lost its place by dead reckoning is held until it is armed again."""


VEHICLES = {
    "agilex_hunter": Shipped(
        speed="MOTION_STATE.LINEAR_VELOCITY",
        fast=0.7,
        drive="MOTION_COMMAND.LINEAR_VELOCITY",
        enabled=("CONTROL_MODE_SETTING.MODE", 1),
        sample="MOTION_STATE",
        stop_latches=True,
    ),
    "fs_ai_ads_dv": Shipped(
        speed="VCU2AI_Speeds.RL_WHEEL_SPEED",
        fast=60.0,
        drive="AI2VCU_Drive_F.FRONT_AXLE_TRQ_REQUEST",
        enabled=("AI2VCU_Status.MISSION_STATUS", 2),
        sample="VCU2AI_Speeds",
        stop_latches=True,
    ),
    "j1939_truck": Shipped(
        speed="EBC2.FRONT_AXLE_SPEED",
        fast=4.0,
        drive="TSC1.REQUESTED_TORQUE",
        enabled=("TSC1.ENGINE_OVERRIDE_MODE", 2),
        sample="VDC2",
        stop_latches=True,
    ),
    "mqb_by_wire": Shipped(
        speed="WHEEL_SPEEDS.WHEEL_SPEED_RL",
        fast=5.0,
        drive="BY_WIRE_COMMAND.ACCEL_REQUEST",
        enabled=("BY_WIRE_COMMAND.ENABLE", 1),
        sample="WHEEL_SPEEDS",
        protected="STEERING_WHEEL",
        stop_latches=True,
    ),
    "new_eagle_raptor": Shipped(
        speed="DBW_WheelSpeedReport.DBW_WhlSpd_RL",
        fast=3.0,
        drive="AKit_AccelPdlRequest.AKit_AccelPdlReq",
        enabled=("AKit_GlobalEnbl.AKit_GlobalByWireEnblReq", 1),
        sample="DBW_WheelSpeedReport",
        stop_latches=True,
    ),
    "pacmod3": Shipped(
        speed="VEHICLE_SPEED_RPT.VEHICLE_SPEED",
        fast=1.0,
        drive="ACCEL_CMD.ACCEL_CMD",
        enabled=("ACCEL_CMD.ENABLE", 1),
        sample="VEHICLE_SPEED_RPT",
        stop_latches=True,
    ),
    "vbox_kart": Shipped(
        speed="VBOX_307.LONGITUDINAL_SPEED",
        fast=3.0,
        drive="KART_COMMAND.DRIVE",
        enabled=("KART_COMMAND.ENABLE", 1),
        sample="VBOX_309",
        protected="KART_STEERING",
    ),
}


class Watched:
    """Every frame on vcan0, from a thread of its own; a message is decoded when a test asks for it."""

    def __init__(self, name: str) -> None:
        database = cantools.database.load_file(str(DBC / f"{name}.dbc"))
        assert isinstance(database, cantools.database.can.Database)
        self._messages = {message.name: message for message in database.messages}
        self.frames: list[Frame] = []
        self._raw = open_socket(CHANNEL)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watched")
        self._thread.start()

    def close(self) -> None:
        """Stop watching; the record stays."""
        self._over.set()
        self._thread.join()
        self._raw.close()

    def values(self, dotted: str, since: int = 0) -> Iterator[tuple[int, float]]:
        """Index after the frame and value, of each frame that has the signal."""
        name, _, signal_name = dotted.partition(".")
        message = self._messages[name]
        for index in range(since, len(self.frames)):
            frame = self.frames[index]
            if (frame.can_id, frame.is_extended) == (message.frame_id, message.is_extended_frame):
                decoded = message.decode(frame.data, decode_choices=False)
                assert isinstance(decoded, dict)
                yield index + 1, float(str(decoded[signal_name]))

    def wait_for(
        self,
        what: str,
        dotted: str,
        fits: Callable[[float], bool],
        since: int,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> int:
        """The index after the first frame with such a value; fails, naming `what`, when it does not come."""
        deadline_s, newest = time.monotonic() + PATIENCE_S, None
        while time.monotonic() < deadline_s:
            meanwhile()
            for since, newest in self.values(dotted, since):  # noqa: B020 (each frame is looked at once)
                if fits(newest):
                    return since
            time.sleep(0.05)  # a test that looks more often takes time from the programs that it watches
        raise AssertionError(f"{what}: did not come in {PATIENCE_S:.0f} s; {dotted} is {newest}")

    def _watch(self) -> None:
        while not self._over.is_set():
            select.select([self._raw], [], [], 0.2)
            self.frames += receive_frames(self._raw)


@dataclass
class Driven:
    """A vehicle with its loop, and what their frames say."""

    vehicle: Shipped
    watched: Watched
    loop: Program
    socket: str
    halts: int = 0
    """After so many latched stops it was armed again."""

    def send_line(self, line: str) -> None:
        """An order to the vehicle's driver."""
        assert send_line(self.socket, line, timeout_s=PATIENCE_S) == "ok"

    def drives(self, since: int) -> int:
        """Commands are enabled, they drive, and the vehicle is fast; armed again where its stops latch."""
        vehicle, wait_for = self.vehicle, self.watched.wait_for
        signal_name, value = vehicle.enabled
        since = wait_for("commands are enabled", signal_name, lambda one: one == value, since, self._arm_again)
        since = wait_for("a command that drives", vehicle.drive, lambda one: one > 0.0, since, self._arm_again)
        return wait_for("the vehicle drives", vehicle.speed, lambda one: one >= vehicle.fast, since, self._arm_again)

    def _arm_again(self) -> None:
        halts = sum("HALTED (" in line for line in self.loop.lines)
        if self.vehicle.stop_latches and halts > self.halts:
            self.halts = halts
            self.loop.send_signal(signal.SIGUSR1)

    def stops(self, since: int) -> int:
        """No command drives any more."""
        return self.watched.wait_for("a command that does not drive", self.vehicle.drive, lambda one: one <= 0, since)

    def is_released(self, since: int) -> int:
        """Commands are no longer enabled."""
        signal_name, value = self.vehicle.enabled
        return self.watched.wait_for("commands are released", signal_name, lambda one: one != value, since)

    def stays_released(self, since: int) -> int:
        """For a dozen frames nothing enables or drives."""
        signal_name, value = self.vehicle.enabled
        end = since
        for _ in range(12):
            end = self.watched.wait_for("the next frame", signal_name, lambda _: True, end)
        assert all(one != value for _, one in self.watched.values(signal_name, since))
        assert all(one <= 0.0 for _, one in self.watched.values(self.vehicle.drive, since))
        return end


def test_every_drivable_shipped_vehicle_is_tested() -> None:
    """The one with two buses is driven in `test_two_buses`."""
    profiles = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in DBC.glob("*.toml")}
    drivable = {name for name, profile in profiles.items() if "command" in profile and "buses" not in profile}
    assert set(VEHICLES) == drivable - {"reference", "reference_fd"}


@pytest.mark.usefixtures("vcan0")
@pytest.mark.parametrize("name", VEHICLES)
def test_a_shipped_vehicle_drives_and_is_stopped_or_released_for_each_cause(
    name: str, request: pytest.FixtureRequest
) -> None:
    vehicle, watched = VEHICLES[name], Watched(name)
    request.addfinalizer(watched.close)
    programs = Programs(request.getfixturevalue("tmp_path"))
    request.addfinalizer(programs.kill_all)
    request.addfinalizer(lambda: print(programs.text))
    socket = str(programs.folder / "driver.sock")
    programs.start("sim", "--profile", name, "--driver-socket", socket)
    watched.wait_for("the vehicle's first sample", vehicle.speed, lambda _: True, 0)
    loop = programs.run("--profile", name, "--arm", "--route", "figure8")
    driven = Driven(vehicle, watched, loop, socket)

    now = driven.drives(0)
    assert loop.is_running

    driven.send_line(f"mute {vehicle.sample} on")
    loop.wait_for_line("reason: STATE_STALE")
    now = driven.stops(now)
    driven.send_line(f"mute {vehicle.sample} off")
    now = driven.drives(now)

    if vehicle.protected:
        driven.send_line(f"corrupt {vehicle.protected} 15")
        now = driven.stops(now)
        now = driven.drives(now)

    driven.send_line("brake 1")
    now = driven.is_released(now)
    loop.wait_for_line(r"OVERRIDDEN \(DRIVER_OVERRIDE\)|OVERRIDDEN \(VEHICLE_NOT_AUTONOMOUS\)")
    driven.send_line("brake 0")
    driven.send_line("ready")
    now = driven.stays_released(now)
    loop.send_signal(signal.SIGUSR1)
    now = driven.drives(now)

    driven.send_line("fault 1")
    now = driven.is_released(now)
    loop.wait_for_line(r"FAULT \(VEHICLE_FAULT\)")
    driven.stays_released(now)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == LATCHED_FAULT
    assert not vehicle.protected or f"bad CRC {vehicle.protected}" in loop.text
