"""The stamps that candump writes: absolute, relative, dates or none, as one kind for a whole log."""

import itertools
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from enum import Enum

from vehicle_iface.logs.frames import GREATEST_STAMP_S
from vehicle_iface.units import NS_PER_S

_MAX_STEPS_BACK = 0.1
"""Maximum share of non-rising steps of absolute times; about half of all differences repeat or fall."""
_SECONDS = re.compile(rb"(\d{1,10})\.(\d{1,9})")
_PADDED = re.compile(rb"0\d\d\.\d{6}")
"""Pattern of three digits of seconds: `candump -td` or `-tz`."""
_DATE = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{1,9}")


class Stamps(Enum):
    """Kinds of stamps in a log; the value is the text for a person."""

    AS_LOGGED = "as logged"
    SINCE_START = "seconds since the first frame (candump -tz)"
    DIFFERENCES = "sums of the log's differences (candump -td), 0 at its first frame"
    DATES = "dates of the log (candump -tA), taken as UTC"
    NONE = "none: this log has no times, every stamp is 0"


def recognize_stamps(stamps: Iterable[bytes | None]) -> Stamps:
    """Recognise the kind of stamps from the beginning of a log; None is a frame without one."""
    texts = list(stamps)
    if not texts or texts[0] is None:
        return Stamps.NONE if texts else Stamps.AS_LOGGED
    if _DATE.fullmatch(texts[0]):
        return Stamps.DATES
    if not _PADDED.fullmatch(texts[0]):
        return Stamps.AS_LOGGED
    times = [time for text in texts if text is not None and (time := parse_seconds(text)) is not None]
    back = sum(after <= before for before, after in itertools.pairwise(times))
    return Stamps.DIFFERENCES if back > _MAX_STEPS_BACK * (len(times) - 1) else Stamps.SINCE_START


def parse_seconds(text: bytes) -> int | None:
    """Parse seconds to nanoseconds; None for an invalid number."""
    found = _SECONDS.fullmatch(text)
    if found is None or int(found[1]) > GREATEST_STAMP_S:
        return None
    return int(found[1]) * NS_PER_S + int(found[2].ljust(9, b"0"))


class StampReader:
    """Reads the stamps of one log, line after line."""

    def __init__(self, stamps: Stamps) -> None:
        self.stamps = stamps
        self._sum_ns = 0

    def read(self, text: bytes | None) -> int | None:
        """Parse a stamp to nanoseconds; None when the text is no stamp of this log's kind."""
        if self.stamps is Stamps.NONE or text is None:
            return 0 if text is None and self.stamps is Stamps.NONE else None
        if self.stamps is Stamps.DATES:
            return _parse_date(text)
        stamp_ns = parse_seconds(text)
        if self.stamps is Stamps.DIFFERENCES and stamp_ns is not None:
            self._sum_ns += stamp_ns
            return self._sum_ns
        return stamp_ns


def _parse_date(text: bytes) -> int | None:
    if not _DATE.fullmatch(text):
        return None
    date, fraction = text.decode("ascii").split(".")
    try:
        seconds = int(datetime.fromisoformat(date).replace(tzinfo=UTC).timestamp())
    except ValueError:
        return None
    return seconds * NS_PER_S + int(fraction.ljust(9, "0"))
