"""The modes of engagement, with what each allows, and the table of the events that lead from one to another."""

from enum import Enum, auto

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState
from vehicle_iface.value import Value


class ModeRow(Value, frozen=True, kw_only=True, eq=False):
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
    """Why a request to arm is rejected; empty where it is accepted."""


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

    __hash__ = object.__hash__  # that of enumerations is written in Python, and modes are looked up on every tick

    def __init__(self, row: ModeRow) -> None:
        self.may_send, self.enables, self.computes, self.engages = row.may_send, row.enables, row.computes, row.engages
        self.stops, self.ends, self.observes, self.latched = row.stops, row.ends, row.observes, row.latched
        self.disengaged, self.wire_state, self.refusal = row.disengaged, row.wire_state, row.refusal


class Event(Enum):
    """Events that change the mode."""

    __hash__ = object.__hash__  # as that of `Mode`

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


DRIVING = tuple(mode for mode in Mode if mode.computes and mode.may_send)
"""The controller's commands are sent."""
_LATCHED_STOP = tuple(mode for mode in Mode if mode.stops and not mode.ends)
_ENABLING = (*DRIVING, *_LATCHED_STOP)
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
    **{(mode, Event.STOP_LATCHED): (Mode.HALTING, None) for mode in DRIVING},
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
SETTLING = tuple(mode for mode, event in TABLE if event is Event.FRESH)
"""The modes that fresh samples change."""
