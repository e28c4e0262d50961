"""A case of the bench in virtual time: the program's loop in place of a device, no bus between them."""

import random
import signal
from pathlib import Path
from types import SimpleNamespace

from hil_bench.applicable import adapt, find_inapplicable
from hil_bench.bench_config import BenchConfig
from hil_bench.bus import RxFrame
from hil_bench.case import Case
from hil_bench.device import Commands
from hil_bench.judge_case import judge_case, unjudged_result
from hil_bench.lateness import DeviceWatch
from hil_bench.peer.build import build_vehicle, open_wire
from hil_bench.phases import clean_up, run_phases
from hil_bench.result import CaseResult, Verdict
from hil_bench.rig import Rig
from hil_bench.wire import Wire
from vehicle_bus_contract.reference import S
from virtual_drive import BenchBus

from vehicle_iface import compose
from vehicle_iface.codec.database import load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.trajectories.csv_file import load_csv
from vehicle_iface.trajectories.source import FixedTrajectory

LATCHED = 4
"""Exit status of a run that ended in a latched fault."""


class VirtualDevice:
    """The program's loop, with what a rig asks of a device."""

    is_started = True

    def __init__(self, profile: str, bus: BenchBus, trajectory: Path, log: Path) -> None:
        database = load_database(load_profile(profile))
        self.log = log
        self._bus = bus
        self.loop = compose.build_loop(
            database=database,
            open_bus=bus.open,
            controller=compose.build_controller("pure_pursuit", database.profile),
            source=FixedTrajectory(load_csv(trajectory)),
            telemetry=None,
            armed=True,
            now_ns=lambda: bus.now_ns,
            sleep_until=bus.sleep_until,
        )

    def start(self, *, armed: bool = True, recorded: bool = False, open_files: int = 0) -> None:
        """It runs already."""
        assert armed
        assert not recorded
        assert not open_files

    def rearm(self) -> None:
        """As SIGUSR1."""
        self.loop.arming.request()

    def stop(self) -> None:
        """As SIGINT."""
        self.loop.shutdown.request()

    def send(self, number: signal.Signals) -> None:
        """Only what ends a run."""
        assert number in (signal.SIGINT, signal.SIGTERM)
        self.stop()

    def poll(self) -> int | None:
        """Its exit status."""
        shutdown = self.loop.shutdown
        return None if not shutdown.is_done else LATCHED if shutdown.ended_in_fault else 0

    def kill(self) -> list[str]:
        """Nothing is left of it."""
        return []


class VirtualRig(Rig):
    """A rig whose clock is the virtual bus's."""

    def __init__(self, wire: Wire, profile: str, trajectory: Path, case: Case) -> None:
        self.wire, self.folder, self.name = wire, trajectory.parent, case.name
        self.random = random.Random(f"0 {case.name}")
        self.vehicle = build_vehicle(wire)
        self.virtual = BenchBus(self.vehicle, lambda frame: [frame])
        self.device = VirtualDevice(profile, self.virtual, trajectory, self.folder / "none.log")  # type: ignore[assignment]
        self.events, self.every_tick, self.late = [], [], []
        self.bus = SimpleNamespace(rejected=0)  # type: ignore[assignment]
        self.delay_s = lambda: 0.0
        self.vehicle_transmits = True
        self.begin_ns = self.inject_ns = self.end_ns = self.then_ns = self.healthy_ns = self.exit_ns = 0
        self.touched_ns = self._next_ns = 0
        self.exit_status = None
        self._output_bytes = []
        self._of_device = frozenset(wire.of_device)
        self.commands_ns, self.armed_ns = 0, []
        self.watch, self._seen_by_witness = DeviceWatch(list), []

    @property
    def now_ns(self) -> int:
        return self.virtual.now_ns

    def begin(self) -> None:
        self.begin_ns = self.now_ns

    def tick(self) -> None:
        loop = self.device.loop  # type: ignore[attr-defined]
        ticks = self.virtual.ticks
        while self.virtual.ticks == ticks:
            if loop.shutdown.is_done:
                self.exit_ns = self.exit_ns or self.now_ns
                self.virtual.wait(self.now_ns + S)
                self.virtual.drain()
            else:
                loop.step()
        for call in tuple(self.every_tick):
            call()

    @property
    def received(self) -> list[RxFrame]:  # type: ignore[override]
        return [
            RxFrame(frame, is_ours=self.wire.name_of(frame) not in self._of_device, hardware_ns=0)
            for frame in self.virtual.frames
        ]

    def close(self) -> None:
        """There is nothing to close."""


def run_virtual(case: Case, profile: str, folder: Path, device_profile: str = "") -> CaseResult:
    """The result of a case, driven with this profile; the device may have another one."""
    wire = open_wire(profile)
    case = adapt(case, wire)
    config = BenchConfig(
        wire=wire, channel="vcan9", commands=Commands(start="", listen=""), folder=folder, profile=profile
    )
    why = find_inapplicable(case, wire)
    if why:
        return unjudged_result(config, case, 1, why, Verdict.NOT_APPLICABLE)
    route = case.route()
    rig = VirtualRig(wire, device_profile or profile, route.write(folder / "route.csv", wire.frame_id), case)
    rig.vehicle.drives_to(route.x_m[-1], route.y_m[-1])
    stretches = run_phases(rig, case)
    killed = clean_up(rig, case)
    return judge_case(config, case, rig, route, killed, stretches)
