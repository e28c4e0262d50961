"""Write a draft as the text of a profile: bindings with reasons, and everything missing marked TODO."""

import os
from collections.abc import Iterator
from pathlib import Path

from vehicle_iface.drafting.draft import Draft
from vehicle_iface.drafting.field_lines import align, quote
from vehicle_iface.drafting.notes import write_message_notes, write_protection, write_signal_notes
from vehicle_iface.drafting.survey import MessageFacts
from vehicle_iface.drafting.tables import write_bus, write_command, write_further, write_state, write_status
from vehicle_iface.drafting.unknowns import write_unknown_tables


def write_draft(draft: Draft, out: Path | None = None) -> str:
    """Write the text of the profile, for the file `out`; the DBC's path is relative to that file's folder."""
    lines = [
        *_write_head(draft, out),
        *write_bus(draft),
        *write_state(draft),
        *write_status(draft),
        *write_command(draft),
        *write_further(draft),
        *write_signal_notes(draft),
        *write_message_notes(draft),
        *write_protection(draft),
        *write_unknown_tables({"timing": dict(_known_periods(draft))}, {"limits": list(_range_hints(draft))}),
    ]
    return "\n".join(lines).rstrip("\n") + "\n"


def _write_head(draft: Draft, out: Path | None) -> Iterator[str]:
    survey = draft.survey
    yield f"# A first draft by `vehicle-iface new-profile {survey.path.name}`. It has not been checked."
    yield "#"
    counts = f"{draft.bound_count} fields are bound, each with its line in the DBC and the reason"
    yield f"# {counts}; {draft.open_count} are left for you to choose."
    yield "# Numbers that no DBC contains, and what is not certain, are marked TODO."
    yield "# A signal with a matching name may still mean something else: compare each with the vendor's description."
    yield "# Signs: x forward, y left, angles and yaw rate positive to the left."
    yield "# Next: complete every TODO, then run `vehicle-iface check-dbc` on this file until it reports nothing."
    if survey.unusable:
        yield f"# Parts of the DBC have faults and are not used ({survey.unusable}); `check-dbc` on the DBC lists them."
    yield ""
    yield f"name = {quote((out or survey.path).stem)}"
    yield f"dbc = {quote(Path(os.path.relpath(survey.path, out.parent if out else '.')).as_posix())}"
    yield align("reviewed = false", "true once limits and signs have been checked against the vehicle itself")
    yield ""


def _known_periods(draft: Draft) -> Iterator[tuple[str, str]]:
    """Return the lines of `[timing]` that follow from cycle times."""
    messages = draft.survey.messages
    used: dict[str, tuple[MessageFacts, ...]] = {
        "sample_period_s": tuple(messages[name] for name in draft.sample[:1]),
        "status_period_s": tuple(message for name, message in messages.items() if name in draft.mode_messages),
        "command_period_s": draft.bound_messages("command"),
        "body_period_s": draft.bound_messages("body"),
        "report_period_s": draft.bound_messages("report"),
    }
    for key, found in used.items():
        fastest = min((message for message in found if message.cycle_ms), key=lambda one: one.cycle_ms, default=None)
        if fastest is not None:
            yield key, align(f"{key} = {fastest.cycle_ms / 1000:g}", f"cycle time of {fastest.name}")
        elif not found and key in ("body_period_s", "report_period_s"):
            yield key, align(f"{key} = 0.1", "no such message is bound: without effect")


def _range_hints(draft: Draft) -> Iterator[str]:
    """Write the ranges of the command's signals: the limits must lie within them."""
    for (section, name), field in draft.fields.items():
        if section == "command" and field.value is not None and field.rule.typical[1]:
            for signal in (one.signal for one in field.chosen if one.signal.low is not None):
                unit = signal.unit or "(no unit)"
                yield f"{signal.dotted} ({name}) carries {signal.low:g} … {signal.high:g} {unit}"
