"""Assembles decoded messages into samples of the vehicle's state, each with its age."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.pose import Locator
from vehicle_iface.row import Row, RowReader
from vehicle_iface.state import VehicleState
from vehicle_iface.status import VehicleStatus
from vehicle_iface.value import Value

MOST_BEHIND = 3
"""The messages of one sample may be later than those of others by so many samples."""


class Sample(Value, frozen=True, gc=False):
    """One complete and consistent sample of the vehicle's state."""

    state: VehicleState
    pose_valid: bool
    """The vehicle's own verdict on its pose."""
    others_fresh: bool
    """Whether each message outside the sample was received not longer than `stale_ns` before `state.stamp_ns`.

    If not, a value of such a message is its last one or, where none was received, 0: the vehicle must be stopped.
    """
    counter: int
    """The counter value that its messages share; −1 where it was assembled by time."""
    completed_ns: int
    """Kernel receive time of the message that completed it; `state.stamp_ns` is that of the first one."""
    is_lost: bool
    """Whether dead reckoning was interrupted: where the vehicle is will not be known again by itself."""


@dataclass(slots=True)
class _Parts:
    """The messages of one counter value that have come so far."""

    first_ns: int
    received: dict[str, DecodedMessage]


class Freshness(NamedTuple):
    """How a sample is made of the newest messages."""

    trigger: str
    """The message whose arrival completes a sample."""
    max_age_ns: Mapping[str, int]
    """How old each part may be by then."""


class StateAssembler:
    """Assembles the messages of one cycle: those with the same counter value, within `window_ns`; or, with `freshness`,
    the newest of each when the trigger arrives.

    By the counter, values of different cycles are never mixed. The newest values of the messages outside the sample are
    in each sample after them; `Sample.others_fresh` is false when one is older than `stale_ns` or was never received.
    """

    def __init__(
        self,
        reader: RowReader,
        locator: Locator,
        *,
        sample: Collection[str],
        window_ns: int,
        stale_ns: int,
        counter_states: int,
        freshness: Freshness | None = None,
    ) -> None:
        """A counter comes round again after `counter_states` samples; 1 where there is none."""
        self._reader = reader
        self.locator = locator
        self._sample = tuple(sample)
        self._others = tuple(name for name in reader.places if name not in self._sample)
        # Messages whose values are all in each frame, and of which nothing tells of the status.
        self._plain = {
            name: place
            for name, place in reader.places.items()
            if name not in reader.multiplexed and name not in reader.driver_messages
        }
        self._window_ns, self._stale_ns = window_ns, stale_ns
        self._counter_states = counter_states
        self._freshness = freshness
        self._newest_counter: int  # of the sample that entered `_completed_ns` last
        self._pending: dict[int, _Parts] = {}
        self._completed_ns: dict[int, int] = {}
        self._stamps_ns: dict[str, int] = {}
        self._row: Row = list(reader.empty)
        self._came_ns: dict[int, int] = {}  # by place, the values of multiplexed messages
        self._omissible = tuple(place for place in reader.omissible if place in self._places_of(self._sample))
        self.status: VehicleStatus | None = None
        """The newest status report."""
        self.newest: Sample | None = None
        """The newest complete sample."""
        self.completed = 0
        self.incomplete = 0
        """Samples of which a message is missing or too old, or a value is."""
        self.repeated = 0
        """Messages of a sample that was complete already."""
        self.oldest_ns: dict[str, int] = dict.fromkeys(freshness.max_age_ns, 0) if freshness is not None else {}
        """The greatest age of each part that a sample by time was made of."""

    @property
    def row(self) -> Row:
        """The newest value of every bound signal."""
        return self._row

    def take(self, received: DecodedMessage) -> Sample | None:
        """The sample that this message completes, if it does."""
        if received.name not in self._sample:
            if received.name in self._reader.places:
                self._store_other(received)
            return None
        return self._take_by_counter(received) if self._freshness is None else self._take_newest(received)

    def reset(self) -> None:
        """Reset after a loss of the link: nothing from before it is combined with anything after it."""
        self._pending.clear()
        self._completed_ns.clear()
        self._stamps_ns.clear()
        self._came_ns.clear()
        self._row = list(self._reader.empty)
        self.locator.reset()
        self.status = None
        self.newest = None

    # --- by the newest

    def _take_newest(self, received: DecodedMessage) -> Sample | None:
        assert self._freshness is not None
        self._store(received)
        if received.name != self._freshness.trigger:
            return None
        stamps_ns, now_ns = self._stamps_ns, received.stamp_ns
        for name, max_age_ns in self._freshness.max_age_ns.items():
            if name not in stamps_ns or now_ns - stamps_ns[name] > max_age_ns:
                self.incomplete += 1
                return None
        for name in self.oldest_ns:
            self.oldest_ns[name] = max(self.oldest_ns[name], now_ns - stamps_ns[name])
        return self._complete(now_ns, received)

    # --- by the counter

    def _take_by_counter(self, received: DecodedMessage) -> Sample | None:
        counter = received.counter
        self._drop_old(received.stamp_ns - self._window_ns)
        completed_ns = self._completed_ns.get(counter)
        if (
            completed_ns is not None
            and completed_ns >= received.stamp_ns - self._window_ns  # what is older is of the counter's last round
            and not self._begins_new_round(counter)
        ):
            self.repeated += 1
            return None
        parts = self._pending.get(counter)
        if parts is None:
            if self._pending:
                self._drop_far_behind(counter)
            parts = self._pending[counter] = _Parts(received.stamp_ns, {})
        parts.received[received.name] = received
        if len(parts.received) < len(self._sample):
            return None
        del self._pending[counter]
        if counter >= 0:  # without a counter a repeated message looks like the next one
            self._completed_ns[counter] = received.stamp_ns
            self._newest_counter = counter
        row, plain, stamps_ns = self._row, self._plain, self._stamps_ns
        for name, part in parts.received.items():
            if name in plain:
                row[plain[name]], stamps_ns[name] = part.values, part.stamp_ns
            else:
                self._store(part)
        return self._complete(parts.first_ns, received)

    def _begins_new_round(self, counter: int) -> bool:
        """Whether the counter is ahead of the newest sample's: samples that were held up come round fast."""
        ahead = (counter - self._newest_counter) % self._counter_states
        return 0 < ahead <= self._counter_states // 2

    def _drop_far_behind(self, counter: int) -> None:
        """Parts of a sample that will not be complete: before their counter comes round again, however fast it does."""
        states = self._counter_states
        old = [other for other in self._pending if MOST_BEHIND < (counter - other) % states <= states // 2]
        for other in old:
            del self._pending[other]
        self.incomplete += len(old)

    def _drop_old(self, before_ns: int) -> None:
        """A counter value comes round again: parts of its last round must be gone by then."""
        if self._pending and next(iter(self._pending.values())).first_ns < before_ns:  # the oldest stand first
            old = [counter for counter, parts in self._pending.items() if parts.first_ns < before_ns]
            for counter in old:
                del self._pending[counter]
            self.incomplete += len(old)

    # --- both

    def _complete(self, stamp_ns: int, last: DecodedMessage) -> Sample | None:
        """The sample of what stands in the row; None when a value of its own is missing."""
        measured = self._reader.read_state(stamp_ns, self._row, self.locator.locate)
        if measured is None or (self._omissible and self._lacks(self._omissible)):
            self.incomplete += 1
            return None
        counter = last.counter if self._freshness is None else -1
        fresh = self._are_others_fresh(stamp_ns)
        is_lost = self.locator.is_interrupted
        self.newest = Sample(measured.state, measured.pose_valid, fresh, counter, last.stamp_ns, is_lost)
        self.completed += 1
        return self.newest

    def _are_others_fresh(self, stamp_ns: int) -> bool:
        oldest_ns, came_ns = stamp_ns - self._stale_ns, self._stamps_ns
        for name in self._others:  # noqa: SIM110  # a generator costs twice as much
            if name not in came_ns or came_ns[name] < oldest_ns:
                return False
        return True

    def _store_other(self, received: DecodedMessage) -> None:
        """A message in which a value is missing that is needed does not count as received."""
        name, reader = received.name, self._reader
        if name not in reader.multiplexed:
            where, values = reader.places[name], received.values
            if any(values[place - where.start] is None for place in reader.needed[name]):
                return
        self._store(received)

    def _store(self, received: DecodedMessage) -> None:
        """Its values stand in the row from now on; there is a status once all messages with the mode have come."""
        name, reader, stamps_ns = received.name, self._reader, self._stamps_ns
        if name in reader.multiplexed:
            self._store_branch(received)
        else:
            self._row[reader.places[name]] = received.values
            stamps_ns[name] = received.stamp_ns
        if (
            name in reader.driver_messages
            and all(one in stamps_ns for one in reader.status_messages)
            and not self._lacks(reader.omissible)
        ):
            self.status = reader.read_status(min(stamps_ns[one] for one in reader.status_messages), self._row)

    def _store_branch(self, received: DecodedMessage) -> None:
        """The values of a branch; those of the other ones stay. The message is as old as the oldest that is needed."""
        name, reader, row, came_ns = received.name, self._reader, self._row, self._came_ns
        for place, value in enumerate(received.values, start=reader.places[name].start):
            if value is not None:
                row[place], came_ns[place] = value, received.stamp_ns
        needed = reader.needed[name]
        if all(place in came_ns for place in needed):
            self._stamps_ns[name] = min((came_ns[place] for place in needed), default=received.stamp_ns)

    def _lacks(self, places: tuple[int, ...]) -> bool:
        """Whether one of these values is missing."""
        return any(self._row[place] is None for place in places)

    def _places_of(self, names: Iterable[str]) -> set[int]:
        """Where the values of these messages stand."""
        return {place for name in names for place in range(len(self._row))[self._reader.places[name]]}
