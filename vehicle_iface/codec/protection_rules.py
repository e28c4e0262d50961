"""Reads the protection that a profile gives each message, and builds the `Protection` from it.

`[e2e]` is the short form for one AUTOSAR profile; `[protection]` gives each message a rule.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.checksums import (
    BitPlace,
    CoveredMessage,
    build_cover,
    crc_function,
    describe_cover,
    sum_function,
    xor_function,
)
from vehicle_iface.codec.e2e import autosar_protection
from vehicle_iface.codec.layout import Layout
from vehicle_iface.codec.protection import (
    NO_COUNTER,
    ChecksumRecipe,
    Payload,
    Protection,
    ProtectionRecipe,
    Reduction,
)
from vehicle_iface.codec.user_checksum import UserChecksum, load_function
from vehicle_iface.profile import Profile
from vehicle_iface.profile.protection import Checksum, DataId, ProtectedMessage, ProtectionRule, SequenceCounter
from vehicle_iface.value import Value

CRC_BITS = {"crc8": 8, "crc16": 16}
DEFAULT_STEP = 3


class MessageRule(Value, frozen=True, kw_only=True):
    """The protection of one message, and the places in the profile where each part is stated."""

    checksum: Checksum | None
    counter: SequenceCounter | None
    data_id: DataId | None
    data_id_place: str
    kind_place: str
    checksum_place: str
    """The place that names the checksum signal."""
    counter_place: str
    """The place that names the counter signal."""
    max_step_place: str

    @property
    def autosar_profile(self) -> int | None:
        """The number of the E2E profile; None for a rule that consists of parts."""
        if self.checksum is None or not self.checksum.kind.startswith("autosar-"):
            return None
        return int(self.checksum.kind.removeprefix("autosar-"))

    @property
    def signals(self) -> tuple[str, ...]:
        """The names of the signals that protect the message."""
        return tuple(part.signal for part in (self.checksum, self.counter) if part is not None)

    @property
    def over(self) -> tuple[str, ...]:
        """The parts that the checksum covers; a data id that `over` does not name comes last."""
        over = self.checksum.over if self.checksum else ()
        return (*over, "data_id") if self.data_id is not None and "data_id" not in over else over


def find_rule(profile: Profile, message_name: str) -> MessageRule | None:
    """Return the rule of a message; None if it is unprotected, or if the named rule does not exist."""
    if profile.e2e is not None and message_name in profile.e2e.data_ids:
        e2e = profile.e2e
        return MessageRule(
            checksum=Checksum(signal=e2e.crc_signal, kind=f"autosar-{e2e.profile}", data_id_mode=e2e.data_id_mode),  # type: ignore[arg-type]
            counter=SequenceCounter(signal=e2e.counter_signal, max_step=e2e.max_counter_step),
            data_id=e2e.data_ids[message_name],
            data_id_place=f"$.e2e.data_ids.{message_name}",
            kind_place="$.e2e.profile",
            checksum_place="$.e2e.crc_signal",
            counter_place="$.e2e.counter_signal",
            max_step_place="$.e2e.max_counter_step",
        )
    if profile.protection is None or message_name not in profile.protection.messages:
        return None
    stated = profile.protection.messages[message_name]
    message = ProtectedMessage(use=stated) if isinstance(stated, str) else stated
    rule = profile.protection.rules.get(message.use)
    return None if rule is None else _place_rule(message_name, message, rule)


def _place_rule(message_name: str, message: ProtectedMessage, rule: ProtectionRule) -> MessageRule:
    place = f"$.protection.{message.use}"
    table = rule.checksum.table if rule.checksum else None
    return MessageRule(
        checksum=rule.checksum,
        counter=rule.counter,
        data_id=message.data_id if message.data_id is not None else table,
        data_id_place=f"$.protection.messages.{message_name}",
        kind_place=f"{place}.checksum.kind",
        checksum_place=f"{place}.checksum.signal",
        counter_place=f"{place}.counter.signal",
        max_step_place=f"{place}.counter.max_step",
    )


def count_states(signal: Signal) -> int:
    """Return the number of counter values, counted from 0, that its bits and its range in the DBC allow."""
    states = 1 << signal.length
    if signal.is_signed or signal.maximum is None or signal.maximum <= (signal.minimum or 0):
        return states
    return max(1, min(states, math.floor((signal.maximum - signal.offset) / signal.scale + 1e-6) + 1))


def find_places(message: Message) -> dict[str, BitPlace]:
    """Return the place of each signal of a message."""
    return {field.name: BitPlace.of(field) for field in Layout.of(message).fields}


def build_protection(profile: Profile, message: Message) -> Protection | None:
    """Build the protection of a message in which `protection_faults` finds no fault; None if none is stated."""
    rule = find_rule(profile, message.name)
    if rule is None:
        return None
    number, step = rule.autosar_profile, rule.counter.max_step if rule.counter else None
    if number is not None and rule.checksum is not None:
        mode, data_id = rule.checksum.data_id_mode or "BOTH", rule.data_id if rule.data_id is not None else ()
        return autosar_protection(number, data_id, message.length, mode, step or DEFAULT_STEP)
    places = find_places(message)
    counter = places[rule.counter.signal] if rule.counter else None
    checksum = _build_checksum(profile, message, rule, rule.checksum, places) if rule.checksum else None
    states = next((count_states(one) for one in message.signals if rule.counter and one.name == rule.counter.signal), 1)

    def protect(data: bytearray, count: int) -> None:
        if counter is not None:
            counter.write(data, count)
        if checksum is not None:
            checksum.place.write(data, checksum.compute(data))

    return Protection(
        intact=checksum.is_right if checksum is not None else lambda _data: True,
        read_counter=counter.read if counter is not None else lambda _data: NO_COUNTER,
        protect=protect,
        counter_states=states,
        max_step=(step or min(DEFAULT_STEP, states - 2)) if counter is not None else 0,
        recipe=_recipe(counter, checksum),
    )


def _recipe(counter: BitPlace | None, checksum: "_ChecksumPart | None") -> ProtectionRecipe | None:
    if checksum is not None and checksum.recipe is None:
        return None
    return ProtectionRecipe(counter.bits if counter else None, checksum.recipe if checksum else None)


class _ChecksumPart(Value, frozen=True):
    """The checksum of one message."""

    place: BitPlace
    compute: Callable[[Payload], int]
    """Computes the checksum of a payload whose counter is already written."""
    is_right: Callable[[bytes], bool]
    recipe: ChecksumRecipe | None
    """The same as numbers; None for a user's function."""


def _build_checksum(
    profile: Profile, message: Message, rule: MessageRule, checksum: Checksum, places: Mapping[str, BitPlace]
) -> _ChecksumPart:
    place = places[checksum.signal]
    if checksum.kind == "python":
        function = load_function(checksum.function or "", Path(profile.file).parent)
        user = UserChecksum(function, message.name, message.frame_id, place.width)
        return _ChecksumPart(
            place,
            lambda data: user.compute(place.clear(data)),
            lambda data: user.matches(place.clear(data), place.read(data)),
            None,
        )
    covered = CoveredMessage(
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        checksum=place,
        counter=places[rule.counter.signal] if rule.counter else None,
        data_id=rule.data_id,
    )
    cover, reduce = build_cover(rule.over, covered), _reduce_function(checksum, place.width)
    return _ChecksumPart(
        place,
        lambda data: reduce(cover(data)),
        lambda data: reduce(cover(data)) == place.read(data),
        ChecksumRecipe(
            place.bits,
            _reduction(checksum),
            CRC_BITS.get(checksum.kind, place.width),
            checksum.poly or 0,
            checksum.init,
            checksum.xor_out,
            describe_cover(rule.over, covered),
        ),
    )


def _reduction(checksum: Checksum) -> Reduction:
    if checksum.kind in CRC_BITS:
        return Reduction.CRC_REFLECTED if checksum.reflect else Reduction.CRC
    return Reduction.SUM if checksum.kind == "sum" else Reduction.XOR


def _reduce_function(checksum: Checksum, width: int) -> Callable[[Payload], int]:
    """Build the function from covered bytes to the checksum."""
    if checksum.kind in CRC_BITS:
        bits = CRC_BITS[checksum.kind]
        return crc_function(bits, checksum.poly or 0, checksum.init, checksum.xor_out, reflect=checksum.reflect)
    return (sum_function if checksum.kind == "sum" else xor_function)(width, checksum.init, checksum.xor_out)
