"""The faults of the catalogue that need no bus: each changes what the vehicle sends, and ends with its context."""

import random
import socket
import struct
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil_bench.case import Case
from hil_bench.cases import CATALOGUE
from hil_bench.errors import UnexpectedNodeError
from hil_bench.faults import frames, process, traffic
from hil_bench.plant import Plant
from hil_bench.vehicle import Vehicle
from scenes import WIRE, CommandedVehicle, find_case
from vehicle_bus_contract.reference import AUTONOMOUS, MANUAL, MS, READY, Frame, S

KINDS = {"frames", "state", "driver"}
TICKS = 40
CASES = [case for case in CATALOGUE if case.inject is not None and KINDS & set(case.tags)]


class Drive:
    """A vehicle that is driven in virtual time, with what an injection needs of a rig."""

    def __init__(self) -> None:
        vehicle = Vehicle(WIRE, Plant(wheelbase_m=2.7, speed_mps=3.0, wheel_rad=0.1), gear=3, mode=AUTONOMOUS)
        self.rig = SimpleNamespace(
            wire=WIRE, vehicle=vehicle, random=random.Random(0), every_tick=[], delay_s=lambda: 0.0
        )
        self._now_ns, self._counter = S, 0

    def tick(self) -> tuple[list[Frame], bool]:
        """The frames of the next 10 ms, and whether they are delayed."""
        rig = self.rig
        self._now_ns, self._counter = self._now_ns + 10 * MS, (self._counter + 1) % 15
        rig.vehicle.receive(WIRE.pack("DRIVE_COMMAND", self._counter, ENABLE=1, ACCEL_REQUEST=1.0), self._now_ns)
        rig.vehicle.receive(WIRE.pack("STEER_COMMAND", self._counter, ENABLE=1), self._now_ns)
        rig.vehicle.move(0.01, self._now_ns)
        frames = rig.vehicle.next_frames()
        for call in tuple(rig.every_tick):
            call()
        return frames, rig.delay_s() > 0.0


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_each_fault_changes_what_the_vehicle_sends_and_ends(case: Case) -> None:
    faulty, sound = Drive(), Drive()
    assert faulty.tick() == sound.tick()
    assert case.inject is not None
    can_engage = faulty.rig.vehicle.can_engage
    with case.inject(faulty.rig):  # type: ignore[arg-type]
        changed = [faulty.tick() != sound.tick() for _ in range(TICKS)]
        is_refusing = faulty.rig.vehicle.can_engage is not can_engage
    assert any(changed) or is_refusing
    assert not faulty.rig.vehicle.faults
    assert not faulty.rig.every_tick
    assert faulty.rig.delay_s() == 0.0
    assert faulty.rig.vehicle.can_engage


ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("share_of_it", [0.1, 1.0])
def test_missing_bus_load_is_an_error_of_the_bench(share_of_it: float, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    per_second = 0.9 * 500_000 / traffic.LOAD_FRAME_BITS
    rig = SimpleNamespace(
        wire=WIRE,
        received=[],
        bus=SimpleNamespace(channel="vcan9", packets=lambda: round(now_s[0] * per_second * share_of_it)),
        **dict.fromkeys(("start_process", "run_for", "mark_injection", "stop_process"), lambda *_: None),
    )
    inject = traffic.add_load(0.9)(rig)  # type: ignore[arg-type]
    with nullcontext() if share_of_it > 0.5 else pytest.raises(OSError, match="were on the bus"), inject:
        now_s[0] += 2.0


def test_a_brief_override_leaves_the_vehicle_ready() -> None:
    commanded = CommandedVehicle()
    commanded.tick(20, accel=1.0)
    rig = SimpleNamespace(vehicle=commanded.vehicle)
    inject = find_case("driver-brakes-briefly").inject
    assert inject is not None
    with inject(rig):  # type: ignore[arg-type]
        commanded.tick(2, accel=1.0)
        assert commanded.vehicle.mode == MANUAL
    commanded.tick(2)
    assert commanded.vehicle.mode == READY
    assert not commanded.vehicle.driver_brake


def test_rejected_browsers_connect_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        pages = subprocess.Popen([sys.executable, "tools/hil_bench/browsers.py", str(port)], cwd=ROOT)
        try:
            for number in range(30):
                page, _ = server.accept()
                if number % 2:
                    page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    page.close()  # by a reset
                else:
                    assert page.recv(4) == b"GET "
                    page.close()
            assert pages.poll() is None
        finally:
            pages.kill()
            pages.wait()


def test_the_wall_clock_is_restored_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[float] = []
    monkeypatch.setattr(time, "clock_settime", lambda _, to_s: steps.append(round(to_s - time.time())))
    received = iter([None, UnexpectedNodeError("another node sends POSE")])

    def receive_commands() -> None:
        if error := next(received):
            raise error

    inject = process.step_wall_clock(60.0)(SimpleNamespace(receive_commands=receive_commands))  # type: ignore[arg-type]
    with pytest.raises(UnexpectedNodeError), inject:
        assert steps == [60]
    assert steps == [60, -60]


def test_injections_stop_when_another_node_sends_the_vehicles_frames() -> None:
    def falls_silent(rig: SimpleNamespace) -> None:
        rig.vehicle_transmits = False
        rig.every_tick.clear()
        raise UnexpectedNodeError("another node sends POSE")

    for injection in (
        traffic.flood(traffic.rival_command, 2),
        traffic.replay(1.0),
        frames.skip_counters(6, every=10),
    ):
        rig = SimpleNamespace(received=[], every_tick=[], vehicle_transmits=True)
        with pytest.raises(UnexpectedNodeError), injection(rig):  # type: ignore[arg-type]
            falls_silent(rig)
        assert not rig.every_tick
        assert not rig.vehicle_transmits
