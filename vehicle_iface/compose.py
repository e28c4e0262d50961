"""Where concrete parts meet: from a profile and a few words to a loop, or to a simulated vehicle."""

import importlib
import importlib.util
import inspect
import math
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

from vehicle_iface import clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.bus.socketcan import SocketCanBus
from vehicle_iface.codec.database import BoundMessage, Role, VehicleDatabase
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.control.base import BehaviorConfig, ControllerBase, StopSteering
from vehicle_iface.control.pure_pursuit import PurePursuit, PurePursuitConfig
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Limits, Plausibility, Profile
from vehicle_iface.runtime.counts import Counts
from vehicle_iface.runtime.intake import TrajectoryIntake
from vehicle_iface.runtime.loop import Loop, Parts
from vehicle_iface.runtime.pilot import Pilot
from vehicle_iface.runtime.shadow import Shadow
from vehicle_iface.runtime.telemetry import TelemetryWriter, VehicleShape
from vehicle_iface.runtime.teller import Teller
from vehicle_iface.safety.deviation import DeviationMonitor
from vehicle_iface.safety.engagement import Engagement, EngagementTiming
from vehicle_iface.safety.feasible import refusal
from vehicle_iface.safety.gate import Gate, gate_channels
from vehicle_iface.safety.handover import Handover
from vehicle_iface.safety.outlet import Outgoing, Outlet
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.safety.stop import StopShape
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.tracker import Tracker
from vehicle_iface.trajectories.csv_file import load_csv
from vehicle_iface.trajectories.route import Route, RouteConfig
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.trajectories.source import TrajectorySource
from vehicle_iface.trajectory import Trajectory
from vehicle_iface.units import ns_from_s

UNBOUND_LSB = 1e-6
"""Step of a command field that the vehicle does not take or takes as a float: finer than any actuator."""


def open_bus(
    interface: str,
    channel: str,
    profile: Profile,
    *,
    hears: Iterable[BoundMessage],
    sends: Iterable[BoundMessage] = (),
    patience_ns: int | None = None,
) -> Bus:
    """The bus of that name, filtered to `hears`; `BusError` with the mending command when it cannot be used.

    `sends` are confirmed where the bus can tell; `patience_ns` is for a reader that lives on arrivals (see
    `SocketCanBus`).
    """
    can_ids = [message.can_id for message in hears]
    if interface == "socketcan":
        own_ids = [message.can_id for message in sends]
        return SocketCanBus(
            channel,
            can_ids,
            own_ids=own_ids,
            bitrate=profile.bus.bitrate,
            data_bitrate=profile.bus.data_bitrate or profile.bus.bitrate,
            patience_ns=patience_ns,
        )
    from vehicle_iface.bus.python_can import PythonCanBus  # 0.2 s to import, and SocketCAN does not need it

    return PythonCanBus(interface, channel, can_ids, bitrate=profile.bus.bitrate, is_fd=profile.bus.fd)


def build_controller(name: str, profile: Profile) -> ControllerBase:
    """`pure_pursuit`, or somebody's own as `FILE.py:CLASS` or `MODULE:CLASS`; `ConfigError` when there is none.

    An own class is called with the `BehaviorConfig`; one with a class method `from_profile(profile, behavior)`
    is made by that.
    """
    behavior = BehaviorConfig(
        safe_deceleration_mps2=profile.behavior.safe_deceleration_mps2,
        time_step_s=profile.behavior.time_step_s,
        stop_steering=StopSteering(profile.behavior.stop_steering),
    )
    if name == "pure_pursuit":
        return PurePursuit(PurePursuitConfig(wheelbase_m=profile.geometry.wheelbase_m), behavior=behavior)
    return _own_controller(name, profile, behavior)


def _own_controller(name: str, profile: Profile, behavior: BehaviorConfig) -> ControllerBase:
    """Somebody's class, loaded and called; whatever its code raises becomes a `ConfigError` with file and line."""
    place, _, class_name = name.rpartition(":")
    if not place:
        raise ConfigError(f"--controller {name}: must be pure_pursuit, FILE.py:CLASS or MODULE:CLASS")
    if place.endswith(".py") and not Path(place).is_file():
        raise ConfigError(f"--controller {name}: no such file {place}")
    try:
        module = _loaded_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
        kind: Any = getattr(module, class_name, None)
        if not inspect.isclass(kind):
            raise ConfigError(f"--controller {name}: there is no class {class_name} in {place}")
        make: Any = kind
        controller = make.from_profile(profile, behavior) if hasattr(kind, "from_profile") else make(behavior)
    except (ConfigError, KeyboardInterrupt):
        raise
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        line = error.lineno if isinstance(error, SyntaxError) else where.lineno
        file = error.filename if isinstance(error, SyntaxError) else where.filename
        raise ConfigError(f"--controller {name}: {type(error).__name__}: {error} ({file}:{line})") from error
    if not isinstance(controller, ControllerBase):
        raise ConfigError(f"--controller {name}: {class_name} is no ControllerBase")
    return controller


def build_route(name: str, profile: Profile) -> Route:
    """A route that the vehicle can drive; `ConfigError` when its wheels cannot turn so far."""
    geometry, limits, usual = profile.geometry, profile.limits, RouteConfig()
    route = make_route(
        name,
        RouteConfig(
            speed_mps=min(usual.speed_mps, limits.speed_max_mps),
            lateral_accel_mps2=min(usual.lateral_accel_mps2, limits.lateral_accel_mps2),
            accel_mps2=min(usual.accel_mps2, limits.accel_max_mps2),
            decel_mps2=min(usual.decel_mps2, -limits.accel_min_mps2),
            vehicle_width_m=geometry.width_m,
            wheelbase_m=geometry.wheelbase_m,
        ),
    )
    needed_rad = float(abs(route.front_wheel_angle_rad).max())
    if needed_rad > limits.front_wheel_angle_rad:
        raise ConfigError(
            f"route {name!r} needs front wheels at {needed_rad:.3f} rad: "
            f"{profile.name} allows {limits.front_wheel_angle_rad} rad"
        )
    text = refusal(route.to_trajectory(), limits, geometry.wheelbase_m)
    if text:
        raise ConfigError(f"route {name!r}: {text}")
    return route


def load_trajectory(file: str, profile: Profile) -> Trajectory:
    """The CSV file's trajectory; `ConfigError` when the vehicle cannot follow it, and what `load_csv` raises."""
    trajectory = load_csv(file)
    text = refusal(trajectory, profile.limits, profile.geometry.wheelbase_m)
    if text:
        raise ConfigError(f"{file}: {text}")
    return trajectory


def build_loop(
    *,
    database: VehicleDatabase,
    open_bus: Callable[[], Bus],
    controller: ControllerBase,
    source: TrajectorySource,
    telemetry: TelemetryWriter | None,
    armed: bool,
    now_ns: Callable[[], int] = clock.monotonic_ns,
    sleep_until: Callable[[int], None] = clock.sleep_until,
    live: Callable[[], None] = lambda: None,
) -> Loop:
    """A loop on an open bus; `BusError` when that cannot be opened. It calls `live` on its time grid."""
    profile, counts = database.profile, Counts()
    timing = profile.timing
    limits, plausibility = _comparable(profile)
    engagement = Engagement(
        EngagementTiming(
            fresh_ns=ns_from_s(timing.engage_fresh_s),
            stale_ns=ns_from_s(timing.state_stale_s),
            lost_ns=ns_from_s(timing.state_silent_s),
            give_up_ns=ns_from_s(timing.engage_give_up_s),
            end_ns=ns_from_s(timing.shutdown_s),
            steer_torque_nm=profile.limits.driver_steer_torque_nm,
        ),
        armed=armed,
    )
    pilot = Pilot(
        controller,
        Gate(
            gate_channels(limits, lambda field: _lsb(database, field)),
            limits,
            wheelbase_m=profile.geometry.wheelbase_m,
            stop=stop_shape(profile, controller.behavior),
        ),
        engagement,
        deviation=DeviationMonitor(profile.deviation, speed_max_mps=profile.limits.speed_max_mps),
        gear_change_speed_mps=profile.limits.gear_change_speed_mps,
        status_stale_ns=ns_from_s(timing.status_stale_s),
        budget_ns=ns_from_s(timing.controller_budget_s),
        answer_age_ns=ns_from_s(timing.answer_age_s),
        counts=counts,
        now_ns=now_ns,
    )
    return Loop(
        Parts(
            open_bus=open_bus,
            decoder=Decoder(database.received),
            tracker=build_tracker(database),
            pilot=pilot,
            engagement=engagement,
            encoder=Encoder(database.sent),
            plausibility=PlausibilityCheck(plausibility, wheelbase_m=profile.geometry.wheelbase_m),
            outlet=Outlet(_outgoing(database)),
            intake=TrajectoryIntake(
                source, controller, counts, limits=profile.limits, wheelbase_m=profile.geometry.wheelbase_m
            ),
            shadow=None if armed else _shadow(database),
            teller=Teller(telemetry, controller, counts),
            counts=counts,
            timing=timing,
            handover=Handover(ns_from_s(profile.handover.warning_s), holds=profile.handover.holds),
            names={(m.can_id, m.is_extended): m.name for m in (*database.received, *database.sent)},
            command_ids=frozenset((message.can_id, message.is_extended) for message in database.sent),
            body_message=database.body.name if database.body else None,
            report_message=database.report.name if database.report else None,
            report_ranges=database.report_ranges,
            now_ns=now_ns,
            sleep_until=sleep_until,
            live=live,
        )
    )


def stop_shape(profile: Profile, behavior: BehaviorConfig) -> StopShape:
    """How the vehicle is stopped: as hard as the controller was told, as smoothly as the profile says."""
    return StopShape(
        deceleration_mps2=behavior.safe_deceleration_mps2,
        time_step_s=behavior.time_step_s,
        jerk_mps3=profile.behavior.stop_jerk_mps3,
        ease_s=profile.behavior.stop_ease_s,
        hold_mps2=profile.behavior.hold_deceleration_mps2,
    )


def _comparable(profile: Profile) -> tuple[Limits, Plausibility]:
    """The limits without those that compare with a signal that the vehicle does not send: it is unknown, and not 0."""
    limits, plausibility, signals = profile.limits, profile.plausibility, profile.state.signals
    if signals.front_wheel_angle_rad is None:
        limits = msgspec.structs.replace(limits, front_wheel_deviation_rad=math.inf)
    if signals.front_wheel_angle_rad is None or signals.yaw_rate_radps is None:
        plausibility = msgspec.structs.replace(plausibility, yaw_rate_apart_radps=math.inf)
    if signals.yaw_rate_radps is None:
        plausibility = msgspec.structs.replace(plausibility, heading_apart_rad=math.inf)
    return limits, plausibility


def _outgoing(database: VehicleDatabase) -> Iterator[Outgoing]:
    """All that may ever leave, and how often."""
    timing = database.profile.timing
    periods_s = {
        Role.COMMAND: timing.command_period_s,
        Role.BODY: timing.body_period_s,
        Role.REPORT: timing.report_period_s,
    }
    for message in database.sent:
        period_ns = ns_from_s(periods_s[message.role])
        yield Outgoing(message.can_id, message.is_extended, message.is_fd, message.length, period_ns)


def _shadow(database: VehicleDatabase) -> Shadow:
    timing = database.profile.timing
    together_ns = ns_from_s(timing.command_period_s / 2)
    return Shadow(database.commands, together_ns=together_ns, longest_ns=ns_from_s(timing.state_stale_s))


def build_tracker(database: VehicleDatabase) -> Tracker:
    """A tracker for the profile's sample."""
    return Tracker(
        sample={message.name: message.fields for message in database.sample},
        others={message.name: message.fields for message in (database.status, *database.extra)},
        frames=database.frames or {0: database.profile.state.frame_id},
        modes={int(mode): mode for mode in VehicleMode},
        gears={int(gear): gear for gear in Gear},
        window_ns=_window_ns(database),
        stale_ns=ns_from_s(database.profile.timing.status_stale_s),
    )


def vehicle_shape(profile: Profile) -> VehicleShape:
    """What the viewer draws the vehicle as."""
    geometry = profile.geometry
    return VehicleShape(
        wheelbase_m=geometry.wheelbase_m,
        length_m=geometry.length_m,
        width_m=geometry.width_m,
        height_m=geometry.height_m,
        rear_overhang_m=geometry.rear_overhang_m,
        track_m=geometry.track_m,
        wheel_radius_m=geometry.wheel_radius_m,
    )


def _window_ns(database: VehicleDatabase) -> int:
    """The messages of one sample come within this: less than half a round of their counter, so rounds never mix."""
    timing = database.profile.timing
    half_rounds_s = (
        0.5 * message.protection.counter_states * timing.sample_period_s
        for message in database.sample
        if message.protection is not None
    )
    return ns_from_s(min((timing.state_stale_s, *half_rounds_s)))


def _lsb(database: VehicleDatabase, field: str) -> float:
    return database.resolutions.get(field, 0.0) or UNBOUND_LSB


def _loaded_file(path: Path) -> ModuleType:
    """The module in a file, under a name that no other module has; its folder's modules can be imported from it."""
    name = f"vehicle_iface_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"--controller {path}: cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.append(str(path.resolve().parent))
    spec.loader.exec_module(module)
    return module
