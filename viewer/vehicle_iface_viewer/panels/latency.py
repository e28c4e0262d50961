"""The histogram of the latency from the arrival of a sample to the sending of its command."""

from __future__ import annotations

import numpy as np

from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.recent import RecentSnapshots

_SPAN_NS = 60 * NS_PER_S
_EDGES_MS = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, float("inf"))


def latency_html(recent: RecentSnapshots) -> str:
    """Return p50, p95, p99 and maximum, and the share of each range, over the last minute."""
    rows = recent.between(recent.newest_ns - _SPAN_NS, recent.newest_ns)
    rows = rows[rows["sent"]]
    if not len(rows):
        return '<div class="vi-note" id="latency">no command was sent in the last seconds</div>'
    latencies_ms = rows["latency_ns"] / NS_PER_MS
    span_s = (recent.newest_ns - int(rows["published_ns"][0])) / NS_PER_S
    levels = (("p50", 50.0), ("p95", 95.0), ("p99", 99.0), ("max", 100.0))
    figures = "".join(
        f"<div><span>{name}</span><span>{np.percentile(latencies_ms, level):.2f} ms</span></div>"
        for name, level in levels
    )
    counts, _ = np.histogram(latencies_ms, _EDGES_MS)
    shares = counts / len(rows)
    bars = "".join(
        f'<div class="vi-bar"><span>{_range(low, high)}</span><span><u style="width:{share * 100:.1f}%"></u></span>'
        f"<span>{count}</span></div>"
        for low, high, share, count in zip(_EDGES_MS[:-1], _EDGES_MS[1:], shares, counts, strict=True)
    )
    note = f"{len(rows)} commands of the last {span_s:.0f} s, from the last frame of a sample to the command"
    return f'<div id="latency"><div class="vi-note">{note}</div><div class="vi-values">{figures}</div>{bars}</div>'


def _range(low_ms: float, high_ms: float) -> str:
    return f"{low_ms:g} … {high_ms:g} ms" if high_ms < float("inf") else f"above {low_ms:g} ms"
