"""The control process of the `pacing` benchmark: `vehicle-iface run` on the embedded bus, with a watch on its wake-ups.

`python -m benchmarks.parts.pacing_loop PROFILE TELEMETRY SECONDS {fifo,ordinary} [OPTION …]` prints JSON; the options
are those of `run`. The program is as it is: only `clock.sleep_until` is wrapped, and `realtime.apply_settings` leaves
one step out where SCHED_FIFO is not wanted.
"""

import gc
import json
import sys
from array import array

from vehicle_iface import cli, clock, compose
from vehicle_iface.runtime import realtime
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.units import ns_from_s

WARM_UP_S = 1.0
"""From the first wake-up on: until then the program engages, and is not counted."""


class _Over(BaseException):
    """Out of the loop: a simulated vehicle need not be stopped."""


class Watch:
    """How late each wake-up is against the instant that was asked for, both grids: the loop's and the vehicle's."""

    def __init__(self, seconds: float) -> None:
        self.late_ns = array("q")
        self.loop: Loop | None = None
        self.full_collections = {"in a pass": 0, "between passes": 0}
        self._sleep_until = clock.sleep_until
        self._tidy = realtime.collect_garbage_if_due
        self._is_tidying = False
        self._seconds = seconds
        self._begin_ns = self._end_ns = 0
        self._ticks_before = 0
        self._grid_begin_ns = 0

    def sleep_until(self, deadline_ns: int) -> None:
        """In the place of `clock.sleep_until`."""
        self._sleep_until(deadline_ns)
        now_ns = clock.monotonic_ns()
        if not self._begin_ns:
            self._begin_ns = now_ns + ns_from_s(WARM_UP_S)
            self._end_ns = self._begin_ns + ns_from_s(self._seconds)
        if now_ns < self._begin_ns:
            return
        if not self._grid_begin_ns:
            assert self.loop is not None
            self._grid_begin_ns, self._ticks_before = now_ns, self.loop.timer.ticks
            gc.callbacks.append(self._collected)
        self.late_ns.append(now_ns - deadline_ns)
        if now_ns >= self._end_ns:
            self._end_ns = now_ns
            raise _Over

    def tidy(self) -> None:
        """In the place of `realtime.collect_garbage_if_due`: collecting there is between two passes."""
        self._is_tidying = True
        self._tidy()
        self._is_tidying = False

    def _collected(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start" and info["generation"] == 2:
            self.full_collections["between passes" if self._is_tidying else "in a pass"] += 1

    def found(self) -> dict[str, object]:
        """For the benchmark."""
        loop = self.loop
        assert loop is not None
        gc.callbacks.remove(self._collected)
        summary = loop.summary()
        return {
            "late_ns": list(self.late_ns),
            "ticks": loop.timer.ticks - self._ticks_before,
            "periods": (self._end_ns - self._grid_begin_ns) / loop.timer.period_ns,
            "state": summary.controller_state,
            "reason": summary.reason,
            "deadline_misses": summary.deadline_misses,
            "full_collections": self.full_collections,
            "imports_viser": "viser" in sys.modules,
        }


def main() -> None:
    profile, telemetry, seconds, policy, *more = sys.argv[1:]
    watch, build_loop = Watch(float(seconds)), compose.build_loop

    def build(**parts: object) -> Loop:
        watch.loop = build_loop(**parts)  # type: ignore[arg-type]
        return watch.loop

    clock.sleep_until, realtime.collect_garbage_if_due = watch.sleep_until, watch.tidy
    compose.build_loop = build
    if policy == "ordinary":
        realtime.STEPS = tuple(step for step in realtime.STEPS if step.__name__ != "_set_fifo")
        assert len(realtime.STEPS) == 5
    options = ["--interface", "embedded", "--route", "figure8", "--arm", "--profile", profile, "--telemetry", telemetry]
    try:
        status = cli.main(["run", *options, *more])
    except _Over:
        print(json.dumps(watch.found()))
        return
    sys.exit(status or 1)


if __name__ == "__main__":
    main()
