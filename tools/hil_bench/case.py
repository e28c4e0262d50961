"""What a case is: preparation, injection, expectations, and how it ends."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from hil_bench import routes
from hil_bench.expect import Expectation, Measurement
from hil_bench.faults.base import Injection
from hil_bench.parts import Part
from hil_bench.routes import Route
from hil_bench.steps import Step


class Then(StrEnum):
    """What the device does after the injection, until the clean-up."""

    GOES_ON = "drives on by itself"
    REARM = "stays released until armed again, then drives"
    GOES_ON_IF_MOVING = "drives on by itself; if its stop ended at rest, it may stay stopped until armed again"
    MAY_GO_ON = "drives on by itself, or stays stopped until armed again"
    HOLDS = "holds the vehicle at standstill"
    END_OF_ROUTE = "drives to the end of its route"
    ENDED = "has ended"
    NEVER = "never drives"


class Need(StrEnum):
    """What a case needs."""

    OWN_PROCESS = "a device that the bench starts on this computer"
    START = "a device that the bench starts"
    REARM = "a way to arm the device again (--rearm, or a device that the bench starts)"
    VIRTUAL = "a virtual interface, which may be taken down and deleted"
    ROOT = "root"
    VXCAN = "vxcan and tc (iproute2), to put a bad cable between device and vehicle"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One test of the device, and what must be observed."""

    name: str
    proves: str
    fault: str = ""
    """Row in the catalogue of faults."""
    tags: tuple[str, ...] = ()
    injected: str = ""
    """The fault, for the report."""
    route: Callable[[], Route] = routes.straight
    at_mps: float = 2.5
    """The injection begins at this speed; 0: as soon as the vehicle is engaged; below 0: before that."""
    reach_s: float = 12.0
    """Time in which the vehicle reaches that speed."""
    inject: Injection | None = None
    for_s: float = 0.5
    """Duration of the injection."""
    see: tuple[Expectation, ...] = ()
    measure: tuple[Measurement, ...] = ()
    """Thresholds that are read from the injection."""
    steps: tuple[Step, ...] = ()
    """Injections one after the other in one drive, in place of the one."""
    lacks: str = ""
    """What this vehicle's profile does not have, so that the case does not apply."""
    after_s: float = 0.0
    """Pause after the injection."""
    then: Then = Then.GOES_ON
    may_fall_silent: bool = False
    """At standstill after its stop the device may also fall silent, where it is to hold the vehicle."""
    allow: frozenset[str] = frozenset()
    """The kinds of findings (`judges.KINDS`) that are no failure during the injection."""
    needs: tuple[Need, ...] = ()
    about: tuple[Part, ...] = ()
    """What the vehicle must have; without it the case does not apply."""
    on_vxcan: bool = False
    """On a vxcan cable: the device on one end, the vehicle on the other."""
    armed: bool = True
    breaks: Callable[[str], str] | None = None
    """Changes the text of the trajectory's file before the device loads it."""
    profile: Callable[[str, str], tuple[str, str]] | None = None
    """Changes the texts of TOML and DBC that the device loads."""
    link_is_down: bool = False
    """The interface is down when the device starts."""
    channel: str = ""
    """The device is started on this interface instead of the bench's."""
    recorded_mib: int = 0
    """The device records its drive on a disk of this size."""
    viewed: bool = False
    """A viewer runs beside the device."""
    open_files: int = 0
    """The device starts with this many open descriptors."""
    exit_status: tuple[int, ...] = (0,)
    max_path_error_m: float | None = None
    answers_in_time: bool = True
    """Outside the injection, answers must be in time."""
    is_measured: bool = False
    """Answers are measured, and must be in time, during the injection instead."""
    samples: int = 0
    """The injection continues until this many samples were sent."""
    setup: dict[str, float] = field(default_factory=dict)
    """Attributes of the plant at the beginning."""

    @property
    def is_manoeuvre(self) -> bool:
        """Whether a drive is judged, not a fault."""
        return "manoeuvre" in self.tags
