"""What the controller did wrong on the bus, in a whole record and whatever anybody else did there meanwhile.

The other rules of the contract, such as one answer to each sample, hold only where the vehicle keeps its own part.
"""

from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence

from vehicle_bus_contract.judge import Record, examine
from vehicle_bus_contract.reference import CONTROLLER_SENDS, MS, Frame, S

OLDEST_DRIVEN_NS = 250 * MS
"""An older sample is never driven by: 100 ms until it is looked at, 50 ms for a controller, and a slow machine."""
LAST_STOP_NS = 600 * MS
"""So long after the last sample there is silence: 500 ms, and a slow machine."""
CLOCK_STEP_NS = 5 * S
"""The stamps' clock was set between two frames that lie further apart, or the other way round."""


def breaches(frames: Iterable[Frame]) -> list[str]:
    """Each frame of the controller's that the contract does not allow; empty when it kept to it throughout.

    Frames are in the order of their arrival.
    """
    return [text for piece in _pieces(list(frames)) for text in _of_record(examine(piece))]


def _pieces(frames: Sequence[Frame]) -> Iterator[Sequence[Frame]]:
    """The frames between one setting of the clock and the next."""
    stamps = [frame.stamp_ns for frame in frames]
    steps = (i for i in range(1, len(stamps)) if not -S <= stamps[i] - stamps[i - 1] <= CLOCK_STEP_NS)
    begin = 0
    for end in (*steps, len(frames)):
        yield frames[begin:end]
        begin = end


def _of_record(record: Record) -> Iterator[str]:
    for kind, texts in (
        ("counter", record.counter_gaps),
        ("damaged", record.crc_errors),
        ("malformed", record.malformed),
    ):
        yield from (f"{kind}: {text}" for text in texts if text.startswith(CONTROLLER_SENDS))
    yield from (f"alone: {text}" for text in record.doubled if " alone " in text)
    yield from (f"command: {text}" for text in record.violations)
    yield from _of_old_state(record)


def _of_old_state(record: Record) -> Iterator[str]:
    """Enabled commands that no young state stands behind."""
    stamps = [sample.stamp_ns for sample in record.samples]
    for pair in record.pairs:
        sent_ns = pair.drive.stamp_ns
        place = bisect(stamps, sent_ns)
        age_ns = sent_ns - (stamps[place - 1] if place else record.begin_ns)
        if pair.is_enabled and age_ns > (LAST_STOP_NS if pair.is_stop else OLDEST_DRIVEN_NS):
            at_s = (sent_ns - record.begin_ns) / S
            yield f"old state: {pair.reason} at {at_s:.3f} s, {age_ns / MS:.0f} ms after the last sample"
