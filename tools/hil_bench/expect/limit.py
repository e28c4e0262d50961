"""A threshold of the profile, and where a device acted beside it."""

from dataclasses import dataclass

from hil_bench.result import Measured


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A threshold of the profile, with the range in which the device may act."""

    key: str
    name: str
    unit: str
    profile: float
    lowest: float | None = None
    highest: float | None = None
    place: str = ""

    def at(self, acts_at: float | None) -> list[Measured]:
        """Where the device acted; None: it did not."""
        return [
            Measured(
                name=self.name,
                unit=self.unit,
                key=self.key,
                place=self.place,
                profile=self.profile,
                lowest=self.lowest,
                highest=self.highest,
                acts_at=None if acts_at is None else round(acts_at, 5),
            )
        ]
