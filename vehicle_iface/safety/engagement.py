"""Engagement: a table of modes and events (arming, driver override, vehicle fault), and what raises the events."""

import logging
from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, VehicleMode, VehicleStatus
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

OBSERVING_NS = 200 * NS_PER_MS
"""Twice the vehicle's watchdog time: by then frames of another commander were received, or the watchdog has acted, or
the vehicle has no watchdog and nobody drives it."""
MAX_TRANSITIONS = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeRow:
    """The properties of a mode. Compared by identity, so that modes with equal columns stay different modes."""

    may_send: bool = False
    """Commands may be sent at all."""
    enables: bool = False
    """Commands go out with ENABLE = 1."""
    computes: bool = False
    """The controller decides the command."""
    engages: bool = False
    """Commands have the profile's additional limits `while_engaging`."""
    stops: bool = False
    """The vehicle is stopped or held, for the reason of the mode."""
    ends: bool = False
    """The run is ending."""
    disengaged: bool = False
    """The vehicle was released, until the loop is armed again."""
    observes: bool = False
    """It is not known yet whether another node drives the vehicle."""
    latched: bool | None = False
    """Whether the run is in a latched fault; None keeps the value of the mode before."""
    wire_state: ControllerState
    """The mode in the words of the bus contract."""
    refusal: str = ""
    """Why a request to arm is refused; empty where it is accepted."""


class Mode(Enum):
    """The modes, one `ModeRow` each; its columns are the mode's attributes."""

    SHADOW = ModeRow(
        computes=True, wire_state=ControllerState.SHADOW, refusal="this run only observes; start it with --arm"
    )
    """Not armed: no frame is sent."""
    OBSERVING = ModeRow(
        observes=True,
        latched=None,
        wire_state=ControllerState.STARTING,
        refusal="it is armed, and observes whether another node drives the vehicle",
    )
    """Armed, but no command is sent: ENABLE = 0 would release a vehicle that another node drives."""
    STARTING = ModeRow(
        may_send=True, wire_state=ControllerState.STARTING, refusal="it is armed, and waits for fresh samples"
    )
    """Armed, waiting until samples have been fresh for a while."""
    STANDBY = ModeRow(
        may_send=True,
        wire_state=ControllerState.STANDBY,
        refusal="it is armed, and waits for the vehicle to be READY",
    )
    """Armed, with fresh samples; engages when the vehicle is READY."""
    ENGAGING = ModeRow(
        may_send=True,
        enables=True,
        computes=True,
        engages=True,
        wire_state=ControllerState.ENGAGING,
        refusal="it is engaging",
    )
    """Commands with ENABLE = 1, until the vehicle reports AUTONOMOUS."""
    ENGAGED = ModeRow(
        may_send=True, enables=True, computes=True, wire_state=ControllerState.ENGAGED, refusal="it drives"
    )
    """Driving."""
    HALTING = ModeRow(
        may_send=True,
        enables=True,
        stops=True,
        latched=True,
        wire_state=ControllerState.STOPPING,
        refusal="the stop is latched, and the vehicle does not stand yet or its sources of motion disagree",
    )
    """Latched; the vehicle is braked to standstill."""
    HALTED = ModeRow(may_send=True, enables=True, stops=True, latched=True, wire_state=ControllerState.STOPPING)
    """Latched; the vehicle is held at standstill until the loop is armed again."""
    OVERRIDDEN = ModeRow(may_send=True, disengaged=True, latched=None, wire_state=ControllerState.STANDBY)
    """Driver override; ENABLE = 0 until the loop is armed again."""
    FAULT = ModeRow(may_send=True, disengaged=True, latched=True, wire_state=ControllerState.FAULT)
    """Latched; samples are answered with ENABLE = 0."""
    SILENT = ModeRow(latched=True, wire_state=ControllerState.FAULT)
    """Latched; nothing is sent, so that the vehicle's own watchdog acts."""
    ENDING = ModeRow(
        may_send=True,
        enables=True,
        stops=True,
        ends=True,
        latched=None,
        wire_state=ControllerState.STOPPING,
        refusal="the run is ending",
    )
    """The run is ending: the vehicle is stopped."""
    RELEASED = ModeRow(
        may_send=True, disengaged=True, latched=None, wire_state=ControllerState.STANDBY, refusal="the run is ending"
    )
    """The run is ending: samples are answered with ENABLE = 0 until the program exits."""

    def __init__(self, row: ModeRow) -> None:
        self.may_send, self.enables, self.computes, self.engages = row.may_send, row.enables, row.computes, row.engages
        self.stops, self.ends, self.observes, self.latched = row.stops, row.ends, row.observes, row.latched
        self.disengaged, self.wire_state, self.refusal = row.disengaged, row.wire_state, row.refusal


class Event(Enum):
    """Events that change the mode."""

    ARMED = auto()
    NO_OTHER_DRIVER = auto()
    FRESH = auto()
    STALE = auto()
    VEHICLE_READY = auto()
    VEHICLE_AUTONOMOUS = auto()
    ENGAGE_TIMEOUT = auto()
    OVERRIDE = auto()
    VEHICLE_DISENGAGED = auto()
    VEHICLE_FAULT = auto()
    STATE_LOST = auto()
    STATUS_LOST = auto()
    LINK_DOWN = auto()
    DUPLICATE_COMMANDER = auto()
    STOP_LATCHED = auto()
    END = auto()
    STANDSTILL = auto()


_DRIVING = tuple(mode for mode in Mode if mode.computes and mode.may_send)
_LATCHED_STOP = tuple(mode for mode in Mode if mode.stops and not mode.ends)
_ENABLING = (*_DRIVING, *_LATCHED_STOP)
_ANSWERING = (Mode.STARTING, Mode.STANDBY, *_ENABLING, Mode.OVERRIDDEN, Mode.FAULT)

TABLE: dict[tuple[Mode, Event], tuple[Mode, Reason | None]] = {
    (Mode.OBSERVING, Event.NO_OTHER_DRIVER): (Mode.STARTING, Reason.NOT_ENGAGED),
    (Mode.STARTING, Event.FRESH): (Mode.STANDBY, Reason.NOT_ENGAGED),
    (Mode.STANDBY, Event.STALE): (Mode.STARTING, Reason.NOT_ENGAGED),
    **{(mode, Event.STATUS_LOST): (Mode.OBSERVING, Reason.NOT_ENGAGED) for mode in (Mode.STARTING, Mode.STANDBY)},
    (Mode.STANDBY, Event.VEHICLE_READY): (Mode.ENGAGING, Reason.NOMINAL),
    (Mode.ENGAGING, Event.VEHICLE_AUTONOMOUS): (Mode.ENGAGED, Reason.NOMINAL),
    (Mode.ENGAGING, Event.ENGAGE_TIMEOUT): (Mode.FAULT, Reason.VEHICLE_NOT_AUTONOMOUS),
    **{
        (mode, Event.VEHICLE_DISENGAGED): (Mode.FAULT, Reason.VEHICLE_NOT_AUTONOMOUS)
        for mode in (Mode.ENGAGED, *_LATCHED_STOP)
    },
    **{(mode, Event.OVERRIDE): (Mode.OVERRIDDEN, Reason.DRIVER_OVERRIDE) for mode in _ENABLING},
    **{(mode, Event.VEHICLE_FAULT): (Mode.FAULT, Reason.VEHICLE_FAULT) for mode in _ENABLING},
    **{(mode, Event.STATE_LOST): (Mode.SILENT, Reason.STATE_STALE) for mode in _ENABLING},
    **{(mode, Event.STOP_LATCHED): (Mode.HALTING, None) for mode in _DRIVING},
    (Mode.HALTING, Event.STANDSTILL): (Mode.HALTED, None),
    (Mode.HALTED, Event.ARMED): (Mode.ENGAGED, Reason.NOMINAL),
    **{(mode, Event.LINK_DOWN): (Mode.SILENT, Reason.LINK_DOWN) for mode in (Mode.OBSERVING, *_ANSWERING, Mode.ENDING)},
    **{
        (mode, Event.DUPLICATE_COMMANDER): (Mode.SILENT, Reason.DUPLICATE_COMMANDER)
        for mode in (Mode.OBSERVING, *_ANSWERING, Mode.ENDING, Mode.RELEASED)
    },
    **{(mode, Event.ARMED): (Mode.STARTING, Reason.NOT_ENGAGED) for mode in (Mode.OVERRIDDEN, Mode.FAULT)},
    (Mode.SILENT, Event.ARMED): (Mode.OBSERVING, Reason.NOT_ENGAGED),
    **{(mode, Event.END): (Mode.ENDING, Reason.SHUTDOWN) for mode in _ENABLING},
    **{
        (mode, Event.END): (Mode.RELEASED, Reason.SHUTDOWN)
        for mode in (Mode.STARTING, Mode.STANDBY, Mode.OVERRIDDEN, Mode.FAULT)
    },
    (Mode.ENDING, Event.STANDSTILL): (Mode.RELEASED, Reason.SHUTDOWN),
    (Mode.ENDING, Event.OVERRIDE): (Mode.RELEASED, Reason.DRIVER_OVERRIDE),
    (Mode.ENDING, Event.VEHICLE_DISENGAGED): (Mode.RELEASED, Reason.SHUTDOWN),
    (Mode.ENDING, Event.VEHICLE_FAULT): (Mode.RELEASED, Reason.VEHICLE_FAULT),
    (Mode.ENDING, Event.STATE_LOST): (Mode.SILENT, Reason.STATE_STALE),
}
"""A missing pair means: no change. Reason None: the new mode has the reason given with the event, else the old one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngagementTiming:
    """How long things may take, in nanoseconds."""

    settle_ns: int
    """Samples must have come this long before the controller engages."""
    stale_ns: int
    """After a gap longer than this, samples are no longer fresh."""
    lost_ns: int
    """No sample for longer than this: silence. No status: observe again whether another node drives."""
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
        """Why `Event.ARMED` was refused, as text for the log."""
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
        if stamp_ns - self._fresh_since_ns >= self._timing.settle_ns:
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
            self.apply(Event.VEHICLE_READY, now_ns)
        else:
            self.apply(Event.VEHICLE_DISENGAGED, now_ns)
        return self.mode is not before and self.mode in _DRIVING

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
