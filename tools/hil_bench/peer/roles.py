"""Which end sends which message of a profile, and how often."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from hil_bench.peer.conditions import signals_of
from hil_bench.peer.layout import Layout
from hil_bench.peer.signals import cycle_s, field_signals, received_signals, sources_of

SHORTEST_WATCHDOG_S, WATCHDOG_PERIODS = 0.1, 10
"""A command is lost after ten of its own periods, but not before 0.1 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Roles:
    """Messages by what they are for; periods in s."""

    sample: tuple[str, ...]
    is_counted: bool
    """The messages of a sample share a counter; else the newest of each make one when the trigger comes."""
    trigger: str
    status: tuple[str, ...]
    """The messages beside the sample that say who drives."""
    periods_s: Mapping[str, float]
    """Of everything that the vehicle sends, in its order."""
    command: tuple[str, ...]
    """The messages of a command that come in its shortest period."""
    command_period_s: float
    periods_of_commands: Mapping[str, float]
    watched_s: Mapping[str, float]
    """For how long each message of a command may be missing."""
    of_device: tuple[str, ...]
    reports: tuple[str, ...]
    """Lights and reports of the device."""
    besides_s: Mapping[str, float]
    """Periods of what the device sends besides the commands of the shortest period, where the profile says so."""


def read_roles(profile: Mapping[str, Any], layout: Layout) -> Roles:
    """From `[state]`, `[status]`, `[command]` and `[[send]]`."""
    timing, state, command = profile["timing"], profile["state"], profile["command"]
    sample = tuple(state["sample"])
    fields = [name for names in field_signals(profile).values() for name in names]
    commands = _owners([*fields, *command.get("values", {})])
    base_s = float(timing["command_period_s"])
    periods = {name: float(command.get("periods", {}).get(name, base_s)) for name in commands}
    reported = (profile.get(part, {}).get("signals", {}).values() for part in ("body", "report"))
    reports = [
        one for one in _owners(n for forms in reported for f in forms for n in sources_of(f)) if one not in periods
    ]
    sends = [str(send["message"]) for send in profile.get("send", ())]
    is_counted = _is_counted(profile, sample)
    trigger = sample[-1] if is_counted else state.get("trigger", sample[0])
    return Roles(
        sample=sample,
        is_counted=is_counted,
        trigger=trigger,
        status=tuple(name for name in _owners(_told(profile)) if name not in sample),
        periods_s=_sent_periods(profile, layout, sample, trigger=trigger, is_counted=is_counted),
        command=tuple(name for name in commands if periods[name] == min(periods.values())),
        command_period_s=min(periods.values()),
        periods_of_commands=periods,
        watched_s={name: max(SHORTEST_WATCHDOG_S, WATCHDOG_PERIODS * period_s) for name, period_s in periods.items()},
        of_device=tuple(dict.fromkeys([*commands, *sends, *reports])),
        reports=tuple(reports),
        besides_s={
            **{name: period_s for name, period_s in periods.items() if period_s > min(periods.values())},
            **{
                str(send["message"]): float(send["period_s"])
                for send in profile.get("send", ())
                if "period_s" in send and send["when"] in ("always", "armed")
            },
            **_report_periods(profile, reports),
        },
    )


def _report_periods(profile: Mapping[str, Any], reports: Collection[str]) -> dict[str, float]:
    found = {}
    for part in ("body", "report"):
        forms = profile.get(part, {}).get("signals", {}).values()
        for name in _owners(name for form in forms for name in sources_of(form)):
            if name in reports:
                found[name] = float(profile["timing"][f"{part}_period_s"])
    return found


def _owners(signals: Any) -> list[str]:
    return list(dict.fromkeys(name.partition(".")[0] for name in signals))


def _told(profile: Mapping[str, Any]) -> list[str]:
    """The signals that say who drives."""
    status = profile.get("status", {})
    tables = [condition for table in ("when", "driver") for condition in status.get(table, {}).values()]
    return [*(name for one in tables for name in signals_of(one)), *status.get("signals", {}).values()]


def _is_counted(profile: Mapping[str, Any], sample: tuple[str, ...]) -> bool:
    ids = profile.get("e2e", {}).get("data_ids", {})
    default = "counter" if len(sample) > 1 and all(name in ids for name in sample) else "newest"
    return bool(profile["state"].get("assemble", default) == "counter")


def _sent_periods(
    profile: Mapping[str, Any], layout: Layout, sample: tuple[str, ...], *, trigger: str, is_counted: bool
) -> dict[str, float]:
    """What the vehicle sends: first what is outside the sample, last what completes one."""
    timing = profile["timing"]
    status_s, sample_s = float(timing["status_period_s"]), float(timing["sample_period_s"])
    others = [name for name in _owners(received_signals(profile)) if name not in sample]
    periods_s = {name: cycle_s(profile, layout.messages[name], status_s) for name in others}
    for name in sorted(sample, key=lambda one: one == trigger):
        is_free = not is_counted and name != trigger
        periods_s[name] = cycle_s(profile, layout.messages[name], sample_s) if is_free else sample_s
    return periods_s
