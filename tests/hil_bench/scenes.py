"""Builders of observations, commands and drives for the tests of the bench."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from hil_bench import routes
from hil_bench.case import Case
from hil_bench.cases import catalogue_for
from hil_bench.expect import Observation
from hil_bench.plant import Plant
from hil_bench.vehicle import Instant, Vehicle
from hil_bench.wire import Wire
from vehicle_bus_contract.judge import Pair
from vehicle_bus_contract.reference import AUTONOMOUS, MS, Frame, S

WIRE = Wire("reference")
ROOT = Path(__file__).resolve().parents[2]


def is_played(profile: str) -> bool:
    """Whether the bench can play a vehicle: it is commanded."""
    return "\n[command" in profile


SHIPPED = (
    *sorted(path.stem for path in (ROOT / "dbc").glob("*.toml") if is_played(path.read_text())),
    str(ROOT / "docs" / "examples" / "06_own_vehicle" / "rover.toml"),
)
"""Every vehicle that the bench plays."""


def other_wire(folder: Path, *, profile: tuple[str, str] = ("", ""), dbc: tuple[str, str] = ("", "")) -> Wire:
    """Return the reference vehicle with one text of its profile or DBC replaced."""
    for text, (old, new) in ((WIRE.path.read_text(), profile), (WIRE.dbc.read_text(), dbc)):
        assert old in text
        name = "reference.dbc" if text.startswith("VERSION") else "mine.toml"
        (folder / name).write_text(text.replace(old, new) if old else text)
    return Wire(str(folder / "mine.toml"))


class CommandedVehicle:
    """The bench's vehicle and a commander, in virtual time."""

    def __init__(self) -> None:
        self.vehicle = Vehicle(WIRE, Plant(wheelbase_m=2.7))
        self.now_ns, self.counter = S, 0

    def pair(
        self, *, enable: float = 1, accel: float = 1.0, wheel: float = 0.0, stop: float = 0, gear: float = 3
    ) -> None:
        self.counter = (self.counter + 1) % 15
        drive = {"ENABLE": enable, "SAFE_STOP": stop, "ACCEL_REQUEST": accel, "GEAR_REQUEST": gear}
        self.send(WIRE.pack("DRIVE_COMMAND", self.counter, **drive))
        self.send(WIRE.pack("STEER_COMMAND", self.counter, ENABLE=enable, FRONT_WHEEL_ANGLE_REQUEST=wheel))

    def send(self, frame: Frame) -> None:
        self.vehicle.receive(frame, self.now_ns)

    def tick(self, count: int = 1, **command: float) -> None:
        for _ in range(count):
            if command:
                self.pair(**command)
            self.vehicle.move(0.01, self.now_ns)
            self.now_ns += 10 * MS


def pair(at_s: float, *, enable: int = 1, stop: int = 0, reason: str = "NOMINAL", accel: float = 0.0) -> Pair:
    number = WIRE.number("REASON", reason)
    values = {"ENABLE": enable, "SAFE_STOP": stop, "REASON": number, "ACCEL_REQUEST": accel}
    drive = WIRE.intact(replace(WIRE.pack("DRIVE_COMMAND", 1, **values), stamp_ns=round(at_s * S)))
    steer = WIRE.intact(replace(WIRE.pack("STEER_COMMAND", 1, ENABLE=enable), stamp_ns=round(at_s * S)))
    assert drive is not None
    assert steer is not None
    return Pair(drive, steer)


def observed(
    *pairs: Pair, samples: Sequence[float] = (), history: Sequence[Instant] = (), status: int | None = 0
) -> Observation:
    """Build the observation of a case of 10 s: an injection from 5 s to 6 s, and the operator's action at 8 s."""
    return Observation(
        begin_ns=0,
        inject_ns=5 * S,
        end_ns=6 * S,
        then_ns=8 * S,
        samples_ns=[round(at_s * S) for at_s in samples],
        pairs=pairs,
        decoded=[pair.drive for pair in pairs],
        frames=[Frame(pair.stamp_ns, 0x080, b"") for pair in pairs],
        history=history,
        exit_status=status,
        exit_ns=9 * S,
        route=routes.straight(7.0),
        wire=WIRE,
    )


def steady(begin_s: float, end_s: float, make: Callable[[float], Pair] = pair) -> list[Pair]:
    return [make(begin_s + 0.01 * i) for i in range(round((end_s - begin_s) / 0.01))]


def stop(at_s: float) -> Pair:
    return pair(at_s, stop=1, reason="STATE_STALE", accel=-3.0)


def released(at_s: float) -> Pair:
    return pair(at_s, enable=0, reason="DRIVER_OVERRIDE")


def at(at_s: float, speed_mps: float, mode: int = AUTONOMOUS, x_m: float = 7.0) -> Instant:
    return Instant(round(at_s * S), x_m, 0.0, 0.0, speed_mps, 0.0, 0.0, mode)


DRIVES, STOPS, SILENT = [*steady(0, 10)], [*steady(0, 5.06), *steady(5.06, 6, stop), *steady(6, 10)], [*steady(0, 5.05)]


def find_case(name: str) -> Case:
    return next(case for case in catalogue_for(WIRE) if case.name == name)
