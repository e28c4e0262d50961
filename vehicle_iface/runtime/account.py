"""What happened: every counter by room and cause, while the loop runs and at its end."""

import logging
from collections.abc import Mapping
from typing import Any

from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.pilot import Pilot
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.safety.engagement import Engagement, Mode
from vehicle_iface.safety.outlet import Outlet
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.tracker import Tracker
from vehicle_iface.units import s_from_ns

log = logging.getLogger(__name__)

MAX_TRANSITIONS = 1000


class Account:
    """Reads what the rooms count, and keeps the changes of mode."""

    def __init__(
        self,
        decoder: Decoder,
        encoder: Encoder,
        tracker: Tracker,
        pilot: Pilot,
        outlet: Outlet,
        plausibility: PlausibilityCheck,
        counts: Counts,
        link: Link,
        shadow: Shadow | None,
        names: Mapping[tuple[int, bool], str],
        started_ns: int,
    ) -> None:
        """`names` are those of the identifiers that the profile knows, each with whether it is extended."""
        self._decoder, self._encoder, self._tracker = decoder, encoder, tracker
        self._pilot, self._outlet, self._plausibility = pilot, outlet, plausibility
        self._counts, self._link, self._shadow, self._names = counts, link, shadow, names
        self._started_ns = started_ns
        self._reason = Reason.NOT_ENGAGED
        self._latched_fault: str | None = None
        self._transitions: list[dict[str, Any]] = []

    def note(self, engagement: Engagement, reason: Reason) -> None:
        """Say each change of mode or reason once, and keep the first changes of mode for the summary."""
        for when_ns, mode, why in engagement.transitions:
            if mode in (Mode.FAULT, Mode.SILENT):
                self._latched_fault = why.name
            elif mode is Mode.STARTING:
                self._latched_fault = None
            log.info("%s (%s)", mode.name, why.name)
            if len(self._transitions) < MAX_TRANSITIONS:
                self._transitions.append({"at_s": self._since_start_s(when_ns), "mode": mode.name, "reason": why.name})
        engagement.transitions.clear()
        if reason is not self._reason:
            log.info("reason: %s", reason.name)
            self._reason = reason

    def details(self, grid_overruns: int) -> dict[str, Any]:
        """For people who look on: counters by room and cause, and the link as it is now."""
        return {
            "link": {"state": self._link.state.name} | self._link.traffic.now(self._names, self._counted()),
            **self._compared(),
            "loop": self._counts.as_dict() | {"grid_overruns": grid_overruns},
            "samples": {
                "complete": self._tracker.completed,
                "incomplete": self._tracker.incomplete,
                "repeated": self._tracker.repeated,
            },
            **self._by_cause(),
            "bus": self._link.counters(),
        }

    def summary(self, grid_overruns: int, now_ns: int) -> dict[str, Any]:
        """For the end of a run; times in seconds since its start."""
        return {
            "bus": self._link.description,
            "latched_fault": self._latched_fault,
            "duration_s": self._since_start_s(now_ns),
            "samples": self._tracker.completed - self._counts.samples_heard_only,
            "incomplete_samples": self._tracker.incomplete,
            "commands": self._counts.commands,
            "deadline_misses": self._counts.deadline_misses,
            "latency": self._counts.latency.summary(),
            **self._by_cause(),
            "counts": self._counts.as_dict() | {"grid_overruns": grid_overruns},
            "bus_counters": self._link.counters(),
            "link": self._link_summary(),
            "transitions": self._transitions,
            **self._compared(),
        }

    def _compared(self) -> dict[str, Any]:
        return {} if self._shadow is None else {"shadow": self._shadow.summary()}

    def _link_summary(self) -> dict[str, Any]:
        changes = [
            {"at_s": self._since_start_s(change.at_ns), "state": change.state.name, "why": change.why}
            for change in self._link.changes
        ]
        return {"state": self._link.state.name, "transitions": changes} | self._link.traffic.whole(
            self._names, self._counted()
        )

    def _counted(self) -> dict[tuple[int, bool], int]:
        return self._decoder.seen | self._encoder.sent

    def _by_cause(self) -> dict[str, dict[str, int]]:
        """What was dropped, cut or refused, and what the hardware reported: each room's own counts."""
        drops = {f"{cause.value} {name}".strip(): count for (cause, name), count in self._decoder.drops.items()}
        return {
            "drops": drops,
            "lost": self._decoder.lost,
            "limited": dict(self._pilot.gate.limited),
            "implausible": dict(self._plausibility.found),
            "deviations": dict(self._pilot.deviation.found),
            "not_let_out": dict(self._outlet.refused),
            "link_events": dict(self._link.events),
        }

    def _since_start_s(self, when_ns: int) -> float:
        return s_from_ns(when_ns - self._started_ns)
