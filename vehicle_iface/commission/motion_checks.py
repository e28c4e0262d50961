"""Checks of the motion: which way a number moves when the person in the vehicle moves something."""

import cmath
import math
from collections import deque
from dataclasses import dataclass

from vehicle_iface.commission.checks import HELD, PERIOD_S, Check, CheckResult
from vehicle_iface.commission.readings import Moment
from vehicle_iface.review.findings import Judgement
from vehicle_iface.standstill import CREEPING_MPS
from vehicle_iface.units import wrapped_rad

ROLLED_M = (1.0, 4.0)
"""Distances that count as about two metres."""
_STOPPED_S = 1.0
_ASIDE_RAD = math.radians(30.0)
"""Maximum difference between a sensor's heading and the path of a short roll."""
_LEG_M = 0.5
"""Length of the pieces from which the path's direction is computed."""
_SMOOTHED = 10
"""Moments of which the mean is taken where noise would be taken for motion."""
_BRAKING_S = 3.0
_FACTOR = 2.0
"""A short braking measures the acceleration this well; g instead of m/s² is a factor of ten."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A number of the state."""

    name: str
    label: str
    unit: str
    signs: str = "left positive"

    def show(self, moment: Moment) -> str:
        """Return the present value as text."""
        value = moment.numbers.get(self.name)
        if value is None:
            return f"{self.name}: no value"
        return f"{self.name} {value:+.2f} {self.unit} ({self.signs})"


class TurnCheck(Check):
    """A number rises, or falls, from where it is when the step begins, by at least `least`."""

    def __init__(self, field: Field, *, sign: float, least: float, most: float, action: str, wrong: str) -> None:
        """`sign` is +1 where it must rise; a magnitude beyond `most` is `wrong`."""
        super().__init__(field.label)
        self._field, self._sign, self._least, self._most = field, sign, least, most
        self._action, self._wrong = action, wrong
        self._before: list[float] = []
        self._changed = self._extreme = 0.0
        self._held = 0

    def prepare(self, moment: Moment) -> None:
        value = moment.numbers.get(self._field.name)
        if value is not None:
            self._before.append(value)

    def take(self, moment: Moment) -> None:
        value = moment.numbers.get(self._field.name)
        if value is None:
            return
        if abs(value) > self._most:
            self._held += 1
            if self._held >= HELD:
                self.contradict(f"{self.label} reads {value:+.3g} {self._field.unit}: {self._wrong}")
            return
        if not self._before:
            self._before.append(value)
        self._note(value - sum(self._before) / len(self._before))

    def _note(self, change: float) -> None:
        is_same_side = change * self._changed > 0.0
        self._held = self._held + 1 if abs(change) >= self._least and (is_same_side or not self._held) else 0
        self._changed = change
        self._extreme = max(self._extreme, change, key=abs)
        if self._held < HELD:
            return
        if change * self._sign > 0.0:
            self.agree(f"{self.label} {_verb(change)} by {abs(change):.2f} {self._field.unit} when {self._action}")
        else:
            self.contradict(f"{self.label} {_verb(change)} when {self._action}: its sign is reversed")

    def show(self, moment: Moment) -> str:
        return self._field.show(moment)

    def explain(self) -> str:
        if not self._before:
            return f"no value of {self.label} came"
        unit = self._field.unit
        return f"{self.label} moved by {abs(self._extreme):.2g} {unit} at most, less than {self._least:.2g} {unit}"


class BendCheck(Check):
    """An angle grows by `least` in a bend to the left: a heading, or the sum of a yaw rate."""

    def __init__(self, field: Field, *, is_rate: bool, least_rad: float = 0.8) -> None:
        super().__init__(field.label)
        self._field, self._is_rate, self._least_rad = field, is_rate, least_rad
        self._before: float | None = None
        self._turned_rad = 0.0
        self._odd = 0

    def take(self, moment: Moment) -> None:
        value = moment.numbers.get(self._field.name)
        if value is None:
            return
        if not self._is_rate and abs(value) > 2.0 * math.pi + 0.1:
            self._odd += 1
            if self._odd >= HELD:
                self.contradict(f"{self.label} reads {value:+.3g} rad, more than a turn: it is in another unit")
            return
        if self._is_rate:
            self._turned_rad += value * PERIOD_S
        elif self._before is not None:
            self._turned_rad += wrapped_rad(value - self._before)
        self._before = value
        if self._turned_rad >= self._least_rad:
            self.agree(f"{self.label} turns left in a bend to the left")
        elif self._turned_rad <= -self._least_rad:
            reason = "its sign is reversed" if self._is_rate else "it is clockwise, like a compass"
            self.contradict(f"{self.label} turns right in a bend to the left: {reason}")

    def show(self, moment: Moment) -> str:
        return self._field.show(moment)

    def explain(self) -> str:
        if self._before is None:
            return f"no value of {self.label} came"
        return f"{self.label} turned by {self._turned_rad:+.2f} rad, {self._least_rad:g} rad were needed"


class PathCheck(Check):
    """The path by the position turns left in a bend to the left."""

    def __init__(self, label: str, *, least_rad: float = 0.8) -> None:
        super().__init__(label)
        self._least_rad = least_rad
        self._past: deque[complex] = deque(maxlen=_SMOOTHED)
        self._from_m: complex | None = None
        self._course_rad: float | None = None
        self._turned_rad = 0.0

    def take(self, moment: Moment) -> None:
        if moment.place_m is None:
            return
        self._past.append(complex(*moment.place_m))
        here_m = sum(self._past) / len(self._past)
        if self._from_m is None or abs(moment.numbers.get("speed_mps", 0.0)) < CREEPING_MPS:
            self._from_m = here_m
        if abs(here_m - self._from_m) < _LEG_M:
            return
        course_rad, self._from_m = cmath.phase(here_m - self._from_m), here_m
        self._turned_rad += wrapped_rad(course_rad - self._course_rad) if self._course_rad is not None else 0.0
        self._course_rad = course_rad
        if self._turned_rad >= self._least_rad:
            self.agree(f"the path by {self.label} turns left in a bend to the left")
        elif self._turned_rad <= -self._least_rad:
            self.contradict(
                f"the path by {self.label} turns right in a bend to the left: it is mirrored, "
                "x and y are swapped or one is reversed"
            )

    def show(self, moment: Moment) -> str:
        return show_place(moment)

    def explain(self) -> str:
        if self._from_m is None:
            return f"no value of {self.label} came"
        return f"the path by {self.label} turned by {self._turned_rad:+.2f} rad, {self._least_rad:g} rad were needed"


class RollCheck(Check):
    """Forward by two metres, then standing: the speed adds up to that, and the position moves along the heading."""

    def __init__(self, speed: Field, *, place: str | None, heading: str | None) -> None:
        """`place` and `heading` are the labels of the signals that are bound."""
        super().__init__(speed.label)
        self._speed, self._place, self._heading = speed, place, heading
        self._way_m = self._standing_s = 0.0
        self._speeds: deque[float] = deque(maxlen=_SMOOTHED)
        self._from_m: tuple[float, float] | None = None
        self._headings: list[complex] = []
        self._has_come = False

    def take(self, moment: Moment) -> None:
        speed_mps = moment.numbers.get(self._speed.name)
        if speed_mps is None or (self._place is not None and moment.place_m is None):
            return
        self._has_come = True
        if self._from_m is None:
            self._from_m = moment.place_m
        self._way_m += speed_mps * PERIOD_S
        self._speeds.append(speed_mps)
        if abs(sum(self._speeds)) > CREEPING_MPS * len(self._speeds):
            self._standing_s = 0.0
            heading_rad = moment.numbers.get("heading_rad")
            if heading_rad is not None:
                self._headings.append(complex(math.cos(heading_rad), math.sin(heading_rad)))
        else:
            self._standing_s += PERIOD_S
        if self._standing_s >= _STOPPED_S and abs(self._way_m) >= ROLLED_M[0]:
            self.results = (self._judge_speed(), *self._judge_place(moment.place_m))

    def _judge_speed(self) -> CheckResult:
        way_m = self._way_m
        if way_m < 0.0:
            text = f"{self.label} is negative when the vehicle rolls forward: its sign is reversed"
        elif way_m > ROLLED_M[1]:
            text = f"{self.label} adds up to {way_m:.1f} m when the vehicle rolls forward two metres: in another unit"
        else:
            text = f"{self.label} is positive and adds up to {way_m:.1f} m"
            return CheckResult(about=self.label, judgement=Judgement.AGREES, text=text)
        return CheckResult(about=self.label, judgement=Judgement.CONTRADICTED, text=text)

    def _judge_place(self, place_m: tuple[float, float] | None) -> tuple[CheckResult, ...]:
        if self._place is None or place_m is None or self._from_m is None:
            return ()
        dx_m, dy_m = place_m[0] - self._from_m[0], place_m[1] - self._from_m[1]
        moved_m = math.hypot(dx_m, dy_m)
        if not ROLLED_M[0] <= moved_m <= ROLLED_M[1]:
            text = f"{self._place} moves by {moved_m:.1f} m when the vehicle rolls forward two metres: in another unit"
            return (CheckResult(about=self._place, judgement=Judgement.CONTRADICTED, text=text),)
        text = f"{self._place} moves by {moved_m:.1f} m"
        if self._heading is None or not self._headings:
            return (CheckResult(about=self._place, judgement=Judgement.AGREES, text=text),)
        along = sum(self._headings)
        aside_rad = wrapped_rad(math.atan2(dy_m, dx_m) - math.atan2(along.imag, along.real))
        is_along = abs(aside_rad) <= _ASIDE_RAD
        text += f", {math.degrees(aside_rad):+.0f}° off the heading by {self._heading}"
        text += (
            "" if is_along else ", when the vehicle rolls forward: the zero of one of them is wrong, or its direction"
        )
        judgement = Judgement.AGREES if is_along else Judgement.CONTRADICTED
        return (CheckResult(about=self._place, judgement=judgement, text=text),)

    def show(self, moment: Moment) -> str:
        place = f", {show_place(moment)}" if self._place is not None else ""
        return f"{self._speed.show(moment)}, {self._way_m:+.1f} m rolled{place}"

    def explain(self) -> str:
        if not self._has_come:
            return f"no value of {self.label} came" + (f" together with {self._place}" if self._place else "")
        if abs(self._way_m) >= ROLLED_M[0]:
            return f"the vehicle did not stand still for {_STOPPED_S:g} s by {self.label}"
        return f"{self.label} adds up to {self._way_m:+.2f} m, at least {ROLLED_M[0]:g} m were needed"


class BrakingCheck(Check):
    """The acceleration adds up to what the speed loses within three seconds of braking."""

    def __init__(self, accel: Field, *, least_mps: float) -> None:
        super().__init__(accel.label)
        self._accel, self._least_mps = accel, least_mps
        self._past: deque[tuple[float, float]] = deque(maxlen=round(_BRAKING_S / PERIOD_S))
        """Magnitude of the speed, and integral of the acceleration since the beginning, both in m/s."""
        self._sum_mps = self._most_mps = 0.0

    def take(self, moment: Moment) -> None:
        speed_mps, accel_mps2 = moment.numbers.get("speed_mps"), moment.numbers.get(self._accel.name)
        if speed_mps is None or accel_mps2 is None:
            return
        self._sum_mps += accel_mps2 * PERIOD_S
        self._past.append((abs(speed_mps), self._sum_mps))
        fastest_mps, sum_then_mps = max(self._past)
        lost_mps, added_mps = fastest_mps - abs(speed_mps), self._sum_mps - sum_then_mps
        self._most_mps = max(self._most_mps, lost_mps)
        if lost_mps < self._least_mps:
            return
        what = f"{self.label} adds up to {added_mps:+.1f} m/s while the speed falls by {lost_mps:.1f} m/s"
        if lost_mps / _FACTOR <= -added_mps <= lost_mps * _FACTOR:
            self.agree(what)
        elif lost_mps / _FACTOR <= added_mps <= lost_mps * _FACTOR:
            self.contradict(f"{self.label} is positive while the vehicle brakes: its sign is reversed")
        else:
            self.contradict(f"{what}: one of them is in another unit, or another quantity")

    def show(self, moment: Moment) -> str:
        return self._accel.show(moment)

    def explain(self) -> str:
        if not self._past:
            return f"no value of {self.label} came together with the speed"
        return f"the speed fell by {self._most_mps:.1f} m/s at most, {self._least_mps:.1f} m/s within 3 s were needed"


def show_place(moment: Moment) -> str:
    """Return the present position as text."""
    if moment.place_m is None:
        return "position: no value"
    return f"x {moment.place_m[0]:+.2f} m, y {moment.place_m[1]:+.2f} m"


def _verb(change: float) -> str:
    return "rises" if change > 0.0 else "falls"
