"""Builds a loop, or a simulated vehicle, from a profile and options."""

from collections.abc import Callable

from vehicle_iface import clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.codec.database import BoundMessage, VehicleDatabase
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.sent_values import SendContext
from vehicle_iface.command_forms import CommandReader, build_former
from vehicle_iface.control.base import BehaviorConfig, ControllerBase, StopSteering
from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig
from vehicle_iface.control.user_controller import load_controller
from vehicle_iface.motion_sources import sources_of
from vehicle_iface.profile import Profile
from vehicle_iface.runtime.arming import ArmingRequests
from vehicle_iface.runtime.arrival import ArrivalFilter
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.runtime.components import LoopComponents
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import ControlCycle
from vehicle_iface.runtime.event_log import EventLog
from vehicle_iface.runtime.event_watch import EventWatch
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.runtime.publisher import TelemetryPublisher
from vehicle_iface.runtime.reports import Reports
from vehicle_iface.runtime.scheduled_sends import ScheduledSends
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.shutdown import Shutdown
from vehicle_iface.runtime.statistics import RunStatistics
from vehicle_iface.runtime.timer import PeriodicTimer
from vehicle_iface.runtime.trajectory_updates import TrajectoryUpdater
from vehicle_iface.runtime.transmit_periods import allowed_messages, build_pace, period_ns
from vehicle_iface.runtime.transmitter import Transmitter
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.engagement import Engagement, EngagementTiming
from vehicle_iface.safety.gate import Gate, gate_channels
from vehicle_iface.safety.gear import GearCheck
from vehicle_iface.safety.handover import Handover
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.phases import find_phases
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.safety.stop import StopShape
from vehicle_iface.safety.stop_hold import StopHold
from vehicle_iface.safety.transmit_filter import TransmitFilter
from vehicle_iface.safety.unmeasured import without_unmeasured
from vehicle_iface.telemetry import DrivingLimits, TelemetryWriter, VehicleShape
from vehicle_iface.trajectories.source import TrajectorySource
from vehicle_iface.units import ns_from_s

UNBOUND_LSB = 1e-6
"""Step of a command field that the vehicle does not take or takes as a float: finer than any actuator."""


def build_controller(name: str, profile: Profile) -> ControllerBase:
    """`pure_pursuit`, or a user class as `FILE.py:CLASS` or `MODULE:CLASS`; `ConfigError` when there is none.

    User classes are constructed with the `BehaviorConfig`, or by a class method `from_profile(profile, behavior)` if
    they define it.
    """
    behavior = BehaviorConfig(
        safe_deceleration_mps2=profile.behavior.safe_deceleration_mps2,
        time_step_s=profile.behavior.time_step_s,
        stop_steering=StopSteering(profile.behavior.stop_steering),
    )
    if name == "pure_pursuit":
        return PurePursuit(PurePursuitConfig(wheelbase_m=profile.geometry.wheelbase_m), behavior=behavior)
    return load_controller(name, profile, behavior)


def build_loop(
    *,
    database: VehicleDatabase,
    open_bus: Callable[[], Bus],
    controller: ControllerBase,
    source: TrajectorySource,
    telemetry: TelemetryWriter | None,
    armed: bool,
    now_ns: Callable[[], int] = clock.monotonic_ns,
    sleep_until: Callable[[int], None] = clock.sleep_until,
    feed_watchdog: Callable[[], None] = lambda: None,
) -> Loop:
    """A loop on an open bus; `BusError` when that cannot be opened. It calls `feed_watchdog` with each tick."""
    profile, counters = database.profile, Counters()
    timing, wheelbase_m = profile.timing, profile.geometry.wheelbase_m
    limits, plausibility_limits = without_unmeasured(profile)
    link = Link(open_bus, counters, now_ns=now_ns, sleep_until=sleep_until)
    started_ns = now_ns()  # opening the bus may take a while
    periods_ns = [period_ns(database, message) for message in database.commands]
    timer = PeriodicTimer(min(periods_ns, default=ns_from_s(timing.command_period_s)), started_ns)
    decoder, assembler, encoder = Decoder(database.received), build_state_assembler(database), Encoder(database.sent)
    engagement = Engagement(_engagement_timing(profile), armed=armed)
    plausibility = PlausibilityCheck(plausibility_limits, wheelbase_m=wheelbase_m)
    motion = MotionCheck(
        plausibility_limits,
        sources=sources_of(profile),
        wheelbase_m=wheelbase_m,
        gap_s=timing.state_stale_s,
        agree_s=profile.recovery.state_invalid_s,
    )
    gate = Gate(
        gate_channels(limits, lambda field: _lsb(database, field)),
        limits,
        wheelbase_m=wheelbase_m,
        stop=stop_shape(profile, controller.behavior),
    )
    deviation = DeviationMonitor(profile.deviation, speed_max_mps=profile.limits.speed_max_mps)
    trajectories = TrajectoryUpdater(
        source,
        controller,
        counters,
        deviation=deviation,
        limits=profile.limits,
        wheelbase_m=wheelbase_m,
        now_ns=now_ns,
    )
    cycle = ControlCycle(
        controller,
        gate,
        engagement,
        deviation=deviation,
        motion=motion,
        gear_check=GearCheck(profile.limits.gear_change_speed_mps),
        stop_hold=StopHold(profile.recovery),
        gear_change_speed_mps=profile.limits.gear_change_speed_mps,
        status_stale_ns=ns_from_s(timing.status_stale_s),
        budget_ns=ns_from_s(timing.controller_budget_s),
        max_command_age_ns=ns_from_s(timing.max_command_age_s),
        counters=counters,
        now_ns=now_ns,
    )
    transmit_filter = TransmitFilter(allowed_messages(database))
    pace = build_pace(database, transmit_filter)

    def read_context(at_ns: int) -> SendContext:
        status_stale_ns = ns_from_s(timing.status_stale_s)
        phases = find_phases(engagement, assembler.status, at_ns, status_stale_ns=status_stale_ns)
        return SendContext(phases, assembler.row)

    former = build_former(profile, database.command_ranges)
    transmitter = Transmitter(
        encoder, pace, transmit_filter, link, gate, engagement, counters, now_ns, read_context, former
    )
    handover = Handover(ns_from_s(profile.handover.warning_s), hold_until_warned=profile.handover.hold_until_warned)
    publisher = TelemetryPublisher(telemetry, controller, counters, lap=lambda: trajectories.lap)
    shadow = None if armed or not database.commands else _shadow(database)
    arming, shutdown = ArmingRequests(engagement), Shutdown(engagement, handover)
    events = EventWatch(
        EventLog(None if telemetry is None else telemetry.publish_event),
        engagement=engagement,
        cycle=cycle,
        link=link,
        counters=counters,
        arming=arming,
        shutdown=shutdown,
        trajectories=trajectories,
        limited=gate.limited,
        causes={
            "implausible": lambda: plausibility.counts,
            "disagreement": lambda: motion.counts,
            "deviation": lambda: cycle.deviation.counts,
            "blocked": lambda: transmit_filter.refused,
        },
        drops=lambda: decoder.drops,
        decided_ns=lambda: transmitter.decided_ns,
    )
    names = {m.key: m.dbc_name for m in (*database.received, *database.sent)}
    return Loop(
        LoopComponents(
            link=link,
            decoder=decoder,
            assembler=assembler,
            arrival=ArrivalFilter(ns_from_s(timing.sample_period_s), ns_from_s(timing.state_stale_s)),
            plausibility=plausibility,
            motion=motion,
            cycle=cycle,
            engagement=engagement,
            transmitter=transmitter,
            reports=_reports(database, transmitter, cycle, publisher, handover, counters, started_ns),
            sends=ScheduledSends(
                profile.send,
                transmitter,
                lambda at_ns: read_context(at_ns).phases,
                sample_period_ns=ns_from_s(timing.sample_period_s),
            ),
            shutdown=shutdown,
            handover=handover,
            trajectories=trajectories,
            shadow=shadow,
            publisher=publisher,
            counters=counters,
            statistics=RunStatistics(
                decoder=decoder,
                encoder=encoder,
                assembler=assembler,
                cycle=cycle,
                trajectories=trajectories,
                engagement=engagement,
                transmit_filter=transmit_filter,
                plausibility=plausibility,
                motion=motion,
                counters=counters,
                link=link,
                timer=timer,
                shadow=shadow,
                names=names,
                events=events,
                tracking=publisher.tracking,
                started_ns=started_ns,
            ),
            events=events,
            arming=arming,
            timer=timer,
            stale_ns=ns_from_s(timing.state_stale_s),
            max_command_age_ns=ns_from_s(timing.max_command_age_s),
            command_ids=frozenset(message.key for message in database.sent),
            now_ns=now_ns,
            feed_watchdog=feed_watchdog,
        )
    )


def _engagement_timing(profile: Profile) -> EngagementTiming:
    timing = profile.timing
    return EngagementTiming(
        settle_ns=ns_from_s(timing.engage_settle_s),
        stale_ns=ns_from_s(timing.state_stale_s),
        lost_ns=ns_from_s(timing.state_silent_s),
        status_stale_ns=ns_from_s(timing.status_stale_s),
        engage_timeout_ns=ns_from_s(timing.engage_timeout_s),
        end_ns=ns_from_s(timing.shutdown_s),
        steer_torque_nm=profile.limits.driver_steer_torque_nm,
    )


def _reports(
    database: VehicleDatabase,
    transmitter: Transmitter,
    cycle: ControlCycle,
    publisher: TelemetryPublisher,
    handover: Handover,
    counters: Counters,
    started_ns: int,
) -> Reports:
    timing = database.profile.timing

    def timed(message: BoundMessage | None, period_s: float) -> tuple[str, PeriodicTimer] | None:
        return (message.name, PeriodicTimer(ns_from_s(period_s), started_ns)) if message is not None else None

    return Reports(
        transmitter,
        cycle,
        publisher,
        handover,
        counters,
        body=timed(database.body, timing.body_period_s),
        report=timed(database.report, timing.report_period_s),
        ranges=database.report_ranges,
    )


def stop_shape(profile: Profile, behavior: BehaviorConfig) -> StopShape:
    """The shape of a stop: deceleration of the controller's behaviour, jerk and release of the profile."""
    return StopShape(
        deceleration_mps2=behavior.safe_deceleration_mps2,
        time_step_s=behavior.time_step_s,
        jerk_mps3=profile.behavior.stop_jerk_mps3,
        release_time_constant_s=profile.behavior.stop_release_time_constant_s,
        hold_mps2=profile.behavior.hold_deceleration_mps2,
    )


def _shadow(database: VehicleDatabase) -> Shadow:
    timing = database.profile.timing
    together_ns = ns_from_s(timing.command_period_s / 2)
    longest_ns, reader = ns_from_s(timing.state_stale_s), CommandReader(database.profile)
    return Shadow(database.commands, reader, together_ns=together_ns, longest_ns=longest_ns)


def vehicle_shape(profile: Profile) -> VehicleShape:
    """What the viewer draws the vehicle as."""
    geometry = profile.geometry
    return VehicleShape(
        wheelbase_m=geometry.wheelbase_m,
        length_m=geometry.length_m,
        width_m=geometry.width_m,
        height_m=geometry.height_m,
        rear_overhang_m=geometry.rear_overhang_m,
        track_m=geometry.track_m,
        wheel_radius_m=geometry.wheel_radius_m,
    )


def driving_limits(profile: Profile) -> DrivingLimits:
    """What the viewer's plots have as ranges."""
    limits = profile.limits
    return DrivingLimits(
        speed_max_mps=limits.speed_max_mps,
        accel_min_mps2=limits.accel_min_mps2,
        accel_max_mps2=limits.accel_max_mps2,
        front_wheel_angle_rad=limits.front_wheel_angle_rad,
        lateral_warn_m=profile.deviation.lateral_warn_m,
        heading_stop_rad=profile.deviation.heading_stop_rad,
    )


def _lsb(database: VehicleDatabase, field: str) -> float:
    """What the wire can tell apart; drive and brake are the acceleration in two signals, the coarser one decides."""
    fields = ("accel_mps2", "drive_mps2", "brake_mps2") if field == "accel_mps2" else (field,)
    return max(database.resolutions.get(one, 0.0) for one in fields) or UNBOUND_LSB
