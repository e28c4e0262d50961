"""The catalogue: every case of the bench.

The rows (B1, F2, S3, …) are those of FAILURES.md; a row that can only be injected from inside a controller is not here.
Times are those of the bus contract.
"""

from hil_bench.case import Case
from hil_bench.cases.bus import BUS
from hil_bench.cases.buses import BUSES
from hil_bench.cases.companions import COMPANIONS
from hil_bench.cases.deviation import DEVIATION
from hil_bench.cases.driver import DRIVER
from hil_bench.cases.fields import field_cases
from hil_bench.cases.files import FILES
from hil_bench.cases.frames import FRAMES
from hil_bench.cases.in_turn import in_turn_cases
from hil_bench.cases.limits import limit_cases
from hil_bench.cases.manoeuvres import MANOEUVRES
from hil_bench.cases.messages import message_cases
from hil_bench.cases.plausibility import PLAUSIBILITY
from hil_bench.cases.process import PROCESS
from hil_bench.cases.second_causes import second_cause_cases
from hil_bench.cases.state import STATE
from hil_bench.cases.thresholds import threshold_cases
from hil_bench.cases.timing import TIMING
from hil_bench.cases.trajectory import TRAJECTORY
from hil_bench.wire import Wire

CATALOGUE: tuple[Case, ...] = (
    *MANOEUVRES,
    *TRAJECTORY,
    *STATE,
    *PLAUSIBILITY,
    *DEVIATION,
    *FRAMES,
    *BUS,
    *DRIVER,
    *PROCESS,
    *COMPANIONS,
    *FILES,
    *TIMING,
)
"""Of every vehicle."""


def catalogue_of(buses: int) -> tuple[Case, ...]:
    """The cases of a vehicle with so many buses."""
    return CATALOGUE if buses == 1 else (*CATALOGUE, *BUSES)


def catalogue_for(wire: Wire) -> tuple[Case, ...]:
    """The cases of one vehicle: those of every vehicle, and those that are generated from its profile."""
    kinds = (threshold_cases, message_cases, field_cases, limit_cases, second_cause_cases, in_turn_cases)
    return (*catalogue_of(len(wire.buses)), *(case for cases_of in kinds for case in cases_of(wire)))
