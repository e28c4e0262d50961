"""What most tests begin with: a vehicle that is being driven."""

import json
from pathlib import Path
from typing import Any

from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import AUTONOMOUS, CONTROLLER_SENDS, DecodedFrame

from .conftest import Program, Programs
from .observer import Observer

FAST_ENOUGH_MPS = 1.0


def line_file(
    folder: Path, *, length_m: float = 300.0, speed_mps: float = 3.0, last_s: float = 100.0, first_m: float = 0.0
) -> str:
    """A CSV trajectory along +x from `first_m` on, its last point due after `last_s`."""
    path, count = folder / "line.csv", round(length_m * 2)
    rows = (f"{last_s * i / count:.6f},{first_m + i / 2:.3f},0,0,{speed_mps}" for i in range(count + 1))
    path.write_text("time_s,x_m,y_m,heading_rad,speed_mps\n" + "\n".join(rows) + "\n")
    return str(path)


def driven(programs: Programs, bus: Observer, *arguments: str, last_s: float = 100.0) -> tuple[Program, int]:
    """A loop that drives the vehicle along a line (or as the arguments say) by now, and the index of that moment."""
    what = arguments or ("--trajectory", line_file(programs.folder, last_s=last_s))
    loop = programs.run("--arm", *what)
    return loop, wait_until_driven(bus)


def wait_until_driven(bus: Observer, since: int = 0) -> int:
    """The index at which the vehicle is AUTONOMOUS, moves, and is commanded to."""
    index, _ = bus.wait_for("the vehicle engages", "VEHICLE_STATUS", MODE=AUTONOMOUS, since=since)
    index, _ = bus.wait_for("a command that drives", "DRIVE_COMMAND", REASON="NOMINAL", ENABLE=1, since=index)
    index, _ = bus.wait_until("the vehicle moves", is_moving, since=index)
    return index


def is_moving(decoded: DecodedFrame) -> bool:
    """Whether it is a MOTION of a vehicle that is well on its way."""
    return decoded.name == "MOTION" and decoded["SPEED"] >= FAST_ENOUGH_MPS


def is_standing(decoded: DecodedFrame) -> bool:
    """Whether it is a MOTION of a vehicle that stands."""
    return decoded.name == "MOTION" and abs(decoded["SPEED"]) < 0.01


def summary(programs: Programs) -> dict[str, Any]:
    """What the loop wrote at its end."""
    content: dict[str, Any] = json.loads((programs.folder / "summary.json").read_text())
    return content


def own_faults(record: Record) -> list[str]:
    """What is wrong with the frames that the controller sent, whatever the vehicle did."""
    gaps = [gap for gap in record.counter_gaps if gap.startswith(CONTROLLER_SENDS)]
    crc = [error for error in record.crc_errors if error.startswith(CONTROLLER_SENDS)]
    return [*gaps, *crc, *record.doubled, *record.unanswered, *record.violations]
