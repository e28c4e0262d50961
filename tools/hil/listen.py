"""What the bench does on a bus that is not its own: nothing but listen, and judge what is said there."""

import datetime
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from bus_contract_judge import examine

from hil.bench import environment
from hil.bus import Bus, candump_line, is_virtual
from hil.expect import check
from hil.result import CaseResult, Check, Evidence, Run, Verdict, verdict_of
from hil.wire import Wire


def run(
    wire: Wire, channel: str, folder: Path, duration_s: float, traffic: Sequence[str], *, real_vehicle: bool
) -> Run:
    """Listen for so long; whoever commands is judged by the bus contract. Raises `OSError`.

    That the vehicle on a real bus is real is for a person to say: it cannot be heard.
    """
    folder.mkdir(parents=True, exist_ok=True)
    began = datetime.datetime.now().astimezone()
    bus = Bus(channel, wire.names)
    frames, interrupted = [], ""
    try:
        begin_s = time.monotonic()
        while time.monotonic() < begin_s + duration_s:
            frames += [heard.frame for heard in bus.drain()]
            time.sleep(0.01)
    except KeyboardInterrupt:  # whoever has heard enough wants to know what it was
        interrupted = "interrupted while it listened"
    finally:
        bus.close()
    duration_s = round(time.monotonic() - begin_s, 1)
    offset_ns = time.time_ns() - time.monotonic_ns()
    lines = [candump_line(frame, channel, offset_ns) for frame in frames]
    (folder / "listened.candump").write_text("".join(f"{line}\n" for line in lines))
    record = examine((frame for frame in frames if not frame.is_error), wire)
    on_wire = Evidence.REAL_VEHICLE if real_vehicle else Evidence.REAL_BUS
    evidence = Evidence.VIRTUAL_BUS if is_virtual(channel) else on_wire
    checks: list[Check] = []
    if record.pairs:
        checks.append(check("what is commanded on this bus keeps to the bus contract", record.faults()))
    found = CaseResult(
        name="listen-only",
        proves="What others command on this bus keeps to the bus contract; the bench said nothing.",
        verdict=(Verdict.FAIL if checks[0].found else Verdict.PASS) if checks else Verdict.NOT_EXECUTED,
        why=checks[0].found[0] if checks and checks[0].found else "" if checks else "nobody commands on this bus",
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
        channel=channel,
        profile=wire.name,
        profile_hash=wire.hash,
        device=f"not known; on the bus: {'; '.join(traffic) or 'nothing at first'}",
        seed=0,
        environment=environment(channel),
        cases=[found],
    )
