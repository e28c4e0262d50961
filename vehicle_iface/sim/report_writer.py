"""Convert a vehicle's report to the values of the sent signals: the reverse of `codec.row_reader`.

Each signal is compiled to a function of the report once, at the start.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import cycle
from operator import attrgetter
from typing import NamedTuple, TypeVar

from vehicle_iface.codec.branches import find_branches, is_shown
from vehicle_iface.codec.compiled import Value
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.codec.signal_view import SignalView
from vehicle_iface.pose import Pose, PoseInputs, build_pose_sensor
from vehicle_iface.profile.forms import FieldForm, FieldSource
from vehicle_iface.profile.state_pose import POSE_SIGNALS, Mount
from vehicle_iface.sim.condition_solver import holds, zero_and_more
from vehicle_iface.sim.condition_values import NEXT_BEST, ConditionValues, RowSignal, Wanted
from vehicle_iface.sim.demands import Handshake
from vehicle_iface.sim.report import VehicleReport
from vehicle_iface.status import Gear, VehicleMode

_PERIODS = {"heading_rad": math.tau, "longitude_deg": 360.0}
"""Periodic fields, and their periods."""
_Number = TypeVar("_Number", VehicleMode, Gear)
_FAULTS = (VehicleMode.FAULT, VehicleMode.EMERGENCY_STOP)


class _Instant(NamedTuple):
    """Data from which the signals of one report are computed."""

    report: VehicleReport
    pose: VehicleReport | PoseInputs
    """Measurement of the position sensor."""
    chosen: Mapping[str, float]
    """Values of the signals in conditions, as in the row."""


Term = Callable[[_Instant], Value]
"""A signal's value in the DBC's unit."""
Getter = Callable[[_Instant], float]
"""Function that returns a field's value."""


class ReportWriter:
    """Computes the values of all received messages of a profile."""

    def __init__(
        self, database: VehicleDatabase, handshakes: Mapping[str, Handshake], *, override_torque_nm: float
    ) -> None:
        """`handshakes` are by MESSAGE.SIGNAL. Raises `ConfigError` for conditions that no values satisfy."""
        self._handshakes = handshakes
        self._profile = database.profile
        self._override_torque_nm = override_torque_nm
        self._signals = {
            f"{message.name}.{name}": RowSignal(view=view, from_wire=table)
            for message in database.received
            for name, view, table in zip(message.codec.names, message.signals, message.from_wire, strict=True)
        }
        state = self._profile.state
        forms = {field: getattr(state.signals, field) for field in state.signals.__struct_fields__}
        self._sources: dict[str, FieldSource] = {field: form for field, form in forms.items() if form is not None}
        status = self._profile.status.signals
        self._status = {name: getattr(status, name) for name in status.__struct_fields__ if getattr(status, name)}
        bound = {dotted for source in self._sources.values() for dotted in _value_signals(source)}
        self._conditions = ConditionValues(self._profile, self._signals, bound | set(self._status.values()))
        self._getters = {field: _getter(field) for field in self._sources}
        self._signed = [
            (self._getters[field], form)
            for field, form in self._sources.items()
            if isinstance(form, FieldForm) and form.negative_if
        ]
        is_located = state.pose.source != "local" or state.pose.mount != Mount()
        self._sensor = build_pose_sensor(self._profile) if is_located else None
        terms = dict(self._terms())
        self._terms_of = {
            message.name: tuple(terms.get(f"{message.name}.{name}", _nothing) for name in message.codec.names)
            for message in database.received
        }
        self._fixed = {dotted: terms[dotted] for dotted in self._conditions.fixed}
        self._branches = {
            message.name: cycle(_build_masks(message))
            for message in database.received
            if database.row.multiplexed & {message.name}
        }
        self._instant: _Instant | None = None

    def values_of(self, message: str, report: VehicleReport) -> tuple[Value, ...]:
        """Return the values of a message in the order and units of its codec; of a multiplexed message the next branch.

        Raises `InvalidValueError` for a position that the vehicle's sensor cannot measure.
        """
        instant = self._instant
        if instant is None or instant.report is not report:
            instant = self._instant = self._prepare(report)
        values = tuple([term(instant) for term in self._terms_of[message]])
        if message in self._branches:
            values = tuple(replace(value) for replace, value in zip(next(self._branches[message]), values, strict=True))
        return values

    def _prepare(self, report: VehicleReport) -> _Instant:
        pose: VehicleReport | PoseInputs = report
        if self._sensor is not None:
            pose = self._sensor(Pose(x_m=report.x_m, y_m=report.y_m, heading_rad=report.heading_rad))
        instant = _Instant(report, pose, {})
        if not self._conditions:
            return instant
        wanted = Wanted(
            mode=report.mode,
            brake=report.driver_brake,
            throttle=report.driver_throttle,
            steering=abs(report.driver_steer_torque_nm) >= self._override_torque_nm,
            valid=report.pose_valid,
            signs=tuple([get(instant) < 0.0 for get, _ in self._signed]),
        )
        fixed = {dotted: self._to_row(dotted, term(instant)) for dotted, term in self._fixed.items()}
        return instant._replace(chosen=self._conditions.choose(wanted, fixed))

    def _to_row(self, dotted: str, value: Value) -> float:
        """Return the value that the receiver decodes."""
        signal, value = self._signals[dotted], value or 0.0
        if signal.from_wire is not None:
            return signal.from_wire.get(int(value), 0)
        return signal.view.find_nearest(signal.view.to_field(value)) or 0.0

    # --- terms

    def _terms(self) -> Iterator[tuple[str, Term]]:
        """List MESSAGE.SIGNAL and its term, of fields and conditions; of several for one signal the last is valid."""
        for dotted, handshake in self._handshakes.items():
            yield dotted, _handshake_term(handshake)
        for dotted in self._conditions.free:
            yield dotted, self._condition_term(dotted)
        for field, source in self._sources.items():
            yield from self._state_terms(field, source)
        for field, dotted in self._status.items():
            yield dotted, self._status_term(field, dotted)

    def _condition_term(self, dotted: str) -> Term:
        view = self._view(dotted)
        return lambda instant: view.to_wire(instant.chosen[dotted])

    def _state_terms(self, field: str, source: FieldSource) -> Iterator[tuple[str, Term]]:
        get = self._getters[field]
        if isinstance(source, str):
            yield source, self._plain_term(field, source)
        elif source.value is not None:
            yield source.value, self._signed_term(get, source)
        elif source.mean is not None:
            yield from ((dotted, _clamp(self._view(dotted), get)) for dotted in source.mean)
        elif source.sum is not None:
            views = [self._view(dotted) for dotted in source.sum]
            yield from ((dotted, _part_term(views, place, get)) for place, dotted in enumerate(source.sum))

    def _plain_term(self, field: str, dotted: str) -> Term:
        """Return the term of an unclamped value: the codec rejects it beyond the range."""
        view, get = self._view(dotted), self._getters[field]
        if field == "pose_valid":
            return self._flag_term(dotted, attrgetter("pose_valid"))
        period = _PERIODS.get(field)
        low, high = view.field_range
        if period is None or (low <= -period / 2 and high >= period / 2):
            return get if not view.is_converted else lambda instant: view.to_wire(get(instant))

        def write(instant: _Instant) -> float:
            value = get(instant)
            turned = (value, value + period, value - period)
            return view.to_wire(next((one for one in turned if low <= one <= high), value))

        return write

    def _signed_term(self, get: Getter, form: FieldForm) -> Term:
        assert form.value is not None
        view, sign, find = self._view(form.value), form.negative_if, self._conditions.find
        if sign is None:
            return _clamp(view, get)

        def magnitude(instant: _Instant) -> float:
            value = get(instant)
            is_negative = holds(sign, instant.chosen, find) if instant.chosen else value < 0.0
            return -value if is_negative else value

        return _clamp(view, magnitude)

    def _status_term(self, field: str, dotted: str) -> Term:
        view = self._view(dotted)
        if field == "mode":
            modes = _choose_number(NEXT_BEST, self._numbers(dotted))
            return lambda instant: modes[instant.report.mode]
        if field == "gear":
            order = {gear: (gear, Gear.NEUTRAL, Gear.PARK, Gear.DRIVE) for gear in Gear}
            gears = _choose_number(order, self._numbers(dotted))
            return lambda instant: gears[instant.report.gear]
        if field == "driver_steer_torque_nm":
            return _clamp(view, lambda instant: instant.report.driver_steer_torque_nm)
        if field == "fault_code":
            return self._fault_code_term(dotted)
        return self._flag_term(dotted, attrgetter(field))

    def _flag_term(self, dotted: str, is_set: Callable[[VehicleReport], bool]) -> Term:
        """Return the term of a flag: 0, or the smallest number that is not 0."""
        off, on = zero_and_more(self._view(dotted))
        return lambda instant: on if is_set(instant.report) else off

    def _fault_code_term(self, dotted: str) -> Term:
        """Return the term of the fault code, at least 1 for a fault that the mode does not express."""
        view, modes = self._view(dotted), self._status.get("mode")
        _, least = zero_and_more(view)
        expressed = self._numbers(modes) if modes is not None else {}
        is_told = any(mode in expressed if modes else self._conditions.can_express(mode) for mode in _FAULTS)

        @cache
        def find(code: int) -> float:
            nearest = view.find_nearest(code)
            return least if nearest is None or (code and not nearest) else view.to_wire(nearest)

        def write(instant: _Instant) -> float:
            report = instant.report
            return find(report.fault_code or int(not is_told and report.mode in _FAULTS))

        return write

    def _numbers(self, dotted: str) -> dict[int, int]:
        """Return the program's number → the DBC's number of an enumeration."""
        signal = self._signals[dotted]
        table = signal.from_wire or {number: number for number in signal.view.names}
        return {ours: number for number, ours in reversed(list(table.items()))}

    def _view(self, dotted: str) -> SignalView:
        return self._signals[dotted].view


def _value_signals(source: FieldSource) -> tuple[str, ...]:
    if isinstance(source, str):
        return (source,)
    return (source.value,) if source.value is not None else source.mean or source.sum or ()


def _getter(field: str) -> Getter:
    return attrgetter(f"pose.{field}" if field in POSE_SIGNALS else f"report.{field}")


def _handshake_term(handshake: Handshake) -> Term:
    return lambda _: handshake.value


def _nothing(_: _Instant) -> Value:
    return None


def _clamp(view: SignalView, get: Getter) -> Term:
    """Return the nearest value that the signal can carry."""
    low, high = (view.find_nearest(end) if math.isfinite(end) else end for end in view.field_range)
    if low is not None and high is not None and not view.names and not view.rules.missing:
        return lambda instant: view.to_wire(min(high, max(low, get(instant))))

    def write(instant: _Instant) -> float:
        nearest = view.find_nearest(get(instant))
        return view.to_wire(nearest) if nearest is not None else view.low

    return write


def _part_term(views: Sequence[SignalView], place: int, get: Getter) -> Term:
    view = views[place]
    return lambda instant: view.to_wire(split(get(instant), views)[place])


def split(value: float, views: Sequence[SignalView]) -> list[float]:
    """Split `value` into parts: the coarsest signal carries the most that leaves a rest for the finer ones."""
    parts, rest = [0.0] * len(views), value
    coarsest_first = sorted(range(len(views)), key=lambda place: -views[place].resolution)
    for index, place in enumerate(coarsest_first):
        finer = [views[other].field_range for other in coarsest_first[index + 1 :]]
        middle = sum(low + high for low, high in finer) / 2
        parts[place] = views[place].find_nearest(rest - middle if math.isfinite(middle) else rest) or 0.0
        rest -= parts[place]
    return parts


def _choose_number(order: Mapping[_Number, tuple[_Number, ...]], numbers: Mapping[int, int]) -> dict[_Number, int]:
    """Return for each the number on the wire of the first alternative that has one; else any."""
    other = next(iter(numbers.values()), 0)
    return {
        one: next((numbers[int(best)] for best in ways if int(best) in numbers), other) for one, ways in order.items()
    }


def _build_masks(message: BoundMessage) -> Iterator[list[Callable[[Value], Value]]]:
    """Return the mask of each branch over the values of the message."""
    by_name = {view.signal.name: view.signal for view in message.signals}
    for branch in find_branches(by_name.values()):
        yield [
            _constant(branch[name]) if name in branch else _same if is_shown(signal, branch, by_name) else _nothing_of
            for name, signal in by_name.items()
        ]


def _constant(number: int) -> Callable[[Value], Value]:
    return lambda _: number


def _same(value: Value) -> Value:
    return value


def _nothing_of(_: Value) -> Value:
    return None
