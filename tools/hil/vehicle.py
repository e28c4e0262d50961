"""The vehicle that the bench plays: speaks, obeys, engages and watches by the bus contract, and misbehaves when told.

`faults` stand between what it would say and what goes on the bus; all else that can be wrong with it is an attribute.
"""

from collections import Counter
from dataclasses import dataclass, field

from bus_contract import (
    AUTONOMOUS,
    DRIVE,
    FAULT,
    GREATEST_STEP,
    MANUAL,
    MS,
    PARK,
    READY,
    REVERSE,
    Frame,
    Told,
)

from hil.plant import Plant
from hil.wire import Wire

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

Values = dict[str, dict[str, float]]
"""Message → signal → value."""


@dataclass(slots=True)
class Utterance:
    """One frame that the vehicle is about to send."""

    name: str
    counter: int
    frame: Frame


class Fault:
    """Between the vehicle and the bus. By itself it changes nothing."""

    def values(self, values: Values) -> None:
        """Change what is true of the vehicle before it is packed."""

    def frames(self, spoken: list[Utterance]) -> list[Frame]:
        """What is sent instead of what was spoken in this tick."""
        return [utterance.frame for utterance in spoken]


@dataclass(frozen=True, slots=True)
class Instant:
    """What was true of the vehicle at one tick."""

    at_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    accel_mps2: float
    wheel_rad: float
    mode: int


@dataclass
class Vehicle:
    """Tick it a hundred times a second: `hear` what came, `move`, then send what `speak` gives."""

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
    engages: bool = True
    """Whether it ever enters AUTONOMOUS."""
    watches: bool = True
    """Whether its watchdog works."""
    faults: list[Fault] = field(default_factory=list)
    history: list[Instant] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.told: dict[str, Told] = {}
        """The newest intact command, by message."""
        self._last: dict[str, int] = {}
        self._seen_ns: dict[str, int] = {}
        self._heard_of: set[str] = set()
        self._pairs = 0
        self._counters: Counter[str] = Counter()
        self._tick = 0
        self._modes = [self.wire.number("MODE", name) for name in MODES]
        self._gears = [self.wire.number("GEAR", name) for name in GEARS] if self.wire.has("GEAR") else []

    def make_ready(self) -> None:
        """The driver lets go, acknowledges faults, and hands over."""
        self.driver_brake = self.driver_throttle = False
        self.driver_torque_nm, self.fault_code = 0.0, 0
        self._forget_pairs()
        self.mode = READY

    def hear(self, frame: Frame, now_ns: int) -> None:
        """Take a frame of the device's: intact is CRC good and counter advanced by 1 to 3."""
        told = self.wire.intact(frame)
        if told is None or told.name not in self.wire.command:
            return
        before, self._last[told.name] = self._last.get(told.name), told.counter
        if before is not None and not 1 <= (told.counter - before) % self.wire.counters <= GREATEST_STEP:
            self._forget_pairs()
            return
        self._seen_ns[told.name], self.told[told.name] = now_ns, told
        if not told["ENABLE"]:
            self._forget_pairs()
            if self.mode == AUTONOMOUS:
                self.mode = READY
            return
        self._heard_of.add(told.name)
        if len(self._heard_of) == len(self.wire.command):
            self._pairs, self._heard_of = self._pairs + 1, set()
        if self.mode == READY and self._pairs >= PAIRS_TO_ENGAGE and self.engages and not self.driver_acts:
            self.mode = AUTONOMOUS
        if self.mode == AUTONOMOUS and "GEAR_REQUEST" in told.signals:
            self._shift(int(told["GEAR_REQUEST"]))

    def move(self, dt_s: float, now_ns: int) -> None:
        """Let the driver, the watchdog and time do their work."""
        self._watch(now_ns)
        accel, only_brake = self._pedals()
        wheel = {AUTONOMOUS: self._wish_of("FRONT_WHEEL_ANGLE_REQUEST"), FAULT: 0.0}.get(
            self.mode, self.plant.wheel_rad
        )
        gear = {DRIVE: 1, REVERSE: -1}.get(self.gear, 0) if self.wire.has("GEAR_REQUEST") else self._way()
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
            )
        )

    def speak(self) -> list[Frame]:
        """What goes on the bus in this tick."""
        values = self._values()
        for fault in self.faults:
            fault.values(values)
        spoken = []
        if self._tick % STATUS_EVERY == 0:
            spoken.append(self._utter("VEHICLE_STATUS", values["VEHICLE_STATUS"]))
        spoken += [self._utter(name, values[name]) for name in self.wire.sample]
        frames = [utterance.frame for utterance in spoken]
        for fault in self.faults:
            frames = fault.frames(spoken)
            spoken = [Utterance(self.wire.names.get(f.can_id, ""), -1, f) for f in frames]
        self._tick += 1
        return frames

    def counter_of(self, name: str) -> int:
        """The counter that a message bore last."""
        return self._counters[name] % self.wire.counters

    def step_counters(self, by: int) -> None:
        """Leave out counter values of the state sample."""
        for name in self.wire.sample:
            self._counters[name] += by

    @property
    def driver_acts(self) -> bool:
        """Whether a hand or a foot is on something."""
        return self.driver_brake or self.driver_throttle or abs(self.driver_torque_nm) >= DRIVER_TORQUE_NM

    @property
    def stands(self) -> bool:
        """Whether it is at rest."""
        return abs(self.plant.speed_mps) < 0.01

    def _forget_pairs(self) -> None:
        self._pairs, self._heard_of = 0, set()

    def _shift(self, gear: int) -> None:
        if gear in (DRIVE, REVERSE) and abs(self.plant.speed_mps) < self.wire.limits.gear_change_mps:
            self.gear = gear

    def _watch(self, now_ns: int) -> None:
        if self.mode == AUTONOMOUS and self.driver_acts:
            self.mode = MANUAL
            self._forget_pairs()
        if self.fault_code:
            self.mode = FAULT
        oldest_ns = min(self._seen_ns.get(name, 0) for name in self.wire.command)
        if self.watches and self.mode == AUTONOMOUS and now_ns - oldest_ns > WATCHDOG_NS:
            self.mode = FAULT
            self._forget_pairs()

    def _pedals(self) -> tuple[float, bool]:
        """Acceleration along the body, and whether it is only to stop."""
        if self.mode == AUTONOMOUS:
            return self._wish_of("ACCEL_REQUEST"), bool(self._wish_of("SAFE_STOP"))
        brake = FAULT_BRAKE_MPS2 if self.mode >= FAULT else DRIVER_BRAKE_MPS2 if self.driver_brake else 0.0
        return (-brake if self.plant.speed_mps > 0.0 else brake), True

    def _way(self) -> int:
        """Of a vehicle without gears: as it rolls, and from rest as it is pushed."""
        push = self.plant.speed_mps if abs(self.plant.speed_mps) > ROLLS_MPS else self._wish_of("ACCEL_REQUEST")
        return -1 if push < 0.0 else 1

    def _wish_of(self, word: str) -> float:
        return next((told[word] for told in self.told.values() if word in told.signals), 0.0)

    def _values(self) -> Values:
        plant, wire = self.plant, self.wire
        words = {
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
        values: Values = {name: {} for name in (*wire.sample, "VEHICLE_STATUS")}
        for word, value in words.items():
            if wire.has(word):
                values[wire.part_of(word)][word] = float(value)
        return values

    def _utter(self, name: str, values: dict[str, float]) -> Utterance:
        self._counters[name] += 1
        counter = self._counters[name] % self.wire.counters
        return Utterance(name, counter, self.wire.pack(name, counter, **values))
