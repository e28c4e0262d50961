"""A case of the bench in virtual time: a device without a process, and no bus between them."""

import random
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
from vehicle_bus_contract.reference import Frame
from virtual_clock import virtual_time
from virtual_device import LoopDevice, MinimalDevice, VirtualDevice
from virtual_drive import BenchBus


class VirtualRig(Rig):
    """A rig whose clock is the virtual bus's."""

    def __init__(self, wire: Wire, bus: BenchBus, device: VirtualDevice, trajectory: Path, case: Case) -> None:
        self.wire, self.folder, self.name = wire, trajectory.parent, case.name
        self.random = random.Random(f"0 {case.name}")
        self.vehicle, self.virtual, self._virtual_device = bus.vehicle, bus, device
        self.device = device  # type: ignore[assignment]
        self.events, self.every_tick, self.late = [], [], []
        self.bus = SimpleNamespace(rejected=0, send=self._send)  # type: ignore[assignment]
        self.delay_s = lambda: 0.0
        self.vehicle_transmits = True
        self.begin_ns = self.inject_ns = self.end_ns = self.then_ns = self.healthy_ns = self.exit_ns = 0
        self.touched_ns = self._next_ns = 0
        self.is_not_engaged_in_time = False
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
        device, ticks = self._virtual_device, self.virtual.ticks
        self.virtual.transmits, self.virtual.delay_s = self.vehicle_transmits, self.delay_s
        while self.virtual.ticks == ticks:
            if device.is_paused or device.poll() is not None:
                self.virtual.pass_tick()
            else:
                device.step()
            if device.poll() is not None:
                self.exit_ns = self.exit_ns or self.now_ns
        for call in tuple(self.every_tick):
            call()

    def set_link(self, *, up: bool, bus: int = 0) -> None:
        assert not bus
        self.virtual.is_up = up

    def receive_commands(self) -> None:
        """They came at once."""

    @property
    def received(self) -> list[RxFrame]:  # type: ignore[override]
        of_others = self.virtual.of_others
        return [
            RxFrame(frame, is_ours=number in of_others or not self._has_device_name(frame), hardware_ns=0)
            for number, frame in enumerate(self.virtual.frames)
        ]

    def close(self) -> None:
        """There is nothing to close."""

    def _send(self, frame: Frame) -> bool:
        assert not frame.is_error, "no error frames in virtual time"
        self.virtual.put(frame, to_vehicle=self._has_device_name(frame))
        return True

    def _has_device_name(self, frame: Frame) -> bool:
        return self.wire.name_of(frame) in self._of_device


def run_virtual(
    case: Case, profile: str, folder: Path, device_profile: str = "", *, is_minimal: bool = False, defect: str = ""
) -> CaseResult:
    """The result of a case, driven with this profile, by the program's loop or by the minimal controller.

    The loop may have another profile than the bench, the minimal controller a defect of its own.
    """
    wire = open_wire(profile)
    case = adapt(case, wire)
    config = BenchConfig(
        wire=wire, channel="vcan9", commands=Commands(start="", listen=""), folder=folder, profile=profile
    )
    why = find_inapplicable(case, wire)
    if why:
        return unjudged_result(config, case, 1, why, Verdict.NOT_APPLICABLE)
    route = case.route()
    trajectory = route.write(folder / "route.csv", wire.frame_id)
    if case.breaks is not None:
        trajectory.write_text(case.breaks(trajectory.read_text()))
    bus, log = BenchBus(build_vehicle(wire), lambda frame: [frame]), folder / "device.log"
    device = (
        MinimalDevice(bus, trajectory, log, defect)
        if is_minimal
        else LoopDevice(device_profile or profile, bus, trajectory, log)
    )
    rig = VirtualRig(wire, bus, device, trajectory, case)
    rig.vehicle.drives_to(route.x_m[-1], route.y_m[-1])
    with virtual_time(bus):
        stretches = run_phases(rig, case, is_recorded=False)
        killed = clean_up(rig, case)
    return judge_case(config, case, rig, route, killed, stretches)
