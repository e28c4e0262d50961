"""The loop: frames in, a command computed from each complete sample and sent within the same pass.

Stale state and a lost link are handled here: see `_stop_on_stale_state` and `_on_link_lost`.
"""

import logging

from vehicle_iface.frame import CanFrame
from vehicle_iface.reason import Reason
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.arrival import Arrival
from vehicle_iface.runtime.components import LoopComponents
from vehicle_iface.runtime.cycle import Decision
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.transmitter import NOT_DUE, NOT_SENT, SENT, Outcome
from vehicle_iface.safety.modes import Event
from vehicle_iface.standstill import AT_REST_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import VehicleStatus
from vehicle_iface.telemetry.details import LiveDetails, RunSummary

log = logging.getLogger(__name__)

AT_REST_SAMPLES = 3
"""The vehicle is released only after this many samples in a row at rest."""


class Loop:
    """One thread, no locks. Call `begin`, then `step` until `shutdown.is_done`: after a requested end, once the vehicle
    has been released."""

    def __init__(self, components: LoopComponents) -> None:
        parts = components
        self.link, self.timer, self.shutdown = parts.link, parts.timer, parts.shutdown
        self.arming, self.events = parts.arming, parts.events
        self._decoder, self._assembler, self._arrival = parts.decoder, parts.assembler, parts.arrival
        self._plausibility, self._motion, self._cycle = parts.plausibility, parts.motion, parts.cycle
        self._engagement, self._transmitter, self._reports = parts.engagement, parts.transmitter, parts.reports
        self._sends = parts.sends
        self._handover, self._trajectories, self._shadow = parts.handover, parts.trajectories, parts.shadow
        self._publisher, self._counters, self._statistics = parts.publisher, parts.counters, parts.statistics
        self._stale_ns = parts.stale_ns
        self._max_command_age_ns = parts.max_command_age_ns
        self._period_ns, self._command_ids = parts.timer.period_ns, parts.command_ids
        self._now_ns, self._feed_watchdog = parts.now_ns, parts.feed_watchdog
        self._newest: Sample | None = None
        self._doubtful: Sample | None = None
        self._seen_status: VehicleStatus | None = None
        self._samples_at_rest = 0
        self._must_restart = self._was_sent = False
        self._logged_reason = Reason.NOT_ENGAGED

    def begin(self) -> None:
        """Discard the frames received during start-up; call it once, before the first pass.

        They are old, but not counted as late: the loop was not running yet.
        """
        begin_ns = self._now_ns()
        while (frames := self.link.receive(begin_ns)) and frames[-1].stamp_ns < begin_ns:
            pass
        self.timer.restart(self._now_ns())

    def step(self) -> None:
        """One pass: receive, send a command for each complete sample, keep time."""
        self._transmitter.begin_pass()
        frames = self.link.receive(self.timer.next_ns)
        if frames:
            samples = self._assemble_samples(frames)
            if self._doubtful is not None:
                self._stop_on_doubtful(self._doubtful)
            if samples:
                self._process_samples(samples)
            if self._shadow is not None:
                self._compare(self._shadow)
        if self.link.take_loss():
            self._on_link_lost()
        now_ns = self._now_ns()
        if self.timer.is_due(now_ns):
            self._on_tick(now_ns)
        realtime.collect_garbage_if_due()

    @property
    def reason(self) -> Reason:
        """The reason of the last command; where commands are not enabled, the reason of the mode."""
        return self._cycle.reason

    def details(self) -> LiveDetails:
        """All counters, by part and cause."""
        return self._statistics.details()

    def summary(self) -> RunSummary:
        """Summary of the run: counts, and latencies in seconds."""
        return self._statistics.summary(self._now_ns())

    def _assemble_samples(self, frames: list[CanFrame]) -> list[Sample]:
        """The plausible samples that these frames complete; status and foreign commands change the mode."""
        samples: list[Sample] = []
        decode, take = self._decoder.decode, self._assembler.take
        for frame in frames:
            received = decode(frame)
            if received is None:
                self._check_foreign_command(frame)
                continue
            sample = take(received)
            if self._assembler.status is not self._seen_status:
                self._update_engagement()
            if sample is not None and self._is_usable(sample):
                samples.append(sample)
        if samples:
            self._newest = samples[-1]
        return samples

    def _is_usable(self, sample: Sample) -> bool:
        """Whether the sample is fresh and plausible; if so, its motion is compared with that of earlier samples."""
        state = sample.state
        arrival = self._arrival.judge(state.stamp_ns)
        if arrival is not Arrival.YOUNG:
            self._counters.samples_held_up += 1
            self._engagement.on_sample(state.stamp_ns, self._now_ns(), is_usable=False)
            if arrival is Arrival.DOUBTFUL:
                self._doubtful = sample
            return False
        if not self._plausibility.is_plausible(state, pose_valid=sample.pose_valid):
            return False
        self._motion.update(state, pose_valid=sample.pose_valid)
        return True

    def _stop_on_doubtful(self, sample: Sample) -> None:
        """Send a stop in answer to a sample that may be old."""
        self._doubtful = None
        self._send_stop((self._newest or sample).state, Reason.STATE_STALE, self._now_ns())

    def _process_samples(self, samples: list[Sample]) -> None:
        """Process each sample; after a pause only the newest, and none that is too old."""
        now_ns = self._now_ns()
        agrees = self._motion.disagreement is None
        for sample in samples:
            self._engagement.on_sample(sample.state.stamp_ns, now_ns, is_usable=agrees)
        self._counters.samples += len(samples)
        if self._engagement.mode.observes:
            self._counters.samples_before_engagement += len(samples)
        is_backlog = now_ns - samples[0].state.stamp_ns > self._stale_ns
        processed = samples[-1:] if is_backlog else samples
        self._counters.samples_expired += len(samples) - len(processed)
        for sample in processed:
            now_ns = now_ns if sample is processed[0] else self._now_ns()
            self._process_sample(sample, now_ns, is_newest=sample is processed[-1])

    def _process_sample(self, sample: Sample, now_ns: int, *, is_newest: bool) -> None:
        """Compute, send, then publish. Skips a sample that expired while earlier ones were processed."""
        if now_ns - sample.state.stamp_ns > self._max_command_age_ns:
            self._counters.samples_expired += 1
            return
        if self._cycle.last is None or self._must_restart:
            self._update_trajectory(sample, restart=self._must_restart)
            self._must_restart = False
        is_at_rest = abs(sample.state.speed_mps) <= AT_REST_MPS and self._motion.disagreement is None
        self._samples_at_rest = self._samples_at_rest + 1 if is_at_rest else 0
        if self._samples_at_rest >= AT_REST_SAMPLES and self.shutdown.may_hold_or_release(now_ns):
            self._engagement.apply(Event.STANDSTILL, now_ns)
        shadow = self._shadow
        decision = self._cycle.decide(
            sample,
            self._assembler.status,
            now_ns,
            is_implausible=self._plausibility.is_persistent(since_ns=now_ns - self._stale_ns),
            link_is_stalled=self.link.is_stalled,
            other_takes_over=shadow is not None and shadow.is_taking_over,
        )
        if shadow is not None:
            shadow.record(sample, decision.permitted, now_ns)
        outcome = self._transmitter.send_command(decision, now_ns, is_newest=is_newest)
        if outcome is not NOT_SENT:
            self._send_others(now_ns)
        latency_ns = self._now_ns() - sample.completed_ns
        if outcome is SENT:
            self._counters.latency.add(latency_ns)
            self._counters.commands_late += latency_ns > self._period_ns
        self._publish(now_ns, decision, outcome, latency_ns=latency_ns)
        self._update_trajectory(sample, now_ns=sample.completed_ns + latency_ns)

    def _send_stop(self, last: VehicleState, reason: Reason, now_ns: int) -> None:
        """Send a stop computed from the last known state, because no usable sample arrived."""
        decision = self._cycle.decide_stop(last, self._assembler.status, reason, now_ns)
        outcome = self._transmitter.send_command(decision, now_ns)
        if outcome is not NOT_SENT:
            self._send_others(now_ns)
        self._counters.stops_on_stale_state += outcome is SENT and decision.permitted.enable
        self._publish(now_ns, decision, outcome)

    def _send_others(self, now_ns: int) -> None:
        self._reports.send_due(now_ns)
        self._sends.send_due(now_ns)

    def _check_foreign_command(self, frame: CanFrame) -> None:
        """Our own frames are not received, so a command frame is another node's."""
        if (frame.can_id, frame.is_extended, frame.bus) in self._command_ids and not frame.is_error:
            self._counters.foreign_commands += 1
            self._engagement.apply(Event.DUPLICATE_COMMANDER, self._now_ns())
            if self._shadow is not None:
                self._shadow.on_foreign_frame(frame)

    def _compare(self, shadow: Shadow) -> None:
        """Compare the other commander's command with ours; on takeover, restart the limits from the measured state."""
        taken = shadow.compare()
        if taken is not None:
            self._cycle.gate.start_from(taken.state, taken.decided_ns)
            self._update_trajectory(self._newest, restart=True)

    def _update_engagement(self) -> None:
        """Apply a new status to the mode before the next command."""
        status = self._seen_status = self._assembler.status
        if status is None:
            return
        has_engaged = self._engagement.on_status(status, self._now_ns())
        if self._shadow is not None:
            has_engaged = self._shadow.on_status(status)
        if has_engaged:
            self._update_trajectory(self._newest, restart=True)  # its time 0 is the instant of engagement

    def _update_trajectory(self, sample: Sample | None, *, restart: bool = False, now_ns: int | None = None) -> None:
        if restart:
            self._cycle.begin_drive()
        if sample is None:
            return
        if self._trajectories.poll(self._now_ns() if now_ns is None else now_ns, sample.state, restart=restart):
            self._publisher.publish_trajectory()

    def _on_tick(self, now_ns: int) -> None:
        """Work on the timer instead of on arrival: requests, link, missing frames, reports, shutdown."""
        self._feed_watchdog()
        self._apply_requests(now_ns)
        self.link.watch(now_ns)
        if self.link.take_loss():
            self._on_link_lost()
        self._engagement.on_tick(now_ns)
        if self._assembler.locator.is_interrupted and not self._engagement.mode.enables:
            self._restart_odometry()
        reason = self._cycle.reason
        if reason is not self._logged_reason:
            log.info("reason: %s", reason.name)
            self._logged_reason = reason
        self.shutdown.warn_if_near(now_ns)
        self._stop_on_stale_state(now_ns)
        reports_alone = now_ns - self._transmitter.decided_ns > 2 * self._period_ns  # else they go out behind a command
        if reports_alone and self._engagement.may_report(now_ns) and self._transmitter.has_room():
            self._send_others(now_ns)
        else:
            self._sends.send_due(now_ns, only_once=True)
        if self._publisher.is_quiet(now_ns):
            self._publish(now_ns, self._cycle.last)
        self._publisher.publish_details(now_ns, self.details)
        self.shutdown.finish_if_released(now_ns, self._assembler.status)
        self.events.poll(now_ns)

    def _stop_on_stale_state(self, now_ns: int) -> None:
        """Stop an engaged vehicle from its last state, at the command period, while no plausible sample arrives.

        While samples are implausible, a vehicle that is not driven is still sent ENABLE = 0.
        """
        newest, since_ns = self._newest, now_ns - self._stale_ns
        if newest is None or now_ns - self._transmitter.decided_ns < self._period_ns // 2:
            return  # there is no last state, or a command was decided just now
        if self._plausibility.is_persistent(since_ns=since_ns):
            self._send_stop(newest.state, Reason.STATE_INVALID, now_ns)
        elif newest.state.stamp_ns < since_ns and self._engagement.mode.enables:
            self._send_stop(newest.state, Reason.STATE_STALE, now_ns)

    def _apply_requests(self, now_ns: int) -> None:
        if self.arming.apply(now_ns, self.link.state, self._assembler.status):
            if self._assembler.locator.is_interrupted:
                self._restart_odometry()
            self._update_trajectory(self._newest, restart=True)
        self.shutdown.begin_if_due(now_ns)
        if self.shutdown.must_release_now and self.shutdown.release_now(now_ns) and self._newest is not None:
            self._send_stop(self._newest.state, Reason.SHUTDOWN, now_ns)

    def _publish(
        self,
        now_ns: int,
        decision: Decision | None,
        outcome: Outcome = NOT_SENT,
        *,
        latency_ns: int = 0,
    ) -> None:
        """Publish a snapshot. Between two commands, `sent` keeps the value of the earlier one."""
        newest = self._newest
        if outcome is not NOT_DUE:
            self._was_sent = outcome is SENT
        self._publisher.publish_snapshot(
            now_ns,
            controller_state=self._cycle.wire_state,
            reason=self._cycle.reason,
            state=newest.state if newest is not None else None,
            status=self._assembler.status,
            decision=decision,
            sent=self._was_sent,
            latency_ns=latency_ns,
            drops=sum(self._decoder.drops.values()),
            handover_pending=self._handover.warns,
            handover_in_ns=self._handover.left_ns(now_ns, is_ending=self._engagement.mode.ends),
        )

    def _restart_odometry(self) -> None:
        """Restart interrupted dead reckoning at 0, 0, 0. Called only while no command is enabled."""
        self._assembler.locator.reset()
        self._plausibility.reset()
        self._motion.reset()
        self._newest = None  # the next sample begins the trajectory
        self._must_restart = True
        log.warning("odometry was interrupted; it restarts at 0, 0, 0")

    def _on_link_lost(self) -> None:
        """Go silent and clear all state, so that nothing from before the loss is combined with anything after it."""
        now_ns = self._now_ns()
        self._engagement.apply(Event.LINK_DOWN, now_ns)
        self._decoder.reset()
        self._assembler.reset()
        self._plausibility.reset()
        self._motion.reset()
        if self._shadow is not None:
            self._shadow.reset()
        self._newest = None
        self._publish(now_ns, self._cycle.last)
