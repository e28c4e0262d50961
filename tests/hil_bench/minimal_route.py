"""The minimal controller's route: a CSV file of points, and where on it the vehicle is."""

import csv
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Protocol

FRAMES = {"odom": 0, "map": 1}


class Pose(Protocol):
    """Where the vehicle is."""

    @property
    def x_m(self) -> float: ...

    @property
    def y_m(self) -> float: ...

    @property
    def heading_rad(self) -> float: ...


class Route:
    """Points in time and space, driven in legs of one direction each, from stop to stop."""

    def __init__(self, frame: int, rows: Sequence[tuple[float, ...]]) -> None:
        """Rows of time, x, y, heading, speed; a row that does not move on is a dwell where its speed is 0."""
        self.frame, self.end_s = frame, rows[-1][0]
        self.times_s = [row[0] for row in rows]
        self.points, self.rows = [rows[0]], [0]
        self.until_s: dict[int, float] = {}
        for number, row in enumerate(rows[1:], 1):
            if math.dist(row[1:3], self.points[-1][1:3]) > 0.001:
                self.points.append(row)
                self.rows.append(number)
            elif row[4] == self.points[-1][4] == 0.0:
                self.until_s[len(self.points) - 1] = row[0]
        self.segments = len(self.points) - 1
        if self.segments < 1:
            raise ValueError("needs two points apart")
        self.along_m = [0.0]
        self.directions: list[int] = []
        self.legs: list[int] = []
        for i, (a, b) in enumerate(pairwise(self.points)):
            self.along_m.append(self.along_m[-1] + math.dist(a[1:3], b[1:3]))
            is_ahead = math.cos(math.atan2(b[2] - a[2], b[1] - a[1]) - a[3]) >= 0.0
            self.directions.append(1 if is_ahead else -1)
            is_new = i in self.until_s or self.directions[-1] != self.directions[max(0, i - 1)]
            self.legs.append((self.legs[-1] if self.legs else 0) + is_new)
        self.begin_again()

    def begin_again(self) -> None:
        """Forget the place on it."""
        self.place = self.furthest = -1
        self.share = self.off_m = self.off_rad = 0.0
        self.is_past = False

    def locate(self, pose: Pose) -> None:
        """The place nearest to the vehicle, sought near the one before and on the same leg."""
        self.place = min(self._candidates(), key=lambda i: self._cost(i, pose))
        self.furthest = max(self.furthest, self.place)
        self.share, self.off_m, is_beyond = self._projected(self.place, pose)
        self.off_rad = math.remainder(pose.heading_rad - self.points[self.place][3], math.tau)
        self.is_past = self.place == self.segments - 1 and is_beyond

    @property
    def direction(self) -> int:
        """1 forwards, -1 in reverse."""
        return self.directions[self.place]

    @property
    def reached_m(self) -> float:
        """Way along it from its beginning."""
        return self.along_m[self.place] + self.share * (self.along_m[self.place + 1] - self.along_m[self.place])

    def left_of_leg_m(self) -> float:
        """Way to the next change of direction or dwell; infinite on the last leg."""
        end = self._leg_end()
        return math.inf if end == self.segments else self.along_m[end] - self.reached_m

    def may_leave_leg(self, t_s: float) -> bool:
        """Whether the dwell at its end is over, if it has one."""
        return t_s >= self.until_s.get(self._leg_end(), 0.0)

    def next_leg(self) -> None:
        """From here on in the other direction, or on after a dwell."""
        self.place, self.share = self._leg_end(), 0.0

    def speed_mps(self, ahead_m: float = 0.0) -> float:
        """At a point of the leg, without its sign."""
        at_m = self.reached_m + ahead_m
        i = min(max(bisect_right(self.along_m, at_m) - 1, self.place), self._leg_end() - 1)
        share = min(1.0, (at_m - self.along_m[i]) / (self.along_m[i + 1] - self.along_m[i]))
        a, b = abs(self.points[i][4]), abs(self.points[i + 1][4])
        return a + share * (b - a)

    def check_curvature(self, most_per_m: float) -> None:
        """Raises `ValueError` where the path bends more sharply."""
        for a, b in pairwise(self.points):
            bend_per_m = abs(math.remainder(b[3] - a[3], math.tau)) / math.dist(a[1:3], b[1:3])
            if bend_per_m > most_per_m:
                raise ValueError(
                    f"at {a[1]:.1f}, {a[2]:.1f} m: curvature {bend_per_m:.3f}/m, at most {most_per_m:.3f}/m"
                )

    def point_ahead(self, ahead_m: float) -> tuple[float, float]:
        """On the leg, or straight on from its end."""
        at_m, last = self.reached_m + ahead_m, self._leg_end() - 1
        i = min(max(bisect_right(self.along_m, at_m) - 1, self.place), last)
        share = (at_m - self.along_m[i]) / (self.along_m[i + 1] - self.along_m[i])
        a, b = self.points[i], self.points[i + 1]
        return a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])

    def index_at(self, t_s: float) -> int:
        """The row last passed in time."""
        return max(0, bisect_right(self.times_s, t_s) - 1)

    def furthest_row(self) -> int:
        """The row of the point last passed in space."""
        return self.rows[max(0, self.furthest)]

    def _leg_end(self) -> int:
        end = self.place + 1
        while end < self.segments and self.legs[end] == self.legs[self.place]:
            end += 1
        return end

    def _candidates(self) -> Iterator[int]:
        if self.place < 0:
            yield from range(self.segments)
            return
        for step, reach_m in ((1, 6.0), (-1, 2.0)):
            i = self.place if step > 0 else self.place - 1
            while 0 <= i < self.segments and self.legs[i] == self.legs[self.place]:
                if abs(self.along_m[i] - self.along_m[self.place]) > reach_m:
                    break
                yield i
                i += step

    def _cost(self, i: int, pose: Pose) -> float:
        """Distance; at first also how badly the direction fits, and rather its beginning than its end."""
        _, distance_m, _ = self._projected(i, pose)
        if self.place >= 0:
            return distance_m
        turned_rad = math.remainder(pose.heading_rad - self.points[i][3], math.tau)
        return distance_m + abs(turned_rad) + 0.1 * self.along_m[i] / self.along_m[-1]

    def _projected(self, i: int, pose: Pose) -> tuple[float, float, bool]:
        """Share of the segment, distance from it, and whether the vehicle is beyond its end."""
        (_, ax, ay, *_), (_, bx, by, *_) = self.points[i : i + 2]
        dx, dy, px, py = bx - ax, by - ay, pose.x_m - ax, pose.y_m - ay
        free = (px * dx + py * dy) / (dx * dx + dy * dy)
        share = min(1.0, max(0.0, free))
        return share, math.hypot(px - share * dx, py - share * dy), free > 1.0


def read_route(path: Path) -> Route:
    """From a CSV file; raises `ValueError` with the line that is wrong."""
    frame, lines = FRAMES["map"], []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if line.startswith("#"):
            name, _, value = line[1:].partition(":")
            frame = FRAMES.get(value.strip(), -1) if name.strip() == "frame_id" else frame
        elif line.strip():
            lines.append((number, line))
    columns = ("time_s", "x_m", "y_m", "heading_rad", "speed_mps")
    rows: list[tuple[float, ...]] = []
    for (number, _), cells in zip(lines[1:], csv.DictReader(line for _, line in lines), strict=False):
        try:
            row = tuple(float(cells[column]) for column in columns)
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{path}:{number}: needs a number for each of {', '.join(columns)}") from None
        if not all(map(math.isfinite, row)) or (rows and row[0] < rows[-1][0]):
            raise ValueError(f"{path}:{number}: not finite, or time runs backwards")
        rows.append(row)
    if frame < 0 or not rows:
        raise ValueError(f"{path}: needs points, and odom or map as frame_id")
    return Route(frame, rows)
