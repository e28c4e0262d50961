"""Notes all inputs of a loop and hands them to the recorder through a pipe. The loop's thread never waits for it.

Between two passes the notes are encoded (a few microseconds), and twenty times a second they are written to the pipe.
What finds no room stays here, up to `MAX_BACKLOG_BYTES`; what is more is lost, and the recording has a gap there.
"""

from collections.abc import Callable

from vehicle_iface.bus.base import Bus
from vehicle_iface.errors import BusError
from vehicle_iface.recorder.inputs import PassInputs, Post, Requests, encode_pass
from vehicle_iface.rerun.tapped_bus import TappedBus, note_fault
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.state import VehicleState
from vehicle_iface.trajectories.source import TrajectorySource
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import NS_PER_MS

MAX_BACKLOG_BYTES = 16 << 20
FLUSH_NS = 50 * NS_PER_MS
"""Period of writing to the pipe."""


class InputTap:
    """Wraps clock, bus and source of a loop. Call `end_pass` after the loop was built, after `begin`, and each step."""

    def __init__(self, write: Callable[[bytes | bytearray], int], now_ns: Callable[[], int]) -> None:
        """`write` takes as many bytes as it can without waiting, and returns how many."""
        self._write, self._read_clock = write, now_ns
        self._backlog = bytearray()
        self._flush_due_ns = 0
        self._armed = self._ends = 0
        self._is_due, self._scheduled_ns = False, 0
        self.notes = PassInputs(number=0, clock_ns=[], received=[], sent=[], has_room=[])
        """Inputs of the present pass so far."""
        self.next_calls = 0
        """Calls of the source in the present pass."""

    def now_ns(self) -> int:
        """Read the clock."""
        now_ns = self._read_clock()
        self.notes.clock_ns.append(now_ns)
        return now_ns

    def wrap_bus(self, open_bus: Callable[[], Bus]) -> Callable[[], Bus]:
        """Return a function that opens the bus with this tap on it."""

        def open_tapped() -> Bus:
            try:
                return TappedBus(open_bus(), lambda: self.notes)
            except BusError as error:
                note_fault(self.notes, "open", 0, error)
                raise

        return open_tapped

    def wrap_source(self, source: TrajectorySource) -> TrajectorySource:
        """Return a source whose trajectories are noted: for one whose trajectories come from outside."""
        return _TappedSource(source, self)

    def schedule(self, at_ns: int) -> None:
        """Note that the end was announced for `at_ns`."""
        self._scheduled_ns = at_ns

    def begin_on_schedule(self) -> None:
        """Note that the schedule has ended."""
        self._is_due = True

    def end_pass(self, loop: Loop) -> None:
        """Encode the notes of a pass, and write them from time to time."""
        notes, armed, ends = self.notes, loop.arming.applied, loop.shutdown.applied
        if armed != self._armed or ends != self._ends or self._is_due or self._scheduled_ns:
            notes.requests = Requests(armed != self._armed, ends, self._is_due, self._scheduled_ns)
            self._armed, self._ends, self._scheduled_ns = armed, ends, 0
        if len(self._backlog) < MAX_BACKLOG_BYTES:
            self._backlog += encode_pass(notes)
        last_ns = notes.clock_ns[-1] if notes.clock_ns else 0
        self.notes = PassInputs(number=notes.number + 1, clock_ns=[], received=[], sent=[], has_room=[])
        self.next_calls = 0
        if last_ns >= self._flush_due_ns:
            self._flush_due_ns = last_ns + FLUSH_NS
            del self._backlog[: self._write(self._backlog)]

    def close(self, write_all: Callable[[bytes], None]) -> None:
        """Write what is left, with a function that may wait: the vehicle was released."""
        write_all(bytes(self._backlog))
        self._backlog.clear()


class _TappedSource:
    """A source whose trajectories are noted."""

    def __init__(self, source: TrajectorySource, tap: InputTap) -> None:
        self._source, self._tap = source, tap

    def next(self, now_ns: int, state: VehicleState) -> Trajectory | None:
        trajectory = self._source.next(now_ns, state)
        if trajectory is not None:
            self._tap.notes.posts.append(Post.of(self._tap.next_calls, trajectory))
        self._tap.next_calls += 1
        return trajectory

    def restart(self) -> None:
        self._source.restart()
