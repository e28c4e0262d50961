"""Gives recorded inputs back to a loop: clock, bus and source, pass by pass.

A loop of other code may ask more often than the recorded one did. Then the clock stands at the last time of the pass,
nothing is received, and everything is accepted.
"""

from collections import deque
from collections.abc import Iterable, Mapping

from vehicle_iface.bus.controller_events import ControllerEvent
from vehicle_iface.bus.traffic_monitor import TrafficSample
from vehicle_iface.errors import BusError, BusGoneError
from vehicle_iface.frame import CanFrame
from vehicle_iface.recorder.inputs import FrameFields, PassInputs, to_frames
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectory import Trajectory


class ReplayedInputs:
    """The inputs of the present pass, and what the loop has sent in it."""

    def __init__(self, first: PassInputs) -> None:
        self._now_ns = 0
        self.overflow: dict[str, int] = {}
        self.begin_pass(first)

    def begin_pass(self, inputs: PassInputs) -> None:
        """Give the inputs of this pass from now on."""
        self.inputs = inputs
        self.sent: list[CanFrame] = []
        self.accepted: list[CanFrame] = []
        """Those that the bus took."""
        self.calls: dict[str, int] = {}
        self._clock_ns = deque(inputs.clock_ns)
        if inputs.overflow is not None:
            self.overflow = inputs.overflow

    def now_ns(self) -> int:
        """Return the next recorded time."""
        if self._clock_ns:
            self._now_ns = self._clock_ns.popleft()
        return self._now_ns

    def open_bus(self, names: Iterable[str]) -> "ReplayedBus":
        """Open the bus, or fail as it did; `names` are those of its parts."""
        self.count("open")
        return ReplayedBus(self, names)

    def count(self, call: str, *, like: str | None = None) -> int:
        """Count a call, and return the number of those of its kind before; raise what it raised when it was recorded.

        A call that is `like` another one has the number of that one's next call.
        """
        number = self.calls.get(like or call, 0)
        if like is None:
            self.calls[call] = number + 1
        for fault in self.inputs.faults:
            if (fault.call, fault.number) == (call, number):
                raise (BusGoneError if fault.is_gone else BusError)(fault.text)
        return number


class ReplayedBus:
    """The recorded bus."""

    description = "recorded bus"

    def __init__(self, replay: ReplayedInputs, names: Iterable[str]) -> None:
        self._replay = replay
        self.parts: Mapping[str, ReplayedPart] = {name: ReplayedPart(name, replay) for name in names}
        self.refusing = ""

    def wait(self, until_ns: int) -> bool:  # noqa: ARG002  # the times are recorded
        """Return at once."""
        self._replay.count("wait", like="drain")
        return True

    def drain(self) -> list[CanFrame]:
        """Return what was received."""
        number = self._replay.count("drain")
        received = self._replay.inputs.received
        return to_frames(received[number]) if number < len(received) else []

    def has_room(self) -> bool:
        """Return whether there was room."""
        number, rooms = self._replay.count("has_room"), self._replay.inputs.has_room
        return rooms[number] if number < len(rooms) else True

    def send(self, *frames: CanFrame) -> int:
        """Keep the frames; as many are accepted as were then."""
        self._replay.sent += frames
        number, sent = self._replay.count("send"), self._replay.inputs.sent
        accepted = min(sent[number].accepted, len(frames)) if number < len(sent) else len(frames)
        self._replay.accepted += frames[:accepted]
        return accepted

    def counters(self) -> dict[str, int]:
        """Return the counts of frames that the kernel dropped."""
        return dict(self._replay.overflow)

    def close(self) -> None:
        """Do nothing."""


class ReplayedPart:
    """One of the buses."""

    description = "recorded bus"

    def __init__(self, name: str, replay: ReplayedInputs) -> None:
        self._name, self._replay = name, replay

    def events(self) -> list[ControllerEvent]:
        """Return what its controller reported."""
        number = self._replay.count(f"events {self._name}")
        mine = [events for name, events in self._replay.inputs.events if name == self._name]
        return [ControllerEvent(event) for event in mine[number]] if number < len(mine) else []

    def poll_traffic(self, now_ns: int) -> TrafficSample:  # noqa: ARG002
        """Return none, or raise what was raised."""
        self._replay.count(f"poll_traffic {self._name}")
        return TrafficSample(0, 0, 0, {})


class ReplayedSource:
    """The trajectories that came from outside."""

    def __init__(self, replay: ReplayedInputs) -> None:
        self._replay = replay

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:  # noqa: ARG002
        """Return the trajectory that came with this call."""
        number = self._replay.count("next")
        return next((post.to_trajectory() for post in self._replay.inputs.posts if post.call == number), None)

    def restart(self) -> None:
        """Do nothing: trajectories are stamped by their planner."""


def sent_frames(inputs: PassInputs) -> list[FrameFields]:
    """Return all frames that were handed to the bus in a pass."""
    return [frame for call in inputs.sent for frame in call.frames]
