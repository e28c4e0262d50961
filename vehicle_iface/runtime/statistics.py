"""All counters by part and cause, while the loop runs and at its end."""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from vehicle_iface import wire
from vehicle_iface.bus.link_state import LinkState
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.frame import FrameKey
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle
from vehicle_iface.runtime.event_watch import EventWatch
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.runtime.tracking_stats import TrackingStats
from vehicle_iface.runtime.trajectory_updates import TrajectoryUpdater
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.safety.transmit_filter import TransmitFilter
from vehicle_iface.state_assembler import StateAssembler
from vehicle_iface.telemetry.details import (
    Causes,
    EventSummary,
    LinkChange,
    LinkDetails,
    LinkSummary,
    LiveDetails,
    RunSummary,
    SampleCounts,
    ShadowSummary,
    Transition,
)
from vehicle_iface.telemetry.events import LoopEvent
from vehicle_iface.units import s_from_ns


class RunStatistics:
    """Reads what the parts of the loop count."""

    def __init__(
        self,
        decoder: Decoder,
        encoder: Encoder,
        assembler: StateAssembler,
        cycle: ControlCycle,
        trajectories: TrajectoryUpdater,
        engagement: Engagement,
        transmit_filter: TransmitFilter,
        plausibility: PlausibilityCheck,
        motion: MotionCheck,
        counters: Counters,
        link: Link,
        timer: PeriodicTimer,
        shadow: Shadow | None,
        names: Mapping[FrameKey, str],
        events: EventWatch,
        tracking: TrackingStats,
        started_ns: int,
    ) -> None:
        """`names` are those of the frames that the profile knows."""
        self._decoder, self._encoder, self._assembler = decoder, encoder, assembler
        self._cycle, self._engagement, self._transmit_filter = cycle, engagement, transmit_filter
        self._trajectories = trajectories
        self._plausibility, self._motion, self._counters = plausibility, motion, counters
        self._link, self._timer, self._shadow, self._names = link, timer, shadow, names
        self._events, self._tracking = events, tracking
        self._started_ns = started_ns

    def details(self) -> LiveDetails:
        """Counters by part and cause, and the present state of the link, for viewer and recorder."""
        return LiveDetails(
            link=self._link_details(),
            shadow=self._shadow_summary(),
            loop=self._loop_counters(),
            samples=SampleCounts(
                complete=self._assembler.completed,
                incomplete=self._assembler.incomplete,
                repeated=self._assembler.repeated,
            ),
            part_ages_s=self._part_ages_s(),
            odometry_m=self._odometry_m(),
            trajectory_being_checked=self._trajectory_being_checked(),
            bus=self._link.counters(),
            **self._causes(),
        )

    def summary(self, now_ns: int) -> RunSummary:
        """For the end of a run; times in seconds since its start."""
        fault = self._engagement.latched_fault
        return RunSummary(
            controller_state=self._cycle.wire_state.name,
            reason=self._cycle.reason.name,
            bus=self._link.description,
            wire=wire.describe(),
            latched_fault=fault.name if fault is not None else None,
            duration_s=self._since_start_s(now_ns),
            samples=self._assembler.completed - self._counters.samples_before_engagement,
            incomplete_samples=self._assembler.incomplete,
            commands=self._counters.commands,
            deadline_misses=self._counters.deadline_misses,
            latency=self._counters.latency.summary(),
            counts=self._loop_counters(),
            bus_counters=self._link.counters(),
            link=self._link_summary(),
            transitions=[
                Transition(at_s=self._since_start_s(at_ns), mode=mode.name, reason=reason.name)
                for at_ns, mode, reason in self._engagement.transitions
            ],
            stops=self._events.stops(self._started_ns, now_ns),
            limits=self._events.limits(),
            tracking=self._tracking.summary(),
            events=[self._summarize(event) for event in self._events.log.kept],
            events_left_out=self._events.log.count - len(self._events.log.kept),
            part_ages_s=self._part_ages_s(),
            odometry_m=self._odometry_m(),
            shadow=self._shadow_summary(),
            **self._causes(),
        )

    def _summarize(self, event: LoopEvent) -> EventSummary:
        at_s = self._since_start_s(event.at_ns)
        return EventSummary(at_s=at_s, kind=event.kind, name=event.name, phase=event.phase, text=event.text)

    def _part_ages_s(self) -> dict[str, float] | UnsetType:
        ages_s = {name: s_from_ns(age_ns) for name, age_ns in self._assembler.oldest_ns.items()}
        return ages_s if len(ages_s) > 1 else UNSET

    def _odometry_m(self) -> float | UnsetType:
        driven_m = self._assembler.locator.driven_m
        return UNSET if driven_m is None else driven_m

    def _trajectory_being_checked(self) -> str | UnsetType:
        points = self._trajectories.points_in_check
        return UNSET if points is None else f"{points} points"

    def _loop_counters(self) -> dict[str, int]:
        return self._counters.as_dict() | {"grid_overruns": self._timer.overruns}

    def _shadow_summary(self) -> ShadowSummary | UnsetType:
        return UNSET if self._shadow is None else self._shadow.summary()

    def _link_details(self) -> LinkDetails:
        link = self._link
        details = link.load.now(link.state.name, self._names, self._counted())
        return details if link.state is LinkState.UP else msgspec.structs.replace(details, why=link.why)

    def _link_summary(self) -> LinkSummary:
        changes = [
            LinkChange(at_s=self._since_start_s(at_ns), state=state.name, why=why)
            for at_ns, state, why in self._link.transitions
        ]
        return self._link.load.whole(self._link.state.name, changes, self._names, self._counted())

    def _counted(self) -> dict[FrameKey, int]:
        return self._decoder.seen | self._encoder.sent

    def _causes(self) -> dict[str, Any]:
        """Each part's own counts, as the fields of `Causes`."""
        causes = Causes(
            drops={f"{cause.value} {name}".strip(): count for (cause, name), count in self._decoder.drops.items()},
            lost=dict(self._decoder.lost),
            limited=dict(self._cycle.gate.limited),
            implausible=dict(self._plausibility.counts),
            disagreements=self._motion.counts | {"gear and motion disagree": self._cycle.gear_check.count},
            deviations=dict(self._cycle.deviation.counts),
            tx_blocked=dict(self._transmit_filter.refused),
            link_events=dict(self._link.events),
        )
        return msgspec.structs.asdict(causes)

    def _since_start_s(self, when_ns: int) -> float:
        return s_from_ns(when_ns - self._started_ns)
