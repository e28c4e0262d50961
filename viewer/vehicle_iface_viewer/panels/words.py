"""States and reasons in words that a driver knows, each with the way on."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, VehicleMode
from vehicle_iface.telemetry import Snapshot, WriterState
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.text import enum_name, plain

_STANDS_MPS = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Words:
    """What the head of the page says, as HTML."""

    sentence: str
    way_on: str = ""
    """What to do; empty where nothing needs to be done."""
    headline: str = ""
    """Empty: that of the state."""


STATES = {
    ControllerState.STARTING: Words(
        headline="WAITING FOR THE VEHICLE",
        sentence="The loop is armed. It waits for fresh data, and checks that nobody else commands the vehicle.",
    ),
    ControllerState.STANDBY: Words(
        headline="READY", sentence="The loop is armed. It engages when the vehicle reports READY."
    ),
    ControllerState.ENGAGING: Words(
        headline="ENGAGING", sentence="Commands are sent. The vehicle does not obey them yet."
    ),
    ControllerState.ENGAGED: Words(headline="DRIVING", sentence="The vehicle follows its trajectory."),
    ControllerState.STOPPING: Words(headline="STOPPING", sentence="The vehicle is braked to standstill."),
    ControllerState.FAULT: Words(headline="FAULT", sentence="The loop does not drive the vehicle."),
    ControllerState.SHADOW: Words(headline="LISTENING ONLY", sentence="Nothing is sent to the vehicle."),
}
"""The sentence where the reason says nothing more."""

REASONS = {
    Reason.NOMINAL: Words(sentence="All is well."),
    Reason.NO_TRAJECTORY: Words(sentence="There is no trajectory to follow.", way_on="Publish a trajectory."),
    Reason.EMPTY_TRAJECTORY: Words(
        sentence="The trajectory has no points.", way_on="Publish a trajectory with points."
    ),
    Reason.PAST_END_SPACE: Words(
        sentence="The vehicle is at the end of its trajectory.", way_on="Publish one that goes on."
    ),
    Reason.PAST_END_TIME: Words(sentence="The time of the trajectory is over.", way_on="Publish one that is in time."),
    Reason.FRAME_MISMATCH: Words(
        sentence="Trajectory and vehicle have different frames of reference.",
        way_on="Publish a trajectory in the vehicle's frame.",
    ),
    Reason.STATE_STALE: Words(
        sentence="The vehicle's state is too old.",
        way_on="Check that the vehicle sends its state: <code>candump</code> on its bus.",
    ),
    Reason.STATE_INVALID: Words(
        sentence="The vehicle's state cannot be true.",
        way_on="Check its sensors. The counters below name the values.",
    ),
    Reason.CONTROLLER_ERROR: Words(
        sentence="The controller failed.", way_on="Read the loop's log, and correct the controller."
    ),
    Reason.DEVIATION: Words(
        sentence="The vehicle is too far from its trajectory, or too fast.",
        way_on="Drive it back to its path, or publish a path from where it is.",
    ),
    Reason.DRIVER_OVERRIDE: Words(
        sentence="The driver took over. The loop does not drive any more.",
        way_on="Release brake, throttle and steering wheel.",
    ),
    Reason.VEHICLE_NOT_AUTONOMOUS: Words(
        sentence="The vehicle does not obey commands.", way_on="Set the vehicle to READY."
    ),
    Reason.VEHICLE_FAULT: Words(sentence="The vehicle reports a fault.", way_on="Clear the fault in the vehicle."),
    Reason.LINK_DOWN: Words(sentence="The bus is down.", way_on="Check its interface: <code>ip -details link</code>."),
    Reason.DUPLICATE_COMMANDER: Words(
        sentence="Another program commands the vehicle.", way_on="End the other program."
    ),
    Reason.SHUTDOWN: Words(sentence="The run is ending.", way_on="To drive again, start the loop again."),
    Reason.DEADLINE_MISSED: Words(
        sentence="The loop is too late.",
        way_on="Check the load of its machine: <code>vehicle-iface doctor</code>.",
    ),
    Reason.NOT_ENGAGED: Words(sentence="The loop does not drive the vehicle.", way_on="Set the vehicle to READY."),
}

_GONE = {
    WriterState.ABSENT: Words(headline="NO LOOP", sentence="There is no loop at this address."),
    WriterState.ENDED: Words(headline="LOOP ENDED", sentence="The run has ended."),
    WriterState.DEAD: Words(
        headline="LOOP GONE",
        sentence="The loop was killed or has crashed. It does not command the vehicle.",
        way_on="Watch the vehicle. Read the loop's log, and start it again.",
    ),
    WriterState.OTHER_VERSION: Words(
        headline="OTHER VERSION", sentence="The loop is of another version than this viewer."
    ),
    WriterState.UNREADABLE: Words(headline="UNREADABLE", sentence="The loop's telemetry cannot be read."),
}


def find_words(view: View) -> Words:
    """Return the head's words for this view."""
    if view.writer_state in _GONE:
        return _GONE[view.writer_state]
    snapshot, pid = view.snapshot, view.info.pid if view.info else 0
    if snapshot is None:
        return Words(headline="WAITING", sentence="The loop has reported nothing yet.")
    if view.is_stale:
        look = f": <code>ps {pid}</code>" if pid else ""
        return Words(
            headline="NO DATA",
            sentence="The loop reports nothing any more.",
            way_on=f"Watch the vehicle. Check the loop's process{look}.",
        )
    words = _driving_words(snapshot, _rearm_command(pid))
    return replace(words, way_on="") if view.recording else words  # nothing can be done about the past


def find_headline(snapshot: Snapshot) -> str:
    """Return the state of a loop in words, as the head of its page has them."""
    return _driving_words(snapshot, "").headline


def is_armed(snapshot: Snapshot) -> bool:
    """Whether an armed loop still is: after an override, a fault or its end it is not."""
    if snapshot.controller_state == ControllerState.STANDBY:
        return snapshot.reason == Reason.NOT_ENGAGED
    return snapshot.controller_state != ControllerState.FAULT


def vehicle_fault(snapshot: Snapshot) -> str:
    """Return what the vehicle's own mode warns of; empty if of nothing."""
    if snapshot.has_status and snapshot.vehicle_mode in (VehicleMode.FAULT, VehicleMode.EMERGENCY_STOP):
        return f"VEHICLE: {enum_name(VehicleMode, snapshot.vehicle_mode).replace('_', ' ')}"
    return ""


def _driving_words(snapshot: Snapshot, command: str) -> Words:
    state, reason = snapshot.controller_state, snapshot.reason
    unknown = plain(enum_name(ControllerState, state))
    of_state = STATES.get(state, Words(headline=unknown, sentence=""))  # type: ignore[call-overload]
    because = REASONS.get(reason)  # type: ignore[call-overload]
    if because is None:
        because = Words(sentence=f"This viewer does not know {plain(enum_name(Reason, reason))}.")
    steps = [because.way_on]
    if reason != Reason.SHUTDOWN:
        if not is_armed(snapshot):
            steps.append(f"Then arm again: {command}.")
        elif state == ControllerState.STOPPING:
            steps.append(f"If the vehicle stays stopped, arm again: {command}.")
    is_plain = reason in (Reason.NOMINAL, Reason.NOT_ENGAGED) and of_state.sentence
    return Words(
        headline=_headline(snapshot, of_state.headline),
        sentence=of_state.sentence if is_plain else because.sentence,
        way_on="" if state == ControllerState.SHADOW and is_plain else " ".join(step for step in steps if step),
    )


def _headline(snapshot: Snapshot, usual: str) -> str:
    state, reason = snapshot.controller_state, snapshot.reason
    stands = snapshot.has_state and abs(snapshot.speed_mps) < _STANDS_MPS
    if state == ControllerState.STOPPING:
        ending = " TO END" if reason == Reason.SHUTDOWN else ""
        return "STOPPED" if stands else f"STOPPING{ending}"
    if state == ControllerState.STANDBY and not is_armed(snapshot):
        return "DRIVER DRIVES" if reason == Reason.DRIVER_OVERRIDE else "RELEASED"
    return usual


def _rearm_command(pid: int) -> str:
    return f"<code>kill -USR1 {pid}</code>" if pid else "signal USR1 to the loop"
