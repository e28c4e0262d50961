"""The tables of a profile that follow from a DBC: bus, state, status, command, body and report."""

from collections.abc import Iterator, Sequence

from vehicle_iface.drafting.draft import Draft
from vehicle_iface.drafting.field_lines import align, format_value, name_some, quote, write_fields
from vehicle_iface.drafting.names import write_frames, write_gears, write_modes
from vehicle_iface.drafting.notes import find_e2e
from vehicle_iface.drafting.rules import Section
from vehicle_iface.drafting.survey import MessageFacts
from vehicle_iface.profile.signals import Command, CommandSignals

_AGE_PERIODS = 2.5
_POSE_NEEDS = {
    "local": {
        "x_m": "a position in m, or [state.pose] with another source",
        "y_m": "as x_m",
        "heading_rad": "the heading",
    },
    "geographic": {"heading_rad": "the heading"},
    "odometry": {},
}
_POSE_FIELDS = ("x_m", "y_m", "latitude_deg", "longitude_deg", "heading_rad", "pose_frame", "pose_valid")
_POSE_REASONS = {
    "geographic": "latitude and longitude were found, no position in metres",
    "odometry": "no position was found: reckoned from speed and turning; its error grows with the distance",
}
_OTHER_FORMS = ("drive_mps2", "brake_mps2", "throttle", "brake", "curvature_per_m", "yaw_rate_radps")


def write_bus(draft: Draft) -> Iterator[str]:
    """Write `[bus]`."""
    yield "[bus]"
    if draft.survey.bit_rate is not None:
        yield align(f"bitrate = {draft.survey.bit_rate}", "the DBC's attribute Baudrate")
    else:
        yield align("# missing: bitrate", "TODO bits per second, such as 500000")
    if any(message.is_fd for message in draft.bound_messages("state", "status", "command")):
        yield align("fd = true", "the DBC has messages of CAN FD")
        yield align("# data_bitrate = …", "TODO bits per second of the data phase, where it is another one")
    yield ""


def write_state(draft: Draft) -> Iterator[str]:
    """Write `[state]` with its sample, `[state.pose]` and `[state.signals]`."""
    yield "[state]"
    messages = [draft.survey.messages[name] for name in draft.sample]
    if messages:
        periods = ", ".join(f"{one.cycle_ms} ms" if one.cycle_ms else "no period" for one in messages)
        yield align(f"sample = {format_value(draft.sample)}", f"these messages are one sample: {periods}")
    else:
        yield align("# missing: sample", "TODO needed: the messages with position and speed")
    if len(messages) > 1 and not {*draft.sample} <= {one.name for one in find_e2e(draft)}:
        yield align('assemble = "newest"', '"counter" where they carry the same counter')
        yield align(f"trigger = {quote(draft.sample[0])}", "its arrival completes a sample")
        ages = [f"{one.name} = {_AGE_PERIODS * one.cycle_ms / 1000:g}" for one in messages[1:] if one.cycle_ms]
        text = f"TODO decide; these are {_AGE_PERIODS} periods" if ages else "TODO seconds"
        yield align(f"# max_age_s = {{ {', '.join(ages) or '…'} }}", text)
    yield ""
    if draft.pose_source != "local":
        yield "[state.pose]"
        yield align(f'source = "{draft.pose_source}"', _POSE_REASONS[draft.pose_source])
        if draft.pose_source == "geographic":
            yield align('origin = "first"', "the first fix; or [latitude, longitude] in degrees")
            yield align("# mount = { x_m = …, y_m = … }", "TODO measure: the antenna, from the rear axle's centre")
        yield ""
    yield "[state.signals]"
    needed = _POSE_NEEDS[draft.pose_source] | {"speed_mps": "the vehicle's speed, or the mean of wheel speeds"}
    unused = {*_POSE_FIELDS} - needed.keys() - ({"pose_valid"} if draft.pose_source != "odometry" else set())
    yield from write_fields(draft, "state", needed, unused)
    yield ""
    yield from write_frames(draft)


def write_status(draft: Draft) -> Iterator[str]:
    """Write `[status.when]` or a mode, and the other fields of the status."""
    if draft.flags is not None:
        yield align("[status.when]", "the first that holds is the mode; TODO check what each flag means")
        for mode, kind, signals in (
            ("fault", "any", draft.flags.fault),
            ("manual", "any", draft.flags.override),
            ("autonomous", "all", draft.flags.enabled),
        ):
            if signals:
                value = format_value(tuple(one.dotted for one in signals))
                yield align(f"{mode} = {{ {kind} = {value} }}", f"lines {', '.join(str(one.line) for one in signals)}")
        yield align("# ready = { all = [] }", "TODO otherwise; or the flag by which it says that it may be enabled")
        yield ""
    yield "[status.signals]"
    needed = {} if draft.flags is not None else {"mode": "a signal that says who drives, or [status.when] with flags"}
    yield from write_fields(draft, "status", needed, {"mode"} - needed.keys())
    yield ""
    yield from write_modes(draft)
    yield from write_gears(draft)


def write_command(draft: Draft) -> Iterator[str]:
    """Write `[command]` in the form that the signals allow; without such signals a remark."""
    messages = draft.bound_messages("command")
    if not messages:
        yield align(
            "# missing: [command]", "no message that a controller would send was found: this profile only watches"
        )
        yield ""
        return
    yield from _write_forms(draft)
    yield from _write_periods(messages)
    yield "[command.signals]"
    needed = {"enable": "a flag that is 1 while the program drives"}
    if draft.longitudinal == "acceleration":
        needed["accel_mps2"] = "an acceleration, or the signals of another form: speed, drive and brake, pedals"
    if draft.lateral == "wheel_angle":
        needed["front_wheel_angle_rad"] = "a wheel angle, or the signal of another form: curvature, yaw rate"
    unused = {*_OTHER_FORMS, "accel_mps2", "front_wheel_angle_rad", "reason"} - needed.keys()
    yield from write_fields(draft, "command", needed, unused, CommandSignals.__struct_fields__)
    bound = {one.dotted for one in draft.bound_signals("command")}
    branches = {f"{one.message}.{one.multiplexer}" for one in draft.bound_signals("command") if one.multiplexer}
    yield from (f"# TODO [constants] must say which branch is sent, by {dotted}" for dotted in sorted(branches))
    rest = [one.dotted for message in messages for one in message.signals if not _is_protection(one.words)]
    rest = [dotted for dotted in rest if dotted not in bound]
    if rest:
        yield f"# no field fills these, [constants] may: {name_some(rest)}"
    yield ""


def _is_protection(words: Sequence[str]) -> bool:
    return not {"checksum", "counter"}.isdisjoint(words)


def _write_forms(draft: Draft) -> Iterator[str]:
    forms = {"longitudinal": (draft.longitudinal, "acceleration"), "lateral": (draft.lateral, "wheel_angle")}
    chosen = [f'{key} = "{form}"' for key, (form, default) in forms.items() if form != default]
    has_forms = "longitudinal" in Command.__struct_fields__
    if chosen:
        yield "[command]" if has_forms else align("# [command]", "TODO this version has no such keys yet")
        yield from (align(f"{'' if has_forms else '# '}{line}", "by the signals that were found") for line in chosen)
        yield ""
    if draft.longitudinal == "pedals":
        yield align("# [command.pedals]", "TODO measure: rows of acceleration in m/s² and pedal")
        yield "# throttle = [[0.0, 0.0], …]"
        yield "# brake = [[0.0, 0.0], …]"
        yield ""


def _write_periods(messages: Sequence[MessageFacts]) -> Iterator[str]:
    """Write the periods of messages that are sent less often than the fastest one."""
    fastest = min((message.cycle_ms for message in messages if message.cycle_ms), default=0)
    slow = [message for message in messages if message.cycle_ms > fastest]
    if slow:
        mark = "" if "periods" in Command.__struct_fields__ else "# "
        yield align(f"{mark}[command.periods]", "by the cycle times of the DBC")
        yield from (f"{mark}{message.name} = {message.cycle_ms / 1000:g}" for message in slow)
        yield ""


def write_further(draft: Draft) -> Iterator[str]:
    """Write `[body]` and `[report]`, where the DBC has such messages."""
    sections: tuple[Section, ...] = ("body", "report")
    for section in sections:
        names = [name for own, name in draft.fields if own == section]
        if draft.bound_signals(section):
            yield f"[{section}.signals]"
            yield from write_fields(draft, section, {}, names)
            yield ""
