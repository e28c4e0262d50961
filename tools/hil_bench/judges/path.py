"""How far the vehicle is from its route."""

import math
from collections.abc import Sequence

from vehicle_bus_contract.judge import lateral_errors_m
from vehicle_bus_contract.reference import AUTONOMOUS

from hil_bench import figures
from hil_bench.case import Case
from hil_bench.expect import check
from hil_bench.result import Check, Path2D, Verdict
from hil_bench.routes import Route
from hil_bench.vehicle import Instant

THINNED_M = 0.2


def check_path(case: Case, route: Route, history: Sequence[Instant]) -> tuple[list[Check], Path2D]:
    """Lateral distance of the vehicle from its route, by the plant's true position."""
    moving = [i for i in history if i.mode == AUTONOMOUS]
    drawn = figures.draw_path(route, moving)
    if case.max_path_error_m is None:
        return [], drawn
    if not moving:
        return [check("stays near its path", ["it was never driven"])], drawn
    errors = lateral_errors_m(moving, *_thin_out(route))  # type: ignore[arg-type]
    worst = max(errors)
    verdict = Verdict.PASS if worst <= case.max_path_error_m else Verdict.FAIL
    limit = case.max_path_error_m
    text = "stays near its path"
    return [Check(text=text, verdict=verdict, measured=round(worst, 3), limit=limit, unit="m")], drawn


def _thin_out(route: Route) -> tuple[list[float], list[float]]:
    """Points of the route at least `THINNED_M` apart; no corner of a path is sharper than that."""
    x_m, y_m = [route.x_m[0]], [route.y_m[0]]
    for x, y in zip(route.x_m, route.y_m, strict=True):
        if math.hypot(x - x_m[-1], y - y_m[-1]) >= THINNED_M:
            x_m.append(x)
            y_m.append(y)
    return [*x_m, route.x_m[-1]], [*y_m, route.y_m[-1]]
