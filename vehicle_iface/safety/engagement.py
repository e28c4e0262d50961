"""Engagement: the mode now, and what raises the events (arming, driver override, vehicle fault) that change it."""

import logging
from typing import NamedTuple

from vehicle_iface.reason import Reason
from vehicle_iface.safety.modes import DRIVING, SETTLING, TABLE, Event, Mode
from vehicle_iface.status import ControllerState, VehicleMode, VehicleStatus
from vehicle_iface.units import NS_PER_MS
from vehicle_iface.value import Value

log = logging.getLogger(__name__)

OBSERVING_NS = 200 * NS_PER_MS
"""Twice the vehicle's watchdog time: by then frames of another commander were received, or the watchdog has acted, or
the vehicle has no watchdog and nobody drives it."""
MAX_TRANSITIONS = 1000


class EngagementTiming(Value, frozen=True, kw_only=True):
    """How long things may take, in nanoseconds."""

    settle_ns: int
    """Samples must have come this long before the controller engages."""
    stale_ns: int
    """After a gap longer than this, samples are no longer fresh."""
    lost_ns: int
    """No sample for longer than this: silence. No status: observe again whether another node drives."""
    status_stale_ns: int
    """A status older than this never leads to engagement: of several messages, one is missing."""
    engage_timeout_ns: int
    """The vehicle must report AUTONOMOUS within this time."""
    end_ns: int
    """The stop at the end of a run takes at most this long; then the vehicle is released."""
    steer_torque_nm: float
    """The driver's steering torque, in Nm without sign, that counts as an override."""


class Transition(NamedTuple):
    """A change of mode, its time and its reason."""

    at_ns: int
    mode: Mode
    reason: Reason


class Engagement:
    """The mode and its reason; methods apply events. Reads no clock: methods get `now_ns`."""

    def __init__(self, timing: EngagementTiming, *, armed: bool) -> None:
        self._timing = timing
        self.mode = Mode.OBSERVING if armed else Mode.SHADOW
        self.reason = Reason.NOT_ENGAGED
        self.latched_fault: Reason | None = None
        """The reason of a latched fault, until the loop is armed again."""
        self.transitions: list[Transition] = []
        """The first mode changes of the run, at most `MAX_TRANSITIONS`."""
        self._since_ns: int | None = None
        self._vehicle_since_ns: int | None = None
        """Time of the first frame from the vehicle; None while nothing is received from it."""
        self._status_ns: int | None = None
        self._fresh_since_ns: int | None = None
        self._last_sample_ns: int | None = None

    def may_report(self, now_ns: int) -> bool:
        """Whether lights and report may be sent; in OBSERVING only after 200 ms without any frame of the vehicle."""
        if not self.mode.observes:
            return self.mode.may_send
        return self._vehicle_since_ns is None and self._since_ns is not None and now_ns - self._since_ns > OBSERVING_NS

    @property
    def ends_in_fault(self) -> bool:
        """Whether the run would end in a latched fault now."""
        return self.mode.latched or (self.mode.observes and self.latched_fault is not None)

    @property
    def is_released(self) -> bool:
        """Whether the vehicle was released for good."""
        return self.mode is Mode.RELEASED

    def wire_state(self, *, stopping: bool) -> ControllerState:
        """The mode in the words of the bus contract; `stopping` while the command is a stop."""
        if stopping and self.mode is Mode.ENGAGED:
            return ControllerState.STOPPING
        return self.mode.wire_state

    def apply(self, event: Event, now_ns: int, reason: Reason | None = None) -> bool:
        """Apply one event; return whether the mode changed. `reason` is the reason of a latched stop."""
        if event is Event.ARMED:
            self._fresh_since_ns = None
        pair = TABLE.get((self.mode, event))
        if pair is None:
            return False
        mode, why = pair
        if mode.observes:
            self._vehicle_since_ns = self._status_ns = None
        if why is None:
            why = reason if reason is not None else self.reason
        self.mode, self.reason = mode, why
        self._since_ns = now_ns
        if mode.latched is not None:
            self.latched_fault = why if mode.latched else None
        log.info("%s (%s)", mode.name, why.name)
        if len(self.transitions) < MAX_TRANSITIONS:
            self.transitions.append(Transition(now_ns, mode, why))
        return True

    def refusal_to_arm(self, status: VehicleStatus | None) -> str:
        """Return why `Event.ARMED` was rejected, as text for the log."""
        refusal = self.mode.refusal
        if self.mode is not Mode.STANDBY or status is None:
            return refusal
        hands = ", and the driver operates it" if self.is_driver_override(status) else ""
        return f"{refusal}; the vehicle is {status.mode.name}{hands}"

    def on_sample(self, stamp_ns: int, now_ns: int, *, is_usable: bool = True) -> None:
        """Note a complete sample of `stamp_ns`. A sample that is not usable never leads to engagement."""
        if self._vehicle_since_ns is None:
            self._vehicle_since_ns = now_ns
        last_ns = self._last_sample_ns
        self._last_sample_ns = stamp_ns
        if not is_usable:
            self._fresh_since_ns = None
            self.apply(Event.STALE, now_ns)
            return
        if self._fresh_since_ns is None or last_ns is None or stamp_ns - last_ns > self._timing.stale_ns:
            self._fresh_since_ns = stamp_ns
        if self.mode in SETTLING and stamp_ns - self._fresh_since_ns >= self._timing.settle_ns:
            self.apply(Event.FRESH, now_ns)

    def on_status(self, status: VehicleStatus, now_ns: int) -> bool:
        """Apply a status of the vehicle (mode, driver). Return whether this began ENGAGING or ENGAGED."""
        before = self.mode
        self._status_ns = now_ns
        if self._vehicle_since_ns is None:
            self._vehicle_since_ns = now_ns
        if status.mode is not VehicleMode.AUTONOMOUS:
            self.apply(Event.NO_OTHER_DRIVER, now_ns)
        if status.mode in (VehicleMode.FAULT, VehicleMode.EMERGENCY_STOP):
            self.apply(Event.VEHICLE_FAULT, now_ns)
        elif status.mode is VehicleMode.MANUAL or self.is_driver_override(status):
            self.apply(Event.OVERRIDE, now_ns)
        elif status.mode is VehicleMode.AUTONOMOUS:
            self.apply(Event.VEHICLE_AUTONOMOUS, now_ns)
        elif self.mode is Mode.STANDBY:
            if now_ns - status.stamp_ns <= self._timing.status_stale_ns:
                self.apply(Event.VEHICLE_READY, now_ns)
        else:
            self.apply(Event.VEHICLE_DISENGAGED, now_ns)
        return self.mode is not before and self.mode in DRIVING

    def on_tick(self, now_ns: int) -> None:
        """Apply timeouts: missing samples, missing status, engagement, end of the run."""
        gap_ns = now_ns - self._last_sample_ns if self._last_sample_ns is not None else 0
        if gap_ns > self._timing.lost_ns:
            self.apply(Event.STATE_LOST, now_ns)
        if self._status_ns is not None and now_ns - self._status_ns > self._timing.lost_ns:
            self.apply(Event.STATUS_LOST, now_ns)
        if gap_ns > self._timing.stale_ns:
            self._fresh_since_ns = None
            self.apply(Event.STALE, now_ns)
        if self._since_ns is None:
            self._since_ns = now_ns
        in_mode_ns = now_ns - self._since_ns
        if self._vehicle_since_ns is not None and now_ns - self._vehicle_since_ns > OBSERVING_NS:
            self.apply(Event.NO_OTHER_DRIVER, now_ns)
        if in_mode_ns > self._timing.engage_timeout_ns:
            self.apply(Event.ENGAGE_TIMEOUT, now_ns)
        if self.mode.ends and in_mode_ns > self._timing.end_ns:
            self.apply(Event.STANDSTILL, now_ns)

    def is_driver_override(self, status: VehicleStatus) -> bool:
        """Whether the driver operates brake, throttle or steering."""
        hands = abs(status.driver_steer_torque_nm) >= self._timing.steer_torque_nm
        return status.driver_brake or status.driver_throttle or status.driver_steers or hands
