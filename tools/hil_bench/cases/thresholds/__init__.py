"""Where the device really acts, for every limit and time of a vehicle's profile."""

from hil_bench.case import Case
from hil_bench.cases.thresholds.deviation import deviation_cases
from hil_bench.cases.thresholds.driver import driver_cases
from hil_bench.cases.thresholds.gear import gear_cases
from hil_bench.cases.thresholds.samples import sample_cases
from hil_bench.cases.thresholds.stops import stop_cases
from hil_bench.cases.thresholds.times import time_cases
from hil_bench.wire import Wire


def threshold_cases(wire: Wire) -> tuple[Case, ...]:
    """The cases of one vehicle; what its profile lacks is in `Case.lacks`."""
    kinds = (time_cases, deviation_cases, stop_cases, driver_cases, sample_cases, gear_cases)
    return tuple(case for kind in kinds for case in kind(wire))
