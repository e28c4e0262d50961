"""The reaction of whole processes on vcan, seen from another process: kernel stamps, and system calls.

`python -m benchmarks.parts.reaction_vcan ROUNDS SAMPLES`, where SocketCAN and the right to make interfaces are; prints
JSON. Each contestant has a vcan interface of its own and is stopped (SIGSTOP) while it is another one's turn.
"""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from vehicle_bus_contract.reference import Frame, intact
from vehicle_bus_contract.socketcan import open_socket, receive_frames

from benchmarks.parts.reaction_contestants import PERIOD_S, PROCESSES
from benchmarks.parts.reaction_vehicle import RailVehicle, figure_of_eight
from vehicle_iface.trajectories import save_csv

OURS = "ours"
NAMES = ("echo", "bare", OURS, "python-can", "notifier")
DRIVE_COMMAND, STEER_COMMAND, CHASSIS = 0x080, 0x081, 0x112
FRAME_S = 0.00025
"""One frame of eight bytes on a bus of 500 kbit/s: samples come in three pieces, not in one."""
TRACED_FRAME_S = 0.002
"""Under strace: so slow a contestant must not find two frames where it would have found one."""
PRIORITY = 40
"""Below the contestants' 50: on one processor each frame is seen when it comes."""
SETTLING = 30
"""Samples after the engagement that are not counted."""
PATIENCE_S = 60.0
CLOCK_READS = "clock_gettime,gettimeofday,time,clock_getres"
ROOT = Path(__file__).resolve().parents[3]


@dataclass(slots=True)
class Found:
    """What was seen of one contestant."""

    first_s: list[float] = field(default_factory=list)
    """From the stamp of a sample's last frame to the stamp of the next DRIVE_COMMAND."""
    second_s: list[float] = field(default_factory=list)
    """The same to the STEER_COMMAND after it."""
    unanswered: int = 0
    stops: int = 0
    """Answers that were not intact or no NOMINAL command."""


class Runner:
    """One contestant's process on its own interface."""

    def __init__(self, name: str, folder: Path, number: int, prefix: Sequence[str] = ()) -> None:
        self.name = name
        self.channel = f"vbench{number}"
        subprocess.run(["ip", "link", "add", "dev", self.channel, "type", "vcan"], check=True)
        subprocess.run(["ip", "link", "set", self.channel, "up"], check=True)
        self.log = folder / f"{self.channel}.log"
        self.ready = folder / f"{self.channel}.ready"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [*prefix, sys.executable, "-P", *self._arguments(folder)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def _arguments(self, folder: Path) -> list[str]:
        if self.name != OURS:
            return ["-m", "benchmarks.parts.reaction_contestants", self.name, self.channel, str(self.ready)]
        course, telemetry = folder / "course.csv", folder / f"{self.channel}.telemetry"
        options = ["--channel", self.channel, "--arm", "--trajectory", str(course), "--telemetry", str(telemetry)]
        return ["-m", "vehicle_iface", "run", *options]

    def wait_until_ready(self) -> None:
        """Until it receives its bus."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not self.ready.exists() and "armed" not in self.log.read_text(errors="replace"):
            if self.process.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(f"{self.name} does not start:\n{self.log.read_text(errors='replace')}")
            time.sleep(0.1)
        time.sleep(0.3)

    def send_signal(self, number: signal.Signals) -> None:
        """To the whole group: under strace the contestant is strace's child."""
        os.killpg(self.process.pid, number)

    def resume(self) -> None:
        """Go on; our own program has latched the loss of its samples and is armed again."""
        self.send_signal(signal.SIGCONT)
        if self.name == OURS:
            time.sleep(0.05)
            self.arm()

    def arm(self) -> None:
        """SIGUSR1 to the program itself."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        is_traced = Path(f"/proc/{self.process.pid}/comm").read_text().strip() == "strace"
        os.kill(int(children[0]) if is_traced else self.process.pid, signal.SIGUSR1)

    def end(self) -> None:
        """It and its interface are gone."""
        self.send_signal(signal.SIGCONT)
        self.send_signal(signal.SIGKILL)
        self.process.wait()
        subprocess.run(["ip", "link", "del", self.channel], check=True)


def spin() -> None:
    """For as long as a frame takes on its bus."""
    free_s = time.monotonic() + FRAME_S
    while time.monotonic() < free_s:
        pass


class Driver:
    """The vehicle's process: sends at 100 Hz and watches with a socket of its own."""

    def __init__(self, channel: str, vehicle: RailVehicle, *, pause: Callable[[], None] = spin) -> None:
        """`pause` is what it does after each frame."""
        self._vehicle, self._pause = vehicle, pause
        self._out = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._out.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
        self._out.bind((channel,))
        self._watch = open_socket(channel)
        self._tick = 0

    def drive(self, samples: int, *, until_engaged: bool = False) -> list[Frame]:
        """Send so many samples, or until the vehicle is autonomous; all frames that were seen."""
        seen: list[Frame] = []
        next_s = time.monotonic() + PERIOD_S
        for _ in range(samples):
            frames = self._vehicle.sample(next_s)
            if self._tick % 2 == 0:
                frames.insert(0, self._vehicle.status())
            self._tick += 1
            time.sleep(max(0.0, next_s - time.monotonic()))
            fresh = receive_frames(self._watch)
            for frame in fresh:
                self._vehicle.receive(frame, next_s)
            seen += fresh
            self._send(frames)
            next_s = max(next_s + PERIOD_S, time.monotonic())
            if until_engaged and self._vehicle.is_autonomous:
                break
        time.sleep(2 * PERIOD_S)
        return seen + receive_frames(self._watch)

    def _send(self, frames: list[bytes]) -> None:
        for frame in frames:
            self._out.send(frame)
            self._pause()

    def close(self) -> None:
        self._out.close()
        self._watch.close()


def judge(frames: list[Frame], found: Found, *, is_echo: bool) -> None:
    """Pair each sample with the commands that came before the next one."""
    places = [index for index, frame in enumerate(frames) if frame.can_id == CHASSIS]
    for place, after in zip(places, [*places[1:], len(frames)], strict=True):
        answers: dict[int, Frame] = {}
        for frame in frames[place:after]:
            answers.setdefault(frame.can_id, frame)
        drive, steer = answers.get(DRIVE_COMMAND), answers.get(STEER_COMMAND)
        if drive is None or steer is None:
            found.unanswered += 1
            continue
        told = intact(drive)
        if not is_echo and (told is None or intact(steer) is None or told.reason != "NOMINAL"):
            found.stops += 1
            continue
        found.first_s.append((drive.stamp_ns - frames[place].stamp_ns) * 1e-9)
        found.second_s.append((steer.stamp_ns - frames[place].stamp_ns) * 1e-9)


def one_turn(runner: Runner, samples: int) -> list[Frame]:
    """Engage one contestant and have it answer; what was on its bus from then on."""
    driver = Driver(runner.channel, vehicle := RailVehicle(figure_of_eight()))
    try:
        runner.resume()
        if runner.name != "echo":  # which has nothing to say that a vehicle would engage on
            driver.drive(500, until_engaged=True)
        if not vehicle.is_autonomous and runner.name != "echo":
            raise RuntimeError(f"{runner.name} does not engage:\n{runner.log.read_text(errors='replace')}")
        driver.drive(SETTLING)
        return driver.drive(samples)
    finally:
        runner.send_signal(signal.SIGSTOP)
        driver.close()


def measure(rounds: int, samples: int) -> dict[str, Found]:
    """Latencies of all contestants, in turns."""
    found = {name: Found() for name in NAMES}
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name, ExitStack() as stack:
        folder = Path(name)
        save_csv(folder / "course.csv", figure_of_eight().trajectory(laps=4))
        runners = []
        for number, one in enumerate(NAMES):
            runners.append(runner := Runner(one, folder, number))
            stack.callback(runner.end)
            runner.wait_until_ready()
            runner.send_signal(signal.SIGSTOP)
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        for number in range(rounds):
            for runner in runners[number % len(runners) :] + runners[: number % len(runners)]:
                frames = one_turn(runner, samples)
                judge(frames, found[runner.name], is_echo=runner.name == "echo")
    return found


def count_calls(samples: int) -> dict[str, dict[str, float]] | None:
    """System calls a sample by name, clock reads left out; None without strace."""
    strace = shutil.which("strace")
    if strace is None:
        return None
    calls: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name:
        folder = Path(name)
        save_csv(folder / "course.csv", figure_of_eight().trajectory(laps=4))
        for number, one in enumerate(NAMES):
            trace = folder / f"{one}.strace"
            prefix = [strace, "-f", "-ttt", "--seccomp-bpf", "-e", f"trace=!{CLOCK_READS}", "-o", str(trace)]
            runner = Runner(one, folder, number, prefix)
            try:
                runner.wait_until_ready()
                begin_s, end_s, count = _traced_turn(runner, samples)
            finally:
                runner.end()
            calls[one] = {call: found / count for call, found in _called(trace, begin_s, end_s).items()}
    return calls


def _traced_turn(runner: Runner, samples: int) -> tuple[float, float, int]:
    """Begin and end on the wall clock, and the samples between them."""
    pause = partial(time.sleep, TRACED_FRAME_S)
    driver = Driver(runner.channel, RailVehicle(figure_of_eight()), pause=pause)
    try:
        if runner.name != "echo":
            driver.drive(500, until_engaged=True)
        driver.drive(SETTLING)
        begin_s = time.time()
        seen = driver.drive(samples)
        end_s = time.time() - 2 * PERIOD_S
        if not any(frame.can_id == STEER_COMMAND for frame in seen):
            raise RuntimeError(f"{runner.name} does not answer under strace")
        return begin_s, end_s, samples
    finally:
        driver.close()


_CALL = re.compile(r"^\d+\s+(\d+\.\d+) (?!<\.\.\.)(\w+)\(")


def _called(trace: Path, begin_s: float, end_s: float) -> Counter[str]:
    found: Counter[str] = Counter()
    for line in trace.read_text(errors="replace").splitlines():
        match = _CALL.match(line)
        if match and begin_s <= float(match[1]) < end_s:
            found[match[2]] += 1
    return found


def main() -> None:
    rounds, samples = map(int, sys.argv[1:])
    found = measure(rounds, samples)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    result: dict[str, Any] = {
        "latencies": {
            name: {"first_s": one.first_s, "second_s": one.second_s, "unanswered": one.unanswered, "stops": one.stops}
            for name, one in found.items()
        },
        "calls": count_calls(samples),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    assert set(PROCESSES) | {OURS} == set(NAMES)
    main()
