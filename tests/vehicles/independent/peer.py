"""The sedan of `sedan.dbc`, simulated with cantools, a bicycle model, and a WGS 84 and checksums of its own.

It shares nothing with the program but the type of a frame.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cantools
import numpy as np

from vehicle_iface.frame import CanFrame

ORIGIN_DEG = (-54.8019, -68.3030)
MOUNT_X_M, MOUNT_Y_M, MOUNT_RAD = 1.2, -0.4, 0.5
WHEELBASE_M, WHEEL_RADIUS_M, STEERING_RATIO = 2.7, 0.31, 15.0
PERIODS_MS = {
    "INS_POS": (20, 3),
    "INS_ATT": (10, 5),
    "INS_STATUS": (50, 7),
    "WHEELS": (50, 1),
    "STEER": (10, 4),
    "ESP": (20, 2),
    "EPS": (20, 6),
    "ACCEL_RPT": (20, 8),
    "BRAKE_RPT": (20, 9),
    "GLOBAL_RPT": (20, 11),
}
"""Period and offset of what it sends."""
_MAJOR_M, _FLATTENING = 6378137.0, 1 / 298.257223563
_SQUARED_ECCENTRICITY = _FLATTENING * (2 - _FLATTENING)


class Command(NamedTuple):
    """A received command."""

    at_ms: int
    name: str
    values: dict[str, float]


class Sedan:
    """Its true pose is that of the rear axle: metres east and north of the origin, heading from east to the left."""

    def __init__(self, dbc: Path) -> None:
        text = dbc.read_bytes().decode("latin-1").replace("2ND_", "SECOND_")
        text = re.sub(r"(?m)^VAL_ .*$|^BO_ 419385573 (.*\n)+?\n", "", text)
        self.messages = cantools.database.Database()
        self.messages.add_dbc_string(text)
        self.now_ms = 0
        self.x_m = self.y_m = self.heading_rad = self.speed_mps = self.accel_mps2 = self.wheel_rad = 0.0
        self.yaw_rate_radps = 0.0
        self.wanted_accel_mps2 = self.wanted_wheel_rad = 0.0
        self.drives_itself = False
        self.muted: set[str] = set()
        self.reports: dict[str, float] = {
            "MODE": 4,
            "SPOOFED": 0,
            "TORQUE": 0.0,
            "PEDAL": 0.0,
            "PEDAL_PRESSED": 0,
            "FAULT": 0,
        }
        self.reports |= {"TORQUE": 0.0, "PEDAL": 0.0, "PEDAL_PRESSED": 0}
        """What a test may change."""
        self.commands: list[Command] = []
        self.faults: list[str] = []
        self._sent: dict[str, int] = {}
        self._counters: dict[str, int] = {}
        self._enabled = 0

    def advance_ms(self) -> list[CanFrame]:
        """A millisecond later: what it sends."""
        self.now_ms += 1
        accel_mps2 = self.wanted_accel_mps2 if self.drives_itself else -0.3 * self.speed_mps
        self.accel_mps2 += (accel_mps2 - self.accel_mps2) * 0.001 / 0.05
        change_rad = self.wanted_wheel_rad - self.wheel_rad if self.drives_itself else 0.0
        self.wheel_rad += max(-0.0015, min(0.0015, change_rad))
        self.speed_mps = max(0.0, self.speed_mps + self.accel_mps2 * 0.001)
        self.yaw_rate_radps = self.speed_mps * math.tan(self.wheel_rad) / WHEELBASE_M
        self.x_m += self.speed_mps * math.cos(self.heading_rad) * 0.001
        self.y_m += self.speed_mps * math.sin(self.heading_rad) * 0.001
        self.heading_rad += self.yaw_rate_radps * 0.001
        due = [name for name, (every, offset) in PERIODS_MS.items() if self.now_ms % every == offset % every]
        return [self._frame(name) for name in due if name not in self.muted]

    def receive(self, frame: CanFrame) -> None:
        """Obey a command, and note what is wrong with it."""
        message = self.messages.get_message_by_frame_id(frame.can_id)
        values = {name: float(str(value)) for name, value in message.decode(frame.data, decode_choices=False).items()}  # type: ignore[union-attr]
        self.commands.append(Command(self.now_ms, message.name, values))
        if frame.data[7] != _checksum(frame.can_id, frame.data):
            self.faults.append(f"checksum of {message.name}")
        counter = int(values["COUNTER"])
        if counter != (self._counters.get(message.name, counter - 1) + 1) % 16:
            self.faults.append(f"counter of {message.name}")
        self._counters[message.name] = counter
        if message.name == "DRIVE_CMD":
            if min(values["DRIVE"], values["BRAKE"]) > 0.0:
                self.faults.append("drives and brakes")
            self.wanted_accel_mps2 = values["DRIVE"] - values["BRAKE"]
        else:
            self.wanted_wheel_rad = -math.radians(values["ANGLE"]) / STEERING_RATIO
            self._enabled = self._enabled + 1 if values["EN"] else 0
            self.drives_itself = self._enabled >= 5

    def _frame(self, name: str) -> CanFrame:
        message = self.messages.get_message_by_name(name)
        count = self._sent[name] = self._sent.get(name, -1) + 1
        signals = [signal.name for signal in message.signals]
        values = {"COUNTER": count % 16, "ALIVE": count % 8, "CHECKSUM": 0, **self.reports, **self._measured(name)}
        data = bytearray(message.encode({signal: values[signal] for signal in signals}, strict=False))
        if "CHECKSUM" in signals:
            data[7] = _checksum(message.frame_id, bytes(data))
        return CanFrame(message.frame_id, bytes(data))

    def _measured(self, name: str) -> dict[str, float]:
        cosine, sine = math.cos(self.heading_rad), math.sin(self.heading_rad)
        east_m = self.x_m + MOUNT_X_M * cosine - MOUNT_Y_M * sine
        north_m = self.y_m + MOUNT_X_M * sine + MOUNT_Y_M * cosine
        wheel_deg = -math.degrees(self.wheel_rad) * STEERING_RATIO
        coarse_deg = round(wheel_deg, 1)
        rpm = 60.0 / (2 * math.pi * WHEEL_RADIUS_M)
        measured: dict[str, Callable[[], dict[str, float]]] = {
            "INS_POS": lambda: dict(zip(("LAT", "LON"), _geodetic(east_m, north_m), strict=True)),
            "INS_ATT": lambda: {
                "HEADING": (90 - math.degrees(self.heading_rad + MOUNT_RAD)) % 360,
                "SECOND_HEADING": 0.0,
            },
            "WHEELS": lambda: {
                "RL": abs(self.speed_mps - 0.8 * self.yaw_rate_radps) * rpm,
                "RR": abs(self.speed_mps + 0.8 * self.yaw_rate_radps) * rpm,
            },
            "STEER": lambda: {"ANGLE": coarse_deg, "FRACTION": round((wheel_deg - coarse_deg) / 0.0125) * 0.0125},
            "ESP": lambda: {"YAW": abs(math.degrees(self.yaw_rate_radps)), "YAW_SIGN": self.yaw_rate_radps < 0.0},
            "EPS": lambda: {"STATE": 2 if self.drives_itself else 1, "TEMP": 40.0},
            "ACCEL_RPT": lambda: {"ENABLED": self.drives_itself, "OVERRIDE": 0},
            "BRAKE_RPT": lambda: {"ENABLED": self.drives_itself, "OVERRIDE": 0},
        }
        return measured[name]() if name in measured else {}


def _checksum(can_id: int, data: bytes) -> int:
    """Of id, length and the bytes before it."""
    return (can_id // 256 + can_id % 256 + len(data) + sum(data[:7])) % 256


def _geodetic(east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place on the ellipsoid near the origin, by Newton's method."""
    latitude_deg, longitude_deg = ORIGIN_DEG
    for _ in range(4):
        found = _east_north(latitude_deg, longitude_deg)
        by_latitude = (_east_north(latitude_deg + 1e-4, longitude_deg) - found) / 1e-4
        by_longitude = (_east_north(latitude_deg, longitude_deg + 1e-4) - found) / 1e-4
        step = np.linalg.solve(np.column_stack((by_latitude, by_longitude)), np.array((east_m, north_m)) - found)
        latitude_deg, longitude_deg = latitude_deg + float(step[0]), longitude_deg + float(step[1])
    return latitude_deg, longitude_deg


def _east_north(latitude_deg: float, longitude_deg: float) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    phi, lam = (math.radians(angle) for angle in ORIGIN_DEG)
    axes = np.array(
        (
            (-math.sin(lam), math.cos(lam), 0.0),
            (-math.sin(phi) * math.cos(lam), -math.sin(phi) * math.sin(lam), math.cos(phi)),
        )
    )
    return axes @ (_geocentric(latitude_deg, longitude_deg) - _geocentric(*ORIGIN_DEG))


def _geocentric(latitude_deg: float, longitude_deg: float) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    normal_m = _MAJOR_M / math.sqrt(1 - _SQUARED_ECCENTRICITY * math.sin(phi) ** 2)
    across_m = normal_m * math.cos(phi)
    up_m = normal_m * (1 - _SQUARED_ECCENTRICITY) * math.sin(phi)
    return np.array((across_m * math.cos(lam), across_m * math.sin(lam), up_m))
