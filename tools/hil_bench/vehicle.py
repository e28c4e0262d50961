"""The simulated vehicle: sends state, executes commands, engages and monitors by the bus contract.

`faults` change what it sends; anything else that can be wrong with it is an attribute.
"""

from collections import Counter
from dataclasses import dataclass, field

from vehicle_bus_contract.reference import (
    AUTONOMOUS,
    DRIVE,
    FAULT,
    GREATEST_STEP,
    MANUAL,
    MS,
    PARK,
    READY,
    REVERSE,
    DecodedFrame,
    Frame,
)

from hil_bench.plant import Plant
from hil_bench.wire import Wire

PERIOD_NS = 10 * MS
STATUS_EVERY = 2
WATCHDOG_NS = 100 * MS
FAULT_BRAKE_MPS2 = 3.0
DRIVER_BRAKE_MPS2 = 4.0
DRIVER_TORQUE_NM = 3.0
PAIRS_TO_ENGAGE = 3
ROLLS_MPS = 0.05

MODES = ("MANUAL", "READY", "AUTONOMOUS", "FAULT", "EMERGENCY_STOP")
GEARS = ("PARK", "REVERSE", "NEUTRAL", "DRIVE")
"""By the contract's numbers; a vehicle may number them otherwise."""

SignalValues = dict[str, dict[str, float]]
"""Message → signal → value."""


@dataclass(slots=True)
class TxFrame:
    """One frame that the vehicle is about to send."""

    name: str
    counter: int
    frame: Frame


class Fault:
    """Changes what the vehicle sends. This base class changes nothing."""

    def values(self, values: SignalValues) -> None:
        """Change signals in place before they are packed."""

    def frames(self, outgoing: list[TxFrame]) -> list[Frame]:
        """The frames to send in this tick instead of `outgoing`."""
        return [tx.frame for tx in outgoing]


@dataclass(frozen=True, slots=True)
class Instant:
    """The vehicle's true state at one tick."""

    at_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    accel_mps2: float
    wheel_rad: float
    mode: int
    drift_mps: float = 0.0
    """To the left."""


@dataclass
class Vehicle:
    """Every 10 ms: `receive` each frame, `move`, then send `next_frames`."""

    wire: Wire
    plant: Plant
    mode: int = READY
    gear: int = PARK
    fault_code: int = 0
    pose_frame: str = "MAP"
    pose_valid: bool = True
    driver_brake: bool = False
    driver_throttle: bool = False
    driver_torque_nm: float = 0.0
    yields_to_driver: bool = True
    """False: what the driver does leaves its mode as it is."""
    can_engage: bool = True
    """False: it never enters AUTONOMOUS."""
    has_watchdog: bool = True
    """False: silence does not stop it."""
    faults: list[Fault] = field(default_factory=list)
    history: list[Instant] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.commands: dict[str, DecodedFrame] = {}
        """The newest intact command, by message."""
        self._last: dict[str, int] = {}
        self._seen_ns: dict[str, int] = {}
        self._received_of: set[str] = set()
        self._pairs = 0
        self._counters: Counter[str] = Counter()
        self._tick = 0
        self._number_names()
        self.period_ns = PERIOD_NS
        """Between two ticks."""
        self.watchdog_ns = WATCHDOG_NS

    def make_ready(self) -> None:
        """The driver releases pedals and wheel, acknowledges faults, and selects READY."""
        self.driver_brake = self.driver_throttle = False
        self.driver_torque_nm, self.fault_code = 0.0, 0
        self.yields_to_driver = True
        self._reset_pairs()
        self.mode = READY

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Process a frame of the device; it counts if its CRC is good and its counter advanced by 1 to 3."""
        decoded = self.wire.intact(frame)
        if decoded is None or decoded.name not in self.wire.command:
            return
        before, self._last[decoded.name] = self._last.get(decoded.name), decoded.counter
        if before is not None and not 1 <= (decoded.counter - before) % self.wire.counters <= GREATEST_STEP:
            self._reset_pairs()
            return
        self._seen_ns[decoded.name], self.commands[decoded.name] = now_ns, decoded
        if not decoded["ENABLE"]:
            self._reset_pairs()
            if self.mode == AUTONOMOUS:
                self.mode = READY
            return
        self._received_of.add(decoded.name)
        if len(self._received_of) == len(self.wire.command):
            self._pairs, self._received_of = self._pairs + 1, set()
        if self.mode == READY and self._pairs >= PAIRS_TO_ENGAGE and self.can_engage and not self.is_driver_active:
            self.mode = AUTONOMOUS
        if self.mode == AUTONOMOUS and "GEAR_REQUEST" in decoded.signals:
            self._shift(int(decoded["GEAR_REQUEST"]))

    def move(self, dt_s: float, now_ns: int) -> None:
        """Update the mode, then move the plant by `dt_s`."""
        self._update_mode(now_ns)
        accel, only_brake = self._pedals()
        wheel = {AUTONOMOUS: self._requested("FRONT_WHEEL_ANGLE_REQUEST"), FAULT: 0.0}.get(
            self.mode, self.plant.wheel_rad
        )
        gear = {DRIVE: 1, REVERSE: -1}.get(self.gear, 0) if self.wire.has("GEAR_REQUEST") else self._drive_direction()
        self.plant.step(dt_s, accel_mps2=accel, wheel_rad=wheel, gear=gear, only_brake=only_brake)
        plant = self.plant
        self.history.append(
            Instant(
                now_ns,
                plant.x_m,
                plant.y_m,
                plant.heading_rad,
                plant.speed_mps,
                plant.accel_mps2,
                plant.wheel_rad,
                self.mode,
                plant.drift_mps,
            )
        )

    def next_frames(self) -> list[Frame]:
        """The frames to send in this tick, after all faults."""
        values = self._values()
        for fault in self.faults:
            fault.values(values)
        outgoing = self._due_frames(values)
        frames = [tx.frame for tx in outgoing]
        for fault in self.faults:
            frames = fault.frames(outgoing)
            outgoing = [TxFrame(self.wire.name_of(f) or "", -1, f) for f in frames]
        self._tick += 1
        return frames

    def is_due(self, name: str) -> bool:
        """True if the next tick sends this message."""
        return name in self.wire.sample or self._tick % STATUS_EVERY == 0

    def counter_of(self, name: str) -> int:
        """The last counter of a message."""
        return self._counters[name] % self.wire.counters

    def step_counters(self, by: int) -> None:
        """Skip counter values of the state sample."""
        for name in self.wire.sample:
            self._counters[name] += by

    @property
    def is_driver_active(self) -> bool:
        """True while the driver brakes, accelerates or steers."""
        return self.driver_brake or self.driver_throttle or abs(self.driver_torque_nm) >= DRIVER_TORQUE_NM

    @property
    def is_standing(self) -> bool:
        """True at rest."""
        return abs(self.plant.speed_mps) < 0.01

    @property
    def is_driven(self) -> bool:
        """True while it is autonomous and its last command is no stop."""
        drive = self.commands.get(self.wire.command[0])
        return self.mode == AUTONOMOUS and drive is not None and not drive["SAFE_STOP"] and bool(drive["ENABLE"])

    @property
    def has_arrived(self) -> bool:
        """True once the device reports the end of its route and the vehicle is at rest."""
        drive = self.commands.get(self.wire.command[0])
        return drive is not None and drive.reason.startswith("PAST_END") and self.is_standing

    def drives_to(self, x_m: float, y_m: float) -> None:
        """Its route ends there, which this vehicle need not know: the device reports the end."""

    def _number_names(self) -> None:
        self._modes = [self.wire.number("MODE", name) for name in MODES]
        self._gears = [self.wire.number("GEAR", name) for name in GEARS] if self.wire.has("GEAR") else []

    def _reset_pairs(self) -> None:
        self._pairs, self._received_of = 0, set()

    def _shift(self, gear: int) -> None:
        if gear in (DRIVE, REVERSE) and abs(self.plant.speed_mps) < self.wire.limits.gear_change_mps:
            self.gear = gear

    def _update_mode(self, now_ns: int) -> None:
        if self.mode == AUTONOMOUS and self.is_driver_active and self.yields_to_driver:
            self.mode = MANUAL
            self._reset_pairs()
        if self.fault_code:
            self.mode = FAULT
        oldest_ns = min(self._seen_ns.get(name, 0) for name in self.wire.command)
        if self.has_watchdog and self.mode == AUTONOMOUS and now_ns - oldest_ns > self.watchdog_ns:
            self.mode = FAULT
            self._reset_pairs()

    def _pedals(self) -> tuple[float, bool]:
        """Requested acceleration along the body, and whether it may only brake."""
        if self.mode == AUTONOMOUS:
            return self._requested("ACCEL_REQUEST"), bool(self._requested("SAFE_STOP"))
        brake = FAULT_BRAKE_MPS2 if self.mode >= FAULT else DRIVER_BRAKE_MPS2 if self.driver_brake else 0.0
        return (-brake if self.plant.speed_mps > 0.0 else brake), True

    def _drive_direction(self) -> int:
        """1 or −1 for a vehicle without gears: as it rolls, or at rest as it is accelerated."""
        push = self.plant.speed_mps if abs(self.plant.speed_mps) > ROLLS_MPS else self._requested("ACCEL_REQUEST")
        return -1 if push < 0.0 else 1

    def _due_frames(self, values: SignalValues) -> list[TxFrame]:
        outgoing = []
        if self.is_due("VEHICLE_STATUS"):
            outgoing.append(self._pack_next("VEHICLE_STATUS", values["VEHICLE_STATUS"]))
        return outgoing + [self._pack_next(name, values[name]) for name in self.wire.sample]

    def _requested(self, signal_name: str) -> float:
        return next((decoded[signal_name] for decoded in self.commands.values() if signal_name in decoded.signals), 0.0)

    def _values(self) -> SignalValues:
        values: SignalValues = {name: {} for name in (*self.wire.sample, *self.wire.status)}
        for signal_name, value in self._fields().items():
            if self.wire.has(signal_name):
                values[self.wire.part_of(signal_name)][signal_name] = float(value)
        return values

    def _fields(self) -> dict[str, float]:
        """What the vehicle measures and reports, by the names of its signals."""
        plant, wire = self.plant, self.wire
        return {
            "POS_X": plant.x_m,
            "POS_Y": plant.y_m,
            "HEADING": plant.heading_rad,
            "SPEED": plant.speed_mps,
            "ACCEL": plant.accel_mps2,
            "YAW_RATE": plant.yaw_rate_radps,
            "LATERAL_SPEED": plant.drift_mps,
            "FRONT_WHEEL_ANGLE": plant.wheel_rad,
            "REAR_WHEEL_ANGLE": 0.0,
            "POSE_FRAME": wire.number("POSE_FRAME", self.pose_frame) if wire.has("POSE_FRAME") else 0,
            "POSE_VALID": self.pose_valid,
            "MODE": self._modes[self.mode],
            "GEAR": self._gears[self.gear] if self._gears else 0,
            "DRIVER_BRAKE": self.driver_brake,
            "DRIVER_THROTTLE": self.driver_throttle,
            "DRIVER_STEER_TORQUE": self.driver_torque_nm,
            "FAULT_CODE": self.fault_code,
        }

    def _pack_next(self, name: str, values: dict[str, float]) -> TxFrame:
        self._counters[name] += 1
        counter = self._counters[name] % self.wire.counters
        return TxFrame(name, counter, self.wire.pack(name, counter, **values))
