"""Checks of the status: pedals, gear and mode."""

from collections.abc import Callable
from enum import IntEnum

from vehicle_iface.commission.checks import HELD, PERIOD_S, Check
from vehicle_iface.commission.readings import Moment
from vehicle_iface.status import VehicleStatus

_REST_S = 1.0
_OTHER_S = 3.0
"""Time after which another gear counts as selected: a lever passes gears that were not asked for."""
_NO_STATUS = "no status came that the loop accepts"


class RestCheck(Check):
    """The control is released: the flag is clear for a second."""

    def __init__(self, label: str, read: Callable[[VehicleStatus], bool], name: str) -> None:
        super().__init__(label)
        self.read, self.name = read, name
        self.was_clear = False
        self._clear_s = 0.0
        self._has_come = False

    def take(self, moment: Moment) -> None:
        if moment.status is None:
            return
        self._has_come = True
        self._clear_s = 0.0 if self.read(moment.status) else self._clear_s + PERIOD_S
        if self._clear_s >= _REST_S:
            self.was_clear = True
            self.agree(f"{self.label} is clear while nobody touches it")

    def show(self, moment: Moment) -> str:
        return show_flag(self, moment)

    def explain(self) -> str:
        return f"{self.label} is set while nobody is to touch it" if self._has_come else _NO_STATUS


class PressCheck(Check):
    """The flag is set when the person does it; `rest` is the check of the same flag before."""

    def __init__(self, rest: RestCheck, action: str) -> None:
        super().__init__(rest.label)
        self._rest, self._action = rest, action
        self._was_clear = self._was_set = False
        self._held, self._before = 0, False

    def prepare(self, moment: Moment) -> None:
        is_set = self._note(moment)
        self._was_set, self._was_clear = self._was_set or is_set is True, self._was_clear or is_set is False

    def take(self, moment: Moment) -> None:
        is_set = self._note(moment)
        if is_set and self._was_clear:
            self.agree(f"{self.label} is set when {self._action}")
        elif is_set is False and self._was_set and not self._rest.was_clear:
            self.contradict(f"{self.label} is cleared when {self._action}: it is inverted")
        self._was_set, self._was_clear = self._was_set or is_set is True, self._was_clear or is_set is False

    def _note(self, moment: Moment) -> bool | None:
        """Return whether the flag is set; None as long as it has not been so for long enough."""
        if moment.status is None:
            return None
        is_set = self._rest.read(moment.status)
        self._held = self._held + 1 if is_set is self._before else 1
        self._before = is_set
        return is_set if self._held >= HELD else None

    def show(self, moment: Moment) -> str:
        return show_flag(self._rest, moment)

    def explain(self) -> str:
        if not self._was_set and not self._was_clear:
            return _NO_STATUS
        return f"{self.label} was {'set' if self._was_set else 'clear'} all the time, also when {self._action}"


class ChoiceCheck(Check):
    """A gear or mode changes to the one that was asked for."""

    def __init__(
        self, label: str, read: Callable[[VehicleStatus], IntEnum | None], name: str, wanted: IntEnum, action: str
    ) -> None:
        super().__init__(label)
        self._read, self._name, self._wanted, self._action = read, name, wanted, action
        self._first: IntEnum | None = None
        self._newest: IntEnum | None = None
        self._held_s = 0.0
        self._has_come = False

    def prepare(self, moment: Moment) -> None:
        if moment.status is not None:
            self._has_come, self._first = True, self._read(moment.status)

    def take(self, moment: Moment) -> None:
        if moment.status is None:
            return
        now = self._read(moment.status)
        if not self._has_come:
            self._has_come, self._first = True, now
        self._held_s = self._held_s + PERIOD_S if now is self._newest else 0.0
        self._newest = now
        if now is self._wanted:
            if self._held_s >= HELD * PERIOD_S:
                self.agree(f"{self.label} is {self._wanted.name} when {self._action}")
        elif now is not None and now is not self._first and self._held_s >= _OTHER_S:
            self.contradict(f"{self.label} is {now.name} when {self._action}: a name of its table means another one")

    def show(self, moment: Moment) -> str:
        now = self._read(moment.status) if moment.status is not None else None
        return f"{self._name} {now.name if now is not None else 'unknown'}"

    def explain(self) -> str:
        if not self._has_come:
            return _NO_STATUS
        return f"{self.label} is {self._newest.name if self._newest is not None else 'none that is known'}"


def show_flag(check: RestCheck, moment: Moment) -> str:
    """Return the present state of the flag as text."""
    if moment.status is None:
        return f"{check.name}: no value"
    return f"{check.name} {'set' if check.read(moment.status) else 'clear'}"
