"""A profile's bus: frames to signals and back, by cantools and checksums of its own.

Every signal has the name that the reference vehicle gives it (`ENABLE`, `POS_X`, …), whatever the DBC calls it, so that
cases and judge use one vocabulary. Messages of a state sample keep their own names.
"""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cantools
from cantools.database.can import Database, Message
from cantools.database.errors import Error as CantoolsError
from vehicle_bus_contract.reference import (
    DRIVE,
    NEUTRAL,
    NO_REQUEST,
    PARK,
    REASONS,
    REVERSE,
    DecodedFrame,
    Frame,
    Limits,
    checksum,
)
from vehicle_bus_contract.reference_fd import checksum as checksum_fd

from hil_bench.places import PROFILES

SIGNAL_NAMES = {
    "state": {
        "x_m": "POS_X",
        "y_m": "POS_Y",
        "heading_rad": "HEADING",
        "speed_mps": "SPEED",
        "accel_mps2": "ACCEL",
        "yaw_rate_radps": "YAW_RATE",
        "lateral_speed_mps": "LATERAL_SPEED",
        "front_wheel_angle_rad": "FRONT_WHEEL_ANGLE",
        "rear_wheel_angle_rad": "REAR_WHEEL_ANGLE",
        "pose_frame": "POSE_FRAME",
        "pose_valid": "POSE_VALID",
    },
    "status": {
        "mode": "MODE",
        "gear": "GEAR",
        "driver_brake": "DRIVER_BRAKE",
        "driver_throttle": "DRIVER_THROTTLE",
        "driver_steer_torque_nm": "DRIVER_STEER_TORQUE",
        "fault_code": "FAULT_CODE",
    },
    "command": {
        "enable": "ENABLE",
        "safe_stop": "SAFE_STOP",
        "accel_mps2": "ACCEL_REQUEST",
        "speed_mps": "SPEED_REQUEST",
        "front_wheel_angle_rad": "FRONT_WHEEL_ANGLE_REQUEST",
        "rear_wheel_angle_rad": "REAR_WHEEL_ANGLE_REQUEST",
        "reason": "REASON",
        "gear_request": "GEAR_REQUEST",
    },
    "body": {"hazard_lights": "HAZARD_LIGHTS"},
    "report": {
        "state": "STATE",
        "reason": "REASON",
        "ref_spatial_index": "REF_SPATIAL_INDEX",
        "ref_temporal_index": "REF_TEMPORAL_INDEX",
        "deadline_misses": "DEADLINE_MISSES",
    },
}
"""Table `[PART.signals]` of a profile: key → the reference vehicle's name of the signal."""

WHEEL_COUNT_RAD = 0.002
"""Rounding differences up to this are no finding, however fine the signal is."""
JUDGED_BY = {
    "limits": (
        "front_wheel_angle_rad",
        "front_wheel_rate_radps",
        "front_wheel_deviation_rad",
        "lateral_accel_mps2",
        "lateral_jerk_mps3",
        "accel_min_mps2",
        "accel_max_mps2",
        "accel_rate_mps3",
        "speed_max_mps",
        "gear_change_speed_mps",
    ),
    "limits.while_engaging": ("front_wheel_rate_radps", "accel_max_mps2"),
    "behavior": ("safe_deceleration_mps2", "stop_jerk_mps3"),
    "geometry": ("wheelbase_m",),
}
"""The keys of a profile that commands are judged by."""
OLD_KEYS = (("limits", "engaging", "while_engaging"), ("timing", "answer_age_s", "max_command_age_s"))
"""Table, name in version 0.1, name: profiles may have either."""
REQUIRED = {"command": ("enable", "safe_stop", "accel_mps2", "front_wheel_angle_rad", "reason"), "status": ("mode",)}
"""Signals that a vehicle must have to be tested."""


REASON_NUMBERS = {name: number for number, name in enumerate(REASONS)}
GEAR_NUMBERS = {"PARK": PARK, "REVERSE": REVERSE, "NEUTRAL": NEUTRAL, "DRIVE": DRIVE, "NO_REQUEST": NO_REQUEST}


class ProfileError(Exception):
    """The profile cannot be used by the bench, and why."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """One message, and the names of its signals here."""

    message: Message
    name: str
    name_of: Mapping[str, str]
    signal_of: Mapping[str, list[str]]


class Wire:
    """One vehicle's bus. Raises `ProfileError` for a profile that does not exist or that cannot be judged."""

    def __init__(self, profile: str) -> None:
        path = Path(profile).resolve() if profile.endswith(".toml") else PROFILES / f"{profile}.toml"
        try:
            text = path.read_bytes()
            self.profile: dict[str, Any] = tomllib.loads(text.decode())
            for table, old, new in OLD_KEYS:
                if old in self.profile.get(table, {}):
                    self.profile[table].setdefault(new, self.profile[table][old])
            dbc = path.parent / self.profile["dbc"]
            database = cantools.database.load_file(dbc, strict=True)
        except (OSError, ValueError, KeyError, CantoolsError) as error:
            raise ProfileError(f"{path}: {error}") from error
        if not isinstance(database, Database):
            raise ProfileError(f"{dbc}: is no CAN database")
        self.path, self.dbc = path, dbc
        self.hash = hashlib.sha256(text + dbc.read_bytes()).hexdigest()
        try:
            self.name = str(self.profile["name"])
            self.is_fd = bool(self.profile["bus"]["fd"])
            self._bind(database)
            self._protect()
            self.limits = self._limits()
        except KeyError as error:
            raise ProfileError(f"{path}: {error} is missing") from None
        self.names = {layout.message.frame_id: name for name, layout in self._layouts.items()}
        self.ids = {name: layout.message.frame_id for name, layout in self._layouts.items()}
        self.lengths = {name: layout.message.length for name, layout in self._layouts.items()}
        self.reports = tuple(name for name in ("BODY_COMMAND", "CONTROLLER_STATUS") if name in self.ids)
        """What a device sends besides its commands; optional."""
        self.of_device = (*self.command, *self.reports)
        self._numbers = self._enumerations()

    def pack(self, name: str, counter: int, **values: float) -> Frame:
        """A frame with a good checksum; missing signals are 0; values wrap as on the wire."""
        layout = self._layouts[name]
        signals: dict[str, float] = dict.fromkeys((signal.name for signal in layout.message.signals), 0)
        signals[self._counter_signal] = counter
        for signal_name, value in values.items():
            for signal in layout.signal_of.get(signal_name, ()):
                signals[signal] = value
        data = layout.message.encode(signals, strict=False, padding=False)
        return self.seal(Frame(0, layout.message.frame_id, data, is_fd=self.is_fd))

    def seal(self, frame: Frame, data_id: int | None = None) -> Frame:
        """The frame with the checksum of its content, by its own or another data id."""
        owner = self._data_ids[self.names[frame.can_id]] if data_id is None else data_id
        crc = self._checksum(owner, frame.data).to_bytes(self.crc_bytes, "little")
        return replace(frame, data=crc + frame.data[self.crc_bytes :])

    def is_well_formed(self, frame: Frame) -> bool:
        """True if a frame with a known identifier has the right kind and length."""
        special = frame.is_extended or frame.is_remote or frame.is_error or frame.is_fd is not self.is_fd
        return not special and len(frame.data) == self.lengths[self.names[frame.can_id]]

    def intact(self, frame: Frame) -> DecodedFrame | None:
        """The decoded frame, if it is a known message with a good checksum; else None."""
        name = self.names.get(frame.can_id)
        if name is None or not self.is_well_formed(frame) or frame != self.seal(frame):
            return None
        layout = self._layouts[name]
        raw = layout.message.decode_simple(frame.data, decode_choices=False)
        signals = {signal_name: float(raw[signal]) for signal, signal_name in layout.name_of.items()}  # type: ignore[arg-type]
        return DecodedFrame(frame.stamp_ns, name, signals)

    def number(self, signal_name: str, name: str) -> int:
        """The raw number of an enumeration's name. Raises `ProfileError` for an unknown name."""
        try:
            return self._numbers[signal_name][name]
        except KeyError:
            raise ProfileError(f"{self.dbc}: {signal_name} has no value {name}") from None

    def has(self, signal_name: str) -> bool:
        """True if this vehicle has the signal."""
        return any(signal_name in layout.signal_of for layout in self._layouts.values())

    @property
    def measures_wheels(self) -> bool:
        """True if the state contains the front wheels' angle."""
        return "front_wheel_angle_rad" in self.profile["state"]["signals"]

    @property
    def wheel_count_rad(self) -> float:
        """Tolerance of the commanded front wheels, for rounding."""
        layout = self._layouts[self.command[-1]]
        signal = layout.message.get_signal_by_name(layout.signal_of["FRONT_WHEEL_ANGLE_REQUEST"][0])
        return max(WHEEL_COUNT_RAD, float(signal.scale))

    def free_block(self) -> int:
        """The first of 256 unused identifiers of low priority; above 0x6FF is diagnosis."""
        used = {can_id >> 8 for can_id in self.names}
        return next(block << 8 for block in range(6, -1, -1) if block not in used)

    def greatest(self, signal_name: str) -> tuple[float, float]:
        """The DBC's maximum of a signal of sample or status, and the maximum that its bits can encode."""
        layout = self._layouts[self.part_of(signal_name)]
        signal = layout.message.get_signal_by_name(layout.signal_of[signal_name][0])
        raw = (1 << signal.length - signal.is_signed) - 1
        most_of_bits = float(signal.scale * raw + signal.offset)
        return (most_of_bits if signal.maximum is None else float(signal.maximum)), most_of_bits

    def part_of(self, signal_name: str) -> str:
        """The message of sample or status that carries a signal. Raises `ProfileError` if none does."""
        for name in (*self.sample, "VEHICLE_STATUS"):
            if signal_name in self._layouts[name].signal_of:
                return name
        raise ProfileError(f"{self.path}: no message carries {signal_name}")

    def _bind(self, database: Database) -> None:
        """Find the messages, and map their signals to the reference vehicle's names."""
        words: dict[str, dict[str, str]] = {}
        homes: dict[str, list[str]] = {}
        for part, vocabulary in SIGNAL_NAMES.items():
            bound = self.profile.get(part, {}).get("signals", {})
            for key in REQUIRED.get(part, ()):
                if key not in bound:
                    raise ProfileError(
                        f"{self.path}: [{part}.signals] {key} is missing: commands cannot be judged without it"
                    )
            for key, signal_name in vocabulary.items():
                signals = bound.get(key, ())
                for signal in (signals,) if isinstance(signals, str) else signals:
                    message, _, short = signal.partition(".")
                    words.setdefault(message, {})[short] = signal_name
                    homes.setdefault(part, []).append(message)
        commands = list(dict.fromkeys(homes["command"]))
        if len(commands) > 2:
            raise ProfileError(
                f"{self.path}: commands in more than two messages ({', '.join(commands)}) cannot be judged"
            )
        if len(commands) == 2:
            accel = self.profile["command"]["signals"]["accel_mps2"].partition(".")[0]
            commands.sort(key=lambda name: name != accel)
        known = dict(
            zip(commands, ("DRIVE_COMMAND", "STEER_COMMAND") if len(commands) == 2 else ("COMMAND",), strict=True)
        )
        known |= dict.fromkeys(homes.get("body", ()), "BODY_COMMAND")
        known |= dict.fromkeys(homes.get("report", ()), "CONTROLLER_STATUS")
        known[self.profile["status"]["signals"]["mode"].partition(".")[0]] = "VEHICLE_STATUS"
        self.sample: tuple[str, ...] = tuple(self.profile["state"]["sample"])
        self.command = tuple(known[name] for name in commands)
        counter, crc = self.profile["e2e"]["counter_signal"], self.profile["e2e"]["crc_signal"]
        self._counter_signal = counter
        self._layouts: dict[str, _Layout] = {}
        self._data_ids: dict[str, int] = {}
        for message, bound in words.items():
            layout = database.get_message_by_name(message)
            bound = {counter: "COUNTER"} | bound
            signal_of: dict[str, list[str]] = {}
            for signal, signal_name in bound.items():
                signal_of.setdefault(signal_name, []).append(signal)
            for signal in layout.signals:
                if signal.name not in (*bound, crc):
                    signal_of[signal.name] = [signal.name]
                    bound[signal.name] = signal.name
            name = known.get(message, message)
            self._layouts[name] = _Layout(layout, name, bound, signal_of)
            self._data_ids[name] = self.profile["e2e"]["data_ids"][message]

    def _protect(self) -> None:
        kind = (self.profile["e2e"]["profile"], self.profile["e2e"].get("data_id_mode", "BOTH"))
        if kind == (1, "BOTH"):
            self.crc_bytes, self.counters, self._checksum = 1, 15, checksum
        elif kind[0] == 5:
            self.crc_bytes, self.counters, self._checksum = 2, 256, checksum_fd
        else:
            raise ProfileError(
                f"{self.path}: the bench checks end-to-end profiles 1 (BOTH) and 5, not {kind[0]} ({kind[1]})"
            )

    def _limits(self) -> Limits:
        own = self.profile["limits"]
        for table, keys in JUDGED_BY.items():
            numbers = self.profile
            for part in table.split("."):
                numbers = numbers[part]
            for key in keys:
                if key not in numbers:
                    raise ProfileError(f"{self.path}: [{table}] {key} is missing: commands cannot be judged without it")
        return Limits(
            steer_rad=own["front_wheel_angle_rad"],
            steer_rate_radps=own["front_wheel_rate_radps"],
            accel_range_mps2=(own["accel_min_mps2"], own["accel_max_mps2"]),
            gear_change_mps=own["gear_change_speed_mps"],
        )

    def _enumerations(self) -> dict[str, dict[str, int]]:
        numbers: dict[str, dict[str, int]] = {}
        for layout in self._layouts.values():
            for signal_name, signals in layout.signal_of.items():
                choices: Mapping[int, object] = layout.message.get_signal_by_name(signals[0]).choices or {}
                numbers.setdefault(signal_name, {}).update({str(name): int(number) for number, name in choices.items()})
        for signal_name, table in (("MODE", "modes"), ("GEAR", "gears")):
            for theirs, ours in self.profile["status"].get(table, {}).items():
                numbers[signal_name][ours] = numbers[signal_name][theirs]
        for signal_name, known in (("REASON", REASON_NUMBERS), ("GEAR_REQUEST", GEAR_NUMBERS)):
            for name, number in numbers.get(signal_name, {}).items():
                if known.get(name) != number:
                    raise ProfileError(
                        f"{self.dbc}: {signal_name} {number} {name}: must be numbered as the reference vehicle's"
                    )
        return numbers
