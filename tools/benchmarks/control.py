"""One command on long trajectories: PurePursuit at 100, 10 000 and 1 000 000 points, beside pure pursuits as written.

Following: the vehicle goes 0.1 m along a weaving path with a point each 0.5 m, as at 10 m/s and 100 Hz, and each call
gets a new state. Jump: a trajectory is set while the vehicle is half-way along it, and the first call has to find the
place; after it come calls that must not be long either. The peers find the point to aim at in the manner of
PythonRobotics (walking on in lists from the nearest point) and by NumPy over all points; they steer only. That ours
advanced over the points, and that all steer alike, is proven on the way.

Takes 60 s; --quick 8 s.

Target: a command at 1 000 000 points costs at most 1.6 times one at 100, and a jump over 500 000 points takes at most
5 ms in one call.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter_ns

import numpy as np

from benchmarks.parts.pursuits import NearestPursuit, WalkingPursuit
from benchmarks.parts.report import BenchmarkError, Cell, Report, Table, Target, progress
from benchmarks.parts.timing import NS_PER_US, Spread, interleaved, ratios
from vehicle_iface import PurePursuit, PurePursuitConfig, Reason, Trajectory, VehicleState

NS_PER_MS = 1_000_000
SIZES = (100, 10_000, 1_000_000)
SPACING_M, STEP_M, SPEED_MPS = 0.5, 0.1, 10.0
CALLS = 350
"""In one round; with the look-ahead of 10 m they end before the end of 100 points."""
NEAREST_CALLS = 4
"""Of the peer that looks at all points each time."""
AFTER_JUMP = 100
LIKE_RAD = 0.01
WHEELBASE_M, LOOKAHEAD_TIME_S = 2.7, 1.0


@dataclass(slots=True)
class Course:
    """A trajectory, and a vehicle at some place of it."""

    trajectory: Trajectory
    controller: PurePursuit
    walking: WalkingPursuit
    nearest: NearestPursuit
    states: Sequence[VehicleState] = ()
    """Of the round."""

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def middle(self) -> int:
        """Half-way; on the shortest nearer to its beginning, so that a look-ahead and some calls fit behind it."""
        return len(self) // 2 if len(self) > SIZES[0] else 10

    def place(self, begin: int) -> None:
        """At point `begin`, with a newly set trajectory; what follows are 0.1 m steps."""
        self.states = [_state(self.trajectory, begin * SPACING_M + number * STEP_M) for number in range(CALLS + 1)]
        self.controller.set_trajectory(self.trajectory)
        self.walking.nearest = None

    def find(self) -> None:
        """The first call, from which on ours and the walking one follow."""
        self.controller.compute_command(self.states[0])
        self.walking.steering(self.states[0])


def run(options: argparse.Namespace) -> Report:
    rounds, jumps = (5, 5) if options.quick else (101, 41)
    progress("control: making trajectories")
    courses = [_course(count) for count in SIZES]
    for course in courses:
        _prove(course)
    following, follow_ratio = _following(courses, rounds)
    jumping, jump_ms = _jumping(courses, jumps)
    method = (
        f"Following: {rounds} rounds, each elsewhere, with {CALLS} calls of each in turn ({NEAREST_CALLS} over all "
        f"points); µs are medians for one call, ratios medians of each round's own. Jump: {jumps} rounds."
    )
    targets = [
        Target(what="a command at 1 000 000 points, in those at 100", value=follow_ratio, at_most=1.6, unit="x"),
        Target(what="a jump over 500 000 points in one call, median", value=jump_ms, at_most=5.0, unit="ms"),
    ]
    return Report(method=method, tables=[following, jumping], targets=targets)


def _following(courses: Sequence[Course], rounds: int) -> tuple[Table, float]:
    """The table, and what the longest trajectory costs in terms of the shortest."""
    begins = iter(range(0, 10**9, 97))

    def prepare(contestant: tuple[str, int]) -> None:
        course = courses[contestant[1]]
        course.place(course.middle + next(begins) % (len(course) // 4) if len(course) > SIZES[0] else 0)
        course.find()

    jobs: dict[tuple[str, int], Callable[[], object]] = {}
    for number, course in enumerate(courses):
        jobs["ours", number] = partial(_drive, course, course.controller.compute_command, CALLS)
        jobs["walking", number] = partial(_drive, course, course.walking.steering, CALLS)
        jobs["over all", number] = partial(_drive, course, course.nearest.steering, NEAREST_CALLS)
    progress(f"control: following, {rounds} rounds")
    took = interleaved(jobs, rounds, prepare)
    calls = {"ours": CALLS, "walking": CALLS, "over all": NEAREST_CALLS}
    micros = {key: [one / calls[key[0]] / NS_PER_US for one in times] for key, times in took.items()}
    rows: list[Sequence[Cell]] = []
    for number, course in enumerate(courses):
        growth = ratios(micros["ours", number], micros["ours", 0])
        medians = (Spread.of(micros[name, number]).median for name in calls)
        peers = (ratios(micros[name, number], micros["ours", number]).median for name in ("walking", "over all"))
        rows.append((len(course), *medians, growth.median, growth.p10, growth.p90, *peers))
    columns = ("points", *(f"{name} µs" for name in calls), "ours vs ours at 100", "p10", "p90")
    table = Table(title="following", columns=(*columns, "walking vs ours", "over all vs ours"), rows=rows)
    return table, ratios(micros["ours", len(courses) - 1], micros["ours", 0]).median


def _jumping(courses: Sequence[Course], rounds: int) -> tuple[Table, float]:
    """The table, and the median of the longest jump in ms."""
    rows: list[Sequence[Cell]] = []
    median_ms = 0.0
    for course in courses:
        progress(f"control: jumps over half of {len(course)} points, {rounds} rounds")
        jumps = [_jump(course) for _ in range(rounds)]
        ours, later, walking = (Spread.of(took) for took in zip(*jumps, strict=True))
        peer = ratios([jump[2] for jump in jumps], [jump[0] for jump in jumps])
        worst = max(jump[0] for jump in jumps)
        rows.append(
            (len(course), course.middle, ours.median, ours.p90, worst, later.median, walking.median, peer.median)
        )
        median_ms = ours.median
    after = f"slowest of the next {AFTER_JUMP} ms"
    columns = ("points", "jumped over", "ours ms", "p90", "worst", after, "walking ms", "walking vs ours")
    return Table(title="first call after a new trajectory in mid-route", columns=columns, rows=rows), median_ms


def _jump(course: Course) -> tuple[float, float, float]:
    """Milliseconds of our first call, of the slowest one soon after it, and of the walking peer's first."""
    compute = course.controller.compute_command
    course.place(course.middle)
    first = _took_ms(compute, course.states[0])
    _require(course.controller.spatial_index >= course.middle - 1, "the jump did not arrive")
    later = max(_took_ms(compute, state) for state in course.states[1 : AFTER_JUMP + 1])
    return first, later, _took_ms(course.walking.steering, course.states[0])


def _drive(course: Course, compute: Callable[[VehicleState], object], calls: int) -> None:
    for state in course.states[1 : calls + 1]:
        compute(state)


def _prove(course: Course) -> None:
    """Ours advances over the points that the vehicle passes and never stops, and all steer alike."""
    course.place(course.middle if len(course) > SIZES[0] else 0)
    course.find()
    passed = course.controller.spatial_index
    for number, state in enumerate(course.states[1:]):
        command = course.controller.compute_command(state)
        _require(command.reason is Reason.NOMINAL, f"{len(course)} points: stops, {command.reason.name}")
        peers = [course.walking.steering(state)]
        if number < NEAREST_CALLS:
            peers.append(course.nearest.steering(state))
        off_rad = max(abs(peer - command.front_wheel_angle_rad) for peer in peers)
        _require(off_rad < LIKE_RAD, f"{len(course)} points: the steering differs by {off_rad:.4f} rad")
    advanced, driven = course.controller.spatial_index - passed, round(CALLS * STEP_M / SPACING_M)
    _require(abs(advanced - driven) <= 1, f"{len(course)} points: advanced over {advanced} in place of {driven}")


def _require(holds: bool, text: str) -> None:
    if not holds:
        raise BenchmarkError(text)


def _took_ms(call: Callable[[VehicleState], object], state: VehicleState) -> float:
    begun_ns = perf_counter_ns()
    call(state)
    return (perf_counter_ns() - begun_ns) / NS_PER_MS


def _course(count: int) -> Course:
    way_m = np.arange(count) * SPACING_M  # (n,)
    heading_rad = 0.3 * np.sin(way_m / 15.0)
    trajectory = Trajectory(
        stamp_ns=0,
        time_from_start_ns=np.rint(way_m / SPEED_MPS * 1e9).astype(np.int64),
        x_m=np.cumsum(np.cos(heading_rad)) * SPACING_M,
        y_m=np.cumsum(np.sin(heading_rad)) * SPACING_M,
        heading_rad=heading_rad,
        speed_mps=np.full(count, SPEED_MPS),
    )
    config = PurePursuitConfig(wheelbase_m=WHEELBASE_M, lookahead_time_s=LOOKAHEAD_TIME_S)
    walking = WalkingPursuit(trajectory, WHEELBASE_M, LOOKAHEAD_TIME_S)
    nearest = NearestPursuit(trajectory, WHEELBASE_M, LOOKAHEAD_TIME_S)
    return Course(trajectory, PurePursuit(config), walking, nearest)


def _state(trajectory: Trajectory, way_m: float) -> VehicleState:
    """Beside the path, up to 5 cm to either side, on time."""
    index, part = divmod(way_m / SPACING_M, 1.0)
    here, there = int(index), int(index) + 1
    heading_rad = float(trajectory.heading_rad[here])
    aside_m = 0.05 * math.sin(way_m / 7.0)
    x_m = float(trajectory.x_m[here]) * (1.0 - part) + float(trajectory.x_m[there]) * part
    y_m = float(trajectory.y_m[here]) * (1.0 - part) + float(trajectory.y_m[there]) * part
    return VehicleState(
        stamp_ns=round(way_m / SPEED_MPS * 1e9),
        x_m=x_m - aside_m * math.sin(heading_rad),
        y_m=y_m + aside_m * math.cos(heading_rad),
        heading_rad=heading_rad,
        speed_mps=SPEED_MPS,
    )
