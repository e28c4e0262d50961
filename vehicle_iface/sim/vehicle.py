"""The simulated vehicle as a node on the bus: frames in, frames out, no clock, no socket.

It keeps the bus contract: one sample each 10 ms, one status each 20 ms on an absolute grid, obedience to
intact commands while AUTONOMOUS, and a watchdog that trusts nobody.

Choices that the contract leaves open:

- It starts READY, in PARK, at standstill, so that a commander can engage, shift and drive with nobody in it.
- Where commands have no gear it starts in DRIVE, and a command at standstill puts in the gear of its direction:
  the sign of its speed or, where that is 0 and it is no stop, of its acceleration.
- While the driver does something it does not become AUTONOMOUS, however many pairs come.
- Out of FAULT and EMERGENCY_STOP only the driver's reset leads, to MANUAL; from there to READY only the
  driver's ready, with feet and hands off.
- Pairs count from becoming READY on; what came before does not.
- In MANUAL and READY the driver's pedals and torque move it; nobody on a pedal means that it rolls on.
- EMERGENCY_STOP brakes harder than FAULT; both straighten the wheels and hold at standstill.
- Commands age by their frame's stamp where there is one: a vehicle that ran late itself blames nobody.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.engagement import PAIRS_TO_ENGAGE, TRANSITIONS, CommandWatch, Event
from vehicle_iface.sim.model import DIRECTION, Actuation, Bicycle, BicycleParameters, BicycleState
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.units import NS_PER_MS, s_from_ns

TORQUE_LIMIT_NM = 12.7
"""What the status message can express, to either side."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One intact command message."""

    kind: str
    """The message's name."""
    values: Mapping[str, float | int]
    """By the field's name: `enable`, `accel_mps2`, `gear_request`, …"""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleReport:
    """Everything that the vehicle can say at one instant, under the names that profiles use."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    accel_mps2: float
    yaw_rate_radps: float
    lateral_speed_mps: float
    front_wheel_angle_rad: float
    rear_wheel_angle_rad: float
    pose_frame: int
    """The frame of reference's number on the bus."""
    pose_valid: bool
    mode: VehicleMode
    gear: Gear
    driver_brake: bool
    driver_throttle: bool
    driver_steer_torque_nm: float
    fault_code: int


class Wire(Protocol):
    """Between the vehicle's fields and the bytes on its bus."""

    commands: tuple[str, ...]
    """Messages that a commander must keep sending."""
    sample: tuple[str, ...]
    """Messages of one state sample, in the order in which they are sent."""
    status: tuple[str, ...]
    """Messages that carry the status."""
    frame_ids: Mapping[str, int]
    """Frames of reference that it can express, and their numbers."""
    requests_gear: bool
    """Whether the commands can say which gear is wanted."""

    def is_command(self, frame: CanFrame) -> bool:
        """Whether the frame claims to be one of `commands`."""
        ...

    def is_known(self, frame: CanFrame) -> bool:
        """Whether the frame has an identifier of this vehicle's profile."""
        ...

    def read(self, frame: CanFrame) -> Heard | None:
        """The frame's content; None when it is damaged, out of order or impossible."""
        ...

    def write(self, message: str, report: VehicleReport) -> CanFrame:
        """The next frame of `message`; its counter steps."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationParameters:
    """How the vehicle behaves on its bus. Raises `InvalidValueError` for what is not positive."""

    sample_period_ns: int = 10 * NS_PER_MS
    status_every: int = 2
    """One status with every so many samples."""
    longest_step_ns: int = 100 * NS_PER_MS
    """After a longer pause the vehicle has moved only for so long."""
    gear_change_speed_mps: float = 0.5
    """Above it another gear is refused."""
    override_torque_nm: float = 3.0
    fault_deceleration_mps2: float = 3.0
    emergency_deceleration_mps2: float = 6.0
    driver_deceleration_mps2: float = 4.0
    driver_acceleration_mps2: float = 1.5
    driver_steering_rad_per_nm: float = 0.02
    """Road-wheel angle that a driver's torque holds; let go, the wheels straighten."""
    fault_code_commands_lost: int = 1

    def __post_init__(self) -> None:
        for name in self.__slots__:
            checks.positive(name, getattr(self, name))


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """What the person in the vehicle does."""

    brake: bool = False
    throttle: bool = False
    steer_torque_nm: float = 0.0
    """Positive to the left, in steps of 0.1 N·m as on the bus."""


class SimulatedVehicle:
    """One vehicle, from its pedals to its frames."""

    def __init__(
        self,
        wire: Wire,
        *,
        start_ns: int,
        start: BicycleState | None = None,
        car: BicycleParameters | None = None,
        parameters: SimulationParameters | None = None,
        mode: VehicleMode = VehicleMode.READY,
        gear: Gear | None = None,
        frame_id: str = "map",
    ) -> None:
        """Its first sample is due at `start_ns`.

        Without a `gear` it is in PARK, or in DRIVE where commands have none.
        """
        self.parameters = parameters if parameters is not None else SimulationParameters()
        self.mode = mode
        self.gear = gear if gear is not None else Gear.PARK if wire.requests_gear else Gear.DRIVE
        self.fault_code = 0
        self.driver = Driver()
        self.frame_id = frame_id
        if frame_id not in wire.frame_ids:
            allowed = ", ".join(wire.frame_ids)
            raise InvalidValueError(f"frame_id = {frame_id!r}: must be one of {allowed}")
        self.pose_valid = True
        self.frozen = False
        """Whether the samples repeat the values of the moment when this was set, with live counters."""
        self.muted: set[str] = set()
        """Messages that are lost on their way: their counters step, nothing leaves."""
        self.counters: Counter[str] = Counter()
        """What happened how often; `other` are frames that are none of the profile's."""
        self._wire = wire
        self._car = Bicycle(car, start)
        self._watch = CommandWatch(wire.commands)
        self._wish: dict[str, float | int] = {}
        self._shown = self._car.state
        self._corrupt: Counter[str] = Counter()
        self._start_ns = start_ns
        self._tick = -1

    @property
    def state(self) -> BicycleState:
        """Where it truly is and what it truly does."""
        return self._car.state

    @property
    def messages(self) -> tuple[str, ...]:
        """Everything that it sends, status first: its angle belongs to the sample sent after it."""
        return (*self._wire.status, *self._wire.sample)

    @property
    def sample(self) -> tuple[str, ...]:
        """The messages of one state sample."""
        return self._wire.sample

    @property
    def frame_ids(self) -> tuple[str, ...]:
        """Frames of reference that its bus has a number for."""
        return tuple(self._wire.frame_ids)

    @property
    def pairs(self) -> int:
        """Consecutive good command pairs so far."""
        return self._watch.pairs

    @property
    def next_due_ns(self) -> int:
        """When `advance` has something to do: the next sample, or the watchdog before it."""
        tick_ns = self._start_ns + (self._tick + 1) * self.parameters.sample_period_ns
        expires_ns = self._watch.expires_ns
        if self.mode is VehicleMode.AUTONOMOUS and expires_ns is not None:
            return min(tick_ns, expires_ns)
        return tick_ns

    def receive(self, frame: CanFrame, now_ns: int) -> None:
        """Take one frame from the bus; whatever is in it, this returns."""
        if not self._wire.is_command(frame):
            self.counters["other"] += not self._wire.is_known(frame)
            return
        seen_ns = min(frame.stamp_ns, now_ns) if frame.stamp_ns else now_ns
        self._check_watchdog(seen_ns)
        heard = self._wire.read(frame)
        if heard is None:
            self.counters["commands_dropped"] += 1
            self._watch.break_row()
            return
        self.counters["commands_intact"] += 1
        self._obey(heard, seen_ns)

    def advance(self, now_ns: int) -> list[CanFrame]:
        """Move on to `now_ns`; the frames that are due, at most one sample and one status.

        The grid is absolute. Ticks that were missed are counted as overruns and not made up for.
        """
        self._check_watchdog(now_ns)
        period_ns = self.parameters.sample_period_ns
        tick = (now_ns - self._start_ns) // period_ns
        if tick <= self._tick:
            return []
        passed, first = tick - self._tick, self._tick < 0
        self._tick = tick
        self.counters["overruns"] += passed - 1 if not first else tick
        if not first:
            self._move(min(passed * period_ns, self.parameters.longest_step_ns))
        every = self.parameters.status_every
        status_due = first or tick // every != (tick - passed) // every
        return self._frames(self.messages if status_due else self._wire.sample)

    def excuse(self, pause_ns: int) -> None:
        """The vehicle itself stood still for so long, as no real one does: its watchdog did not run meanwhile."""
        self._watch.excuse(pause_ns)
        self.counters["pauses"] += 1

    def drive_by(self, driver: Driver) -> None:
        """The driver's feet and hands from now on.

        Raises `InvalidValueError` for a torque that is not finite or beyond ±`TORQUE_LIMIT_NM`.
        """
        torque_nm = round(checks.finite("steer_torque_nm", driver.steer_torque_nm), 1) + 0.0
        if abs(torque_nm) > TORQUE_LIMIT_NM:
            raise InvalidValueError(f"steer_torque_nm = {torque_nm}: must be within ±{TORQUE_LIMIT_NM}")
        self.driver = replace(driver, steer_torque_nm=torque_nm)
        if self.driver_acts:
            self._watch.break_row()
            self._happen(Event.OVERRIDE)

    @property
    def driver_acts(self) -> bool:
        """Whether the driver does enough to take over."""
        d = self.driver
        return d.brake or d.throttle or abs(d.steer_torque_nm) >= self.parameters.override_torque_nm

    def make_ready(self) -> bool:
        """The driver hands over: MANUAL → READY, with feet and hands off; whether it is READY now."""
        if not self.driver_acts:
            self._happen(Event.MADE_READY)
        return self.mode is VehicleMode.READY

    def reset(self) -> bool:
        """The driver acknowledges a FAULT or EMERGENCY_STOP: → MANUAL; whether there was one."""
        if not self._happen(Event.RESET):
            return False
        self.fault_code = 0
        return True

    def break_down(self, fault_code: int) -> None:
        """Something of the vehicle's own broke (1..255): → FAULT."""
        if not 1 <= checks.integer("fault_code", fault_code) <= 255:
            raise InvalidValueError(f"fault_code = {fault_code}: must be 1..255")
        self.fault_code = fault_code
        self._happen(Event.FAULT)

    def press_emergency_stop(self) -> None:
        """The red button: → EMERGENCY_STOP from everywhere."""
        self._happen(Event.EMERGENCY_STOP)

    def shift(self, gear: Gear) -> bool:
        """Put `gear` in; refused (false) above the speed for it."""
        if gear in (Gear.NO_REQUEST, self.gear):
            return True
        if abs(self.state.speed_mps) > self.parameters.gear_change_speed_mps:
            self.counters["gear_refusals"] += 1
            return False
        self.gear = gear
        return True

    def jump(self, dx_m: float, dy_m: float) -> None:
        """Be somewhere else at once, as a pose source does that lost its way."""
        s = self._car.state
        self._car.state = replace(s, x_m=s.x_m + dx_m, y_m=s.y_m + dy_m)

    def corrupt(self, message: str, frames: int) -> None:
        """Damage the next `frames` frames of `message`."""
        self._corrupt[message] = frames

    def skip_counter(self, message: str, steps: int) -> None:
        """As if `steps` frames of `message` had been lost before its next one."""
        report = self._report()
        for _ in range(steps):
            self._wire.write(message, report)

    def _check_watchdog(self, now_ns: int) -> None:
        expires_ns = self._watch.expires_ns
        if expires_ns is not None and now_ns >= expires_ns and self._happen(Event.COMMANDS_LOST):
            self.fault_code = self.parameters.fault_code_commands_lost
            self.counters["commands_lost"] += 1

    def _obey(self, heard: Heard, seen_ns: int) -> None:
        """Take an intact command: it may engage, let go, or be followed."""
        enabled = bool(heard.values.get("enable", True))
        self._watch.note(heard.kind, enabled=enabled, seen_ns=seen_ns)
        self._wish.update(heard.values)
        if not enabled:
            self._happen(Event.LET_GO)
        elif self.driver_acts:
            self._watch.break_row()
        elif self._watch.pairs >= PAIRS_TO_ENGAGE:
            self._happen(Event.PAIRS_RECEIVED)
        if self.mode is VehicleMode.AUTONOMOUS:
            if "gear_request" in heard.values:
                self.shift(Gear(int(heard.values["gear_request"])))
            elif not self._wire.requests_gear and self.state.speed_mps == 0.0:
                self.shift(self._gear_of_direction())

    def _gear_of_direction(self) -> Gear:
        """Which gear the newest command drives in; NO_REQUEST where it has no direction."""
        direction = self._wish.get("speed_mps", 0.0)
        if direction == 0.0 and not self._wish.get("safe_stop", False):
            direction = self._wish.get("accel_mps2", 0.0)
        if direction == 0.0:
            return Gear.NO_REQUEST
        return Gear.DRIVE if direction > 0.0 else Gear.REVERSE

    def _happen(self, event: Event) -> bool:
        """Whether the event changed the mode."""
        mode = TRANSITIONS.get((self.mode, event))
        if mode is None:
            return False
        self.mode = mode
        self._watch.break_row()
        self.counters[f"to_{mode.name.lower()}"] += 1
        return True

    def _move(self, dt_ns: int) -> None:
        self._car.step(s_from_ns(dt_ns), self._actuation())
        if not self.frozen:
            self._shown = self._car.state

    def _actuation(self) -> Actuation:
        """Who drives decides what engine, brakes and steering are asked for."""
        p = self.parameters
        if self.mode is VehicleMode.AUTONOMOUS:
            return self._as_commanded()
        if self.mode is VehicleMode.FAULT:
            return self._braking(p.fault_deceleration_mps2)
        if self.mode is VehicleMode.EMERGENCY_STOP:
            return self._braking(p.emergency_deceleration_mps2)
        return self._as_driven()

    def _as_commanded(self) -> Actuation:
        wish = self._wish
        return Actuation(
            gear=self.gear,
            accel_mps2=wish.get("accel_mps2", 0.0),
            front_wheel_angle_rad=wish.get("front_wheel_angle_rad", 0.0),
            rear_wheel_angle_rad=wish.get("rear_wheel_angle_rad", 0.0),
            hold=bool(wish.get("safe_stop", False)),
        )

    def _as_driven(self) -> Actuation:
        p, d = self.parameters, self.driver
        front_rad = d.steer_torque_nm * p.driver_steering_rad_per_nm
        if d.brake:
            return replace(self._braking(p.driver_deceleration_mps2), front_wheel_angle_rad=front_rad)
        accel_mps2 = p.driver_acceleration_mps2 * DIRECTION[self.gear] if d.throttle else None
        return Actuation(gear=self.gear, accel_mps2=accel_mps2, front_wheel_angle_rad=front_rad)

    def _braking(self, deceleration_mps2: float) -> Actuation:
        """Against the motion, wheels straight; at least as hard as the driver brakes."""
        if self.driver.brake:
            deceleration_mps2 = max(deceleration_mps2, self.parameters.driver_deceleration_mps2)
        accel_mps2 = -math.copysign(deceleration_mps2, self.state.speed_mps)
        return Actuation(gear=self.gear, accel_mps2=accel_mps2, hold=True)

    def _frames(self, messages: Sequence[str]) -> list[CanFrame]:
        report = self._report()
        frames = []
        for message in messages:
            frame = self._wire.write(message, report)
            if self._corrupt[message] > 0:
                self._corrupt[message] -= 1
                frame = _damaged(frame)
            if message not in self.muted:
                frames.append(frame)
        self.counters["frames"] += len(frames)
        return frames

    def _report(self) -> VehicleReport:
        s, d = self._shown, self.driver
        return VehicleReport(
            x_m=s.x_m,
            y_m=s.y_m,
            heading_rad=s.heading_rad,
            speed_mps=s.speed_mps,
            accel_mps2=s.accel_mps2,
            yaw_rate_radps=s.yaw_rate_radps,
            lateral_speed_mps=s.lateral_speed_mps,
            front_wheel_angle_rad=s.front_wheel_angle_rad,
            rear_wheel_angle_rad=s.rear_wheel_angle_rad,
            pose_frame=self._wire.frame_ids[self.frame_id],
            pose_valid=self.pose_valid,
            mode=self.mode,
            gear=self.gear,
            driver_brake=d.brake,
            driver_throttle=d.throttle,
            driver_steer_torque_nm=d.steer_torque_nm,
            fault_code=self.fault_code,
        )


def _damaged(frame: CanFrame) -> CanFrame:
    """The frame with bits of its first byte turned over: where the checksum is, or under it."""
    return frame._replace(data=bytes((frame.data[0] ^ 0x5A, *frame.data[1:])))
