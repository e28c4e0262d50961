"""The control process that `start` looks at: `vehicle-iface run` itself, in a time that passes only when it sleeps.

    python -P -c "from benchmarks.parts.control_process import main; main()" PASSES TELEMETRY RESULT_FD

The clock is replaced before the program is imported; everything else is as it is (options, profile, DBC, route,
controller, telemetry writer, real-time claims, the loop, the embedded bus), and nothing waits. A newline goes to
RESULT_FD when the first pair of commands is handed to the bus; after PASSES passes a line of JSON, what was seen.
"""

import gc
import os
import resource
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vehicle_iface import clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from vehicle_iface.telemetry.details import LiveDetails

COMMAND_IDS = {0x080, 0x081}
"""Of reference.dbc: one pair."""
MARKS = 20
"""Looks at the memory, evenly over the passes."""
SCHED_RESET_ON_FORK = 0x40000000


class VirtualClock:
    """Moves only when somebody sleeps."""

    def __init__(self) -> None:
        self.t_ns = clock.monotonic_ns()

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.t_ns = max(self.t_ns, deadline_ns)


class Witness:
    """Sees commands, passes and collections go by, and ends the process when there were enough passes."""

    def __init__(self, passes: int, result: int) -> None:
        self.passes = passes
        self.result = result
        self.done = 0
        self.commands: set[int] = set()
        self.rss_kib: list[int] = []
        self.is_tidying = False
        self.collections: Counter[str] = Counter()

    def sent(self, can_id: int) -> None:
        if len(self.commands) < len(COMMAND_IDS) and can_id in COMMAND_IDS:
            self.commands.add(can_id)
            if len(self.commands) == len(COMMAND_IDS):
                os.write(self.result, b"\n")

    def passed(self, details: "Callable[[], LiveDetails]") -> None:
        if len(self.commands) < len(COMMAND_IDS):
            return
        if self.done % max(1, self.passes // MARKS) == 0 or self.done == self.passes:
            self.rss_kib.append(resident_kib())
        if self.done == self.passes:
            self.write_details(details())
            raise SystemExit
        self.done += 1

    def collected(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start" and self.done:
            self.collections[f"{'between' if self.is_tidying else 'in'} {info['generation']}"] += 1

    def write_details(self, details: "LiveDetails") -> None:
        seen = {
            "passes": self.done,
            "samples": details.samples.complete,
            "rss_kib": self.rss_kib,
            "collections": self.collections,
            "imported": [name for name in ("viser", "can", "cantools", "numpy") if name in sys.modules],
        }
        import json  # only now: the start does not need it

        os.write(self.result, json.dumps(seen).encode() + b"\n")


def main() -> None:
    passes, telemetry, result = sys.argv[1:]
    witness, virtual = Witness(int(passes), int(result)), VirtualClock()
    clock.monotonic_ns, clock.sleep_until = virtual.now_ns, virtual.sleep_until
    from vehicle_iface import cli  # only now, when it finds the other clock

    cli.use_one_blas_thread()  # both as `main` does before the imports, of which `watch` needs some
    gc.disable()
    watch(witness)
    cli.main(["run", "--interface", "embedded", "--route", "figure8", "--arm", "--telemetry", telemetry])


def watch(witness: Witness) -> None:
    """Put the witness where commands leave, passes end, and garbage is collected."""
    from vehicle_iface.frame import CanFrame
    from vehicle_iface.runtime import realtime
    from vehicle_iface.runtime.loop import Loop
    from vehicle_iface.sim.embedded import EmbeddedBus

    collect, apply_settings, step, send = (
        realtime.collect_garbage_if_due,
        realtime.apply_settings,
        Loop.step,
        EmbeddedBus.send,
    )

    def watched_collect() -> None:
        witness.is_tidying = True
        collect()
        witness.is_tidying = False

    def watched_apply(**settings: Any) -> list[str]:
        lacks = apply_settings(**settings)
        # What never waits must not have a processor to itself.
        os.sched_setscheduler(0, os.SCHED_OTHER | SCHED_RESET_ON_FORK, os.sched_param(0))
        return lacks

    def watched_step(loop: Loop) -> None:
        step(loop)
        witness.passed(loop.details)

    def watched_send(bus: EmbeddedBus, *frames: CanFrame) -> int:
        for frame in frames:
            witness.sent(frame.can_id)
        return send(bus, *frames)

    gc.callbacks.append(witness.collected)
    for place, name, watched in (
        (realtime, "collect_garbage_if_due", watched_collect),
        (realtime, "apply_settings", watched_apply),
        (Loop, "step", watched_step),
        (EmbeddedBus, "send", watched_send),
    ):
        setattr(place, name, watched)


def resident_kib() -> int:
    """VmRSS."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() // 1024
