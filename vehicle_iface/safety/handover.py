"""Handing control back at a planned end: the driver is warned before ENABLE = 0.

Planned ends are the end of the duration and a request to end. A driver override (`safety.engagement`), a fault and a
second request never wait for the warning. At the end of a trajectory the vehicle is held, not released.
"""

import sys


class Handover:
    """The warning, and what it holds up. Time is given."""

    def __init__(self, warning_ns: int, *, hold_until_warned: bool) -> None:
        """With `hold_until_warned` a standing vehicle is held until the driver has been warned for `warning_ns`."""
        self._warning_ns = warning_ns
        self._hold_until_warned = hold_until_warned
        self._planned_ns = sys.maxsize  # that is, never
        self._since_ns: int | None = None

    @property
    def warns(self) -> bool:
        """Whether control is about to be given back."""
        return self._since_ns is not None

    def plan(self, end_ns: int) -> None:
        """The run will be asked to end then."""
        self._planned_ns = end_ns

    def update(self, now_ns: int, *, is_driven: bool, is_ending: bool) -> bool:
        """Whether a warning begins now. Without control there is none to give back."""
        if not is_driven:
            self._since_ns = None
            return False
        is_near = now_ns >= self._planned_ns - self._warning_ns
        begins = self._since_ns is None and (is_ending or is_near)
        if begins:
            self._since_ns = now_ns
        return begins

    def left_ns(self, now_ns: int, *, is_ending: bool) -> int:
        """Until control is given back at the earliest; 0 where only standstill is waited for."""
        if self._since_ns is None:
            return 0
        if is_ending:
            return max(0, self._since_ns + self._warning_ns - now_ns) if self._hold_until_warned else 0
        return max(0, self._planned_ns - now_ns)

    def may_release(self, now_ns: int) -> bool:
        """Whether a vehicle at standstill may be released."""
        return not self._hold_until_warned or self._since_ns is None or now_ns - self._since_ns >= self._warning_ns
