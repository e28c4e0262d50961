"""What one check of a step is: it watches moments until it can say in words whether the profile is right."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from vehicle_iface.commission.readings import Moment
from vehicle_iface.review.findings import Judgement

PERIOD_S = 0.05
"""Between two moments of a walk."""
PREPARED = 5
"""Moments before a step is asked for."""
HELD = 4
"""Moments for which something must hold: one sample with an error is no movement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """The verdict on one signal in one step."""

    about: str
    """Its name."""
    judgement: Judgement
    text: str


class Check(ABC):
    """Watches one signal, or a few that belong together, during one step."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.results: tuple[CheckResult, ...] = ()
        """Empty as long as nothing is certain."""

    def prepare(self, moment: Moment) -> None:  # noqa: B027  # most need no such moment
        """Watch a moment before the person is asked: where things are when the step begins."""

    @abstractmethod
    def take(self, moment: Moment) -> None:
        """Watch the next moment, `PERIOD_S` after the one before; not called any more once there are results."""

    @abstractmethod
    def show(self, moment: Moment) -> str:
        """What is seen now, with its unit."""

    @abstractmethod
    def explain(self) -> str:
        """Why there is no result, once the time is over."""

    def agree(self, text: str) -> None:
        """End with the profile confirmed."""
        self.results = (CheckResult(about=self.label, judgement=Judgement.AGREES, text=text),)

    def contradict(self, text: str) -> None:
        """End with the profile contradicted."""
        self.results = (CheckResult(about=self.label, judgement=Judgement.CONTRADICTED, text=text),)

    def give_up(self) -> CheckResult:
        """The result where the time is over."""
        return CheckResult(about=self.label, judgement=Judgement.UNKNOWN, text=self.explain())
