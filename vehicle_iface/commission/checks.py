"""What one check of a step is: it watches moments until it can say in words whether the profile is right."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from vehicle_iface.commission.readings import Moment
from vehicle_iface.review.findings import Judgement

PERIOD_S = 0.05
"""Time between two moments of a walk."""
PREPARED = 5
"""Number of moments watched before the person is asked for a step."""
HELD = 4
"""Number of moments for which a condition must hold: a single wrong sample is no movement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """The verdict on one signal in one step."""

    about: str
    """Name of the signal."""
    judgement: Judgement
    text: str


class Check(ABC):
    """Watches one signal, or a few that belong together, during one step."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.results: tuple[CheckResult, ...] = ()
        """Results; empty until they are certain."""

    def prepare(self, moment: Moment) -> None:  # noqa: B027  # most need no such moment
        """Watch a moment before the person is asked, for the values at the beginning of the step."""

    @abstractmethod
    def take(self, moment: Moment) -> None:
        """Watch the next moment, `PERIOD_S` after the one before; not called any more once there are results."""

    @abstractmethod
    def show(self, moment: Moment) -> str:
        """Return the present measurement as text, with its unit."""

    @abstractmethod
    def explain(self) -> str:
        """Explain, after the time limit, why there is no result."""

    def agree(self, text: str) -> None:
        """End with the profile confirmed."""
        self.results = (CheckResult(about=self.label, judgement=Judgement.AGREES, text=text),)

    def contradict(self, text: str) -> None:
        """End with the profile contradicted."""
        self.results = (CheckResult(about=self.label, judgement=Judgement.CONTRADICTED, text=text),)

    def give_up(self) -> CheckResult:
        """Return the result after the time limit."""
        return CheckResult(about=self.label, judgement=Judgement.UNKNOWN, text=self.explain())
