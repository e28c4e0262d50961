"""The corridor: frames in, a command computed from each complete sample and sent within the same pass."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from vehicle_iface.bus.base import Bus
from vehicle_iface.bus.link_state import OPEN
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import Timing
from vehicle_iface.reason import Reason
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.account import Account
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.intake import TrajectoryIntake
from vehicle_iface.runtime.link import Link
from vehicle_iface.runtime.pilot import Answer, Pilot
from vehicle_iface.runtime.rate import Grid
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.teller import Teller
from vehicle_iface.safety.engagement import Engagement, Event, Mode
from vehicle_iface.safety.handover import Handover
from vehicle_iface.safety.outlet import Outlet
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.status import BodyRequest, ControllerReport, VehicleMode
from vehicle_iface.tracker import Sample, Tracker
from vehicle_iface.units import NS_PER_MS, ns_from_s

log = logging.getLogger(__name__)

LETTING_GO_NS = 200 * NS_PER_MS
"""How long ENABLE = 0 is repeated at the end for a vehicle that does not say that it has let go."""
AT_REST_MPS, AT_REST_SAMPLES = 0.01, 3
"""Two counts of the reference vehicle's speed signal, several times in a row: only then is it let go."""
END_OF_TRAJECTORY = (Reason.PAST_END_SPACE, Reason.PAST_END_TIME)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What the loop is made of; `compose` puts it together."""

    open_bus: Callable[[], Bus]
    decoder: Decoder
    tracker: Tracker
    pilot: Pilot
    engagement: Engagement
    encoder: Encoder
    outlet: Outlet
    plausibility: PlausibilityCheck
    intake: TrajectoryIntake
    shadow: Shadow | None
    """Compares with another commander; None where this one may command."""
    teller: Teller
    counts: Counts
    timing: Timing
    handover: Handover
    names: dict[tuple[int, bool], str]
    """Of the messages of the profile, by identifier and whether it is extended."""
    command_ids: frozenset[tuple[int, bool]]
    """Identifiers that only we may send, each with whether it is extended."""
    body_message: str | None
    """The message that carries a `BodyRequest`; None where the vehicle has none."""
    report_message: str | None
    """The message that carries a `ControllerReport`; None where the vehicle has none."""
    report_ranges: Mapping[str, tuple[float, float]]
    """Of its bound fields."""
    now_ns: Callable[[], int]
    sleep_until: Callable[[int], None]
    live: Callable[[], None]
    """Called on the time grid: a sign of life."""


class Loop:
    """One thread, no locks. `run` ends when it was asked to and the vehicle was let go."""

    def __init__(self, parts: Parts) -> None:
        """Opens the bus; `BusError` when that is not possible."""
        self._parts = parts
        self._decoder, self._tracker, self._engagement = parts.decoder, parts.tracker, parts.engagement
        self._pilot, self._encoder, self._counts = parts.pilot, parts.encoder, parts.counts
        self._now_ns, self._handover = parts.now_ns, parts.handover
        self.link = Link(
            parts.open_bus,
            parts.counts,
            now_ns=parts.now_ns,
            sleep_until=parts.sleep_until,
            on_lost=self._on_link_lost,
        )
        now_ns = parts.now_ns()
        timing = parts.timing
        self.grid = Grid(ns_from_s(timing.command_period_s), now_ns)
        self._body_grid = Grid(ns_from_s(timing.body_period_s), now_ns)
        self._report_grid = Grid(ns_from_s(timing.report_period_s), now_ns)
        self._stale_ns = ns_from_s(timing.state_stale_s)
        self._answer_age_ns = ns_from_s(timing.answer_age_s)
        self._late_ns = ns_from_s(timing.command_period_s)
        self._commanded_ns = now_ns
        self._room: bool | None = None
        self._newest: Sample | None = None
        self._answer: Answer | None = None
        self._end_requests = 0
        self._end_is_due = False
        self._has_begun_to_end = False
        self._arm_requested = False
        self._released_ns: int | None = None
        self._standing = 0
        self.account = Account(
            parts.decoder,
            parts.encoder,
            parts.tracker,
            parts.pilot,
            parts.outlet,
            parts.plausibility,
            parts.counts,
            self.link,
            parts.shadow,
            parts.names,
            now_ns,
        )
        self.ended_in_fault = False
        self.done = False

    def run(self) -> None:
        """Pass after pass until the end."""
        while not self.done:
            self.step()

    def step(self) -> None:
        """One pass: hear, answer each complete sample, keep time."""
        self._room = None
        frames = self.link.hear(self.grid.next_ns)
        if frames:
            samples = self._samples_in(frames)
            if samples:
                self._answer_samples(samples)
            if self._parts.shadow is not None:
                self._compare(self._parts.shadow)
        now_ns = self._now_ns()
        if self.grid.due(now_ns):
            self._keep_time(now_ns)
        realtime.tidy()

    def request_end(self) -> None:
        """Stop the vehicle and end; asked a second time, let it go at once. Safe in a signal handler."""
        self._end_requests += 1

    def plan_end(self, at_ns: int) -> None:
        """`end_as_planned` will be called then: the person is warned before."""
        self._handover.plan(at_ns)

    def end_as_planned(self) -> None:
        """Stop the vehicle and end, unless that was asked for already: no request, so the next one is not a second."""
        self._end_is_due = True

    def request_arming(self) -> None:
        """Engage (again) when everything is well. Safe in a signal handler."""
        self._arm_requested = True

    @property
    def reason(self) -> Reason:
        """What decided the last command; where none is enabled, why the mode is as it is."""
        if self._engagement.mode in (Mode.ENGAGING, Mode.ENGAGED, Mode.LISTENING) and self._answer is not None:
            return self._answer.safe.reason
        return self._engagement.reason

    def details(self) -> dict[str, Any]:
        """Every counter there is, by room and cause."""
        return self.account.details(self.grid.overruns)

    def summary(self) -> dict[str, Any]:
        """What the run came to; counts, and latencies in seconds."""
        ended = {
            "controller_state": self._engagement.wire_state(stopping=self._is_stopping).name,
            "reason": self.reason.name,
        }
        return ended | self.account.summary(self.grid.overruns, self._now_ns())

    def _samples_in(self, frames: list[CanFrame]) -> list[Sample]:
        """The samples that these frames complete and that can be true; what else they say is taken note of."""
        samples: list[Sample] = []
        for frame in frames:
            received = self._decoder.decode(frame)
            if received is None:
                self._look_at_foreign(frame)
                continue
            sample = self._tracker.take(received)
            if sample is None:
                self._look_at_status(received.stamp_ns)
            elif self._parts.plausibility.believes(sample.state, pose_valid=sample.pose_valid):
                samples.append(sample)
        if samples:
            self._newest = samples[-1]
        return samples

    def _answer_samples(self, samples: list[Sample]) -> None:
        """Each sample, unless they have waited: after a pause only the newest, and not even that when it is old."""
        now_ns = self._now_ns()
        for sample in samples:
            self._engagement.see_sample(sample.state.stamp_ns, now_ns)
        self._counts.samples += len(samples)
        if self._engagement.mode is Mode.HEARING:
            self._counts.samples_heard_only += len(samples)
        is_backlog = now_ns - samples[0].state.stamp_ns > self._stale_ns
        answered = samples[-1:] if is_backlog else samples
        self._counts.too_old_to_answer += len(samples) - len(answered)
        for sample in answered:
            self._answer_sample(sample)

    def _answer_sample(self, sample: Sample) -> None:
        """Decide, send, and only then tell; nothing of it for a sample that has grown old behind the others."""
        now_ns = self._now_ns()
        if now_ns - sample.state.stamp_ns > self._answer_age_ns:
            self._counts.too_old_to_answer += 1
            return
        if self._answer is None:
            self._take_trajectory(sample)
        self._standing = self._standing + 1 if abs(sample.state.speed_mps) <= AT_REST_MPS else 0
        stands = self._standing >= AT_REST_SAMPLES
        if self._is_ending and stands and self._handover.may_let_go(now_ns):
            self._engagement.happened(Event.STANDSTILL, now_ns)
        status, shadow = self._tracker.status, self._parts.shadow
        self._answer = self._pilot.answer(
            sample,
            status,
            now_ns,
            link_is_stalled=self.link.is_stalled,
            other_takes_over=shadow is not None and shadow.is_taking_over,
        )
        if shadow is not None:
            shadow.note(sample, self._answer.safe, now_ns)
        sent = self._send_command(self._answer, now_ns)
        latency_ns = self._now_ns() - sample.completed_ns
        if sent:
            self._counts.latency.add(latency_ns)
            self._counts.answered_late += latency_ns > self._late_ns
        self._tell(now_ns, sent=sent, latency_ns=latency_ns)
        self._take_trajectory(sample)

    def _send_command(self, answer: Answer, now_ns: int) -> bool:
        """All command frames of one answer, each at most once, and behind them what else is due.

        Nothing while the command of an earlier pass still waits to leave: however dead the bus is, no more of them
        than one pass sends are under way.
        """
        self._commanded_ns = now_ns
        if not self._engagement.sends:
            return False
        frames = self._encoder.encode_command(answer.safe) if self._has_room() else ()
        left = self._hand_over(frames)
        is_sent = bool(frames) and len(left) == len(frames)
        if is_sent:
            self._counts.commands += 1
            self._send_reports(now_ns)
        elif answer.safe.enable:
            self._pilot.gate.take_back(left=self._encoder.fields_of(left))
        return is_sent

    def _has_room(self) -> bool:
        """Asked once a pass."""
        if self._room is None:
            self._room = self.link.has_room()
        return self._room

    def _hand_over(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        """Up to the first that is refused: those that left. What did not leave has stepped no counter."""
        now_ns, outlet = self._now_ns(), self._parts.outlet
        allowed = list(takewhile(lambda frame: outlet.lets_out(frame, now_ns), frames))
        sent = self.link.send(*allowed) if allowed else 0
        for unsent in frames[sent:]:
            self._encoder.take_back(unsent)
        return frames[:sent]

    def _look_at_foreign(self, frame: CanFrame) -> None:
        """Our own frames do not come back to us, so this one is another node's command."""
        if (frame.can_id, frame.is_extended) in self._parts.command_ids and not frame.is_error:
            self._counts.foreign_commands += 1
            self._engagement.happened(Event.DUPLICATE_COMMANDER, self._now_ns())
            if self._parts.shadow is not None:
                self._parts.shadow.hear(frame)

    def _compare(self, shadow: Shadow) -> None:
        """What another commander sends, with what we would have; where it takes the vehicle over, so would we."""
        taken = shadow.compare()
        if taken is not None:
            self._pilot.gate.start_from(taken.state, taken.answered_ns)
            self._take_trajectory(self._newest, restart=True)

    def _look_at_status(self, stamp_ns: int) -> None:
        """A vehicle that is autonomous, or not any more, changes the mode before the next answer."""
        status, engagement = self._tracker.status, self._engagement
        if status is None or status.stamp_ns != stamp_ns:
            return
        before = engagement.mode
        engagement.see_status(status, self._now_ns())
        has_engaged = engagement.mode is not before and engagement.mode in (Mode.ENGAGING, Mode.ENGAGED)
        if self._parts.shadow is not None:
            has_engaged = self._parts.shadow.see_status(status)
        if has_engaged:
            self._take_trajectory(self._newest, restart=True)  # its time 0 is the instant of engagement

    def _take_trajectory(self, sample: Sample | None, *, restart: bool = False) -> None:
        if restart:
            self._pilot.deviation.forget()
        if sample is not None and self._parts.intake.take(self._now_ns(), sample.state, restart=restart):
            self._parts.teller.tell_trajectory()

    def _keep_time(self, now_ns: int) -> None:
        """What happens on the grid and not on arrival: noticing what did not come, reports, the end."""
        self._parts.live()
        self._hear_requests(now_ns)
        self.link.watch(now_ns)
        self._engagement.see_time(now_ns)
        if self._handover.look(now_ns, is_driven=self._engagement.enables, is_ending=self._is_ending):
            log.warning("HANDOVER: control is about to be given back")
        self.account.note(self._engagement, self.reason)
        newest, stale_ns = self._newest, now_ns - self._stale_ns
        implausible = self._parts.plausibility.persists(since_ns=stale_ns)
        if newest is not None and (implausible or newest.state.stamp_ns < stale_ns):
            self._answer_silence(newest, now_ns, Reason.STATE_INVALID if implausible else Reason.STATE_STALE)
        reports_alone = now_ns - self._commanded_ns > 2 * self._late_ns  # else they go out behind a command
        if reports_alone and self._engagement.reports(now_ns) and self._has_room():
            self._send_reports(now_ns)
        if self._parts.teller.is_quiet(now_ns):
            self._tell(now_ns)
        self._parts.teller.tell_details(now_ns, self.details)
        if self._has_begun_to_end:
            self._end_when_let_go(now_ns)

    def _answer_silence(self, newest: Sample, now_ns: int, reason: Reason) -> None:
        """No sample, or none to believe: an engaged vehicle is stopped from its last state, at the command period.

        Samples that cannot be believed are still answered where nothing is driven: with ENABLE = 0.
        """
        if not self._engagement.enables and reason is not Reason.STATE_INVALID:
            return
        self._answer = self._pilot.answer_without_sample(newest.state, self._tracker.status, reason)
        sent = self._send_command(self._answer, now_ns)
        self._counts.stale_stops += sent and self._answer.safe.enable
        self._tell(now_ns, sent=sent)

    def _send_reports(self, now_ns: int) -> None:
        """Lights and the controller's own report, when they are due."""
        body, report = self._parts.body_message, self._parts.report_message
        if body is not None and self._body_grid.due(now_ns):
            hazard = self._is_stopping and self.reason not in END_OF_TRAJECTORY
            self._hand_over((self._encoder.encode(body, BodyRequest(hazard_lights=hazard)),))
        if report is not None and self._report_grid.due(now_ns):
            spatial, temporal = self._parts.teller.indices
            content = ControllerReport(
                state=self._engagement.wire_state(stopping=self._is_stopping),
                reason=self.reason,
                ref_spatial_index=self._sayable("ref_spatial_index", spatial),
                ref_temporal_index=self._sayable("ref_temporal_index", temporal),
                deadline_misses=self._sayable("deadline_misses", self._counts.deadline_misses),
                handover=self._handover.warns,
            )
            self._hand_over((self._encoder.encode(report, content),))

    def _sayable(self, field: str, count: int) -> int:
        """The nearest that the report's signal can say."""
        low, high = self._parts.report_ranges.get(field, (count, count))
        return int(max(low, min(high, count)))

    @property
    def _is_stopping(self) -> bool:
        return self._answer is not None and self._answer.safe.safe_stop

    @property
    def _is_ending(self) -> bool:
        return self._engagement.mode is Mode.ENDING

    def _hear_requests(self, now_ns: int) -> None:
        if self._arm_requested:
            self._arm_requested = False
            if self.link.state not in OPEN:
                log.warning("not armed: the link is %s", self.link.state.name)
            elif not self._engagement.happened(Event.ARMED, now_ns):
                log.warning("not armed: %s", self._engagement.refusal_to_arm(self._tracker.status))
        if not self._has_begun_to_end and (self._end_is_due or self._end_requests):
            self._has_begun_to_end = True
            self.ended_in_fault = self._engagement.latched
            self._engagement.happened(Event.END, now_ns)
            self.done = not self._engagement.sends
        if self._end_requests > 1 and not self.done:
            self._let_go_at_once(now_ns)

    def _let_go_at_once(self, now_ns: int) -> None:
        """Asked to end twice: one ENABLE = 0, and out."""
        self.done = True
        self._engagement.happened(Event.STANDSTILL, now_ns)
        if self._engagement.mode is Mode.RELEASED and self._newest is not None:
            state = self._newest.state
            answer = self._pilot.answer_without_sample(state, self._tracker.status, Reason.SHUTDOWN)
            self._send_command(answer, now_ns)

    def _end_when_let_go(self, now_ns: int) -> None:
        """Done when the vehicle says that it has let go, was told so long enough, or hears nothing from us."""
        if not self._engagement.sends:
            self.ended_in_fault = self.ended_in_fault or self._engagement.latched
            self.done = True
        elif self._engagement.mode is Mode.RELEASED:
            self.ended_in_fault = self.ended_in_fault or self._engagement.reason is Reason.VEHICLE_FAULT
            if self._released_ns is None:
                self._released_ns = now_ns
            status = self._tracker.status
            let_go = (
                status is not None and status.stamp_ns > self._released_ns and status.mode is not VehicleMode.AUTONOMOUS
            )
            self.done = self.done or let_go or now_ns - self._released_ns >= LETTING_GO_NS

    def _tell(self, now_ns: int, *, sent: bool = False, latency_ns: int = 0) -> None:
        newest = self._newest
        self._parts.teller.tell(
            now_ns,
            controller_state=self._engagement.wire_state(stopping=self._is_stopping),
            reason=self.reason,
            state=newest.state if newest is not None else None,
            status=self._tracker.status,
            answer=self._answer,
            sent=sent,
            latency_ns=latency_ns,
            drops=sum(self._decoder.drops.values()),
            hands_over=self._handover.warns,
            handover_ns=self._handover.left_ns(now_ns, is_ending=self._is_ending),
        )

    def _on_link_lost(self) -> None:
        self._engagement.happened(Event.LINK_DOWN, self._now_ns())
        self._decoder.reset()
        self._tracker.forget()
        self._parts.plausibility.forget()
        if self._parts.shadow is not None:
            self._parts.shadow.forget()
        self._newest = None
