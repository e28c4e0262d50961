"""Where the time of a case goes."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

from vehicle_bus_contract.reference import Frame, S

from hil_bench.rig import Rig

STAGES = (
    "start of the device",
    "engaging",
    "driving to the injection",
    "injection and reaction",
    "rest of the drive",
    "end of the device",
    "files and verdict",
)
"""In their order; a case that skips one spends no time in it."""


def measure_stages(rig: Rig, frames: Sequence[Frame], begin_ns: int, judged_ns: int) -> dict[str, float]:
    """Seconds of a case by stage, from its beginning until its verdict. Instants are monotonic, ns."""
    first_ns = next((frame.stamp_ns for frame in frames if frame.stamp_ns), 0)
    injected_ns = rig.inject_ns or rig.engaged_ns
    ends_ns = (
        first_ns,
        rig.engaged_ns,
        injected_ns,
        rig.end_ns,
        rig.healthy_ns or rig.then_ns,
        rig.closed_ns,
        judged_ns,
    )
    return {name: spent for name, spent in durations_s(begin_ns, zip(STAGES, ends_ns, strict=True)) if spent > 0.0}


def durations_s(begin_ns: int, stages: Iterable[tuple[str, int]]) -> Iterable[tuple[str, float]]:
    """Each from the end of the one before; a stage without an end was skipped."""
    reached = [("", begin_ns), *((name, end_ns) for name, end_ns in stages if end_ns)]
    latest_ns = begin_ns
    for _, (name, end_ns) in pairwise(reached):
        yield name, round(max(0, end_ns - latest_ns) / S, 2)
        latest_ns = max(latest_ns, end_ns)
