"""A DBC and the profile that gives it a meaning, loaded together and checked against each other
both ways.

`load_database(profile)` gives the `VehicleDatabase` of bound messages: for each signal of a message
the program's name of it, so that decoder and encoder never look one up again. Everything that does
not fit is a `ConfigError` with file, line and what is allowed, before the first frame.
"""

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, IntEnum
from pathlib import Path

import msgspec
from cantools.database import Message, Signal
from cantools.database.can import Database

from vehicle_iface import checks
from vehicle_iface.codec.compiled import MessageCodec
from vehicle_iface.codec.dbc_file import DbcFile, read_dbc
from vehicle_iface.codec.e2e import Protection
from vehicle_iface.codec.layout import Layout
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.profile import Profile
from vehicle_iface.reason import Reason
from vehicle_iface.status import ControllerState, Gear, VehicleMode


class Role(Enum):
    """What a message is to the program."""

    SAMPLE = "sample"
    """Received: a part of one sample of the state."""
    STATUS = "status"
    """Received: mode, gear, driver."""
    EXTRA = "extra"
    """Received: further fields of state or status."""
    COMMAND = "command"
    """Sent, one frame for each computed command."""
    BODY = "body"
    """Sent: lights and horn."""
    REPORT = "report"
    """Sent: what the controller says about itself."""


_SENT = (Role.COMMAND, Role.BODY, Role.REPORT)
PERIODS = {
    Role.SAMPLE: "sample_period_s",
    Role.STATUS: "status_period_s",
    Role.COMMAND: "command_period_s",
    Role.BODY: "body_period_s",
    Role.REPORT: "report_period_s",
}
"""Of the messages of a role, in the profile's timing."""
UNITS: Mapping[str, tuple[str, ...]] = {
    "m": ("m",),
    "rad": ("rad",),
    "mps": ("m/s",),
    "mps2": ("m/s^2", "m/s²", "m/s2", "m/s/s", "m/(s^2)"),
    "radps": ("rad/s",),
    "nm": ("N*m", "N·m", "Nm", "N.m", "N m"),
}
"""The last part of a field's name, and how a DBC may write that unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundMessage:
    """A message of the DBC with the program's names for its signals."""

    name: str
    role: Role
    can_id: int
    is_extended: bool
    is_fd: bool
    length: int
    """Payload, bytes."""
    codec: MessageCodec
    fields: tuple[str, ...]
    """The program's name of each value, in the order of `codec.names`; "" where it has none."""
    constants: tuple[float | int, ...]
    """What is sent where there is no field; checksum and counter are written afterwards."""
    to_program: tuple[Mapping[int, int] | None, ...]
    """For each value the program's number of the DBC's, None where they are the same."""
    to_bus: tuple[Mapping[int, int] | None, ...]
    """For each value the DBC's number of the program's, None where they are the same."""
    protection: Protection | None
    max_counter_step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleDatabase:
    """All that the program knows about one vehicle's messages."""

    profile: Profile
    sample: tuple[BoundMessage, ...]
    """One sample: these, with the same counter; in the order of the profile."""
    status: BoundMessage
    """The message with the vehicle's mode."""
    extra: tuple[BoundMessage, ...]
    """Further received messages with fields of state or status."""
    commands: tuple[BoundMessage, ...]
    body: BoundMessage | None
    report: BoundMessage | None
    frames: Mapping[int, str]
    """Number of `pose_frame` on the bus = frame of reference."""
    resolutions: Mapping[str, float]
    """The step of each bound command field on the wire, in its unit; 0 for a float."""
    report_ranges: Mapping[str, tuple[float, float]]
    """What each bound report field can say."""

    @property
    def received(self) -> tuple[BoundMessage, ...]:
        """What the vehicle sends."""
        return (*self.sample, self.status, *self.extra)

    @property
    def sent(self) -> tuple[BoundMessage, ...]:
        """What the program sends."""
        return (*self.commands, *(message for message in (self.body, self.report) if message is not None))


def load_database(profile: Profile) -> VehicleDatabase:
    """The profile's DBC, bound and checked; `ConfigError` for the first thing that does not fit."""
    return _Binder(profile, read_dbc(Path(profile.dbc))).database()


def binding_faults(profile: Profile, file: DbcFile) -> list[ConfigError]:
    """Everything that does not fit, and not only the first; each once."""
    found: list[ConfigError] = []
    binder = _Binder(profile, file, found)
    with binder.noted():
        binder.check()
    return list({str(error): error for error in found}.values())


def roles_of(profile: Profile, file: DbcFile) -> dict[str, Role]:
    """What each message is to the program, as far as the profile's names exist."""
    return _Binder(profile, file, []).roles()


class _Binder:
    """Binds one profile to one DBC.

    A check that fails raises; with a list of `faults` it is noted there instead, and the next check follows."""

    def __init__(self, profile: Profile, file: DbcFile, faults: list[ConfigError] | None = None) -> None:
        self._faults = faults
        self._profile = profile
        self._file = file
        self._dbc: Database = file.database
        self._where = Path(profile.file).name or profile.name
        self._fields: dict[str, str] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """One check."""
        try:
            yield
        except ConfigError as error:
            if self._faults is None:
                raise
            self._faults.append(error)

    def roles(self) -> dict[str, Role]:
        """Of every message that the profile binds."""
        named = self._named_signals()
        return self._roles(named["state"] | named["status"], named["command"], named["body"], named["report"])

    def _named_signals(self) -> dict[str, dict[str, tuple[str, ...]]]:
        """Section → field → its signals."""
        profile = self._profile
        return {
            "state": _named(profile.state.signals),
            "status": _named(profile.status.signals),
            "command": _named(profile.command.signals),
            "body": _named(profile.body.signals) if profile.body else {},
            "report": _named(profile.report.signals) if profile.report else {},
        }

    def check(self) -> dict[str, BoundMessage]:
        """The bound messages; when faults are noted, those that could be bound."""
        for section, bindings in self._named_signals().items():
            self._claim(section, bindings)
        self._check_named_messages()
        self._check_sample()
        roles = self.roles()
        self._check_senders(roles)
        self._check_periods(roles)
        self._check_limits()
        self._check_rates()
        self._check_kinds(roles)
        bound = {}
        for name, role in roles.items():
            with self.noted():
                bound[name] = self._bound(name, role)
        with self.noted():
            self._frames()
        return bound

    def database(self) -> VehicleDatabase:
        profile, bound, named = self._profile, self.check(), self._named_signals()
        return VehicleDatabase(
            profile=profile,
            sample=tuple(bound[name] for name in profile.state.sample),
            status=next(message for message in bound.values() if message.role is Role.STATUS),
            extra=tuple(message for message in bound.values() if message.role is Role.EXTRA),
            commands=tuple(message for message in bound.values() if message.role is Role.COMMAND),
            body=next((message for message in bound.values() if message.role is Role.BODY), None),
            report=next((message for message in bound.values() if message.role is Role.REPORT), None),
            frames=self._frames(),
            resolutions={field: self._resolution(places) for field, places in named["command"].items()},
            report_ranges={field: self._range(places) for field, places in named["report"].items()},
        )

    # --- names

    def _fault(self, place: str, text: str) -> ConfigError:
        return ConfigError(f"{self._where}: {place}: {text}")

    def _message(self, name: str, place: str) -> Message:
        names = [message.name for message in self._dbc.messages]
        if name not in names:
            raise self._fault(place, f"no message {name!r} in {self._file.name}{_nearest(name, names)}")
        return self._dbc.get_message_by_name(name)

    def _signal(self, dotted: str, place: str) -> Signal:
        message_name, _, name = dotted.partition(".")
        message = self._message(message_name, place)
        names = [signal.name for signal in message.signals]
        if name not in names:
            raise self._fault(place, f"no signal {name!r} in {message_name}{_nearest(name, names)}")
        return message.get_signal_by_name(name)

    def _claim(self, section: str, bindings: Mapping[str, tuple[str, ...]]) -> None:
        """Give every signal its one field."""
        for field, signals in bindings.items():
            for dotted in signals:
                with self.noted():
                    self._claim_one(f"$.{section}.signals.{field}", field, dotted)

    def _claim_one(self, place: str, field: str, dotted: str) -> None:
        signal = self._signal(dotted, place)
        if dotted in self._fields:
            raise self._fault(place, f"{dotted} is already bound to {self._fields[dotted]}")
        self._fields[dotted] = field
        if signal.multiplexer_ids or signal.multiplexer_signal or signal.is_multiplexer:
            raise self._fault(place, f"{dotted} is multiplexed; bound signals must not be")
        with self.noted():
            self._check_unit(field, dotted, signal)
        self._check_range(dotted, signal)

    def _check_unit(self, field: str, dotted: str, signal: Signal) -> None:
        """A field's unit is in its name; a signal that states another one is not that field."""
        unit, wanted = field.rpartition("_")[2], signal.unit
        if wanted and unit in UNITS and wanted not in UNITS[unit]:
            raise self._file.fault(dotted, f"unit {wanted!r}: {field} must be in {UNITS[unit][0]!r}")

    def _check_range(self, dotted: str, signal: Signal) -> None:
        if signal.length > 1 and (signal.minimum is None or signal.maximum is None):
            raise self._file.fault(dotted, "no range; a signal that the program uses must have [min|max]")

    def _check_named_messages(self) -> None:
        """Names that are not signals' fields: sample, data ids, ignored, constants."""
        profile = self._profile
        for index, name in enumerate(profile.state.sample):
            with self.noted():
                self._message(name, f"$.state.sample[{index}]")
                if name in profile.state.sample[:index]:
                    raise self._fault(f"$.state.sample[{index}]", f"{name} is there twice")
        for name in profile.e2e.data_ids if profile.e2e else ():
            with self.noted():
                self._message(name, f"$.e2e.data_ids.{name}")
        for place, names in (("$.ignored", profile.ignored), ("$.constants", tuple(profile.constants))):
            for dotted in names:
                with self.noted():
                    self._signal(dotted, place)
                    if dotted in self._fields:
                        raise self._fault(place, f"{dotted} is bound to {self._fields[dotted]}")

    def _check_sample(self) -> None:
        """Values that mean nothing without one another are of one sample; frames of reference have usable names."""
        state = self._profile.state
        for field in _ONE_SAMPLE:
            dotted = getattr(state.signals, field)
            if dotted is not None and dotted.partition(".")[0] not in state.sample:
                with self.noted():
                    text = f"{dotted}: must be in a message of the sample: {', '.join(state.sample)}"
                    raise self._fault(f"$.state.signals.{field}", text)
        names = {"frame_id": state.frame_id} | {f"frames.{key}": name for key, name in state.frames.items()}
        for place, name in names.items():
            with self.noted():
                self._check_frame(f"$.state.{place}", name)

    def _check_frame(self, place: str, name: str) -> None:
        try:
            checks.frame_id("frame of reference", name)
        except InvalidValueError as error:
            raise self._fault(place, str(error)) from None

    # --- roles

    def _roles(
        self,
        received: Mapping[str, tuple[str, ...]],
        command: Mapping[str, tuple[str, ...]],
        body: Mapping[str, tuple[str, ...]],
        report: Mapping[str, tuple[str, ...]],
    ) -> dict[str, Role]:
        """Every bound message with its one role, in the order of the DBC within a role."""
        there = {message.name for message in self._dbc.messages}
        roles: dict[str, Role] = {name: Role.SAMPLE for name in self._profile.state.sample if name in there}
        mode_message = self._profile.status.signals.mode.partition(".")[0]
        wanted = [(mode_message, Role.STATUS)] if mode_message in there else []
        wanted += [(name, Role.EXTRA) for name in self._messages_of(received)]
        wanted += [(name, Role.COMMAND) for name in self._messages_of(command)]
        wanted += [(name, Role.BODY) for name in self._messages_of(body)]
        wanted += [(name, Role.REPORT) for name in self._messages_of(report)]
        for name, role in wanted:
            known = roles.setdefault(name, role)
            with self.noted():
                if known is not role and (role in _SENT or known in _SENT):
                    raise self._fault(f"$.{role.value}", f"{name} is already a message of {known.value}")
                if role is Role.STATUS and known is not role:
                    raise self._fault("$.status.signals.mode", f"{name} is a part of the state sample")
        for role in (Role.BODY, Role.REPORT):
            names = [name for name, known in roles.items() if known is role]
            with self.noted():
                if len(names) > 1:
                    raise self._fault(f"$.{role.value}.signals", f"must be one message: {', '.join(names)}")
        return roles

    def _messages_of(self, bindings: Mapping[str, tuple[str, ...]]) -> list[str]:
        used = {dotted.partition(".")[0] for signals in bindings.values() for dotted in signals}
        return [message.name for message in self._dbc.messages if message.name in used]

    def _check_senders(self, roles: Mapping[str, Role]) -> None:
        """Nobody sends both what the program receives and what it sends."""
        sent = {node for name, role in roles.items() if role in _SENT for node in self._senders(name)}
        for name, role in roles.items():
            both = sent.intersection(self._senders(name)) if role not in _SENT else set()
            with self.noted():
                if both:
                    raise self._file.fault(name, f"is received, but its sender {min(both)} sends the commands")

    def _senders(self, name: str) -> list[str]:
        return self._dbc.get_message_by_name(name).senders

    def _check_periods(self, roles: Mapping[str, Role]) -> None:
        timing = self._profile.timing
        for name, role in roles.items():
            cycle_ms = self._dbc.get_message_by_name(name).cycle_time
            if role is Role.EXTRA and cycle_ms and cycle_ms / 1000 >= timing.status_stale_s:
                with self.noted():
                    text = f"{timing.status_stale_s} s: must be above the cycle of {name}, {cycle_ms} ms"
                    raise self._fault("$.timing.status_stale_s", text)
            if role not in PERIODS or not cycle_ms:
                continue
            period_s = getattr(timing, PERIODS[role])
            with self.noted():
                if not math.isclose(period_s, cycle_ms / 1000, rel_tol=1e-9):
                    text = f"{period_s} s, but {name} has a cycle of {cycle_ms} ms in {self._file.name}"
                    raise self._fault(f"$.timing.{PERIODS[role]}", text)

    def _check_kinds(self, roles: Mapping[str, Role]) -> None:
        """FD frames need an FD bus."""
        for name in roles:
            with self.noted():
                if self._dbc.get_message_by_name(name).is_fd and not self._profile.bus.fd:
                    raise self._fault("$.bus.fd", f"false, but {name} is an FD frame in {self._file.name}")

    def _check_limits(self) -> None:
        """What may be commanded must lie in the range of the signal that says it."""
        limits, signals = self._profile.limits, _named(self._profile.command.signals)
        checks: tuple[tuple[str, str, tuple[float, ...]], ...] = (
            ("front_wheel_angle_rad", "front_wheel_angle_rad", _both(limits.front_wheel_angle_rad)),
            ("rear_wheel_angle_rad", "rear_wheel_angle_rad", _both(limits.rear_wheel_angle_rad)),
            ("accel_max_mps2", "accel_mps2", (limits.accel_max_mps2,)),
            ("accel_min_mps2", "accel_mps2", (limits.accel_min_mps2,)),
            ("speed_max_mps", "speed_mps", _both(limits.speed_max_mps)),
        )
        for key, field, values in checks:
            for dotted in self._fields.keys() & set(signals.get(field, ())):
                low, high = _expressible(self._signal(dotted, ""))
                with self.noted():
                    if any(not low <= value <= high for value in values):
                        text = f"{values[0]}: {dotted} is in [{low:.10g}, {high:.10g}]"
                        raise self._fault(f"$.limits.{key}", text)

    def _check_rates(self) -> None:
        """What is slower than one count of its signal from sample to sample would never move."""
        limits, signals = self._profile.limits, _named(self._profile.command.signals)
        period_s = self._profile.timing.sample_period_s
        rates = [
            ("accel_rate_mps3", "accel_mps2", limits.accel_rate_mps3),
            ("front_wheel_rate_radps", "front_wheel_angle_rad", limits.front_wheel_rate_radps),
        ]
        if limits.rear_wheel_angle_rad > 0.0:
            rates.append(("rear_wheel_rate_radps", "rear_wheel_angle_rad", limits.rear_wheel_rate_radps))
        for key, field, per_s in rates:
            for dotted in sorted(self._fields.keys() & set(signals.get(field, ()))):
                count = self._resolution((dotted,))
                with self.noted():
                    if per_s * period_s < count * (1.0 - 1e-6):
                        text = f"{getattr(limits, key)}: moves {field} by {per_s * period_s:.4g} in {period_s} s"
                        raise self._fault(f"$.limits.{key}", f"{text}, and a count of {dotted} is {count:.4g}: never")

    # --- messages

    def _bound(self, name: str, role: Role) -> BoundMessage:
        message = self._dbc.get_message_by_name(name)
        try:
            codec, layout = MessageCodec(message), Layout.of(message)
        except ConfigError as error:
            raise self._file.fault(name, str(error)) from None
        for signal in layout.fields:
            with self.noted():
                if not signal.is_float and signal.allowed_raw()[0] > signal.allowed_raw()[1]:
                    text = f"no value lies in its range [{signal.minimum}|{signal.maximum}]"
                    raise self._file.fault(f"{name}.{signal.name}", text)
                counts = self._fields.get(f"{name}.{signal.name}") in _COUNTS
                if counts and 0 < len(signal.enumeration()) <= signal.highest - signal.lowest:
                    text = f"is a count, but its VAL_ table names only {len(signal.enumeration())} of its numbers"
                    raise self._file.fault(f"{name}.{signal.name}", text)
        protection: Protection | None = None
        with self.noted():
            protection = self._protection(message)
        with self.noted():
            if role is Role.SAMPLE and not self._is_protected(name) and len(self._profile.state.sample) > 1:
                raise self._fault(f"$.e2e.data_ids.{name}", "missing; the parts of a sample need a counter")
        fields = tuple(self._fields.get(f"{name}.{value}", "") for value in codec.names)
        self._check_complete(message, role)
        to_program = tuple(
            self._noted_translation(f"{name}.{value}", field) for value, field in zip(codec.names, fields, strict=True)
        )
        return BoundMessage(
            name=name,
            role=role,
            can_id=message.frame_id,
            is_extended=message.is_extended_frame,
            is_fd=message.is_fd,
            length=message.length,
            codec=codec,
            fields=fields,
            constants=tuple(self._constant(message, signal) for signal in message.signals),
            to_program=to_program,
            to_bus=tuple(_inverted(table) for table in to_program),
            protection=protection,
            max_counter_step=self._profile.e2e.max_counter_step if self._profile.e2e else 1,
        )

    def _constant(self, message: Message, signal: Signal) -> float | int:
        """What an unbound signal is sent as: its constant, or the allowed value nearest to 0."""
        value = self._profile.constants.get(f"{message.name}.{signal.name}")
        if value is not None:
            return value
        low, high = _expressible(signal)
        return min(max(0, low), high)

    def _is_protected(self, name: str) -> bool:
        return self._profile.e2e is not None and name in self._profile.e2e.data_ids

    def _check_complete(self, message: Message, role: Role) -> None:
        """Every signal is bound, or protects the message, or is named as of no use."""
        profile = self._profile
        known = set(self._fields) | set(profile.constants)
        known |= set(profile.ignored)
        if profile.e2e is not None and self._is_protected(message.name):
            known |= {
                f"{message.name}.{profile.e2e.crc_signal}",
                f"{message.name}.{profile.e2e.counter_signal}",
            }
        for signal in message.signals:
            dotted = f"{message.name}.{signal.name}"
            with self.noted():
                if dotted not in known:
                    wanted = (
                        "bind it or give it under constants" if role in _SENT else "bind it or list it under ignored"
                    )
                    raise self._file.fault(dotted, f"means nothing to {self._where}; {wanted}")

    def _protection(self, message: Message) -> Protection | None:
        rules = self._profile.e2e
        if rules is None or message.name not in rules.data_ids:
            return None
        place = f"$.e2e.data_ids.{message.name}"
        data_id = rules.data_ids[message.name]
        attributes = message.dbc.attributes if message.dbc else {}
        stated_id, stated_profile = attributes.get("E2EDataId"), attributes.get("E2EProfile")
        if stated_id is not None and isinstance(data_id, int) and stated_id.value != data_id:
            raise self._fault(place, f"{data_id:#x}, but E2EDataId is {stated_id.value:#x} in {self._file.name}")
        try:
            protection = Protection(rules.profile, data_id, message.length, rules.data_id_mode)
        except ConfigError as error:
            raise self._fault(place, str(error)) from None
        if rules.max_counter_step > protection.counter_states - 2:
            limit = protection.counter_states - 2
            raise self._fault("$.e2e.max_counter_step", f"{rules.max_counter_step}: must be at most {limit}")
        for key, name, bits in (
            ("crc_signal", rules.crc_signal, protection.crc_bits),
            ("counter_signal", rules.counter_signal, protection.counter_bits),
        ):
            with self.noted():
                self._check_header(f"$.e2e.{key}", f"{message.name}.{name}", bits)
        if stated_profile is not None and stated_profile.value not in (0, rules.profile):
            text = f"{rules.profile}, but E2EProfile of {message.name} is {stated_profile.value} in {self._file.name}"
            raise self._fault("$.e2e.profile", text)
        self._check_nibble(message)
        return protection

    def _check_header(self, place: str, dotted: str, bits: tuple[int, int]) -> None:
        """Checksum or counter are where the E2E profile puts them, and are nothing else."""
        signal = self._signal(dotted, place)
        if (_first_bit(signal), signal.length) != bits:
            rules = self._profile.e2e
            wanted = f"E2E profile {rules.profile if rules else 0} has {bits[0]}|{bits[1]}"
            raise self._file.fault(dotted, f"bits {signal.start}|{signal.length}, but {wanted}")
        if dotted in self._fields:
            raise self._fault(place, f"{dotted} is bound to {self._fields[dotted]}")

    def _check_nibble(self, message: Message) -> None:
        """In data-id mode NIBBLE the high nibble of byte 1 is the data id's."""
        if self._profile.e2e is None or self._profile.e2e.data_id_mode != "NIBBLE":
            return
        for signal in message.signals:
            if set(bits_of(signal)).intersection(range(12, 16)):
                raise self._file.fault(f"{message.name}.{signal.name}", "bits 12|4 hold the data id's nibble")

    # --- enumerations

    def _noted_translation(self, dotted: str, field: str) -> Mapping[int, int] | None:
        found: list[Mapping[int, int] | None] = [None]
        with self.noted():
            found.append(self._translation(dotted, field))
        return found[-1]

    def _translation(self, dotted: str, field: str) -> Mapping[int, int] | None:
        """DBC's number → program's number of an enumerated field; None when they are the same."""
        vocabulary = _VOCABULARIES.get(field)
        if vocabulary is None:
            return None
        members, needed = vocabulary
        names = self._renamed(field)
        table = self._table(dotted)
        numbers: dict[int, int] = {}
        for number, name in table.items():
            ours = names.get(name, name)
            with self.noted():
                if ours not in members:
                    allowed = ", ".join(members)
                    raise self._file.fault(dotted, f"{number} {name!r} means nothing; must be one of: {allowed}")
                if members[ours] in numbers.values():
                    raise self._file.fault(dotted, f"{number} {name!r}: {ours} has two numbers")
                numbers[number] = members[ours]
        missing = [name for name in needed if members[name] not in numbers.values()]
        if missing:
            raise self._file.fault(dotted, f"VAL_ table without {', '.join(missing)}")
        return None if all(ours == theirs for theirs, ours in numbers.items()) else numbers

    def _renamed(self, field: str) -> Mapping[str, str]:
        status = self._profile.status
        return {"mode": status.modes, "gear": status.gears, "gear_request": status.gears}.get(field, {})

    def _table(self, dotted: str) -> dict[int, str]:
        choices = self._signal(dotted, "").choices
        if not choices:
            raise self._file.fault(dotted, "no VAL_ table; the program needs its names")
        return {int(number): str(name) for number, name in choices.items()}

    def _frames(self) -> dict[int, str]:
        frames, dotted = self._profile.state.frames, self._profile.state.signals.pose_frame
        if dotted is None:
            return {}
        table = self._table(dotted)
        for name in frames:
            with self.noted():
                if name not in table.values():
                    raise self._fault(f"$.state.frames.{name}", f"not in {dotted}{_nearest(name, table.values())}")
        for number, name in table.items():
            with self.noted():
                if name not in frames:
                    raise self._fault("$.state.frames", f"{dotted} = {number} {name!r} has no frame")
        return {number: frames[name] for number, name in table.items() if name in frames}

    def _resolution(self, signals: tuple[str, ...]) -> float:
        found = [self._signal(dotted, "") for dotted in signals]
        return max(0.0 if signal.is_float else abs(float(signal.scale)) for signal in found)

    def _range(self, signals: tuple[str, ...]) -> tuple[float, float]:
        """What all of them can say."""
        lows, highs = zip(*(_expressible(self._signal(dotted, "")) for dotted in signals), strict=True)
        return max(lows), min(highs)


def _members(kind: type[IntEnum]) -> dict[str, int]:
    return {member.name: int(member) for member in kind}


_COUNTS = ("ref_spatial_index", "ref_temporal_index", "deadline_misses")
"""Fields of the report in which every number means itself."""
_ONE_SAMPLE = ("x_m", "y_m", "heading_rad", "speed_mps", "pose_frame")
"""Fields of the state that must come in messages of its sample: where the vehicle is, in which frame, how fast."""
_LIGHTS = {"OFF": 0, "LOW": 1, "HIGH": 2}
_TURNS = {"OFF": 0, "LEFT": 1, "RIGHT": 2}
_VOCABULARIES: dict[str, tuple[dict[str, int], tuple[str, ...]]] = {
    "mode": (_members(VehicleMode), ("READY", "AUTONOMOUS")),
    "gear": (_members(Gear), ("REVERSE", "DRIVE")),
    "gear_request": (_members(Gear), ("REVERSE", "DRIVE", "NO_REQUEST")),
    "reason": (_members(Reason), tuple(_members(Reason))),
    "state": (_members(ControllerState), tuple(_members(ControllerState))),
    "headlights": (_LIGHTS, ("OFF", "LOW")),
    "turn_indicator": (_TURNS, tuple(_TURNS)),
}
"""Enumerated fields: the program's names and numbers, and those that a DBC must have."""


def _named(signals: msgspec.Struct) -> dict[str, tuple[str, ...]]:
    """Field → its signals, without those that are not bound."""
    places = {field: getattr(signals, field) for field in signals.__struct_fields__}
    return {
        field: (value,) if isinstance(value, str) else tuple(value)
        for field, value in places.items()
        if value is not None
    }


def _nearest(name: str, names: Iterable[str]) -> str:
    found = difflib.get_close_matches(name, list(names), n=3, cutoff=0.4)
    return f"; nearest: {', '.join(found)}" if found else ""


def _both(limit: float) -> tuple[float, float]:
    return limit, -limit


def _expressible(signal: Signal) -> tuple[float, float]:
    """Smallest and greatest value that both the bits and the range allow, with the tolerance of a
    decimal limit."""
    if signal.is_float:
        low, high = -math.inf, math.inf
    else:
        raw_low = -(1 << signal.length - 1) if signal.is_signed else 0
        raw_high = (1 << signal.length - bool(signal.is_signed)) - 1
        low, high = sorted(raw * signal.scale + signal.offset for raw in (raw_low, raw_high))
    if signal.minimum is not None:
        low = max(low, signal.minimum)
    if signal.maximum is not None:
        high = min(high, signal.maximum)
    return low, high


def bits_of(signal: Signal) -> Iterator[int]:
    """The signal's bits in little-endian numbering, the one that comes first on the wire's byte
    order first."""
    bit = signal.start
    for _ in range(signal.length):
        yield bit
        if signal.byte_order == "little_endian":
            bit += 1
        else:
            bit = bit - 1 if bit % 8 else bit + 15


def _first_bit(signal: Signal) -> int:
    """Lowest bit of a signal in little-endian numbering; within one byte the byte orders agree."""
    return min(bits_of(signal)) if signal.length <= 8 else signal.start


def _inverted(table: Mapping[int, int] | None) -> Mapping[int, int] | None:
    return None if table is None else {ours: theirs for theirs, ours in table.items()}
