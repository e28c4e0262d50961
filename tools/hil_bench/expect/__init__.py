"""The vocabulary of expectations: what must be observed of a device in a case."""

from hil_bench.expect.base import (
    Expectation,
    Measurement,
    Observation,
    check,
    check_measured,
    measure,
    not_applicable,
)
from hil_bench.expect.commands import (
    Answers,
    DrivesOn,
    FallsSilent,
    FollowsGaps,
    GivesUp,
    LetsGo,
    MakesUpForNothing,
    MomentaryAtMost,
    NeverDrives,
    NeverEnables,
    StaysOut,
    Stops,
)
from hil_bench.expect.fields import DoesNoHarm, StopsOnContradiction
from hil_bench.expect.path import StandsAtDwells, StaysNear
from hil_bench.expect.process import Ends, EndsOrderly, NamesBus, Refuses
from hil_bench.expect.vehicle import AsksForItsSpeed, HazardLights, ReachesEnd, Standstill, WatchdogActs

__all__ = [
    "Answers",
    "AsksForItsSpeed",
    "DoesNoHarm",
    "DrivesOn",
    "Ends",
    "EndsOrderly",
    "Expectation",
    "FallsSilent",
    "FollowsGaps",
    "GivesUp",
    "HazardLights",
    "LetsGo",
    "MakesUpForNothing",
    "Measurement",
    "MomentaryAtMost",
    "NamesBus",
    "NeverDrives",
    "NeverEnables",
    "Observation",
    "ReachesEnd",
    "Refuses",
    "StandsAtDwells",
    "Standstill",
    "StaysNear",
    "StaysOut",
    "Stops",
    "StopsOnContradiction",
    "WatchdogActs",
    "check",
    "check_measured",
    "measure",
    "not_applicable",
]
