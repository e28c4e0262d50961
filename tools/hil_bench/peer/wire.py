"""Any profile's bus: fields to the vehicle's frames, and the device's frames to commands."""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from vehicle_bus_contract.reference import DecodedFrame, Frame

from hil_bench.peer import allowances
from hil_bench.peer.command import CommandReader
from hil_bench.peer.fields import Fields
from hil_bench.peer.layout import EXTENDED, read_layout
from hil_bench.peer.mode import ACTIONS, ORDER
from hil_bench.peer.protection import write_bits
from hil_bench.peer.roles import read_roles
from hil_bench.peer.signals import field_signals, sources_of
from hil_bench.profile import ProfileError, read_files, read_limits
from hil_bench.vocabulary import SIGNAL_NAMES
from hil_bench.wire import WHEEL_COUNT_RAD, Protection, Wire

LONGEST_TICK_S = 0.02
MODE_NUMBERS = {name.upper(): number for name, number in ORDER.items()}
ACTION_OF = dict(zip(("driver_brake", "driver_throttle", "driver_steer_torque_nm"), ACTIONS, strict=True))
OPPOSED = {"pedals": ("throttle", "brake"), "drive_and_brake": ("drive_mps2", "brake_mps2")}
WHEEL_FIELDS = {"curvature": "curvature_per_m", "yaw_rate": "yaw_rate_radps"}
KEYS = {name: key for part in ("state", "status", "command") for key, name in SIGNAL_NAMES[part].items()}
"""The reference vehicle's name of a signal → key of the profile."""
GEOGRAPHIC_KEYS = {"POS_X": "longitude_deg", "POS_Y": "latitude_deg"}
"""Of a vehicle that sends its position on the ellipsoid; x is to the east."""

WHOLE_TURN_RAD = 0.999 * math.tau


class PeerWire(Wire):
    """One vehicle's bus, by any profile. Raises `ProfileError` for one that the bench cannot play or judge."""

    def __init__(self, profile: str) -> None:
        files = read_files(profile, strict=False)
        self.path, self.dbc, self.profile, self.hash = files.path, files.dbc, files.profile, files.hash
        self.buses, self.further_files = files.buses, files.further_files
        if not self.profile.get("command", {}).get("signals"):
            raise ProfileError(
                f"{files.path}: has no [command]: the vehicle can only be watched, nothing can be judged"
            )
        try:
            self.name = str(self.profile["name"])
            self.is_fd = bool(self.profile.get("bus", {}).get("fd", False))
            self.layout = read_layout(files)
            self.limits = read_limits(self.profile, self.path)
            self.profile["limits"]["speed_max_mps"] = allowances.speed_max_mps(self.profile)
            self._take_roles()
            self._take_allowances()
        except KeyError as error:
            raise ProfileError(f"{files.path}: {error} is missing, or the DBC does not have it") from None
        except (AttributeError, TypeError, ValueError) as error:
            raise ProfileError(f"{files.path}: is no profile ({error}); vehicle-iface check-dbc says why") from None

    # --- frames

    def pack(self, name: str, counter: int, **values: float) -> Frame:
        """A frame with a good checksum: of the vehicle by fields, of both ends by MESSAGE.SIGNAL."""
        told = {} if name not in self.periods_s else self.fields.write(values)
        return self.pack_signals(
            name, counter, {**told, **{dotted: v for dotted, v in values.items() if "." in dotted}}
        )

    def pack_signals(self, name: str, counter: int, values: Mapping[str, float]) -> Frame:
        """A frame with a good checksum, by MESSAGE.SIGNAL; those of other messages are ignored."""
        message, protection = self.layout.messages[name], self.layout.protections[name]
        signals = dict(self.layout.initial[name])
        for dotted, short in self.layout.dotted[name]:
            if dotted in values:
                signals[short] = self.signals[dotted].to_dbc(values[dotted])
        branches = self.layout.branches[name] if name in self.periods_s else ()
        signals |= branches[counter % len(branches)] if branches else {}
        data = message.encode(signals, strict=False, padding=False)
        if protection.counters:
            data = write_bits(data, protection.counter_bits, counter % protection.counters)
        is_extended, is_fd, bus = message.is_extended_frame, self.layout.fd[name], self.layout.buses[name]
        return self.seal(Frame(0, message.frame_id, data, is_extended=is_extended, is_fd=is_fd, bus=bus))

    def seal(self, frame: Frame, data_id: int | None = None) -> Frame:
        """The frame with the checksum of its content, by its own or another data id."""
        protection = self.layout.protections[self.name_of(frame) or ""]
        data = protection.seal(frame.can_id, frame.data, is_extended=frame.is_extended, data_id=data_id)
        return replace(frame, data=data)

    def name_of(self, frame: Frame) -> str | None:
        """The message of a frame's identifier; of a J1939 message whatever its priority."""
        return self.layout.name_of(frame)

    def break_checksum(self, frame: Frame) -> Frame:
        """Flip one bit of the checksum."""
        place = self.layout.protections[self.name_of(frame) or ""].checksum_bits[0]
        data = bytearray(frame.data)
        data[place // 8] ^= 1 << place % 8
        return replace(frame, data=bytes(data))

    def covered_bits(self, frame: Frame) -> list[int]:
        """The bits that the checksum covers."""
        own = self.layout.protections[self.name_of(frame) or ""].checksum_bits
        return [place for place in range(8 * len(frame.data)) if place not in own]

    def is_well_formed(self, frame: Frame) -> bool:
        """True if a frame with a known identifier has the right kind and length."""
        name = self.name_of(frame) or ""
        special = frame.is_remote or frame.is_error or frame.is_fd is not self.layout.fd[name]
        return not special and len(frame.data) == self.lengths[name]

    def intact(self, frame: Frame) -> DecodedFrame | None:
        """The decoded frame, if it is a known message with a good checksum: MESSAGE.SIGNAL and fields → values."""
        name = self.name_of(frame)
        if name is None or not self.is_well_formed(frame) or frame != self.seal(frame):
            return None
        raw: Mapping[str, Any] = self.layout.messages[name].decode_simple(
            frame.data, decode_choices=False, scaling=False
        )
        found = {}
        for dotted, short in self.layout.dotted[name]:
            signal = self.signals[dotted]
            if short in raw and raw[short] not in signal.missing:
                found[dotted] = signal.from_raw(raw[short])
        if name in self.periods_s:
            found |= self.fields.read_alone(name, found)
        if self.layout.protections[name].counters:
            found["COUNTER"] = float(self.layout.protections[name].counter_of(frame.data))
        return DecodedFrame(frame.stamp_ns, name, found)

    def mode_of(self, values: Mapping[str, float]) -> int:
        """The mode that the newest values report, by the contract's numbers."""
        fault_code, mode = self.fields.status.get("fault_code"), self.fields.status.get("mode")
        if fault_code is not None and values.get(fault_code, 0.0) != 0.0:
            return MODE_NUMBERS["FAULT"]
        if mode is None:
            return self.fields.conditions.mode_of(values)
        word = self.signals[mode].word_of(values.get(mode, -1.0))
        return MODE_NUMBERS.get(self.profile["status"].get("modes", {}).get(word, word), MODE_NUMBERS["FAULT"])

    # --- what the vehicle has

    def has(self, signal_name: str) -> bool:
        """True if this vehicle has the signal, or something else that says it."""
        key = KEYS.get(signal_name, "")
        if signal_name in ("POS_X", "POS_Y"):
            return self.fields.place.source != "odometry"
        if signal_name == "POSE_VALID" and self.fields.conditions.valid is not None:
            return True
        if key in ACTION_OF and ACTION_OF[key] in self.fields.conditions.driver:
            return True
        return key in self.fields.forms or key in self.fields.status or key in field_signals(self.profile)

    def has_spare(self, signal_name: str, number: int) -> bool:
        """True if an enumerated mode has no name for a number that its bits can carry."""
        dotted = self.fields.status.get(KEYS[signal_name])
        if dotted is None:
            return False
        return number not in self.signals[dotted].names.values() and self.signals[dotted].bits_range[1] >= number

    def can_report(self, mode: str) -> bool:
        """True if the vehicle can say that it is in this mode."""
        if mode == "FAULT" and "fault_code" in self.fields.status:
            return True
        if "mode" in self.fields.status:
            return mode in self._numbers["MODE"]
        return self.fields.conditions.can_report(MODE_NUMBERS[mode])

    def number(self, signal_name: str, name: str) -> int:
        """The number of an enumeration's name; of a mode that only conditions tell, the contract's."""
        if signal_name == "MODE" and "mode" not in self.fields.status:
            return MODE_NUMBERS[name]
        try:
            return self._numbers[signal_name][name]
        except KeyError:
            raise ProfileError(f"{self.dbc}: {signal_name} has no value {name}") from None

    def part_of(self, signal_name: str) -> str:
        """The message that carries a field, or the first of several. Raises `ProfileError` if none does."""
        keys = GEOGRAPHIC_KEYS if self.fields.place.source == "geographic" else {}
        key = keys.get(signal_name) or KEYS.get(signal_name, "")
        sources = (*sources_of(self.fields.forms.get(key)), *sources_of(self.fields.status.get(key)))
        if sources:
            return sources[0].partition(".")[0]
        if self.has(signal_name) or signal_name == "MODE":
            return (*self.status, *self.sample)[0]
        raise ProfileError(f"{self.path}: no message carries {signal_name}")

    def greatest(self, signal_name: str) -> tuple[float, float]:
        """The profile's maximum of a field, and the maximum that it can be told with.

        A heading of any size is told by the turn that is in range, where the range has one.
        """
        signal = self.signals[sources_of(self.fields.forms[KEYS[signal_name]])[0]]
        low, high = sorted(map(signal.to_field, (signal.low, signal.high)))
        if signal_name == "HEADING" and high - low >= WHOLE_TURN_RAD:
            return high, high
        return high, max(map(signal.to_field, signal.bits_range))

    def protection_of(self, name: str) -> Protection:
        """How a message is protected."""
        own = self.layout.protections[name]
        return Protection(
            has_checksum=own.has_checksum,
            covers_identity=own.covers_identity,
            counters=own.counters,
            max_step=own.max_step,
        )

    def lights_in(self, decoded: DecodedFrame) -> bool | None:
        """Whether a frame of the device switches the hazard lights on; None for other frames."""
        form = self.profile.get("body", {}).get("signals", {}).get("hazard_lights")
        found = [decoded[dotted] for dotted in sources_of(form) if dotted in decoded.signals]
        return any(found) if found else None

    @property
    def has_lights(self) -> bool:
        """True if the vehicle has hazard lights."""
        return "hazard_lights" in self.profile.get("body", {}).get("signals", {})

    def carriers(self, field: str) -> tuple[str, ...]:
        """The signals that carry a field of the command."""
        return field_signals(self.profile).get(field, ())

    def max_age_s(self, name: str) -> float:
        """How old a part of a sample may be."""
        stated = self.profile["state"].get("max_age_s", {})
        own = stated.get(name) if isinstance(stated, Mapping) else stated
        return float(self.profile["timing"]["state_stale_s"] if own is None else own)

    def bus_of(self, name: str) -> int:
        """The number of a message's bus."""
        return self.layout.buses[name]

    def ids_on(self, number: int) -> Collection[int]:
        """The identifiers to receive on a bus; also those of the device, which belong on another."""
        own = (self.ids[name] for name, bus in self.layout.buses.items() if bus == number)
        return sorted({*own, *(self.ids[name] for name in self.of_device)})

    def find_stray(self, frame: Frame) -> str:
        """The device's message that a frame on another bus than that message's has the identifier of; empty: none."""
        if len(self.buses) == 1 or self.name_of(frame) is not None:
            return ""
        names = (self.name_of(replace(frame, bus=number)) for number in range(len(self.buses)))
        return next((name for name in names if name in self.of_device), "")

    def free_block(self) -> int:
        """The first of 256 unused identifiers of low priority; above 0x6FF is diagnosis."""
        used = {can_id >> 8 for can_id in self.names if can_id < EXTENDED}
        return next(block << 8 for block in range(6, -1, -1) if block not in used)

    @property
    def measures_wheels(self) -> bool:
        """True if one message of the vehicle contains the front wheels' angle."""
        return len({name.partition(".")[0] for name in sources_of(self.fields.forms.get("front_wheel_angle_rad"))}) == 1

    @property
    def wheel_count_rad(self) -> float:
        """Tolerance of the commanded front wheels, for rounding."""
        per_m = WHEEL_FIELDS.get(self.reader.lateral)
        if per_m is None:
            return max(WHEEL_COUNT_RAD, self.reader.count("front_wheel_angle_rad"))
        return max(WHEEL_COUNT_RAD, self.reader.count(per_m) * float(self.profile["geometry"]["wheelbase_m"]))

    def hold_s(self, *fields: str) -> float:
        """How much longer than a command's shortest period the slowest of these fields keeps its value."""
        messages = (name.partition(".")[0] for field in fields for name in self.carriers(field))
        periods_s = [self.roles.periods_of_commands[message] for message in messages]
        return max(periods_s, default=self.command_period_s) - self.command_period_s

    def wheel_slack_rad(self, rate_radps: float) -> float:
        """Tolerance of a wheel rate: commands that are slower than samples step by as much."""
        return rate_radps * self.wheel_hold_s + self.wheel_count_rad * (self.wheel_hold_s > 0.0)

    # --- from the profile

    def _take_roles(self) -> None:
        layout, roles = self.layout, read_roles(self.profile, self.layout)
        self.signals = layout.signals
        self.ids, self.names = dict(layout.ids), dict(layout.names)
        self.lengths = {name: message.length for name, message in layout.messages.items()}
        self.fields = Fields(self.profile, layout.signals)
        self.reader = CommandReader(self.profile, layout.signals)
        self.roles = roles
        self.sample, self.status, self.command = roles.sample, roles.status, roles.command
        self.periods_s, self.trigger, self.is_counted = roles.periods_s, roles.trigger, roles.is_counted
        self.of_device = roles.of_device
        self.reports = roles.reports
        self.besides_s = roles.besides_s
        self.frame_id = self.fields.place.frame_id
        self.loses_its_place = self.fields.place.source == "odometry"
        self.counters = min((layout.protections[name].counters for name in self.sample), default=0) or 1
        self.tells_reasons, self.has_stop_signal = self.reader.has_reason, self.reader.has_stop
        self.tells_enable = bool(self.reader.enabling_messages)
        form = self.reader.longitudinal
        self.commands_acceleration, self.commands_angle = form != "speed", self.reader.lateral != "yaw_rate"
        self.opposed = OPPOSED.get(form, ())
        speeds = sources_of(self.fields.forms["speed_mps"])
        is_signed = (
            isinstance(self.fields.forms["speed_mps"], Mapping) and "negative_if" in self.fields.forms["speed_mps"]
        )
        self.measures_backwards = is_signed or all(self.signals[name].bits_range[0] < 0.0 for name in speeds)
        by_sign = form in ("speed", "acceleration") and self.reader.is_signed
        self.can_reverse = self.measures_backwards and (self.reader.has_gear or by_sign)
        self._numbers = self._read_numbers()

    def _take_allowances(self) -> None:
        profile, roles = self.profile, self.roles
        self.period_s, self.command_period_s = float(profile["timing"]["sample_period_s"]), roles.command_period_s
        self.ticks_per_sample = math.ceil(self.period_s / LONGEST_TICK_S)
        self.ticks_per_command = round(self.command_period_s / self.period_s * self.ticks_per_sample)
        self.watchdog_s = max(roles.watched_s.values())
        self.enable_period_s = allowances.enable_period_s(profile, self.reader)
        self.later_s = allowances.later_s(profile, roles, self.reader)
        self.accel_slack_mps2 = self.engaging_slack_mps2 = allowances.accel_slack_mps2(profile, self.reader)
        measured_mps2 = self.greatest("ACCEL")[0] if self.has("ACCEL") else math.inf
        self.tow_mps2 = allowances.tow_mps2(profile, self.reader, measured_mps2)
        self.wheel_hold_s = self.hold_s(WHEEL_FIELDS.get(self.reader.lateral, "front_wheel_angle_rad"))
        self.speed_slack_mps = 2.0 * self.reader.count("speed_mps")
        self.along_mps2 = allowances.along_mps2(profile)
        self.length_share = allowances.length_share(profile)
        self.speed_share = allowances.speed_share(profile, self.length_share)
        self.unjudged = allowances.find_unjudged(self.layout, roles, self.reader)

    def _read_numbers(self) -> dict[str, dict[str, int]]:
        """Names of modes, gears and frames by the reference vehicle's words."""
        status, state = self.profile.get("status", {}), self.profile["state"]
        frames = {theirs: ours.upper() for theirs, ours in state.get("frames", {}).items()}
        bound = (
            ("MODE", self.fields.status.get("mode"), status.get("modes", {})),
            ("GEAR", self.fields.status.get("gear"), status.get("gears", {})),
            ("POSE_FRAME", state["signals"].get("pose_frame"), frames),
        )
        numbers = {}
        for signal_name, dotted, words in bound:
            if dotted is not None:
                theirs = reversed(list(self.signals[dotted].names.items()))
                numbers[signal_name] = {words.get(word, word): number for word, number in theirs}
        return numbers
