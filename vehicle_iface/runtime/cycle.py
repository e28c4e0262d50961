"""One control cycle: from a sample, through the controller and the gate, to a permitted command."""

import logging
from collections.abc import Callable

from vehicle_iface.command import Command, SafeCommand
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.errors import FrameMismatchError
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.gate import Gate
from vehicle_iface.safety.gear import GearCheck
from vehicle_iface.safety.modes import Event
from vehicle_iface.safety.motion import MotionCheck
from vehicle_iface.safety.stop_hold import StopHold
from vehicle_iface.standstill import STANDING_MPS
from vehicle_iface.state import VehicleState
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import ControllerState, Gear, VehicleStatus
from vehicle_iface.units import NS_PER_MS
from vehicle_iface.value import Value

log = logging.getLogger(__name__)

_NO_GEAR, _DRIVE, _REVERSE, _NOMINAL = Gear.NO_REQUEST, Gear.DRIVE, Gear.REVERSE, Reason.NOMINAL  # slow to read


class Decision(Value, frozen=True, gc=False):
    """What the controller requested and what may be sent for it."""

    requested: Command
    permitted: SafeCommand
    state: VehicleState | None = None
    """The state that the command was computed from; None for a release."""
    speed_mps: float = 0.0
    """The speed that the limits were computed for."""
    reversing: bool = False
    """Whether the vehicle drives backwards or, at standstill, is about to."""
    engaging: bool = False
    """Whether the vehicle has not reported AUTONOMOUS yet."""


class ControlCycle:
    """Decides the command for one sample, and its reason code."""

    def __init__(
        self,
        controller: ControllerBase,
        gate: Gate,
        engagement: Engagement,
        *,
        deviation: DeviationMonitor,
        motion: MotionCheck,
        gear_check: GearCheck,
        stop_hold: StopHold,
        gear_change_speed_mps: float,
        status_stale_ns: int,
        budget_ns: int,
        max_command_age_ns: int,
        counters: Counters,
        now_ns: Callable[[], int],
    ) -> None:
        """`budget_ns` limits the controller's computing time by the clock `now_ns`; `max_command_age_ns` the age of the
        sample when it returns."""
        self.controller = controller
        self.gate = gate
        self.deviation = deviation
        self.gear_check = gear_check
        self._motion, self._stop_hold = motion, stop_hold
        self._budget_ns, self._max_command_age_ns, self._now_ns = budget_ns, max_command_age_ns, now_ns
        self._engagement = engagement
        self._gear_change_speed_mps = gear_change_speed_mps
        self._status_stale_ns = status_stale_ns
        self._counters = counters
        self.last: Decision | None = None
        """The newest decision, sent or not."""
        self._was_enabled = False
        self._driven_gear: Gear | None = None
        self._is_slow = False

    @property
    def reason(self) -> Reason:
        """The reason of the last command; where commands are not enabled, the reason of the mode."""
        if self.last is not None and self._engagement.mode.computes:
            return self.last.permitted.reason
        return self._engagement.reason

    @property
    def is_stopping(self) -> bool:
        """Whether the last command is a stop."""
        return self.last is not None and self.last.permitted.safe_stop

    @property
    def wire_state(self) -> ControllerState:
        """The mode in the words of the bus contract."""
        return self._engagement.wire_state(stopping=self.is_stopping)

    def decide(
        self,
        sample: Sample,
        status: VehicleStatus | None,
        now_ns: int,
        *,
        is_implausible: bool = False,
        link_is_stalled: bool = False,
        other_takes_over: bool = False,
    ) -> Decision:
        """The decision for a fresh sample; a stop while the link accepts no commands.

        `is_implausible`: too many samples around this one are implausible. With `other_takes_over` a shadow's
        command is limited as while engaging, like that of the commander it is compared with.
        """
        state, mode = sample.state, self._engagement.mode
        fault = Reason.STATE_INVALID if is_implausible else self._fault(sample, status, now_ns)
        if mode.stops:
            requested = self._stop(state, self._engagement.reason, may_track=mode.ends and fault is None)
        elif link_is_stalled:
            requested = self._stop(state, Reason.LINK_DOWN, may_track=fault is None)
        elif fault is not None:
            requested = self._stop(state, fault)
        else:
            requested = self._request(state, now_ns)
        latches = sample.is_lost or self._motion.disagreement is not None
        needed_gear = find_needed_gear(requested, state)
        gear = status.gear if status is not None else None
        if self.gear_check.contradicts(state.speed_mps, needed_gear, gear, now_ns):
            requested, needed_gear, latches = self._stop(state, Reason.STATE_INVALID), Gear.NO_REQUEST, True
        held = self._hold(requested, state, now_ns, latches=latches)
        if held is not requested:
            needed_gear = _NO_GEAR
        return self._permit(held, state, gear, needed_gear, other_takes_over)

    def decide_stop(self, last: VehicleState, status: VehicleStatus | None, reason: Reason, now_ns: int) -> Decision:
        """A stop from the last known state, because no plausible sample came."""
        if self._engagement.mode.stops:
            reason = self._engagement.reason
        requested = self._hold(self._stop(last, reason), last, now_ns, latches=False)
        return self._permit(requested, last, status.gear if status is not None else None, Gear.NO_REQUEST)

    def begin_drive(self) -> None:
        """Clear earlier stops and deviations: the vehicle is driven from now on."""
        self.deviation.reset()
        self._stop_hold.reset()

    def _hold(self, requested: Command, state: VehicleState, now_ns: int, *, latches: bool) -> Command:
        """The request, or a stop while an earlier one still holds.

        A stop is latched when stops recur; with `latches`, one for an invalid state is latched at once.
        """
        cause = None if requested.reason is _NOMINAL else requested.reason
        reason = self._stop_hold.update(cause, now_ns, state.speed_mps)
        latches = latches and cause is Reason.STATE_INVALID
        if reason is not None and (latches or self._stop_hold.must_latch):
            self._latch_stop(reason, now_ns)
        return requested if reason is cause or reason is None else self._stop(state, reason)

    def _latch_stop(self, reason: Reason, now_ns: int) -> None:
        if self._engagement.apply(Event.STOP_LATCHED, now_ns, reason):
            log.warning("the stop is latched (%s): the vehicle is held until it is armed again", reason.name)

    def _stop(self, state: VehicleState, reason: Reason, *, may_track: bool = False) -> Command:
        """A stop command. `may_track`: the state is good, so it may steer along the path."""
        return self.controller.compute_stop_command(state, reason, may_track=may_track)

    def _fault(self, sample: Sample, status: VehicleStatus | None, now_ns: int) -> Reason | None:
        """Why the state must not be used for driving; None when it is good."""
        if not sample.pose_valid or self._motion.disagreement is not None:
            return Reason.STATE_INVALID
        if not sample.others_fresh:
            return Reason.STATE_STALE
        if status is not None and now_ns - status.stamp_ns > self._status_stale_ns:
            return Reason.STATE_STALE
        return None

    def _request(self, state: VehicleState, now_ns: int) -> Command:
        stop = self._stop
        try:
            requested = self.controller.compute_command(state)
        except FrameMismatchError:
            return stop(state, Reason.FRAME_MISMATCH)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a controller is the user's code: whatever it raises stops the vehicle
            self._counters.controller_errors += 1
            if self._counters.controller_errors == 1:
                log.exception("the controller raised; the vehicle is stopped (further ones are counted)")
            return stop(state, Reason.CONTROLLER_ERROR)
        done_ns = self._now_ns()
        if done_ns - now_ns > self._budget_ns:
            self._counters.controller_too_slow += 1
            if not self._is_slow:
                took_ms, budget_ms = (done_ns - now_ns) / NS_PER_MS, self._budget_ns / NS_PER_MS
                log.warning("the controller took %.4g ms, its budget is %.4g ms", took_ms, budget_ms)
            self._is_slow = True
            return stop(state, Reason.DEADLINE_MISSED)
        self._is_slow = False
        if done_ns - state.stamp_ns > self._max_command_age_ns:
            return stop(state, Reason.STATE_STALE)
        return stop(state, Reason.DEVIATION) if self._deviates(state, requested) else requested

    def _deviates(self, state: VehicleState, requested: Command) -> bool:
        trajectory = self.controller.trajectory
        if requested.is_stop or trajectory is None:
            return False
        greatest_mps = abs(self._motion.limit_speed_mps(state.speed_mps))
        index = self.controller.spatial_index
        return self.deviation.update(state, trajectory, index, requested.speed_mps, greatest_mps=greatest_mps)

    def _permit(
        self,
        requested: Command,
        state: VehicleState,
        gear: Gear | None,
        needed_gear: Gear,
        other_takes_over: bool = False,
    ) -> Decision:
        """The permitted command for a request. `gear` is the reported one, `needed_gear` that of the request."""
        mode, now_ns = self._engagement.mode, self._now_ns()
        driving = mode.enables or mode.computes
        if driving and not self._was_enabled:
            self.gate.start_from(state, now_ns)
            self._driven_gear = None
        self._was_enabled = driving
        if not driving:
            permitted = self.gate.release(stamp_ns=state.stamp_ns, reason=self._engagement.reason)
            self.last = Decision(requested=requested, permitted=permitted)
            return self.last
        may_change = abs(state.speed_mps) < self._gear_change_speed_mps
        gear_request = needed_gear if may_change and needed_gear is not gear else _NO_GEAR
        motion = self._motion
        if needed_gear is not _NO_GEAR:
            self._driven_gear = needed_gear
        # The last commanded direction is more reliable than the gear that the vehicle reports.
        reversing = motion.is_backwards(state.speed_mps, self._driven_gear if self._driven_gear is not None else gear)
        speed_mps = motion.limit_speed_mps(state.speed_mps)
        permitted = self.gate.permit(
            requested,
            state,
            now_ns=now_ns,
            reversing=reversing,
            engaging=other_takes_over or mode.engages,
            gear_request=gear_request,
            speed_mps=speed_mps,
            speed_is_known=motion.disagreement is None,
        )
        self.last = Decision(requested, permitted, state, speed_mps, reversing, mode.engages)
        return self.last


def find_needed_gear(requested: Command, state: VehicleState) -> Gear:
    """DRIVE or REVERSE by the direction of the command; NO_REQUEST for a stop or a command without a direction.

    The direction is the sign of the reference speed; at a standing start, where that speed is still 0, it is
    the direction in which the command accelerates.
    """
    if requested.reason is not _NOMINAL:
        return _NO_GEAR
    direction = requested.speed_mps
    if direction == 0.0 and abs(state.speed_mps) < STANDING_MPS:
        direction = requested.accel_mps2
    if direction == 0.0:
        return _NO_GEAR
    return _DRIVE if direction > 0.0 else _REVERSE
