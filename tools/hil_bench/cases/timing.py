"""Measurements of latency and regularity, and endurance."""

from hil_bench import routes
from hil_bench.case import Case
from hil_bench.cases.common import DROPPED
from hil_bench.expect import DrivesOn, FollowsGaps
from hil_bench.faults import base, frames, traffic

TIMING = (
    *(
        Case(
            name=f"latency-at-{round(share * 100)}-percent-load",
            tags=("timing", "load"),
            proves=f"Latency from state to command, and jitter of the commands, at {share:.0%} bus load.",
            injected=f"unknown frames at {share:.0%} bus load for 8 s, every 23rd sample dropped",
            route=lambda: routes.straight(600.0, 4.0),
            inject=base.combine(traffic.add_load(share), frames.drop_samples(23)) if share else frames.drop_samples(23),
            for_s=8.0,
            is_measured=True,
            see=(DrivesOn(), FollowsGaps()),
            allow=DROPPED,
        )
        for share in (0.0, 0.3, 0.6, 0.9)
    ),
    Case(
        name="forty-thousand-samples",
        tags=("endurance",),
        proves="Every one of 40,000 samples is answered.",
        injected="no fault, 400 s of driving",
        route=lambda: routes.route("rounds", [(8.0, 0.0), (120 * 75.4, 1.0 / 12.0)], 4.0, slack=3.0),
        inject=base.inject_nothing,
        for_s=1.0,
        samples=40_000,
        is_measured=True,
        see=(DrivesOn(),),
        max_path_error_m=0.6,
    ),
)
