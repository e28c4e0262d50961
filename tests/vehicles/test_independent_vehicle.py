"""A vehicle that shares no code with the program is driven by its profile, and judged by its own truth."""

from pathlib import Path

import numpy as np
import pytest

from tests.harness import START_NS, Clock, pure_pursuit
from tests.inbox_bus import InboxBus
from tests.vehicles.independent.peer import Sedan
from vehicle_iface import compose
from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.safety.modes import Mode
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.route import RouteConfig
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.units import NS_PER_MS

FOLDER = Path(__file__).parent / "independent"
REFERENCE = (Path(__file__).parents[2] / "dbc/reference.toml").read_text(encoding="utf-8")
FIGURE = make_route("figure8", RouteConfig(half_width_m=12.0))


class Line(InboxBus):
    """The bus: the vehicle moves while the loop waits."""

    description = "an independent vehicle"

    def __init__(self, sedan: Sedan, clock: Clock) -> None:
        super().__init__()
        self._sedan, self._clock = sedan, clock

    def open(self) -> "Line":
        return self

    def wait(self, until_ns: int) -> bool:
        while not self.inbox and self._clock.t_ns < until_ns:
            next_ns = START_NS + (self._sedan.now_ms + 1) * NS_PER_MS
            self._clock.sleep_until(min(until_ns, next_ns))
            if self._clock.t_ns >= next_ns:
                self.inbox += (frame._replace(stamp_ns=next_ns) for frame in self._sedan.advance_ms())
        return bool(self.inbox)

    def send(self, *frames: CanFrame) -> int:
        for frame in frames:
            self._sedan.receive(frame)
        return len(frames)


class Drive:
    def __init__(self, folder: Path, *, armed: bool = True) -> None:
        head = REFERENCE[REFERENCE.index("[geometry]") : REFERENCE.index("[e2e]")]
        text = (FOLDER / "sedan.toml").read_text(encoding="utf-8")
        (folder / "sedan.toml").write_text(f'name = "sedan"\ndbc = "sedan.dbc"\n{head}{text}', encoding="utf-8")
        (folder / "sedan.dbc").write_bytes((FOLDER / "sedan.dbc").read_bytes())
        self.sedan, self.clock = Sedan(FOLDER / "sedan.dbc"), Clock()
        self.route = RecedingRoute(FIGURE)
        line = Line(self.sedan, self.clock)
        self.loop = compose.build_loop(
            database=load_database(load_profile(folder / "sedan.toml")),
            open_bus=line.open,
            controller=pure_pursuit(),
            source=self.route,
            telemetry=None,
            armed=armed,
            now_ns=self.clock.now_ns,
            sleep_until=self.clock.sleep_until,
        )

    @property
    def mode(self) -> Mode:
        return self.loop._engagement.mode

    def run_ms(self, duration_ms: int) -> None:
        end_ns = self.clock.t_ns + duration_ms * NS_PER_MS
        while self.clock.t_ns < end_ns:
            self.loop.step()

    def engage(self) -> "Drive":
        while self.sedan.speed_mps < 2.0:
            self.run_ms(100)
            assert self.sedan.now_ms < 5000, (self.mode, self.loop.reason, self.sedan.faults)
        return self

    def sent_ms(self, name: str) -> list[int]:
        return [command.at_ms for command in self.sedan.commands if command.name == name]


def test_it_follows_a_figure_of_eight_and_each_command_comes_at_its_period(tmp_path: Path) -> None:
    drive, aside_m, way_m = Drive(tmp_path), 0.0, 0.0
    sedan = drive.sedan
    while way_m < FIGURE.length_m - 2.0:
        drive.run_ms(100)
        way_m = max(way_m, drive.route.progress_m)
        aside_m = max(aside_m, float(np.min(np.hypot(FIGURE.x_m - sedan.x_m, FIGURE.y_m - sedan.y_m))))
        assert sedan.now_ms < 40_000, (drive.mode, drive.loop.reason)
    assert aside_m < 0.3
    assert sedan.faults == []
    assert drive.loop._decoder.drops == {}
    assert set(np.diff(drive.sent_ms("STEER_CMD"))) == {10}
    assert set(np.diff(drive.sent_ms("DRIVE_CMD"))) == {20}
    steering = [command.values for command in sedan.commands if command.name == "STEER_CMD"]
    assert {values["ROTATION_RATE"] for values in steering} == {250.0}
    assert 1 <= sum(values["CLEAR_FAULTS"] for values in steering) < 10


def test_nothing_is_sent_to_it_unarmed(tmp_path: Path) -> None:
    drive = Drive(tmp_path, armed=False)
    drive.run_ms(1500)
    assert drive.mode is Mode.SHADOW
    assert drive.sedan.commands == []


@pytest.mark.parametrize(
    ("report", "value", "reason"),
    [
        ("PEDAL", 6.0, "DRIVER_OVERRIDE"),
        ("PEDAL", 4.0, "NOMINAL"),
        ("TORQUE", -3.5, "DRIVER_OVERRIDE"),
        ("PEDAL_PRESSED", 1, "DRIVER_OVERRIDE"),
        ("FAULT", 1, "VEHICLE_FAULT"),
        ("MODE", 3, "STATE_INVALID"),
        ("SPOOFED", 1, "STATE_INVALID"),
    ],
)
def test_a_report_stops_the_drive_with_its_reason(tmp_path: Path, report: str, value: float, reason: str) -> None:
    drive = Drive(tmp_path).engage()
    drive.sedan.reports[report] = value
    drive.run_ms(100)
    assert drive.loop.reason.name == reason


@pytest.mark.parametrize("part", ["INS_POS", "INS_ATT", "WHEELS", "STEER", "ESP"])
def test_it_is_stopped_when_a_part_of_the_sample_is_too_old(tmp_path: Path, part: str) -> None:
    drive = Drive(tmp_path).engage()
    drive.sedan.muted.add(part)
    drive.run_ms(250)
    assert drive.loop.reason.name == "STATE_STALE"
    last = next(command for command in reversed(drive.sedan.commands) if command.name == "DRIVE_CMD")
    assert (last.values["DRIVE"], last.values["BRAKE"] > 1.0) == (0.0, True)
