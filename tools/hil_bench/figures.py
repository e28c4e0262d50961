"""What the report draws and counts of a case: distributions, the path, counts and the time line."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import Frame

from hil_bench.case import Case
from hil_bench.expect import Observation
from hil_bench.result import Distribution, Event, EventKind, Path2D
from hil_bench.rig import Rig
from hil_bench.routes import Route
from hil_bench.vehicle import Instant

PLOT_POINTS = 300


def draw_path(route: Route, driven: Sequence[Instant]) -> Path2D:
    """The route and where the vehicle went."""
    few = driven[:: max(1, len(driven) // PLOT_POINTS)]
    points = range(0, len(route.x_m), max(1, len(route.x_m) // PLOT_POINTS))
    return Path2D(
        wanted_x_m=[route.x_m[i] for i in points],
        wanted_y_m=[route.y_m[i] for i in points],
        driven_x_m=[round(i.x_m, 3) for i in few],
        driven_y_m=[round(i.y_m, 3) for i in few],
    )


def describe_distribution(name: str, values: Sequence[float], limit: float | None = None) -> Distribution:
    """Quantiles and histogram of measurements in ms."""
    ordered = sorted(values)

    def at(share: float) -> float:
        return round(ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)], 4)

    top = max(1e-3, ordered[-1])
    width = next(w for w in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 1e3, 1e6) if top / w <= 60)
    bins = math.floor(top / width) + 1
    numbers = [0] * bins
    for value in ordered:
        numbers[min(bins - 1, int(value / width))] += 1
    edges = [round(width * i, 6) for i in range(bins + 1)]
    return Distribution(
        name=name,
        unit="ms",
        count=len(ordered),
        p50=at(0.5),
        p95=at(0.95),
        p99=at(0.99),
        max=round(ordered[-1], 4),
        edges=edges,
        counts=numbers,
        limit=limit,
    )


def count(record: Record, rig: Rig, frames: Sequence[Frame]) -> dict[str, int]:
    """How many frames, samples, commands and losses there were."""
    buses = rig.wire.buses if len(rig.wire.buses) > 1 else ()
    on_each = Counter(rx.frame.bus for rx in rig.received)
    return {
        "frames on the bus": len(rig.received),
        **{f"frames on the bus {name}": on_each[number] for number, name in enumerate(buses)},
        "frames of the device": len(frames),
        "complete samples": len(record.samples),
        "command pairs": len(record.pairs),
        "answered samples": len(record.answers),
        "unanswered samples": len(record.unanswered),
        "doubled commands": len(record.doubled),
        "stops for lack of state": record.stale_stops,
        "counter gaps": sum(text.split()[0] in rig.wire.of_device for text in record.counter_gaps),
        "late ticks of the bench": len(rig.late),
        "frames the bench could not send": rig.bus.rejected,
    }


def order_timeline(case: Case, rig: Rig, observed: Observation, events: Iterable[Event]) -> list[Event]:
    """All events in order, each once."""
    own = list(rig.events)
    if observed.inject_ns and case.inject is not None:
        own.append(Event(at_s=observed.at_s(observed.inject_ns), kind=EventKind.INJECTION, text=case.injected))
        own.append(Event(at_s=observed.at_s(observed.end_ns), kind=EventKind.END_OF_INJECTION, text="injection over"))
    unique = {(event.at_s, event.kind, event.text): event for event in (*own, *events)}
    return sorted(unique.values(), key=lambda event: event.at_s)
