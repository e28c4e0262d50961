"""Assembles decoded messages into samples of the vehicle's state, each with its age."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, NamedTuple

from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.state import VehicleState
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus

FieldMap = Mapping[str, Sequence[str]]
"""Message name → the field of each of its values, '' where it has none."""
_STATUS_WORDS = {"mode", "gear", "driver_brake", "driver_throttle", "driver_steer_torque_nm", "fault_code"}
"""Fields of the status; they may come in several messages."""


MOST_BEHIND = 3
"""The messages of one sample may be later than those of others by so many samples."""


class Sample(NamedTuple):
    """One complete and consistent sample of the vehicle's state."""

    state: VehicleState
    pose_valid: bool
    """The vehicle's own verdict on its pose."""
    others_fresh: bool
    """Whether each message outside the sample was received not longer than `stale_ns` before `state.stamp_ns`.

    If not, a value of such a message is its last one or, where none was received, 0: the vehicle must be stopped.
    """
    counter: int
    """The counter value that its messages share."""
    completed_ns: int
    """Kernel receive time of the message that completed it; `state.stamp_ns` is that of the first one."""


@dataclass(slots=True)
class _Parts:
    """The messages of one counter value that have come so far."""

    first_ns: int
    received: dict[str, DecodedMessage] = field(default_factory=dict)


class StateAssembler:
    """Assembles the messages of one cycle: those with the same counter value, within `window_ns`.

    Values of different cycles are never mixed. The newest values of a message outside the sample (`others`) are in
    each sample after it; `Sample.others_fresh` is false when it is older than `stale_ns` or was never received.
    """

    def __init__(
        self,
        *,
        sample: FieldMap,
        others: FieldMap,
        frames: Mapping[int, str],
        modes: Mapping[int, VehicleMode],
        gears: Mapping[int, Gear],
        window_ns: int,
        stale_ns: int,
        counter_states: int,
    ) -> None:
        """`frames`, `modes` and `gears` translate wire numbers; the status message is in `others`.

        A counter comes round again after `counter_states` samples; 1 where there is none.

        Position, heading and speed must be in `sample`, and so must `pose_frame` where there is one.
        """
        self._sample = tuple(sample)
        # The values of a sample, message after message, are one long tuple; what is bound is picked out of it.
        row = [field for fields in sample.values() for field in fields]
        places = {field: place for place, field in enumerate(row) if field}
        self._frame_place, self._valid_place = places.pop("pose_frame", None), places.pop("pose_valid", None)
        self._fields = tuple(places)
        self._pick = _make_picker(*places.values())
        self._others = {name: tuple(fields) for name, fields in others.items()}
        self._frames, self._modes, self._gears = dict(frames), dict(modes), dict(gears)
        self._usual_frame = next(iter(frames.values()))
        self._window_ns, self._stale_ns = window_ns, stale_ns
        self._counter_states = counter_states
        self._newest_counter: int  # of the sample that entered `_completed_ns` last
        self._pending: dict[int, _Parts] = {}
        self._completed_ns: dict[int, int] = {}
        self._others_ns: dict[str, int] = {}
        self._newest_others: dict[str, float | int] = {}
        self._newest_words: dict[str, float | int] = {}
        self.status: VehicleStatus | None = None
        """The newest status report."""
        self.newest: Sample | None = None
        """The newest complete sample."""
        self.completed = 0
        self.incomplete = 0
        """Samples of which at least one message came, but not all within the window, or a value was missing."""
        self.repeated = 0
        """Messages of a sample that was complete already."""

    def take(self, received: DecodedMessage) -> Sample | None:
        """The sample that this message completes, if it does."""
        if received.name in self._sample:
            return self._assemble(received)
        if received.name in self._others:
            self._store_others(received)
        return None

    def reset(self) -> None:
        """Start anew after the link was lost: nothing from before it is combined with anything after it."""
        self._pending.clear()
        self._completed_ns.clear()
        self._others_ns.clear()
        self._newest_others.clear()
        self._newest_words.clear()
        self.status = None
        self.newest = None

    def _assemble(self, received: DecodedMessage) -> Sample | None:
        counter = received.counter
        self._drop_old(received.stamp_ns - self._window_ns)
        if counter in self._completed_ns and not self._begins_new_round(counter):
            self.repeated += 1
            return None
        parts = self._pending.get(counter)
        if parts is None:
            if self._pending:
                self._drop_far_behind(counter)
            parts = self._pending[counter] = _Parts(received.stamp_ns)
        parts.received[received.name] = received
        if len(parts.received) < len(self._sample):
            return None
        del self._pending[counter]
        if counter >= 0:  # without a counter a repeated message looks like the next one
            self._completed_ns.pop(counter, None)  # the oldest stand first
            self._completed_ns[counter] = received.stamp_ns
            self._newest_counter = counter
        sample = self._build_sample(parts, received)
        if sample is None:
            self.incomplete += 1
            return None
        self.completed += 1
        self.newest = sample
        return sample

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
        if self._completed_ns and next(iter(self._completed_ns.values())) < before_ns:
            done = [counter for counter, completed_ns in self._completed_ns.items() if completed_ns < before_ns]
            for counter in done:
                del self._completed_ns[counter]

    def _build_sample(self, parts: _Parts, last: DecodedMessage) -> Sample | None:
        """None when a value of its own is missing: it is in another multiplexer branch."""
        row: tuple[Any, ...] = ()
        for name in self._sample:
            row += parts.received[name].values
        values = self._pick(row)
        frame = row[self._frame_place] if self._frame_place is not None else -1
        is_valid = row[self._valid_place] if self._valid_place is not None else True
        if frame is None or is_valid is None or None in values:
            return None
        state = VehicleState(
            stamp_ns=parts.first_ns,
            frame_id=self._usual_frame if frame == -1 else self._frames[int(frame)],
            **(self._newest_others | dict(zip(self._fields, values, strict=True))),
        )
        return Sample(state, bool(is_valid), self._are_others_fresh(parts.first_ns), last.counter, last.stamp_ns)

    def _are_others_fresh(self, stamp_ns: int) -> bool:
        oldest_ns, came_ns = stamp_ns - self._stale_ns, self._others_ns
        return all(name in came_ns and came_ns[name] >= oldest_ns for name in self._others)

    def _store_others(self, received: DecodedMessage) -> None:
        """Store its values; a message with the mode in it updates the status."""
        self._others_ns[received.name] = received.stamp_ns
        pairs = zip(self._others[received.name], received.values, strict=True)
        values = {name: value for name, value in pairs if name and value is not None}
        for name, value in values.items():
            (self._newest_words if name in _STATUS_WORDS else self._newest_others)[name] = value
        if "mode" in values:
            self.status = self._build_status(received.stamp_ns, self._newest_words)

    def _build_status(self, stamp_ns: int, words: Mapping[str, float | int]) -> VehicleStatus:
        return VehicleStatus(
            stamp_ns=stamp_ns,
            mode=self._modes[int(words["mode"])],
            gear=self._gears[int(words["gear"])] if "gear" in words else None,
            driver_brake=bool(words.get("driver_brake", False)),
            driver_throttle=bool(words.get("driver_throttle", False)),
            driver_steer_torque_nm=float(words.get("driver_steer_torque_nm", 0.0)),
            fault_code=int(words.get("fault_code", 0)),
        )


def _make_picker(*places: int) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """The values at these places of a row."""
    if len(places) < 2:  # where `itemgetter` gives no tuple
        return lambda row: tuple(row[place] for place in places)
    return itemgetter(*places)
