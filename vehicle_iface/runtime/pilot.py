"""What to answer: from a sample, through the controller and the gate, to a permission."""

import logging
from collections.abc import Callable
from typing import NamedTuple

from vehicle_iface.command import Command, SafeCommand
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.errors import FrameMismatchError
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.engagement import Engagement, Mode
from vehicle_iface.safety.gate import Gate
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear, VehicleStatus
from vehicle_iface.tracker import Sample
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

STANDSTILL_MPS = 0.05
"""Slower than this the vehicle stands, as far as its own speed signal can tell."""


class Answer(NamedTuple):
    """What the controller wished and what may be sent for it."""

    wish: Command
    safe: SafeCommand


class Pilot:
    """Decides the command for one sample; the reason that decided goes with it."""

    def __init__(
        self,
        controller: ControllerBase,
        gate: Gate,
        engagement: Engagement,
        *,
        deviation: DeviationMonitor,
        gear_change_speed_mps: float,
        status_stale_ns: int,
        budget_ns: int,
        answer_age_ns: int,
        counts: Counts,
        now_ns: Callable[[], int],
    ) -> None:
        """By the clock `now_ns` the controller may take `budget_ns` for a command, and no longer than until the sample
        is `answer_age_ns` old."""
        self.controller = controller
        self.gate = gate
        self.deviation = deviation
        self._budget_ns, self._answer_age_ns, self._now_ns = budget_ns, answer_age_ns, now_ns
        self._engagement = engagement
        self._gear_change_speed_mps = gear_change_speed_mps
        self._status_stale_ns = status_stale_ns
        self._counts = counts
        self._was_enabled = False
        self._is_slow = False

    def answer(
        self,
        sample: Sample,
        status: VehicleStatus | None,
        now_ns: int,
        *,
        link_is_stalled: bool = False,
        other_takes_over: bool = False,
    ) -> Answer:
        """The answer to a fresh sample; a stop while the link does not take the commands.

        While another commander takes the vehicle over, a shadow's answer is within the limits of engaging.
        """
        fault = self._fault(sample, status, now_ns)
        if self._engagement.mode is Mode.ENDING:
            wish = self._stop(sample.state, Reason.SHUTDOWN, may_track=fault is None)
        elif link_is_stalled:
            wish = self._stop(sample.state, Reason.LINK_DOWN, may_track=fault is None)
        elif fault is not None:
            wish = self._stop(sample.state, fault)
        else:
            wish = self._wish(sample.state, now_ns)
        return self._permitted(wish, sample.state, status, other_takes_over=other_takes_over)

    def answer_without_sample(self, last: VehicleState, status: VehicleStatus | None, reason: Reason) -> Answer:
        """A stop from the last known state, because no sample came that can be believed."""
        if self._engagement.mode is Mode.ENDING:
            reason = Reason.SHUTDOWN
        return self._permitted(self._stop(last, reason), last, status)

    def _stop(self, state: VehicleState, reason: Reason, *, may_track: bool = False) -> Command:
        """Steered along the path only where nothing is wrong but what it stops for."""
        return self.controller.compute_stop_command(state, reason, may_track=may_track)

    def _fault(self, sample: Sample, status: VehicleStatus | None, now_ns: int) -> Reason | None:
        """Why the state is not to be driven by; None when it is good."""
        if not sample.pose_valid:
            return Reason.STATE_INVALID
        if not sample.others_fresh:
            return Reason.STATE_STALE
        if status is not None and now_ns - status.stamp_ns > self._status_stale_ns:
            return Reason.STATE_STALE
        return None

    def _wish(self, state: VehicleState, now_ns: int) -> Command:
        stop = self._stop
        try:
            wish = self.controller.compute_command(state)
        except FrameMismatchError:
            return stop(state, Reason.FRAME_MISMATCH)
        except KeyboardInterrupt:
            raise
        except BaseException:  # a controller is the user's code: whatever it raises stops the vehicle
            self._counts.controller_errors += 1
            if self._counts.controller_errors == 1:
                log.exception("the controller raised; the vehicle is stopped (further ones are counted)")
            return stop(state, Reason.CONTROLLER_ERROR)
        done_ns = self._now_ns()
        if done_ns - now_ns > self._budget_ns:
            self._counts.controller_too_slow += 1
            if not self._is_slow:
                took_ms, budget_ms = (done_ns - now_ns) / NS_PER_MS, self._budget_ns / NS_PER_MS
                log.warning("the controller took %.4g ms, its budget is %.4g ms", took_ms, budget_ms)
            self._is_slow = True
            return stop(state, Reason.DEADLINE_MISSED)
        self._is_slow = False
        if done_ns - state.stamp_ns > self._answer_age_ns:
            return stop(state, Reason.STATE_STALE)
        return stop(state, Reason.DEVIATION) if self._deviates(state, wish) else wish

    def _deviates(self, state: VehicleState, wish: Command) -> bool:
        trajectory = self.controller.trajectory
        if wish.is_stop or trajectory is None:
            return False
        return self.deviation.stops(state, trajectory, self.controller.spatial_index, wish.speed_mps)

    def _permitted(
        self,
        wish: Command,
        state: VehicleState,
        status: VehicleStatus | None,
        *,
        other_takes_over: bool = False,
    ) -> Answer:
        engagement, now_ns = self._engagement, self._now_ns()
        driving = engagement.enables or engagement.mode is Mode.LISTENING
        if driving and not self._was_enabled:
            self.gate.start_from(state, now_ns)
        self._was_enabled = driving
        if not driving:
            return Answer(wish=wish, safe=self.gate.release(stamp_ns=state.stamp_ns, reason=engagement.reason))
        gear = status.gear if status is not None else None
        wanted = wanted_gear(wish, state)
        may_change = abs(state.speed_mps) < self._gear_change_speed_mps
        request = wanted if may_change and wanted is not gear else Gear.NO_REQUEST
        safe = self.gate.permit(
            wish,
            state,
            now_ns=now_ns,
            reversing=_is_reversing(state, wanted, gear),
            engaging=other_takes_over or engagement.mode is Mode.ENGAGING,
            gear_request=request,
        )
        return Answer(wish=wish, safe=safe)


def wanted_gear(wish: Command, state: VehicleState) -> Gear:
    """DRIVE or REVERSE by the direction of the command, NO_REQUEST for a stop or where it has none.

    The direction is the sign of the reference speed; at a standing start, where that speed is still 0, it is
    the direction in which the command accelerates.
    """
    if wish.is_stop:
        return Gear.NO_REQUEST
    direction = wish.speed_mps
    if direction == 0.0 and abs(state.speed_mps) < STANDSTILL_MPS:
        direction = wish.accel_mps2
    if direction == 0.0:
        return Gear.NO_REQUEST
    return Gear.DRIVE if direction > 0.0 else Gear.REVERSE


def _is_reversing(state: VehicleState, wanted: Gear, gear: Gear | None) -> bool:
    """Which way driving and braking point: by motion, else by the gear that is wanted or in; forwards if unknown."""
    if abs(state.speed_mps) >= STANDSTILL_MPS:
        return state.speed_mps < 0.0
    return (wanted if wanted is not Gear.NO_REQUEST else gear) is Gear.REVERSE
