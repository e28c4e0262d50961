"""What all cases of a run have in common."""

from dataclasses import dataclass
from pathlib import Path

from hil_bench.bus import is_virtual
from hil_bench.buses import describe_channels
from hil_bench.device import Commands
from hil_bench.result import Evidence
from hil_bench.wire import Wire


@dataclass(frozen=True, kw_only=True)
class BenchConfig:
    """What all cases of a run have in common."""

    wire: Wire
    channel: str
    """The interface of the first bus."""
    commands: Commands
    folder: Path
    """Folder for the files of every case."""
    profile: str
    seed: int = 0
    further_channels: tuple[str, ...] = ()
    """Of the buses after the first."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The interface of each bus."""
        return (self.channel, *self.further_channels)

    @property
    def described_channels(self) -> str:
        """The interfaces, for a report."""
        return describe_channels(self.channels, self.wire)

    @property
    def evidence(self) -> Evidence:
        """The class of evidence of its results."""
        return Evidence.VIRTUAL_BUS if any(map(is_virtual, self.channels)) else Evidence.REAL_BUS
