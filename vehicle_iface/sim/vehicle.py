"""The simulated vehicle as a node on the bus: frames in, frames out, without clock and socket.

It implements the bus contract: each message at its period on an absolute grid, intact commands followed while
AUTONOMOUS, and a watchdog.

Choices that the contract leaves open:

- It starts READY, in PARK, at standstill, so that a commander can engage, shift and drive without a driver.
- Where commands have no gear it starts in DRIVE, and a command at standstill puts in the gear of its direction:
  the sign of its speed or, where that is 0 and it is no stop, of its acceleration.
- It does not become AUTONOMOUS while the driver brakes, accelerates or steers.
- Only the driver's reset leads out of FAULT and EMERGENCY_STOP, to MANUAL; only the driver's ready leads from there to
  READY, with feet and hands off.
- Only command pairs received in READY count. `demands` has its further requirements.
- In MANUAL and READY the driver's pedals and torque move it; without a pedal it rolls on.
- EMERGENCY_STOP brakes harder than FAULT; both straighten the wheels and hold at standstill.
- The age of a command is that of its frame's stamp where there is one, so a late simulation loses none.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from vehicle_iface import checks
from vehicle_iface.errors import InvalidValueError
from vehicle_iface.frame import CanFrame
from vehicle_iface.sim.actuation import choose_actuation, find_needed_gear
from vehicle_iface.sim.command_forms import Interpret
from vehicle_iface.sim.engagement import PAIRS_TO_ENGAGE, TRANSITIONS, CommandWatch, Event
from vehicle_iface.sim.frame_faults import FrameFaults
from vehicle_iface.sim.model import Bicycle, BicycleParameters, BicycleState
from vehicle_iface.sim.parameters import TORQUE_LIMIT_NM, Driver, SimulationParameters
from vehicle_iface.sim.report import ReceivedMessage, VehicleReport, Wire
from vehicle_iface.sim.schedule import SendSchedule
from vehicle_iface.sim.signal_faults import SignalFault, apply_faults
from vehicle_iface.status import Gear, VehicleMode
from vehicle_iface.units import s_from_ns


class SimulatedVehicle:
    """A vehicle that turns driver inputs and commands into frames."""

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
        interpret: Interpret | None = None,
    ) -> None:
        """The first sample is due at `start_ns`. `interpret` converts commands to acceleration and angle.

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
        self.signal_faults: dict[str, SignalFault] = {}
        """Faults of sensors, by the field that they measure."""
        self.frame_faults = FrameFaults()
        self.counters: Counter[str] = Counter()
        """Number of events by kind; `other` counts frames that are not in the profile."""
        self._wire = wire
        self._car = Bicycle(car, start)
        self._watch = CommandWatch(wire.command_periods_ns)
        self._requested: dict[str, float | int] = {}
        self._interpret = interpret
        self._reported = self._car.state
        self._schedule = SendSchedule(wire.periods_ns, start_ns)
        self._moved_ns: int | None = None
        """Time up to which the motion is simulated; None before the first message."""

    @property
    def state(self) -> BicycleState:
        """True state, without sensor faults."""
        return self._car.state

    @property
    def messages(self) -> tuple[str, ...]:
        """All messages that it sends, in this order."""
        return tuple(self._wire.periods_ns)

    @property
    def sample(self) -> tuple[str, ...]:
        """Messages of one state sample."""
        return self._wire.sample

    @property
    def frame_ids(self) -> tuple[str, ...]:
        """Frames of reference that its bus has a number for."""
        return tuple(self._wire.frame_ids)

    @property
    def pairs(self) -> int:
        """Number of consecutive intact command pairs so far."""
        return self._watch.pairs

    @property
    def next_due_ns(self) -> int:
        """Time of the next call of `advance`: the next message, or the watchdog before it."""
        due_ns, expires_ns = self._schedule.next_due_ns, self._expires_ns
        if self.mode is VehicleMode.AUTONOMOUS and expires_ns is not None:
            return min(due_ns, expires_ns)
        return due_ns

    def receive(self, frame: CanFrame, now_ns: int) -> None:
        """Handle one frame from the bus; never raises for any frame."""
        name = self._wire.find_name(frame)
        if name is None:
            self.counters["other"] += not self._wire.is_known(frame)
            return
        is_command = name in self._wire.command_periods_ns
        seen_ns = min(frame.stamp_ns, now_ns) if frame.stamp_ns else now_ns
        self._check_watchdog(seen_ns)
        received = self._wire.read(frame)
        if received is None:
            self.counters["commands_dropped" if is_command else "messages_dropped"] += 1
            if is_command:
                self._watch.reset_streak()
            return
        if self._wire.demands.note(name, received.signals, seen_ns):
            self._watch.reset_streak()
            self._apply(Event.RELEASED)
        if is_command:
            self.counters["commands_intact"] += 1
            self._follow_command(received, seen_ns)

    def advance(self, now_ns: int) -> list[CanFrame]:
        """Advance to `now_ns`; return the frames that are due, at most one of each message.

        The grid is absolute. Instants that were missed are counted as overruns and not made up for.
        """
        self._check_watchdog(now_ns)
        due = self._schedule.take_due(now_ns)
        if due is None:
            return []
        self.counters["overruns"] += due.missed
        if self._moved_ns is not None and due.instant_ns > self._moved_ns:
            self._move(min(due.instant_ns - self._moved_ns, self.parameters.longest_step_ns))
        self._moved_ns = due.instant_ns
        return self._frames(due.messages)

    def extend_watchdog(self, pause_ns: int) -> None:
        """Extend the watchdog by `pause_ns`: the simulation itself was paused for this long."""
        self._watch.extend_watchdog(pause_ns)
        self._wire.demands.extend(pause_ns)
        self.counters["pauses"] += 1

    def set_driver(self, driver: Driver) -> None:
        """Set the driver's pedals and steering torque.

        Raises `InvalidValueError` for a torque that is not finite or beyond ±`TORQUE_LIMIT_NM`.
        """
        torque_nm = round(checks.finite("steer_torque_nm", driver.steer_torque_nm), 1) + 0.0
        if abs(torque_nm) > TORQUE_LIMIT_NM:
            raise InvalidValueError(f"steer_torque_nm = {torque_nm}: must be within ±{TORQUE_LIMIT_NM}")
        self.driver = replace(driver, steer_torque_nm=torque_nm)
        if self.is_driver_active:
            self._watch.reset_streak()
            self._apply(Event.OVERRIDE)

    @property
    def is_driver_active(self) -> bool:
        """Return whether the driver brakes, accelerates or steers hard enough to take over."""
        d = self.driver
        return d.brake or d.throttle or abs(d.steer_torque_nm) >= self.parameters.override_torque_nm

    def request_ready(self) -> bool:
        """Hand over to a commander: MANUAL → READY, unless the driver is active; return whether it is READY now."""
        if not self.is_driver_active:
            self._apply(Event.MADE_READY)
        return self.mode is VehicleMode.READY

    def reset(self) -> bool:
        """Acknowledge a FAULT or EMERGENCY_STOP: → MANUAL; return whether there was one."""
        if not self._apply(Event.RESET):
            return False
        self.fault_code = 0
        return True

    def raise_fault(self, fault_code: int) -> None:
        """Enter FAULT with a code within 1..255."""
        if not 1 <= checks.integer("fault_code", fault_code) <= 255:
            raise InvalidValueError(f"fault_code = {fault_code}: must be 1..255")
        self.fault_code = fault_code
        self._apply(Event.FAULT)

    def press_emergency_stop(self) -> None:
        """Press the emergency stop button: → EMERGENCY_STOP from every mode."""
        self._apply(Event.EMERGENCY_STOP)

    def shift(self, gear: Gear) -> bool:
        """Select `gear`; return false, rejected, above the speed for it."""
        if gear in (Gear.NO_REQUEST, self.gear):
            return True
        if abs(self.state.speed_mps) > self.parameters.gear_change_speed_mps:
            self.counters["gear_refusals"] += 1
            return False
        self.gear = gear
        return True

    def jump(self, dx_m: float, dy_m: float) -> None:
        """Move at once, like a pose source that jumps by (dx, dy) in m."""
        s = self._car.state
        self._car.state = replace(s, x_m=s.x_m + dx_m, y_m=s.y_m + dy_m)

    def skip_counter(self, message: str, steps: int) -> None:
        """Step the counter of `message` as if `steps` frames had been lost before the next one."""
        report = self._report()
        for _ in range(steps):
            self._wire.write(message, report)

    @property
    def _expires_ns(self) -> int | None:
        """Time at which the commander counts as lost, by its commands or by a handshake."""
        deadlines_ns = (self._watch.expires_ns, self._wire.demands.expires_ns)
        return min([one for one in deadlines_ns if one is not None], default=None)

    def _check_watchdog(self, now_ns: int) -> None:
        expires_ns = self._expires_ns
        if expires_ns is not None and now_ns >= expires_ns and self._apply(Event.COMMANDS_LOST):
            self.fault_code = self.parameters.fault_code_commands_lost
            self.counters["commands_lost"] += 1

    def _follow_command(self, command: ReceivedMessage, seen_ns: int) -> None:
        """Handle an intact command: it may engage, release, or be followed."""
        enabled = bool(command.values.get("enable", True))
        self._watch.note(command.name, enabled=enabled, seen_ns=seen_ns)
        self._requested.update(command.values)
        if not enabled:
            self._apply(Event.RELEASED)
        elif self.is_driver_active:
            self._watch.reset_streak()
        elif self._watch.pairs >= PAIRS_TO_ENGAGE and self._wire.demands.are_met(seen_ns):
            self._apply(Event.PAIRS_RECEIVED)
        if self.mode is VehicleMode.AUTONOMOUS:
            if "gear_request" in command.values:
                self.shift(Gear(int(command.values["gear_request"])))
            elif not self._wire.requests_gear and self.state.speed_mps == 0.0:
                self.shift(find_needed_gear(self._requested))

    def _apply(self, event: Event) -> bool:
        """Apply the transition of `event`; return whether the mode changed."""
        mode = TRANSITIONS.get((self.mode, event))
        if mode is None:
            return False
        self.mode = mode
        self._watch.reset_streak()
        self._wire.demands.forget()
        self.counters[f"to_{mode.name.lower()}"] += 1
        return True

    def _move(self, dt_ns: int) -> None:
        requested = self._requested
        actuation = choose_actuation(
            self.mode,
            requested if self._interpret is None else self._interpret(requested, self.state, self.gear),
            self.driver,
            gear=self.gear,
            speed_mps=self.state.speed_mps,
            parameters=self.parameters,
        )
        self._car.step(s_from_ns(dt_ns), actuation)
        if not self.frozen:
            self._reported = (
                apply_faults(self._car.state, self.signal_faults) if self.signal_faults else self._car.state
            )

    def _frames(self, messages: Sequence[str]) -> list[CanFrame]:
        report = self._report()
        frames = [self.frame_faults.apply(message, self._wire.write(message, report)) for message in messages]
        sent = [frame for frame in frames if frame is not None]
        self.counters["frames"] += len(sent)
        return sent

    def _report(self) -> VehicleReport:
        s, d = self._reported, self.driver
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
