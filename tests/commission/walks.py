"""Walks with the simulated vehicle in simulated time: a person who does what is asked, a profile that may be wrong."""

from collections.abc import Callable, Mapping
from pathlib import Path

from tests.harness import START_NS, Clock, reference
from tests.review.drives import Rewriter
from vehicle_iface.cli.commission import walk_and_review
from vehicle_iface.codec.database import load_binding
from vehicle_iface.commission.readings import Moment
from vehicle_iface.commission.report import Commissioning
from vehicle_iface.commission.steps import Step
from vehicle_iface.commission.walk import StepResult
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.driver_commands import execute
from vehicle_iface.sim.embedded import EmbeddedBus
from vehicle_iface.sim.vehicle import SimulatedVehicle
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.status import VehicleMode

DBC = Path(__file__).resolve().parents[2] / "dbc"
BEGINS: Mapping[str, tuple[str, ...]] = {
    "rest": ("steer 0", "brake 0", "throttle 0"),
    "wheel_left": ("steer 6",),
    "wheel_right": ("steer -6",),
    "brake": ("steer 0", "brake 1"),
    "throttle": ("brake 0", "gear NEUTRAL", "throttle 1"),
    "mode_manual": ("throttle 0",),
    "gear_reverse": ("throttle 0", "gear REVERSE"),
    "gear_drive": ("throttle 0", "gear DRIVE"),
    "roll": ("brake 0", "throttle 1"),
    "bend": ("brake 0", "throttle 1", "steer 12"),
    "braking": ("steer 0", "throttle 1"),
    "mode_ready": ("brake 0", "throttle 0", "ready"),
}


class Person:
    """Does at once what is asked, but for the steps in `lazy`."""

    def __init__(self, vehicle: SimulatedVehicle, lazy: frozenset[str] = frozenset()) -> None:
        self._vehicle, self._lazy = vehicle, lazy
        self._from_m = 0.0
        self.shown: list[str] = []
        self.skips: Callable[[], bool] = lambda: False
        self.ends: Callable[[], bool] = lambda: False

    def begin(self, step: Step, number: int, count: int) -> None:
        assert 1 <= number <= count
        self._from_m = self._vehicle.state.x_m
        for line in BEGINS[step.key] if step.key not in self._lazy else ():
            assert execute(self._vehicle, line) == "ok", line

    def show(self, step: Step, moment: Moment) -> None:
        self.shown += [check.show(moment) for check in step.checks]
        if step.key in self._lazy:
            return
        state = self._vehicle.state
        if step.key == "roll" and state.x_m - self._from_m > 1.5:
            self._press("throttle 0", "brake 1")
        if step.key == "bend" and state.speed_mps > 4.0:
            self._press("throttle 0")
        if step.key == "braking" and state.speed_mps > 5.0:
            self._press("throttle 0", "brake 1")

    def _press(self, *lines: str) -> None:
        for line in lines:
            execute(self._vehicle, line)

    def end(self, result: StepResult) -> None:
        """Nothing to do."""

    def wants_to_skip(self) -> bool:
        return self.skips()

    def wants_to_end(self) -> bool:
        return self.ends()


class DeafBus(EmbeddedBus):
    """Fails the test when anybody sends; `rewriter` makes the vehicle's sensors worse."""

    rewriter: Rewriter | None = None

    def drain(self) -> list[CanFrame]:
        frames = super().drain()
        return frames if self.rewriter is None else self.rewriter.rewrite(frames)

    def send(self, *frames: CanFrame) -> int:
        raise AssertionError(f"sent {frames}")


def write_profile(folder: Path, more: str = "", edits: Mapping[str, str] | None = None) -> Path:
    """The reference vehicle's profile with texts replaced and `more` at its end."""
    text = (DBC / "reference.toml").read_text(encoding="utf-8")
    for old, new in (edits or {}).items():
        assert old in text, old
        text = text.replace(old, new)
    (folder / "reference.dbc").write_bytes((DBC / "reference.dbc").read_bytes())
    (folder / "profile.toml").write_text(f"{text}\n{more}\n", encoding="utf-8")
    return folder / "profile.toml"


def walk(
    folder: Path, profile: Path, *, lazy: frozenset[str] = frozenset(), step_timeout_s: float = 12.0
) -> Commissioning:
    """A walk with the reference vehicle as it is, read by the profile."""
    vehicle = simulated_vehicle(reference(), start_ns=START_NS, mode=VehicleMode.MANUAL)
    return walk_with(vehicle, Person(vehicle, lazy), folder, profile, step_timeout_s=step_timeout_s)


def walk_with(
    vehicle: SimulatedVehicle,
    person: Person,
    folder: Path,
    profile: Path,
    *,
    step_timeout_s: float = 12.0,
    rewriter: Rewriter | None = None,
) -> Commissioning:
    """A walk with a vehicle and a person."""
    clock = Clock()
    bus = DeafBus(vehicle, clock.now_ns, clock.sleep_until)
    bus.rewriter = rewriter
    return walk_and_review(
        load_binding(load_profile(profile)),
        bus,
        person,
        folder / "walk.log",
        channels={"": "can0"},
        step_timeout_s=step_timeout_s,
        now_ns=clock.now_ns,
    )
