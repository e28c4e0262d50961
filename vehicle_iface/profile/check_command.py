"""Checks `[command]`: the bound signals against its forms, the tables of the pedals, and the limits."""

import itertools
from collections.abc import Iterator

from vehicle_iface.profile.command_forms import FORM_SIGNALS, Pedals
from vehicle_iface.profile.schema import Profile
from vehicle_iface.profile.signals import Command

ALSO_WITH_OTHERS = "speed_mps"
"""The signal of the form "speed"; with another form it carries the reference speed."""


def check_command(profile: Profile) -> Iterator[str]:
    """Return every fault of the table with its place; `check_tables` reports the signals that are missing."""
    command = profile.command
    for key, forms in FORM_SIGNALS.items():
        chosen = getattr(command, key)
        for form, fields in forms.items():
            for field in fields:
                bound = getattr(command.signals, field)
                if bound is None or field in forms[chosen] or field == ALSO_WITH_OTHERS:
                    continue
                text = f'belongs to {key} = "{form}", and $.command.{key} is "{chosen}"; remove it, or change that'
                yield f"$.command.signals.{field}: {bound}: {text}"
    if command.longitudinal in ("drive_and_brake", "pedals"):
        yield from _check_gear(profile, command)
    if command.pedals is not None and command.longitudinal != "pedals":
        text = f'only with longitudinal = "pedals", and it is "{command.longitudinal}"; remove it'
        yield f"$.command.pedals: {text}"
    elif command.pedals is not None:
        yield from _check_pedals(profile, command.pedals)
    elif command.longitudinal == "pedals":
        yield '$.command: pedals is missing; $.command.longitudinal = "pedals" needs its tables throttle and brake'


def _check_gear(profile: Profile, command: Command) -> Iterator[str]:
    """Check that the vehicle reports its gear: nothing may drive before the requested gear is engaged."""
    if command.signals.gear_request is not None and profile.status.signals.gear is None:
        text = f'longitudinal = "{command.longitudinal}" with a gear_request needs the gear that is in'
        yield f"$.status.signals: gear is missing; {text}"


def _check_pedals(profile: Profile, pedals: Pedals) -> Iterator[str]:
    limits = profile.limits
    for pedal, key, needed_mps2 in (
        ("throttle", "accel_max_mps2", limits.accel_max_mps2),
        ("brake", "accel_min_mps2", -limits.accel_min_mps2),
    ):
        rows, place = getattr(pedals, pedal), f"$.command.pedals.{pedal}"
        if rows[0][0] != 0.0:
            yield f"{place}[0][0]: {rows[0][0]}: the first row must be for an acceleration of 0"
        for row, (before, after) in enumerate(itertools.pairwise(rows), start=1):
            for column in (0, 1):
                if not before[column] < after[column]:
                    text = f"must be above the row before it, {before[column]}"
                    yield f"{place}[{row}][{column}]: {after[column]}: {text}"
        if rows[-1][0] < needed_mps2:
            text = f"{place} ends at {rows[-1][0]} m/s²; add a row for this limit, or lower it"
            yield f"$.limits.{key}: {getattr(limits, key)}: {text}"
    if pedals.feedback is not None and profile.state.signals.accel_mps2 is None:
        yield "$.command.pedals.feedback: $.state.signals.accel_mps2 is missing: there is no acceleration to go by"
