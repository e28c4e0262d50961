"""What a case is: preparation, what is injected and for how long, what must be seen, and how it ends."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from hil import routes
from hil.expect import Expectation
from hil.faults import Injection
from hil.routes import Route


class Then(StrEnum):
    """How a case goes on when its injection is over, until it is cleaned up."""

    GOES_ON = "drives on by itself"
    REARM = "stays out until the operator arms again, then drives"
    HOLDS = "holds the vehicle at standstill"
    END_OF_ROUTE = "drives to the end of its route"
    ENDED = "has ended"
    NEVER = "never drives"


class Need(StrEnum):
    """What a case cannot do without."""

    OWN_PROCESS = "a device that the bench starts on this computer"
    START = "a device that the bench starts"
    REARM = "a way to arm the device again (--rearm, or a device that the bench starts)"
    VIRTUAL = "a virtual interface, which may be taken down and deleted"
    ROOT = "root"
    VXCAN = "vxcan and tc (iproute2), to put a bad cable between device and vehicle"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One question to the device, and what the right answer looks like."""

    name: str
    proves: str
    fault: str = ""
    """Row in the catalogue of faults."""
    tags: tuple[str, ...] = ()
    injected: str = ""
    """In words, for the report."""
    route: Callable[[], Route] = routes.straight
    frame_id: str = "map"
    at_mps: float = 2.5
    """The injection begins when the vehicle drives so fast; 0: as soon as it is engaged; below 0: before it engages."""
    inject: Injection | None = None
    for_s: float = 0.5
    """So long."""
    see: tuple[Expectation, ...] = ()
    after_s: float = 0.0
    """After the injection nothing is done for so long."""
    then: Then = Then.GOES_ON
    allow: frozenset[str] = frozenset()
    """Of what is never to be seen, what may be seen while the injection works: see `judge.KINDS`."""
    needs: tuple[Need, ...] = ()
    on_vxcan: bool = False
    """On a cable of two ends: the device on one, the vehicle on the other."""
    armed: bool = True
    breaks: Callable[[str], str] | None = None
    """Changes the text of the trajectory's file before the device gets it."""
    profile: Callable[[str, str], tuple[str, str]] | None = None
    """Changes the texts of TOML and DBC that the device gets."""
    link_is_down: bool = False
    """The interface is down before the device begins."""
    channel: str = ""
    """An interface that the device is told to use instead of the bench's."""
    recorded_mib: int = 0
    """The device writes its drive down, on a disk of this size."""
    viewed: bool = False
    """A viewer shows the device to browsers."""
    open_files: int = 0
    """So many descriptors are open in the device before it begins."""
    exit_status: tuple[int, ...] = (0,)
    most_path_error_m: float | None = None
    answers_in_time: bool = True
    """Whether answers must come in time, outside the injection."""
    is_measured: bool = False
    """Answers are measured, and must come in time, while the injection works instead."""
    samples: int = 0
    """The injection goes on until so many samples were sent."""
    setup: dict[str, float] = field(default_factory=dict)
    """Attributes of the plant at the beginning."""
