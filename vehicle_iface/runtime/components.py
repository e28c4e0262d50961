"""The components of the loop."""

from collections.abc import Callable

from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.frame import FrameKey
from vehicle_iface.runtime.arming import ArmingRequests
from vehicle_iface.runtime.arrival import ArrivalFilter
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle
from vehicle_iface.runtime.event_watch import EventWatch
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.publisher import TelemetryPublisher
from vehicle_iface.runtime.reports import Reports
from vehicle_iface.runtime.scheduled_sends import ScheduledSends
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.shutdown import Shutdown
from vehicle_iface.runtime.statistics import RunStatistics
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.runtime.trajectory_updates import TrajectoryUpdater
from vehicle_iface.runtime.transmitter import Transmitter
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.handover import Handover
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.state_assembler import StateAssembler
from vehicle_iface.value import Value


class LoopComponents(Value, frozen=True, kw_only=True):
    """The parts of the loop, put together by `compose`."""

    link: Link
    decoder: Decoder
    assembler: StateAssembler
    arrival: ArrivalFilter
    plausibility: PlausibilityCheck
    motion: MotionCheck
    cycle: ControlCycle
    engagement: Engagement
    transmitter: Transmitter
    reports: Reports
    sends: ScheduledSends
    shutdown: Shutdown
    handover: Handover
    trajectories: TrajectoryUpdater
    shadow: Shadow | None
    """Compares with another commander; None if this loop may command."""
    publisher: TelemetryPublisher
    counters: Counters
    statistics: RunStatistics
    events: EventWatch
    arming: ArmingRequests
    timer: PeriodicTimer
    """Ticks at the command period."""
    stale_ns: int
    """An enabled vehicle is stopped when its newest sample is older."""
    max_command_age_ns: int
    """No command is computed from an older sample."""
    command_ids: frozenset[FrameKey]
    """The frames that only this loop may send."""
    now_ns: Callable[[], int]
    feed_watchdog: Callable[[], None]
    """Called with each tick."""
