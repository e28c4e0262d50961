"""The passes of the `long_work` benchmark: milliseconds of the thread's CPU time by kind of work, as JSON."""

import gc
import json
import logging
import os
import sys
import tempfile
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

from benchmarks.parts.reaction_pass import OURS, Runner, Wires, build_ours, engage, keep_time_of
from benchmarks.parts.reaction_vehicle import Course, RailVehicle, driven, figure_of_eight
from vehicle_iface import Trajectory
from vehicle_iface.cli.logging import log_to_terminal
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.telemetry import SessionInfo, TelemetryWriter
from vehicle_iface.trajectories.mailbox import Mailbox
from vehicle_iface.trajectories.source import restamp

NOTHING = "none"
LONG_TRAJECTORY = "a trajectory of 1,000,000 points"
POSTED_TRAJECTORY = "a trajectory of 20,000 points"
SHORT_TRAJECTORY = "a trajectory of 256 points"
LOGGING = "a line of the log, each pass"
COUNTERS = "the counters, each pass"
GARBAGE = "garbage of a controller, each pass"
REST_S = 0.0025
LIVE_OBJECTS, NEW_OBJECTS = 100_000, 701
LONGEST_CHECK = 20_000
"""Passes after which a trajectory must be accepted."""

log = logging.getLogger("vehicle_iface.benchmark")


@dataclass(slots=True)
class Bench:
    """The program and its vehicle, while it drives."""

    runner: Runner
    loop: Loop
    mailbox: Mailbox
    course: Course
    telemetry: TelemetryWriter
    live: list[list[int]] = field(default_factory=list)

    def passes(self, name: str, count: int, before: Callable[[], object] = lambda: None) -> list[float]:
        """Milliseconds of `count` passes, each with the work that `before` causes."""
        for _ in range(count):
            before()
            self.runner.one_pass(name)
            time.sleep(REST_S)
        return self._took_ms(name)

    def accept(self, name: str, trajectory: Trajectory) -> list[float]:
        """Milliseconds of the passes from the posting of a trajectory to its acceptance, and one more."""
        accepted = self._accepted()
        self.post(trajectory)
        for _ in range(LONGEST_CHECK):
            self.passes(name, 1)
            if self._accepted() > accepted:
                self.passes(name, 1)
                return self._took_ms(name)
        raise RuntimeError(f"{name}: not accepted in {LONGEST_CHECK} passes")

    def post(self, trajectory: Trajectory) -> None:
        self.mailbox.put(restamp(trajectory, time.monotonic_ns()))

    def make_garbage(self) -> None:
        """Objects as a controller may make them, most of them gone at once."""
        replaced = range(0, LIVE_OBJECTS, LIVE_OBJECTS // NEW_OBJECTS)
        self.live[:: replaced.step] = [[number] for number in replaced]

    def _accepted(self) -> int:
        return self.loop.details().loop["trajectories"]

    def _took_ms(self, name: str) -> list[float]:
        return [took_ns / 1e6 for took_ns in self.runner.passes_ns[name]]


@contextmanager
def drive() -> Iterator[Bench]:
    """Engaged and driving."""
    course, wires, mailbox = figure_of_eight(), Wires(), Mailbox()
    info = SessionInfo(channel="socket pair", bus="AF_UNIX")
    with (
        tempfile.TemporaryDirectory(dir="/dev/shm") as folder,
        TelemetryWriter(f"{folder}/telemetry", info) as telemetry,
    ):
        loop = build_ours(wires, course, telemetry, mailbox)
        runner = Runner(OURS, loop, wires.far[0], RailVehicle(course), keep_time_of(loop), clock_ns=time.thread_time_ns)
        bench = Bench(runner, loop, mailbox, course, telemetry)
        realtime.apply_settings(cpu=max(os.sched_getaffinity(0)))
        bench.post(course.trajectory())
        engage([runner])
        yield bench


def measure(passes: int) -> dict[str, list[float]]:
    """Milliseconds of the passes with each kind of work."""
    with drive() as bench, log_to_terminal(verbose=False):
        cut = partial(ahead, bench.course, bench.runner.vehicle)
        found = {NOTHING: bench.passes(NOTHING, passes)}
        long = cut(1_000_000)  # kept: to free it takes 10 ms
        found[LONG_TRAJECTORY] = bench.accept(LONG_TRAJECTORY, long)
        found[POSTED_TRAJECTORY] = bench.accept(POSTED_TRAJECTORY, cut(20_000))
        for _ in range(passes // 10):
            found[SHORT_TRAJECTORY] = bench.accept(SHORT_TRAJECTORY, cut(256))
        bench.accept("", cut(20_000))
        found[LOGGING] = bench.passes(LOGGING, passes, lambda: log.info("a line of the log"))
        found[COUNTERS] = [counters_ms(bench) for _ in range(passes)]
        bench.live = [[number] for number in range(LIVE_OBJECTS)]
        gc.collect()
        found[GARBAGE] = bench.passes(GARBAGE, passes, bench.make_garbage)
        return found


def ahead(course: Course, vehicle: RailVehicle, points: int) -> Trajectory:
    """So many points of the course from the vehicle on, in place and time."""
    way_m, _ = driven(time.monotonic() - vehicle.left_s)
    whole = course.trajectory(points // (len(course.s_m) - 1) + 2)
    first = bisect_right(course.s_m, way_m % course.s_m[-1]) - 1
    part = slice(first, first + points)
    times_ns = whole.time_from_start_ns[part] - whole.time_from_start_ns[first]
    columns = {name: getattr(whole, name)[part] for name in ("x_m", "y_m", "heading_rad", "speed_mps")}
    return Trajectory(stamp_ns=0, time_from_start_ns=times_ns, **columns)


def counters_ms(bench: Bench) -> float:
    """The time that a tick takes to publish all counters, twice a second."""
    begun_ns = time.thread_time_ns()
    bench.telemetry.publish_details(bench.loop.details())
    return (time.thread_time_ns() - begun_ns) / 1e6


def main() -> None:
    print(json.dumps(measure(int(sys.argv[1]))))


if __name__ == "__main__":
    main()
