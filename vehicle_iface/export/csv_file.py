"""The samples of a recording as CSV: one row for each snapshot."""

import csv
from pathlib import Path

from vehicle_iface.export.recording import RecordedDrive
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, Gear, VehicleMode
from vehicle_iface.telemetry import Snapshot

NAMES = {"controller_state": ControllerState, "reason": Reason, "vehicle_mode": VehicleMode, "gear": Gear}
"""Fields that are written as names."""


def write_csv(drive: RecordedDrive, path: Path) -> int:
    """Write one row for each snapshot; return their number. Raises `OSError`.

    `time_s` is the time since the first snapshot. Where a group's flag (`has_state`, `has_status`, `has_reference`, …)
    is false, its values are 0. Booleans are 0 and 1.
    """
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("time_s", *Snapshot._fields))
        for snapshot in drive.snapshots():
            writer.writerow((f"{drive.time_s(snapshot.published_ns):.6f}", *_cells(snapshot)))
            count += 1
    return count


def _cells(snapshot: Snapshot) -> list[object]:
    cells = ((field, getattr(snapshot, field)) for field in Snapshot._fields)
    return [
        name_of(field, value) if field in NAMES else int(value) if isinstance(value, bool) else value
        for field, value in cells
    ]


def name_of(field: str, number: int) -> str:
    """The name of a number of such a field."""
    try:
        return NAMES[field](number).name
    except ValueError:  # a number of another version
        return str(number)
