"""What the cases that measure thresholds share: the profile's numbers, tolerances, routes and how a sequence ends."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from vehicle_bus_contract.reference import S

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.cases.common import ANY
from hil_bench.peer.infer import WINDOW_NS
from hil_bench.peer.wire import PeerWire
from hil_bench.routes import Route
from hil_bench.steps import Step
from hil_bench.wire import Wire

ANYTHING = frozenset({*ANY, "command", "dynamics", "brakes", "counter", "burst"})
"""What the injections of a sequence may cause besides what is measured."""
FASTEST_SHARE = 0.9
"""Of the profile's speed limit, as `applicable.adapt` has it."""
STOP_SHARE = 0.4
"""Of the safe deceleration: from there on a command without SAFE_STOP is taken as a stop."""
JITTER_S = 0.006
SLOW_MPS, USUAL_MPS, FAST_MPS = 1.0, 2.5, 12.0
BEND_M = 25.0


@dataclass(frozen=True)
class Numbers:
    """The numbers of a vehicle's profile."""

    wire: Wire

    def find(self, key: str) -> float | None:
        """`table.key` of the profile; None where it has none."""
        found: Any = self.wire.profile
        for part in key.split("."):
            if not isinstance(found, Mapping) or part not in found:
                return None
            found = found[part]
        return float(found) if isinstance(found, int | float) else None

    def __getitem__(self, key: str) -> float:
        """Raises `KeyError` where the profile has none."""
        found = self.find(key)
        if found is None:
            raise KeyError(key)
        return found

    def lacks(self, *keys: str) -> str:
        """Why a case about these keys does not apply; empty if the profile has them all."""
        missing = [key for key in keys if self.find(key) is None]
        return f"the profile has no {' and no '.join(missing)}" if missing else ""

    def or_else(self, key: str, default: float) -> float:
        """The number, or a default."""
        found = self.find(key)
        return default if found is None else found

    def true_mps(self, at_mps: float, top_mps: float) -> float:
        """A speed of a case as this vehicle drives it, on a route whose greatest speed is `top_mps`."""
        fastest_mps = FASTEST_SHARE * self["limits.speed_max_mps"]
        return at_mps * min(self.wire.speed_share, fastest_mps / top_mps)

    @property
    def period_s(self) -> float:
        """The longer one of sample and command."""
        return max(self.wire.period_s, self.wire.command_period_s)

    @property
    def late_s(self) -> float:
        """A device acts by its next command, which may be a period and a half away."""
        return 1.5 * self.period_s + JITTER_S

    @property
    def inferred_s(self) -> float:
        """Until a stop without a signal of its own brakes so hard that it is one."""
        if self.wire.has_stop_signal:
            return 0.0
        return STOP_SHARE * self["behavior.safe_deceleration_mps2"] / self.or_else("behavior.stop_jerk_mps3", 20.0)

    @property
    def begins_s(self) -> float:
        """The longest time from the first command of a stop, after a pause, to the one that is taken as a stop."""
        wire = self.wire
        if wire.has_stop_signal or not isinstance(wire, PeerWire):
            return 0.0
        # A speed is taken as a stop by its slope, in which the pause counts until it is older than the window.
        slow_s = wire.hold_s(*wire.opposed) if wire.commands_acceleration else WINDOW_NS / S
        return self.inferred_s + slow_s + wire.command_period_s + JITTER_S

    @property
    def least_fall(self) -> float:
        """How much less the first command of a stop asks for, m/s² or m/s: half of the profile's step."""
        safe_mps2, period_s = self["behavior.safe_deceleration_mps2"], self.wire.command_period_s
        if not self.wire.commands_acceleration:
            return 0.5 * safe_mps2 * period_s
        return 0.5 * min(STOP_SHARE * safe_mps2, self.or_else("behavior.stop_jerk_mps3", 20.0) * period_s)


def sequence_case(
    *,
    name: str,
    fault: str,
    tags: tuple[str, ...],
    proves: str,
    injected: str,
    route: Callable[[], Route],
    steps: Iterable[Step],
    at_mps: float = USUAL_MPS,
    lacks: str = "",
    allow: frozenset[str] = ANYTHING,
) -> Case:
    """Steps in one drive, between which the device is armed again wherever it has stopped."""
    return Case(
        name=name,
        fault=fault,
        tags=tags,
        proves=proves,
        injected=injected,
        route=route,
        at_mps=at_mps,
        steps=tuple(steps),
        lacks=lacks,
        then=Then.REARM,
        needs=(Need.REARM,),
        allow=allow,
        answers_in_time=False,
    )


def straight(length_m: float = 600.0, speed_mps: float = USUAL_MPS + 1.0) -> Callable[[], Route]:
    """Along x, forwards, with time to be armed again often."""
    name = f"patient-straight-{length_m:.0f}-m-at-{speed_mps:.0f}"
    return lambda: routes.route(name, [(length_m, 0.0)], speed_mps, slack=6.0)


def backwards(length_m: float = 400.0, speed_mps: float = USUAL_MPS) -> Callable[[], Route]:
    """Along −x, in reverse."""
    name = f"backwards-{length_m:.0f}-m-at-{speed_mps:.0f}"
    return lambda: routes.route(name, [(-length_m, 0.0)], speed_mps, slack=6.0)


def bend(curvature_per_m: float = 1.0 / BEND_M, speed_mps: float = USUAL_MPS + 1.0) -> Callable[[], Route]:
    """A wide bend to the left, several times around."""
    return lambda: routes.route("patient-bend", [(450.0, curvature_per_m)], speed_mps, slack=6.0)
