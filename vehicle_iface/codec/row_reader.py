"""Compiles the fields, forms and conditions of a profile to two functions that read state and status from a row of
values.

Each is straight-line Python: it looks up no names and builds no dictionaries on the loop's path.
"""

from collections.abc import Iterator, Mapping

from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.enumerations import translate_from_wire
from vehicle_iface.codec.expressions import Find, Place, condition_expression, field_expression, place_of
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.pose import PoseInputs
from vehicle_iface.profile.forms import Condition
from vehicle_iface.profile.signals import DriverConditions
from vehicle_iface.profile.state_pose import POSE_SIGNALS, Mount
from vehicle_iface.row import MeasuredState, RowReader
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

_MODES = ("emergency_stop", "fault", "manual", "autonomous", "ready")
"""The modes in the order in which their conditions are checked."""
_OF_POSE = ("pose_frame", "pose_valid")
_POSE = ("x_m", "y_m", "heading_rad")
_MISSING = (TypeError, KeyError, InvalidValueError)
"""Exceptions that mean that the state is incomplete: a value is None, or a number does not name a frame of reference.
"""


def build_row_reader(binding: Binding, signals: Mapping[str, tuple[str, ...]], frames: Mapping[int, str]) -> RowReader:
    """Compile the row reader.

    `signals` maps each received message to the names of its signals, in the order of its values. `frames` maps numbers
    of `pose_frame` to frames of reference.
    """
    places: dict[str, slice] = {}
    columns: dict[str, int] = {}
    for message, names in signals.items():
        places[message] = slice(len(columns), len(columns) + len(names))
        columns |= {f"{message}.{name}": len(columns) + place for place, name in enumerate(names)}

    def find(dotted: str) -> Place:
        return place_of(columns[dotted], binding.view(dotted), translate_from_wire(binding, dotted))

    of_state = {columns[dotted] for of_field in binding.sections["state"].values() for dotted in of_field}
    of_status = {
        columns[dotted]
        for word, of_word in binding.sections["status"].items()
        for dotted in of_word
        if word != "gear"  # an unknown one is a gear, too
    }
    needed = of_state | of_status
    functions: dict[str, object] = {
        "VehicleState": VehicleState,
        "VehicleStatus": VehicleStatus,
        "MeasuredState": MeasuredState,
        "PoseInputs": PoseInputs,
        "FRAMES": dict(frames),
        "MODES": {int(mode): mode for mode in VehicleMode},
        "GEARS": {int(gear): gear for gear in Gear},
        "Mode": VehicleMode,
        "MISSING": _MISSING,
    }
    source = "\n".join([*_state_lines(binding, find), *_status_lines(binding, find)])
    exec(compile(source, f"<row of {binding.profile_name}>", "exec"), functions)
    multiplexed = frozenset(name for name in signals if binding.is_multiplexed(name))
    partial = {column for name in multiplexed for column in range(len(columns))[places[name]]}
    omissible = partial | {column for dotted, column in columns.items() if binding.view(dotted).rules.missing}
    return RowReader(
        empty=tuple(0 if column in of_state - partial else None for column in range(len(columns))),
        places=places,
        status_messages=binding.status_messages,
        driver_messages=frozenset(
            dotted.partition(".")[0] for of_word in binding.sections["status"].values() for dotted in of_word
        ),
        needed={name: frozenset(needed.intersection(range(where.start, where.stop))) for name, where in places.items()},
        multiplexed=multiplexed,
        read_state=functions["read_state"],  # type: ignore[arg-type]
        read_status=functions["read_status"],  # type: ignore[arg-type]
        omissible=tuple(sorted(of_status & omissible)),
    )


def _state_lines(binding: Binding, find: Find) -> Iterator[str]:
    state = binding.profile.state
    fields = {name: getattr(state.signals, name) for name in state.signals.__struct_fields__}
    bound = {name: field_expression(form, find) for name, form in fields.items() if form is not None}
    frame = f"FRAMES[{bound['pose_frame']}]" if "pose_frame" in bound else repr(state.frame_id)
    conditions = [f"float({bound['pose_valid']}) != 0.0"] if "pose_valid" in bound else []
    conditions += [condition_expression(state.pose.valid, find)] if state.pose.valid is not None else []
    is_located = state.pose.source != "local" or state.pose.mount != Mount()
    inputs = {name: source for name, source in bound.items() if name in PoseInputs.__struct_fields__}
    others = {name: source for name, source in bound.items() if name not in (*_OF_POSE, *POSE_SIGNALS)}
    pose = {name: f"pose.{name}" for name in _POSE} if is_located else {name: bound[name] for name in _POSE}
    yield "def read_state(stamp_ns, s, locate):"
    yield "    try:"
    yield f"        is_valid = {' and '.join(conditions) or 'True'}"
    if is_located:
        yield f"        pose, is_valid = locate(stamp_ns, is_valid, PoseInputs({_as_arguments(inputs)}))"
    yield f"        state = VehicleState(stamp_ns=stamp_ns, frame_id={frame}, {_as_arguments(pose | others)})"
    yield "        return MeasuredState(state, is_valid)"
    yield "    except MISSING:"
    yield "        return None"


def _as_arguments(sources: Mapping[str, str]) -> str:
    return ", ".join(f"{name}={source}" for name, source in sources.items())


def _status_lines(binding: Binding, find: Find) -> Iterator[str]:
    status = binding.profile.status
    signals, when, driver = status.signals, status.when, status.driver or DriverConditions()

    def number(dotted: str | None) -> str:
        return "0" if dotted is None else f"s[{find(dotted).column}] or 0"

    def flag(dotted: str | None, condition: Condition | None) -> str:
        parts = [f"bool({number(dotted)})"] if dotted is not None else []
        parts += [condition_expression(condition, find)] if condition is not None else []
        return " or ".join(parts) or "False"

    yield "def read_status(stamp_ns, s):"
    if when is None:
        assert signals.mode is not None
        yield f"    mode = MODES.get(s[{find(signals.mode).column}], Mode.FAULT)"
    else:
        conditions = [(name, getattr(when, name)) for name in _MODES]
        chain = [
            f"Mode.{name.upper()} if {condition_expression(condition, find)}"
            for name, condition in conditions
            if condition is not None
        ]
        yield f"    mode = {' else '.join([*chain, 'Mode.MANUAL'])}"
    yield f"    fault_code = int({number(signals.fault_code)})"
    yield "    if fault_code and mode is not Mode.EMERGENCY_STOP:"
    yield "        mode = Mode.FAULT"
    gear = "None" if signals.gear is None else f"GEARS.get(s[{find(signals.gear).column}])"
    yield "    return VehicleStatus("
    yield f"        stamp_ns=stamp_ns, mode=mode, gear={gear}, fault_code=fault_code,"
    yield f"        driver_brake={flag(signals.driver_brake, driver.brake)},"
    yield f"        driver_throttle={flag(signals.driver_throttle, driver.throttle)},"
    yield f"        driver_steers={flag(None, driver.steering)},"
    yield f"        driver_steer_torque_nm=float({number(signals.driver_steer_torque_nm)}),"
    yield "    )"
