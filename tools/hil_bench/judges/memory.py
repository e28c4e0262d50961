"""Whether the device's memory grows while it drives."""

from collections.abc import Sequence

from vehicle_bus_contract.reference import S

from hil_bench.expect import check
from hil_bench.result import Check

WARM_S, LEAST_S = 10.0, 15.0
"""What it builds up at first does not count; a shorter time after that shows nothing."""
ROOM_BYTES, BYTES_PER_SAMPLE = 512 << 10, 50.0
"""What it may take in addition: once, and for each sample."""


def check_memory(seen: Sequence[tuple[int, int]], commands_ns: int, period_s: float) -> list[Check]:
    """A check of (time, bytes) once a second; none where the device's processes cannot be seen, or not for long."""
    later = [(at_ns, held) for at_ns, held in seen if commands_ns and at_ns > commands_ns + WARM_S * S and held]
    if len(later) < 4 or later[-1][0] - later[0][0] < LEAST_S * S:
        return []
    quarter = max(1, len(later) // 4)
    first, last = min(held for _, held in later[:quarter]), min(held for _, held in later[-quarter:])
    passed_s = (later[-quarter][0] - later[0][0]) / S
    most = ROOM_BYTES + BYTES_PER_SAMPLE * passed_s / period_s
    grown = last - first
    text = f"its memory grows by at most 512 KiB and {BYTES_PER_SAMPLE:.0f} B a sample"
    per_sample = grown * period_s / passed_s
    wrong = [f"{grown / 1024:.0f} KiB in {passed_s:.0f} s, {per_sample:.0f} B a sample"] if grown > most else []
    return [check(text, wrong)]
