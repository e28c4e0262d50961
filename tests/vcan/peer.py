"""A minimal vehicle written from the contract's page: what the program drives when it must not be our own simulator.

A point on a bicycle without any lag. It sends, obeys, engages and watches as the contract requires; everything that it
could do wrong on the bus is a public attribute.
"""

import math
import os
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

from vehicle_bus_contract.reference import (
    AUTONOMOUS,
    COUNTERS,
    DRIVE,
    FAULT,
    GREATEST_STEP,
    LAYOUT,
    MANUAL,
    MAP,
    MS,
    NAMES,
    PAIR,
    PARK,
    READY,
    REVERSE,
    SAMPLE,
    DecodedFrame,
    Frame,
    S,
    intact,
    pack,
)
from vehicle_bus_contract.socketcan import open_socket, receive_frames, send

from .observer import CHANNEL, GEAR_CHANGE_MPS

PERIOD_NS = 10 * MS
WATCHDOG_NS = 100 * MS
WHEELBASE_M = 2.7
FAULT_BRAKE_MPS2 = 3.0
DRIVER_BRAKE_MPS2 = 4.0
LATE_NS = 30 * MS
"""A step this late was not the program's doing: nothing that a test starts goes before the vehicle's thread."""
ALWAYS = 1 << 30
PAIR_IDS = [LAYOUT[name][0] for name in PAIR]

_late_s: list[float] = []


def take_delays_s() -> list[float]:
    """By how much vehicles of this process were late since the last call, s."""
    taken = _late_s.copy()
    del _late_s[: len(taken)]
    return taken


@dataclass
class Faults:
    """How many of the next frames of a message, or of the next samples, are not as they should be."""

    crc: Counter[str]
    """By message: sent with a wrong CRC."""
    muted: Counter[str]
    """By message: stepped, but not sent."""
    repeated: int = 0
    """Samples: sent with the counter of the one before."""
    skipped: int = 0
    """Steps that the next sample's counter makes too many."""


class Vehicle:
    """Drives from its own thread between `start` and `close`."""

    def __init__(self, x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0, *, channel: str = CHANNEL) -> None:
        self.x_m, self.y_m, self.heading_rad = x_m, y_m, heading_rad
        self.speed_mps = self.accel_mps2 = self.wheel_rad = 0.0
        self.mode, self.gear, self.fault_code = READY, PARK, 0
        self.pose_frame, self.pose_valid = MAP, True
        self.driver_brake = self.driver_throttle = False
        self.driver_torque_nm = 0.0
        self.push_mps2 = self.slide_mps = 0.0
        """What a hill or ice does to it: an acceleration along the body, and a speed to the left."""
        self.steers_by_itself_rad: float | None = None
        """Where its wheels are, whatever is commanded."""
        self.engages = self.watches = True
        self.faults = Faults(crc=Counter(), muted=Counter())
        self._commands: dict[str, DecodedFrame] = {}
        self._last: dict[str, int] = {}
        self._seen_ns: dict[str, int] = {}
        self._half = ""
        self._row = 0
        self._counters = Counter(dict.fromkeys(NAMES.values(), 0))
        self._channel = channel
        self._raws = [open_socket(channel, PAIR_IDS)]
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, name="vehicle")

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def close(self) -> None:
        """Fall silent. May be called twice."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        for raw in self._raws:
            raw.close()

    def reconnect(self) -> None:
        """Use the interface that has the name now: the one before it was deleted."""
        self._raws.append(open_socket(self._channel, PAIR_IDS))

    def mute(self, samples: int) -> None:
        """Lose the next samples on their way."""
        for name in SAMPLE:
            self.faults.muted[name] = samples

    def make_ready(self) -> None:
        """The driver takes feet and hands off, acknowledges, and hands over."""
        self.driver_brake = self.driver_throttle = False
        self.driver_torque_nm, self.fault_code = 0.0, 0
        self._row, self._half = 0, ""
        self.mode = READY

    def _live(self) -> None:
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        begin_ns = now_ns = time.monotonic_ns()
        tick = 0
        while not self._over.is_set():
            late_ns = time.monotonic_ns() - begin_ns - tick * PERIOD_NS
            if late_ns < 0:
                time.sleep(-late_ns / S)
            before_ns, now_ns = now_ns, time.monotonic_ns()
            if now_ns - before_ns > PERIOD_NS + LATE_NS:
                _late_s.append((now_ns - before_ns - PERIOD_NS) / S)
            for frame in receive_frames(self._raws[-1]):
                self._receive(frame, now_ns)
            self._judge(now_ns)
            self._move(PERIOD_NS / S)
            self._send_state(tick)
            tick = max(tick + 1, (time.monotonic_ns() - begin_ns) // PERIOD_NS)

    def _receive(self, frame: Frame, now_ns: int) -> None:
        """Intact is: CRC good, counter advanced by 1 to 3."""
        decoded = intact(frame)
        if decoded is None or decoded.name not in PAIR:
            return
        before, self._last[decoded.name] = self._last.get(decoded.name), decoded.counter
        if before is not None and not 1 <= (decoded.counter - before) % COUNTERS <= GREATEST_STEP:
            self._row = 0
            return
        self._seen_ns[decoded.name] = now_ns
        self._commands[decoded.name] = decoded
        if not decoded["ENABLE"]:
            self._row, self._half = 0, ""
            if self.mode == AUTONOMOUS:
                self.mode = READY
            return
        if self._half and self._half != decoded.name:
            self._row, self._half = self._row + 1, ""
        else:
            self._half = decoded.name
        if self.mode == READY and self._row >= 3 and self.engages and not self._driver_acts:
            self.mode = AUTONOMOUS
        if decoded.name == PAIR[0] and self.mode == AUTONOMOUS:
            self._shift(int(decoded["GEAR_REQUEST"]))

    def _shift(self, gear: int) -> None:
        if gear in (DRIVE, REVERSE) and abs(self.speed_mps) < GEAR_CHANGE_MPS:
            self.gear = gear

    @property
    def _driver_acts(self) -> bool:
        return self.driver_brake or self.driver_throttle or abs(self.driver_torque_nm) >= 3.0

    def _judge(self, now_ns: int) -> None:
        """Driver, own faults and watchdog."""
        if self.mode == AUTONOMOUS and self._driver_acts:
            self.mode, self._row = MANUAL, 0
        if self.fault_code:
            self.mode = FAULT
        oldest_ns = min((self._seen_ns.get(name, 0) for name in PAIR), default=0)
        if self.watches and self.mode == AUTONOMOUS and now_ns - oldest_ns > WATCHDOG_NS:
            self.mode, self._row = FAULT, 0

    def _move(self, dt_s: float) -> None:
        accel_mps2, holds = self._accelerates()
        before_mps = self.speed_mps
        if self.mode == AUTONOMOUS:
            self.wheel_rad = self._commands[PAIR[1]]["FRONT_WHEEL_ANGLE_REQUEST"]
        elif self.mode == FAULT:
            self.wheel_rad = 0.0
        forward = {DRIVE: 1.0, REVERSE: -1.0}.get(self.gear, 0.0)
        if self.steers_by_itself_rad is not None:
            self.wheel_rad = self.steers_by_itself_rad
        if self.push_mps2 and self.mode == AUTONOMOUS:
            accel_mps2, holds = self.push_mps2, False
            forward = math.copysign(1.0, self.push_mps2)
        after_mps = before_mps + accel_mps2 * dt_s
        against = accel_mps2 * before_mps < 0.0 and not self.push_mps2
        if (against and after_mps * before_mps <= 0.0) or (not against and (holds or accel_mps2 * forward <= 0.0)):
            after_mps = 0.0 if against or before_mps == 0.0 else before_mps
        self.speed_mps = after_mps
        self.accel_mps2 = (after_mps - before_mps) / dt_s if after_mps else 0.0
        mean_mps = (before_mps + after_mps) / 2.0
        turn_rad = mean_mps * math.tan(self.wheel_rad) / WHEELBASE_M * dt_s
        cos, sin = math.cos(self.heading_rad + turn_rad / 2.0), math.sin(self.heading_rad + turn_rad / 2.0)
        self.x_m += (mean_mps * cos - self.slide_mps * sin) * dt_s
        self.y_m += (mean_mps * sin + self.slide_mps * cos) * dt_s
        self.heading_rad = math.remainder(self.heading_rad + turn_rad, math.tau)

    def _accelerates(self) -> tuple[float, bool]:
        """What engine and brakes are asked for along the body, and whether only to stop."""
        if self.mode == AUTONOMOUS:
            drive = self._commands[PAIR[0]]
            return drive["ACCEL_REQUEST"], bool(drive["SAFE_STOP"])
        brake = FAULT_BRAKE_MPS2 if self.mode == FAULT else DRIVER_BRAKE_MPS2 if self.driver_brake else 0.0
        return -math.copysign(brake, self.speed_mps), True

    def _send_state(self, tick: int) -> None:
        faults = self.faults
        if tick % 2 == 0:
            self._counters["VEHICLE_STATUS"] += 1
            self._send_message(
                "VEHICLE_STATUS",
                self._counters["VEHICLE_STATUS"],
                GEAR=self.gear,
                MODE=self.mode,
                DRIVER_BRAKE=self.driver_brake,
                DRIVER_THROTTLE=self.driver_throttle,
                DRIVER_STEER_TORQUE=self.driver_torque_nm,
                FAULT_CODE=self.fault_code,
            )
        if faults.repeated > 0:
            faults.repeated -= 1
        else:
            self._counters["POSE"] += 1 + faults.skipped
            faults.skipped = 0
        counter = self._counters["POSE"]
        self._send_message(
            "POSE",
            counter,
            POSE_FRAME=self.pose_frame,
            POSE_VALID=self.pose_valid,
            POS_X=self.x_m,
            POS_Y=self.y_m,
        )
        yaw_radps = self.speed_mps * math.tan(self.wheel_rad) / WHEELBASE_M
        self._send_message("MOTION", counter, HEADING=self.heading_rad, SPEED=self.speed_mps, YAW_RATE=yaw_radps)
        self._send_message(
            "CHASSIS",
            counter,
            ACCEL=self.accel_mps2,
            LATERAL_SPEED=self.slide_mps,
            FRONT_WHEEL_ANGLE=self.wheel_rad,
        )

    def _send_message(self, name: str, counter: int, **signals: float) -> None:
        faults = self.faults
        if faults.muted[name] > 0:
            faults.muted[name] -= 1
            return
        can_id, data = pack(name, counter % COUNTERS, **signals)
        if faults.crc[name] > 0:
            faults.crc[name] -= 1
            data = bytes((data[0] ^ 0x5A,)) + data[1:]
        send(self._raws[-1], Frame(0, can_id, data))
