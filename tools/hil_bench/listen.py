"""Listening on a bus with other traffic: the bench sends nothing and judges the commands it receives."""

import datetime
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from vehicle_bus_contract.candump import candump_line

from hil_bench.bus import is_virtual
from hil_bench.buses import describe_channels, open_bus
from hil_bench.expect import check
from hil_bench.peer.build import examine
from hil_bench.result import CaseResult, Check, Evidence, Run, Verdict, verdict_of
from hil_bench.surroundings import environment
from hil_bench.wire import Wire


def run(
    wire: Wire, channels: Sequence[str], folder: Path, duration_s: float, traffic: Sequence[str], *, real_vehicle: bool
) -> Run:
    """Listen for `duration_s` and judge any commands by the bus contract. Raises `OSError`.

    Only a person can say that the vehicle on a real bus is real.
    """
    folder.mkdir(parents=True, exist_ok=True)
    began = datetime.datetime.now().astimezone()
    bus, described = open_bus(channels, wire), describe_channels(channels, wire)
    frames, interrupted = [], ""
    try:
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + duration_s:
            frames += [rx.frame for rx in bus.drain()]
            time.sleep(0.01)
    except KeyboardInterrupt:  # report what was received until now
        interrupted = "interrupted while listening"
    finally:
        bus.close()
    duration_s = round(time.monotonic() - begin_s, 1)
    offset_ns = time.time_ns() - time.monotonic_ns()
    lines = [candump_line(frame, channels[frame.bus], offset_ns) for frame in frames]
    (folder / "listened.candump").write_text("".join(f"{line}\n" for line in lines))
    record = examine(wire, (frame for frame in frames if not frame.is_error))
    on_wire = Evidence.REAL_VEHICLE if real_vehicle else Evidence.REAL_BUS
    evidence = Evidence.VIRTUAL_BUS if any(map(is_virtual, channels)) else on_wire
    checks: list[Check] = []
    if record.pairs:
        checks.append(check("the commands on this bus keep the bus contract", record.faults()))
    found = CaseResult(
        name="listen-only",
        proves="The commands of other nodes keep the bus contract; the bench sent nothing.",
        verdict=(Verdict.FAIL if checks[0].found else Verdict.PASS) if checks else Verdict.NOT_EXECUTED,
        why=checks[0].found[0] if checks and checks[0].found else "" if checks else "no commands on this bus",
        evidence=evidence,
        duration_s=duration_s,
        checks=checks,
        counts=dict(record.frames),
        candump="listened.candump",
    )
    return Run(
        verdict=verdict_of([found], interrupted=interrupted),
        interrupted=interrupted,
        evidence=evidence,
        began=began.isoformat(timespec="seconds"),
        duration_s=duration_s,
        command=" ".join(sys.argv),
        channel=described,
        profile=wire.name,
        profile_hash=wire.hash,
        device=f"unknown; on the bus: {'; '.join(traffic) or 'no traffic at first'}",
        seed=0,
        environment=environment(channels, described),
        cases=[found],
    )
