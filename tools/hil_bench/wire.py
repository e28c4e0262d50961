"""A profile's bus: frames to signals and back, by cantools and checksums of its own.

Every signal has the name that the reference vehicle gives it (`ENABLE`, `POS_X`, …), whatever the DBC calls it, so that
cases and judge use one vocabulary. Messages of a state sample keep their own names.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cantools.database.can import Database, Message
from vehicle_bus_contract.reference import (
    DRIVE,
    GREATEST_STEP,
    NEUTRAL,
    NO_REQUEST,
    PARK,
    REASONS,
    REVERSE,
    DecodedFrame,
    Frame,
    checksum,
)
from vehicle_bus_contract.reference_fd import checksum as checksum_fd

from hil_bench.profile import ProfileError, read_files, read_limits
from hil_bench.vocabulary import PERIOD_S, SIGNAL_NAMES, Wait

WHEEL_COUNT_RAD = 0.002
"""Rounding differences up to this are no finding, however fine the signal is."""
REQUIRED = {"command": ("enable", "safe_stop", "accel_mps2", "front_wheel_angle_rad", "reason"), "status": ("mode",)}
"""Signals that a vehicle must have to be tested."""


REASON_NUMBERS = {name: number for number, name in enumerate(REASONS)}
GEAR_NUMBERS = {"PARK": PARK, "REVERSE": REVERSE, "NEUTRAL": NEUTRAL, "DRIVE": DRIVE, "NO_REQUEST": NO_REQUEST}


@dataclass(frozen=True, slots=True, kw_only=True)
class Protection:
    """What a receiver can see of a message beside its content."""

    has_checksum: bool
    covers_identity: bool
    """The checksum also covers which message it is."""
    counters: int
    """Values of the counter; 0 without one."""
    max_step: int


@dataclass(frozen=True, slots=True)
class _Layout:
    """One message, and the names of its signals here."""

    message: Message
    name: str
    name_of: Mapping[str, str]
    signal_of: Mapping[str, list[str]]


class Wire:
    """One vehicle's bus. Raises `ProfileError` for a profile that does not exist or that cannot be judged."""

    tells_reasons = True
    """False: commands have no signal for their reason."""
    tells_enable = True
    """False: commands are always to be obeyed; a release is their end."""
    has_stop_signal = True
    """False: a stop is inferred from what is commanded."""
    commands_acceleration = True
    """False: a speed is commanded instead."""
    commands_angle = True
    """False: a yaw rate is commanded, which is no angle at low speed."""
    accel_slack_mps2, engaging_slack_mps2, speed_slack_mps = 0.002, 1e-9, 0.0
    """Tolerances of commanded values, for rounding."""
    can_reverse = measures_backwards = True
    tow_mps2 = 14.0
    """Acceleration by a tow that makes the vehicle too fast whatever it brakes."""
    watchdog_s = 0.1
    """The vehicle stops itself when a command is missing for this long."""
    enable_period_s = 0.0
    """Of the message that says whether commands are enabled; 0 where each command says so."""
    speed_share = length_share = along_mps2 = 1.0
    """By which the speeds and lengths of the cases' routes are multiplied for this vehicle, and their acceleration."""
    wheel_hold_s = 0.0
    """How much longer than a sample's period a commanded wheel angle lasts."""
    ticks_per_command = ticks_per_sample = 1
    unjudged: Mapping[str, str] = {}
    """The kinds of `judges.KINDS` that this vehicle's bus has nothing for, and what it lacks."""
    is_counted = True
    """The messages of a sample share a counter."""
    frame_id = "map"
    buses: tuple[str, ...] = ("",)
    """Their names; the only one needs none."""
    further_files: tuple[Path, ...] = ()
    """What the profile names besides its first DBC: further DBCs, and Python files with checksums."""
    loses_its_place = False
    """Its position is dead reckoning, which ends with a gap in its state."""

    def __init__(self, profile: str) -> None:
        files = read_files(profile)
        self.path, self.dbc, self.profile, self.hash = files.path, files.dbc, files.profile, files.hash
        path = files.path
        try:
            self.name = str(self.profile["name"])
            self.is_fd = bool(self.profile["bus"]["fd"])
            self._bind(files.database)
            self._protect()
            self.limits = read_limits(self.profile, self.path)
        except KeyError as error:
            raise ProfileError(f"{path}: {error} is missing") from None
        self.names = {layout.message.frame_id: name for name, layout in self._layouts.items()}
        self.ids = {name: layout.message.frame_id for name, layout in self._layouts.items()}
        self.lengths = {name: layout.message.length for name, layout in self._layouts.items()}
        self.reports: tuple[str, ...] = tuple(
            name for name in ("BODY_COMMAND", "CONTROLLER_STATUS") if name in self.ids
        )
        """What a device sends besides its commands; optional."""
        self.of_device: tuple[str, ...] = (*self.command, *self.reports)
        timing = self.profile["timing"]
        periods_s = {"BODY_COMMAND": timing["body_period_s"], "CONTROLLER_STATUS": timing["report_period_s"]}
        self.besides_s: Mapping[str, float] = {name: float(periods_s[name]) for name in self.reports}
        """The periods of what a device sends besides its commands, s."""
        self.status: tuple[str, ...] = ("VEHICLE_STATUS",)
        """The messages outside the sample that say who drives."""
        self.period_s = self.command_period_s = PERIOD_S
        self.later_s = dict.fromkeys(Wait, 0.0)
        """How much later than the reference vehicle's a reaction may come."""
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

    def name_of(self, frame: Frame) -> str | None:
        """The message of a frame's identifier, whatever its content."""
        return None if frame.is_extended else self.names.get(frame.can_id)

    def break_checksum(self, frame: Frame) -> Frame:
        """Flip one bit of the checksum."""
        return replace(frame, data=bytes((frame.data[0] ^ 0x10,)) + frame.data[1:])

    def covered_bits(self, frame: Frame) -> list[int]:
        """The bits (8 · byte + bit) that the checksum covers."""
        return list(range(8 * self.crc_bytes, 8 * len(frame.data)))

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

    def bus_of(self, name: str) -> int:  # noqa: ARG002
        """The number of a message's bus."""
        return 0

    def ids_on(self, number: int) -> Collection[int]:  # noqa: ARG002
        """The identifiers to receive on a bus."""
        return self.names

    def find_stray(self, frame: Frame) -> str:  # noqa: ARG002
        """The device's message that a frame on another bus than that message's has the identifier of; empty: none."""
        return ""

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

    def has_spare(self, signal_name: str, number: int) -> bool:
        """True if an enumeration has no name for a number that its bits can carry."""
        return self.greatest(signal_name)[1] >= number and number not in self._numbers[signal_name].values()

    def can_report(self, mode: str) -> bool:
        """True if the vehicle can say that it is in this mode."""
        return mode in self._numbers["MODE"]

    def protection_of(self, name: str) -> Protection:  # noqa: ARG002
        """How a message is protected."""
        return Protection(has_checksum=True, covers_identity=True, counters=self.counters, max_step=GREATEST_STEP)

    def lights_in(self, decoded: DecodedFrame) -> bool | None:
        """Whether a frame of the device switches the hazard lights on; None for other frames."""
        return bool(decoded["HAZARD_LIGHTS"]) if "HAZARD_LIGHTS" in decoded.signals else None

    @property
    def has_lights(self) -> bool:
        """True if the vehicle has hazard lights."""
        return self.has("HAZARD_LIGHTS")

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
        self.trigger = self.sample[-1]
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
