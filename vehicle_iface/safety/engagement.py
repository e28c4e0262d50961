"""Who drives: a table of modes and events, and the conditions that raise the events."""

from dataclasses import dataclass
from enum import Enum, auto

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, VehicleMode, VehicleStatus
from vehicle_iface.units import NS_PER_MS

HEARING_NS = 200 * NS_PER_MS
"""Twice as long as a vehicle waits for its commander: by then another one was heard, or the vehicle's watchdog has
acted, or it has none and nobody drives it."""


class Mode(Enum):
    """What the controller is allowed to do."""

    LISTENING = auto()
    """Not armed: not one frame leaves."""
    HEARING = auto()
    """Armed, but no command leaves: ENABLE = 0 would take the vehicle away from whoever drives it."""
    STARTING = auto()
    """Armed, waiting until samples have been fresh for a while."""
    STANDBY = auto()
    """Armed and fresh; engages when it has been told to and the vehicle is ready."""
    ENGAGING = auto()
    """Commands with ENABLE = 1, until the vehicle says that it is autonomous."""
    ENGAGED = auto()
    """Driving."""
    OVERRIDDEN = auto()
    """The driver took over; stays out until told again."""
    FAULT = auto()
    """Latched; answers with ENABLE = 0."""
    SILENT = auto()
    """Latched; sends nothing, so that the vehicle's own watchdog acts."""
    ENDING = auto()
    """Stopping the vehicle for good."""
    RELEASED = auto()
    """Let go for good: answers with ENABLE = 0 until the program ends."""


class Event(Enum):
    """What changes the mode."""

    ARMED = auto()
    NOBODY_DRIVES = auto()
    FRESH = auto()
    STALE = auto()
    VEHICLE_READY = auto()
    VEHICLE_AUTONOMOUS = auto()
    GAVE_UP = auto()
    OVERRIDE = auto()
    VEHICLE_LEFT = auto()
    VEHICLE_FAULT = auto()
    STATE_LOST = auto()
    STATUS_LOST = auto()
    LINK_DOWN = auto()
    DUPLICATE_COMMANDER = auto()
    END = auto()
    STANDSTILL = auto()


_DRIVING = (Mode.ENGAGING, Mode.ENGAGED)
_ANSWERING = (Mode.STARTING, Mode.STANDBY, *_DRIVING, Mode.OVERRIDDEN, Mode.FAULT)

TABLE: dict[tuple[Mode, Event], tuple[Mode, Reason]] = {
    (Mode.HEARING, Event.NOBODY_DRIVES): (Mode.STARTING, Reason.NOT_ENGAGED),
    (Mode.STARTING, Event.FRESH): (Mode.STANDBY, Reason.NOT_ENGAGED),
    (Mode.STANDBY, Event.STALE): (Mode.STARTING, Reason.NOT_ENGAGED),
    **{(mode, Event.STATUS_LOST): (Mode.HEARING, Reason.NOT_ENGAGED) for mode in (Mode.STARTING, Mode.STANDBY)},
    (Mode.STANDBY, Event.VEHICLE_READY): (Mode.ENGAGING, Reason.NOMINAL),
    (Mode.ENGAGING, Event.VEHICLE_AUTONOMOUS): (Mode.ENGAGED, Reason.NOMINAL),
    (Mode.ENGAGING, Event.GAVE_UP): (Mode.FAULT, Reason.VEHICLE_NOT_AUTONOMOUS),
    (Mode.ENGAGED, Event.VEHICLE_LEFT): (Mode.FAULT, Reason.VEHICLE_NOT_AUTONOMOUS),
    **{(mode, Event.OVERRIDE): (Mode.OVERRIDDEN, Reason.DRIVER_OVERRIDE) for mode in _DRIVING},
    **{(mode, Event.VEHICLE_FAULT): (Mode.FAULT, Reason.VEHICLE_FAULT) for mode in _DRIVING},
    **{(mode, Event.STATE_LOST): (Mode.SILENT, Reason.STATE_STALE) for mode in _DRIVING},
    **{(mode, Event.LINK_DOWN): (Mode.SILENT, Reason.LINK_DOWN) for mode in (Mode.HEARING, *_ANSWERING, Mode.ENDING)},
    **{
        (mode, Event.DUPLICATE_COMMANDER): (Mode.SILENT, Reason.DUPLICATE_COMMANDER)
        for mode in (Mode.HEARING, *_ANSWERING, Mode.ENDING, Mode.RELEASED)
    },
    **{(mode, Event.ARMED): (Mode.STARTING, Reason.NOT_ENGAGED) for mode in (Mode.OVERRIDDEN, Mode.FAULT)},
    (Mode.SILENT, Event.ARMED): (Mode.HEARING, Reason.NOT_ENGAGED),
    **{(mode, Event.END): (Mode.ENDING, Reason.SHUTDOWN) for mode in _DRIVING},
    **{
        (mode, Event.END): (Mode.RELEASED, Reason.SHUTDOWN)
        for mode in (Mode.STARTING, Mode.STANDBY, Mode.OVERRIDDEN, Mode.FAULT)
    },
    (Mode.ENDING, Event.STANDSTILL): (Mode.RELEASED, Reason.SHUTDOWN),
    (Mode.ENDING, Event.OVERRIDE): (Mode.RELEASED, Reason.DRIVER_OVERRIDE),
    (Mode.ENDING, Event.VEHICLE_LEFT): (Mode.RELEASED, Reason.SHUTDOWN),
    (Mode.ENDING, Event.VEHICLE_FAULT): (Mode.RELEASED, Reason.VEHICLE_FAULT),
    (Mode.ENDING, Event.STATE_LOST): (Mode.SILENT, Reason.STATE_STALE),
}
"""A missing pair means: stay."""

_WIRE_STATE = {
    Mode.LISTENING: ControllerState.SHADOW,
    Mode.HEARING: ControllerState.STARTING,
    Mode.STARTING: ControllerState.STARTING,
    Mode.STANDBY: ControllerState.STANDBY,
    Mode.ENGAGING: ControllerState.ENGAGING,
    Mode.ENGAGED: ControllerState.ENGAGED,
    Mode.OVERRIDDEN: ControllerState.STANDBY,
    Mode.FAULT: ControllerState.FAULT,
    Mode.SILENT: ControllerState.FAULT,
    Mode.ENDING: ControllerState.STOPPING,
    Mode.RELEASED: ControllerState.STANDBY,
}


_NOT_ARMED = {
    Mode.LISTENING: "this run only listens; start it with --arm",
    Mode.HEARING: "it is armed, and hears whether somebody else drives the vehicle",
    Mode.STARTING: "it is armed, and waits for fresh samples",
    Mode.STANDBY: "it is armed, and waits for the vehicle to be READY",
    Mode.ENGAGING: "it is engaging",
    Mode.ENGAGED: "it drives",
    Mode.ENDING: "it is ending",
    Mode.RELEASED: "it is ending",
}
"""Every mode that `Event.ARMED` does not change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngagementTiming:
    """How long things may take, in nanoseconds."""

    fresh_ns: int
    """Samples must have come this long before the controller engages."""
    stale_ns: int
    """A gap of this much ends being fresh."""
    lost_ns: int
    """No sample for this long: silence. No status: it is not known any more whether somebody else drives."""
    give_up_ns: int
    """The vehicle has this long to become autonomous."""
    end_ns: int
    """A stop for good takes at most this long."""
    steer_torque_nm: float
    """The driver's hands count as an override from here on."""


class Engagement:
    """The mode, why it is so, and what makes it change. Time is given."""

    def __init__(self, timing: EngagementTiming, *, armed: bool) -> None:
        self._timing = timing
        self.mode = Mode.HEARING if armed else Mode.LISTENING
        self.reason = Reason.NOT_ENGAGED
        self._since_ns: int | None = None
        self._heard_ns: int | None = None
        """Since then there is a vehicle; None while it hears nothing."""
        self._status_ns: int | None = None
        self._hears_after_fault = False
        self._fresh_since_ns: int | None = None
        self._last_sample_ns: int | None = None
        self.transitions: list[tuple[int, Mode, Reason]] = []
        """(when in ns, mode, reason), to be taken by whoever logs them."""

    @property
    def enables(self) -> bool:
        """Whether commands go out with ENABLE = 1."""
        return self.mode in (*_DRIVING, Mode.ENDING)

    @property
    def sends(self) -> bool:
        """Whether commands may be sent at all."""
        return self.mode not in (Mode.LISTENING, Mode.HEARING, Mode.SILENT)

    def reports(self, now_ns: int) -> bool:
        """Whether lights and report may be sent; while it hears, only where there is no vehicle yet."""
        if self.mode is not Mode.HEARING:
            return self.sends
        return self._heard_ns is None and self._since_ns is not None and now_ns - self._since_ns > HEARING_NS

    @property
    def latched(self) -> bool:
        """Whether the run ended, so far, in a latched fault."""
        return self.mode in (Mode.FAULT, Mode.SILENT) or (self.mode is Mode.HEARING and self._hears_after_fault)

    def wire_state(self, *, stopping: bool) -> ControllerState:
        """The mode in the words of the bus contract; `stopping` while the command is a stop."""
        if self.mode is Mode.ENGAGED and stopping:
            return ControllerState.STOPPING
        return _WIRE_STATE[self.mode]

    def happened(self, event: Event, now_ns: int) -> bool:
        """Apply one event; whether the mode changed."""
        if event is Event.ARMED:
            self._fresh_since_ns = None
        pair = TABLE.get((self.mode, event))
        if pair is None:
            return False
        if pair[0] is Mode.HEARING:
            self._heard_ns = self._status_ns = None
            self._hears_after_fault = self.mode is Mode.SILENT
        self.mode, self.reason = pair
        self._since_ns = now_ns
        self.transitions.append((now_ns, self.mode, self.reason))
        return True

    def refusal_to_arm(self, status: VehicleStatus | None) -> str:
        """Why `Event.ARMED` has changed nothing, in words."""
        if self.mode is not Mode.STANDBY or status is None:
            return _NOT_ARMED[self.mode]
        hands = ", and the driver acts" if self.driver_acts(status) else ""
        return f"{_NOT_ARMED[self.mode]}; it is {status.mode.name}{hands}"

    def see_sample(self, stamp_ns: int, now_ns: int) -> None:
        """A complete sample of `stamp_ns` has come."""
        self._hears(now_ns)
        last_ns = self._last_sample_ns
        self._last_sample_ns = stamp_ns
        if self._fresh_since_ns is None or last_ns is None or stamp_ns - last_ns > self._timing.stale_ns:
            self._fresh_since_ns = stamp_ns
        if stamp_ns - self._fresh_since_ns >= self._timing.fresh_ns:
            self.happened(Event.FRESH, now_ns)

    def see_status(self, status: VehicleStatus, now_ns: int) -> None:
        """The vehicle has reported its mode and its driver."""
        self._status_ns = now_ns
        self._hears(now_ns)
        if status.mode is not VehicleMode.AUTONOMOUS:
            self.happened(Event.NOBODY_DRIVES, now_ns)
        overridden = self.driver_acts(status) or status.mode is VehicleMode.MANUAL
        if status.mode in (VehicleMode.FAULT, VehicleMode.EMERGENCY_STOP):
            self.happened(Event.VEHICLE_FAULT, now_ns)
        elif overridden:
            self.happened(Event.OVERRIDE, now_ns)
        elif status.mode is VehicleMode.AUTONOMOUS:
            self.happened(Event.VEHICLE_AUTONOMOUS, now_ns)
        elif self.mode is Mode.STANDBY:
            self.happened(Event.VEHICLE_READY, now_ns)
        else:
            self.happened(Event.VEHICLE_LEFT, now_ns)

    def see_time(self, now_ns: int) -> None:
        """Time has passed: notice what did not come."""
        gap_ns = now_ns - self._last_sample_ns if self._last_sample_ns is not None else 0
        if gap_ns > self._timing.lost_ns:
            self.happened(Event.STATE_LOST, now_ns)
        if self._status_ns is not None and now_ns - self._status_ns > self._timing.lost_ns:
            self.happened(Event.STATUS_LOST, now_ns)
        if gap_ns > self._timing.stale_ns:
            self._fresh_since_ns = None
            self.happened(Event.STALE, now_ns)
        if self._since_ns is None:
            self._since_ns = now_ns
        in_mode_ns = now_ns - self._since_ns
        if self._heard_ns is not None and now_ns - self._heard_ns > HEARING_NS:
            self.happened(Event.NOBODY_DRIVES, now_ns)
        if in_mode_ns > self._timing.give_up_ns:
            self.happened(Event.GAVE_UP, now_ns)
        if self.mode is Mode.ENDING and in_mode_ns > self._timing.end_ns:
            self.happened(Event.STANDSTILL, now_ns)

    def driver_acts(self, status: VehicleStatus) -> bool:
        """Whether the driver's feet or hands are on the controls."""
        hands = abs(status.driver_steer_torque_nm) >= self._timing.steer_torque_nm
        return status.driver_brake or status.driver_throttle or hands

    def _hears(self, now_ns: int) -> None:
        if self._heard_ns is None:
            self._heard_ns = now_ns
