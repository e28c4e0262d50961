"""The simulated vehicle of any profile: a peer that sends by the profile, and obeys and monitors what it expects."""

import math
from collections.abc import Mapping
from typing import Any

from vehicle_bus_contract.reference import AUTONOMOUS, DRIVE, PARK, READY, REVERSE, DecodedFrame, Frame, S

from hil_bench.peer.allowances import SPEED_BRAKE_MPS2
from hil_bench.peer.infer import InferredStop
from hil_bench.peer.signals import echoed_signals, sent_values
from hil_bench.peer.wire import LONGEST_TICK_S, MODE_NUMBERS, PeerWire
from hil_bench.plant import Plant
from hil_bench.profile import ProfileError
from hil_bench.vehicle import DRIVER_TORQUE_NM, GEARS, MODES, PAIRS_TO_ENGAGE, SignalValues, TxFrame, Vehicle

SPEED_LAG_S = 0.3
"""Of its speed controller, which accelerates and brakes within these limits."""
SPEED_DRIVE_MPS2, SPEED_HOLD_MPS2 = 2.5, 0.3
NEAR_M, ARRIVED_S = 1.5, 1.5
"""A vehicle that is told no reason has arrived when it has been at rest for this long near the end of its route."""
ECHO_CHANGES_NS, ECHO_STATES = S // 2, 16
"""A signal that the device must send back changes this often, between at most so many values."""
COMMAND = "COMMAND"


class PeerVehicle(Vehicle):
    """As `Vehicle`; every 10 or 20 ms: `receive` each frame, `move`, then send `next_frames`."""

    wire: PeerWire

    def __init__(self, wire: PeerWire, plant: Plant) -> None:
        super().__init__(wire, plant)
        self.gear = PARK if wire.reader.has_gear else DRIVE
        ticks = math.ceil(wire.period_s / LONGEST_TICK_S)
        self.period_ns = round(wire.period_s / ticks * S)
        self._every = {name: max(1, round(period_s * S / self.period_ns)) for name, period_s in wire.periods_s.items()}
        self.goal_m: tuple[float, float] | None = None
        """End of the route."""
        self.near_m = NEAR_M * min(1.0, wire.length_share)
        self._newest: dict[str, float] = {}
        self._counts: dict[str, int] = {}
        self._stood_s = 0.0
        self._stop = InferredStop(wire)
        self._asked: Mapping[str, float] = {}
        self._echoes = echoed_signals(wire.profile)
        self._expected = _expected_values(wire.profile)
        self._seen_sends: set[str] = set()

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Process a frame of the device; it counts if its checksum is good and its counter advanced."""
        decoded = self.wire.intact(frame)
        if decoded is None or decoded.name not in self.wire.of_device:
            return
        name, protection = decoded.name, self.wire.layout.protections[decoded.name]
        if protection.counters:
            before, self._counts[name] = self._counts.get(name), decoded.counter
            if before is not None and not 1 <= (decoded.counter - before) % protection.counters <= protection.max_step:
                self._reset_pairs()
                return
        self._newest.update(decoded.signals)
        self._seen_ns[name] = now_ns
        if all(
            abs(decoded.signals.get(dotted, math.nan) - value) < 1e-6 for dotted, value in self._expected.get(name, ())
        ):
            self._seen_sends.add(name)
        self._obey(name, now_ns)

    @property
    def is_driven(self) -> bool:
        """True while it is autonomous and its last command is no stop."""
        drive = self.commands.get(COMMAND)
        return self.mode == AUTONOMOUS and drive is not None and bool(drive["ENABLE"]) and not drive["SAFE_STOP"]

    @property
    def has_arrived(self) -> bool:
        """True once it has come to rest near the end of its route."""
        if self.wire.tells_reasons:
            drive = self.commands.get(COMMAND)
            return drive is not None and drive.reason.startswith("PAST_END") and self.is_standing
        if self.goal_m is None or self._stood_s < ARRIVED_S:
            return False
        return math.dist(self.goal_m, (self.plant.x_m, self.plant.y_m)) < self.near_m

    def drives_to(self, x_m: float, y_m: float) -> None:
        """Its route ends there."""
        self.goal_m = (x_m, y_m)

    def move(self, dt_s: float, now_ns: int) -> None:
        """Update the mode, then move the plant by `dt_s`."""
        if "SPEED_REQUEST" in self._asked and self.wire.reader.longitudinal == "speed":
            asked = {**self._asked, "ACCEL_REQUEST": self._follow_speed_mps2(), "SAFE_STOP": 0.0}
            asked["SAFE_STOP"] = self.commands[COMMAND]["SAFE_STOP"] if COMMAND in self.commands else 0.0
            self.commands[COMMAND] = DecodedFrame(now_ns, COMMAND, asked)
        super().move(dt_s, now_ns)
        self._stood_s = self._stood_s + dt_s if self.is_standing else 0.0

    def is_due(self, name: str) -> bool:
        """True if the next tick sends this message."""
        return self._tick % self._every[name] == 0

    def counter_of(self, name: str) -> int:
        """The last counter of a message."""
        return self._counters[name] % (self.wire.layout.protections[name].counters or 1)

    def _obey(self, name: str, now_ns: int) -> None:
        """Engage, disengage or follow, by the newest signals of all messages."""
        if not all(one in self._seen_ns for one in self.wire.roles.watched_s):
            return
        plant = self.plant
        direction = -1.0 if self.gear == REVERSE else 1.0
        asked = self.wire.reader.read(self._newest, speed_mps=plant.speed_mps, direction=direction)
        if name in self.wire.command or COMMAND not in self.commands:
            stop = self._stop.is_stop(asked, speed_mps=plant.speed_mps, direction=direction, at_ns=now_ns)
        else:
            stop = bool(self.commands[COMMAND]["SAFE_STOP"])
        self._asked = {"ACCEL_REQUEST": 0.0, **asked, "SAFE_STOP": float(stop)}
        self.commands[COMMAND] = DecodedFrame(now_ns, COMMAND, self._asked)
        if not asked["ENABLE"]:
            self._reset_pairs()
            self._seen_sends -= {name}
            if self.mode == AUTONOMOUS:
                self.mode = READY
            return
        self._count_pair(name)
        may_engage = self.mode == READY and self.can_engage and not self.is_driver_active
        if may_engage and self._pairs >= PAIRS_TO_ENGAGE and self._seen_sends >= self._expected.keys():
            self.mode = AUTONOMOUS
        if self.mode == AUTONOMOUS and "GEAR_REQUEST" in asked:
            self._shift(int(asked["GEAR_REQUEST"]))

    def _count_pair(self, name: str) -> None:
        if name in self.wire.command:
            self._received_of.add(name)
        if len(self._received_of) == len(self.wire.command):
            self._pairs, self._received_of = self._pairs + 1, set()

    def _follow_speed_mps2(self) -> float:
        """What a speed controller asks of engine and brake."""
        goal_mps, speed_mps = self._asked["SPEED_REQUEST"], self.plant.speed_mps
        wanted = (goal_mps - speed_mps) / SPEED_LAG_S
        if goal_mps == 0.0 and speed_mps != 0.0:
            wanted = math.copysign(max(abs(wanted), SPEED_HOLD_MPS2), wanted)
        most = SPEED_DRIVE_MPS2 if wanted * speed_mps >= 0.0 else SPEED_BRAKE_MPS2
        return min(most, max(-most, wanted))

    def _pedals(self) -> tuple[float, bool]:
        """Requested acceleration along the body, and whether it may only brake."""
        if self.mode != AUTONOMOUS:
            return super()._pedals()
        is_speed = self.wire.reader.longitudinal == "speed"
        brakes = self._asked.get("SPEED_REQUEST", 0.0) == 0.0 if is_speed else bool(self._requested("SAFE_STOP"))
        return self._requested("ACCEL_REQUEST"), brakes

    def _update_mode(self, now_ns: int) -> None:
        """As the reference vehicle's, with a watchdog for each message that it expects."""
        watched = self.wire.roles.watched_s.items()
        late_ns = max(now_ns - self._seen_ns.get(name, 0) - round(limit_s * S) for name, limit_s in watched)
        has_watchdog, self.has_watchdog = self.has_watchdog, self.has_watchdog and late_ns > 0
        self.watchdog_ns = 0
        super()._update_mode(now_ns)
        self.has_watchdog = has_watchdog

    def _due_frames(self, values: SignalValues) -> list[TxFrame]:
        flat = {signal: value for message in values.values() for signal, value in message.items()}
        for dotted in self._echoes:
            states = min(ECHO_STATES, 1 << self.wire.signals[dotted].signal.length)
            flat[dotted] = float(self._tick * self.period_ns // ECHO_CHANGES_NS % states)
        told = {**self.wire.fields.write(flat), **{dotted: flat[dotted] for dotted in self._echoes}}
        return [self._pack_next(name, told) for name in self._every if self.is_due(name)]

    def _pack_next(self, name: str, values: dict[str, float]) -> TxFrame:
        self._counters[name] += 1
        return TxFrame(name, self.counter_of(name), self.wire.pack_signals(name, self._counters[name], values))

    def _values(self) -> SignalValues:
        values: SignalValues = {name: {} for name in self.wire.periods_s}
        for signal_name, value in self._fields().items():
            if signal_name == "MODE" or self.wire.has(signal_name):
                values[self.wire.part_of(signal_name)][signal_name] = float(value)
        return values

    def _fields(self) -> dict[str, float]:
        """As the reference vehicle's; the torque by which the driver takes over is the profile's."""
        share = float(self.wire.profile["limits"].get("driver_steer_torque_nm", DRIVER_TORQUE_NM)) / DRIVER_TORQUE_NM
        return super()._fields() | {"DRIVER_STEER_TORQUE": share * self.driver_torque_nm}

    def _number_names(self) -> None:
        self._modes = [self._number("MODE", name, MODE_NUMBERS[name]) for name in MODES]
        self._gears = [self._number("GEAR", name, 0) for name in GEARS] if self.wire.has("GEAR") else []

    def _number(self, signal_name: str, name: str, other: int) -> int:
        """The DBC's number; that of the next best name where it has none."""
        best = {"FAULT": ("EMERGENCY_STOP", "MANUAL"), "EMERGENCY_STOP": ("FAULT", "MANUAL"), "READY": ("MANUAL",)}
        for one in (name, *best.get(name, ("READY",)), "NEUTRAL", "DRIVE"):
            try:
                return self.wire.number(signal_name, one)
            except ProfileError:
                continue
        return other


def _expected_values(profile: Mapping[str, Any]) -> dict[str, list[tuple[str, float]]]:
    """The messages besides commands that must come before the vehicle engages, with their fixed values."""
    values = sent_values(profile)
    found: dict[str, list[tuple[str, float]]] = {}
    for send in profile.get("send", ()):
        if send["when"] in ("engaging", "enabled"):
            names = [f"{send['message']}.{name}" for name in send.get("values", {})]
            fixed = [(name, values[name]) for name in names]
            found[send["message"]] = [(name, float(value)) for name, value in fixed if isinstance(value, int | float)]
    return found
