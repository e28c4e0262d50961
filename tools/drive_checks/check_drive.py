"""Judge a recorded drive: `candump -L vcan0 > LOG.candump`, then `tools/check_drive LOG.candump`."""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vehicle_bus_contract.candump import read_candump
from vehicle_bus_contract.judge import Record, examine, lateral_errors_m
from vehicle_bus_contract.reference import REFERENCE, Contract, Frame, S
from vehicle_bus_contract.reference_fd import REFERENCE_FD

PROFILES = {"reference": REFERENCE, "reference_fd": REFERENCE_FD}
LATERAL_LIMIT_M = 0.3
MOST_SHOWN = 10


def main() -> int:
    """0 when nothing is wrong, 1 when something is, 2 for a log that cannot be read."""
    options = _options()
    try:
        frames = list(read_candump(Path(options.log)))
    except (OSError, ValueError) as error:
        print(f"check_drive: {options.log}: {error}", file=sys.stderr)
        return 2
    result = judge(frames, PROFILES[options.profile], options.route, options.lateral_limit)
    print(json.dumps(result, indent=2) if options.json else table(result))
    return 1 if result["wrong"] else 0


def judge(frames: Iterable[Frame], contract: Contract, route: str, lateral_limit_m: float) -> dict[str, Any]:
    """What a drive came to; `wrong` lists all that is wrong with it."""
    record = examine(frames, contract)
    driving = [pair.stamp_ns for pair in record.pairs if pair.reason == "NOMINAL"]
    begin_ns, end_ns = (driving[0], driving[-1]) if driving else (0, 0)
    worst_m, worst_s = _worst_lateral_error(record, route, begin_ns, end_ns)
    wrong = record.faults()
    if not record.samples or not record.pairs:
        wrong.append("no drive: not one complete sample or not one command")
    if worst_m is not None and worst_m >= lateral_limit_m:
        wrong.append(f"lateral error {worst_m:.3f} m at {worst_s:.3f} s: must be below {lateral_limit_m} m")
    known = [*contract.messages, *sorted(set(record.frames) - set(contract.messages))]
    return {
        "duration_s": round((record.end_ns - record.begin_ns) / S, 3),
        "driven_s": round((end_ns - begin_ns) / S, 3),
        "frames": {name: record.frames[name] for name in known},
        "crc_errors": len(record.crc_errors),
        "malformed_frames": len(record.malformed),
        "counter_gaps": len(record.counter_gaps),
        "samples": len(record.samples),
        "pairs": len(record.pairs),
        "pairs_by_reason": _by_reason(record),
        "unanswered_samples": len(record.unanswered),
        "pairs_too_many": len(record.doubled),
        "stale_stops": record.stale_stops,
        "silences": len(record.silences),
        "command_violations": len(record.violations),
        "worst_lateral_error_m": None if worst_m is None else round(worst_m, 4),
        "worst_lateral_error_at_s": None if worst_s is None else round(worst_s, 3),
        "wrong": wrong,
    }


def _worst_lateral_error(record: Record, route: str, begin_ns: int, end_ns: int) -> tuple[float | None, float | None]:
    """The greatest distance from the route between two instants, and when that was."""
    if route == "none":
        return None, None
    from vehicle_iface.trajectories.shapes import make_route  # only its geometry

    path = make_route(route)
    driven = [sample for sample in record.samples if begin_ns <= sample.stamp_ns <= end_ns]
    errors = lateral_errors_m(driven, path.x_m.tolist(), path.y_m.tolist())
    if not errors:
        return None, None
    worst_m = max(errors)
    return worst_m, (driven[errors.index(worst_m)].stamp_ns - record.begin_ns) / S


def _by_reason(record: Record) -> dict[str, int]:
    counts: dict[str, int] = {}
    for pair in record.pairs:
        key = f"{pair.reason}, {'enabled' if pair.is_enabled else 'released'}"
        counts[key] = counts.get(key, 0) + 1
    return counts


def table(result: dict[str, Any]) -> str:
    """What `judge` found, for people."""
    rows: list[tuple[str, str]] = []
    for key, value in result.items():
        name = key.replace("_", " ")
        if isinstance(value, dict):
            rows += [(f"{name}: {part}", str(count)) for part, count in value.items()]
        elif not isinstance(value, list):
            rows.append((name, "-" if value is None else str(value)))
    width = max(len(name) for name, _ in rows)
    lines = [f"  {name:<{width}}  {value}" for name, value in rows]
    wrong = result["wrong"]
    lines += [f"  wrong: {text}" for text in wrong[:MOST_SHOWN]]
    if len(wrong) > MOST_SHOWN:
        lines.append(f"  wrong: and {len(wrong) - MOST_SHOWN} more (--json lists them)")
    return "\n".join([*lines, "  nothing is wrong" if not wrong else f"  {len(wrong)} things are wrong"])


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tools/check_drive",
        description=__doc__,
        epilog="Exit status: 0 nothing is wrong, 1 something is, 2 the log cannot be read.",
    )
    parser.add_argument("log", metavar="LOG.candump", help="what candump -L wrote")
    parser.add_argument("--route", default="figure8", help="the route that was driven; 'none' leaves it out")
    parser.add_argument(
        "--lateral-limit",
        type=float,
        default=LATERAL_LIMIT_M,
        metavar="M",
        help="largest distance from it, in m (default 0.3)",
    )
    parser.add_argument("--profile", default="reference", choices=PROFILES, help="the bus (default reference)")
    parser.add_argument("--json", action="store_true", help="everything, for programs")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
