"""Checksums and counters of a profile's messages, computed bit by bit from their definitions."""

import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cantools.database.can import Message, Signal
from vehicle_bus_contract.reference import crc8
from vehicle_bus_contract.reference_fd import crc16

AUTOSAR = ("autosar-1", "autosar-5")


class UnknownProtectionError(Exception):
    """The bench has no code of its own for this protection."""


def signal_bits(signal: Signal) -> list[int]:
    """The places of a signal's bits in the payload (8 · byte + bit), the least significant one first."""
    if signal.byte_order == "little_endian":
        return list(range(signal.start, signal.start + signal.length))
    place, places = signal.start, []
    for _ in range(signal.length):
        places.append(place)
        place = place - 1 if place % 8 else place + 15
    return places[::-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Protection:
    """Of one message; without a checksum every content is sound, without a counter every order."""

    checksum_bits: Sequence[int] = ()
    counter_bits: Sequence[int] = ()
    counter_signal: str = ""
    checksum_signal: str = ""
    kind: str = ""
    over: Sequence[str] = ("bytes",)
    init: int = 0
    xor_out: int = 0
    poly: int = 0
    reflect: bool = False
    data_id: int | Sequence[int] | None = None
    counters: int = 0
    """Number of values of the counter; 0: none."""
    max_step: int = 3
    function: Callable[[int, bytes], int] | None = None
    """The profile's own checksum, of identifier and payload."""

    @property
    def has_checksum(self) -> bool:
        """False: damage cannot be seen."""
        return bool(self.checksum_bits)

    @property
    def covers_identity(self) -> bool:
        """True where the checksum tells one message from another of the same length."""
        return self.kind in AUTOSAR or "id" in self.over or self.data_id is not None

    def seal(self, can_id: int, data: bytes, *, is_extended: bool = False, data_id: int | None = None) -> bytes:
        """The payload with the checksum of its content, by its own or another data id (or identifier)."""
        if not self.checksum_bits:
            return data
        number = self._compute(can_id, data, is_extended, data_id)
        return write_bits(data, self.checksum_bits, number)

    def counter_of(self, data: bytes) -> int:
        """The counter of a payload."""
        return read_bits(data, self.counter_bits)

    def _compute(self, can_id: int, data: bytes, is_extended: bool, data_id: int | None) -> int:
        clear = write_bits(data, self.checksum_bits, 0)
        owner = data_id if data_id is not None else self.data_id
        if self.function is not None:
            return self.function(can_id if data_id is None else data_id, clear)
        if self.kind == "autosar-1":
            assert isinstance(owner, int)
            return crc8(bytes((owner & 0xFF, owner >> 8)) + _without(data, self.checksum_bits))
        if self.kind == "autosar-5":
            assert isinstance(owner, int)
            return crc16(_without(data, self.checksum_bits) + bytes((owner & 0xFF, owner >> 8)))
        can_id = can_id if data_id is None else data_id
        parts = {
            "id": can_id.to_bytes(4 if is_extended else 2, "little"),
            "length": bytes((len(data),)),
            "bytes": _without(clear, self.checksum_bits),
            "data_id": self._data_id_bytes(data, owner),
            "counter": self.counter_of(data).to_bytes((len(self.counter_bits) + 7) // 8, "little"),
        }
        over = [*self.over, *(["data_id"] if owner is not None and "data_id" not in self.over else [])]
        covered = b"".join(parts[name] for name in over)
        width = len(self.checksum_bits)
        if self.kind in ("sum", "xor"):
            pieces = [half for byte in covered for half in (byte >> 4, byte & 0xF)] if width <= 4 else list(covered)
            total = self.init
            for piece in pieces:
                total = total + piece if self.kind == "sum" else total ^ piece
            return (total ^ self.xor_out) & ((1 << width) - 1)
        return self._crc(covered, 8 if self.kind == "crc8" else 16)

    def _data_id_bytes(self, data: bytes, owner: int | Sequence[int] | None) -> bytes:
        if owner is None:
            return b""
        if isinstance(owner, int):
            return owner.to_bytes(2, "little")
        return bytes((owner[self.counter_of(data) % len(owner)],))

    def _crc(self, covered: bytes, width: int) -> int:
        top, mask = 1 << width - 1, (1 << width) - 1
        register = self.init
        for byte in covered:
            turned = int(f"{byte:08b}"[::-1], 2) if self.reflect else byte
            register ^= turned << width - 8
            for _ in range(8):
                register = (register << 1 ^ self.poly if register & top else register << 1) & mask
        if self.reflect:
            register = int(f"{register:0{width}b}"[::-1], 2)
        return register ^ self.xor_out


UNPROTECTED = Protection()


def read_protection(profile: Mapping[str, Any], message: Message, folder: Path) -> Protection:
    """The protection of a message, by a profile in this folder.

    Raises `UnknownProtectionError`, and `KeyError` for a signal that is not there.
    """
    e2e = profile.get("e2e", {})
    if message.name in e2e.get("data_ids", {}):
        if e2e.get("data_id_mode", "BOTH") != "BOTH" or e2e["profile"] not in (1, 5):
            raise UnknownProtectionError(f"end-to-end profile {e2e['profile']} ({e2e.get('data_id_mode', 'BOTH')})")
        return _build(
            message,
            checksum={"signal": e2e.get("crc_signal", "CRC"), "kind": f"autosar-{e2e['profile']}"},
            counter={"signal": e2e.get("counter_signal", "COUNTER"), "max_step": e2e.get("max_counter_step", 3)},
            data_id=e2e["data_ids"][message.name],
        )
    table = profile.get("protection", {})
    use = table.get("messages", {}).get(message.name)
    if use is None:
        return UNPROTECTED
    own = {"use": use} if isinstance(use, str) else use
    rule = table[own["use"]]
    checksum = rule.get("checksum", {})
    if checksum and checksum["kind"] not in (*AUTOSAR, "sum", "xor", "crc8", "crc16", "python"):
        raise UnknownProtectionError(f"checksum {checksum['kind']}")
    data_id = own.get("data_id", checksum.get("table"))
    found = _build(message, checksum=checksum, counter=rule.get("counter", {}), data_id=data_id)
    if checksum.get("kind") == "python":
        file, _, name = checksum["function"].partition(":")
        return replace(found, function=runpy.run_path(str(folder / file))[name])
    return found


def _build(
    message: Message, *, checksum: Mapping[str, Any], counter: Mapping[str, Any], data_id: int | Sequence[int] | None
) -> Protection:
    checksum_signal, counter_signal = checksum.get("signal", ""), counter.get("signal", "")
    bits = signal_bits(message.get_signal_by_name(checksum_signal)) if checksum_signal else []
    counted = signal_bits(message.get_signal_by_name(counter_signal)) if counter_signal else []
    kind = checksum.get("kind", "")
    states = 15 if kind == "autosar-1" else 1 << len(counted) if counted else 0
    return Protection(
        checksum_bits=bits,
        counter_bits=counted,
        counter_signal=counter_signal,
        checksum_signal=checksum_signal,
        kind=kind,
        over=checksum.get("over", ("bytes",)),
        init=checksum.get("init", 0),
        xor_out=checksum.get("xor_out", 0),
        poly=checksum.get("poly", 0),
        reflect=checksum.get("reflect", False),
        data_id=data_id,
        counters=states,
        max_step=counter.get("max_step") or min(3, max(1, states - 1)),
    )


def read_bits(data: bytes, places: Sequence[int]) -> int:
    """The number in these bits, the least significant one first."""
    return sum((data[place // 8] >> place % 8 & 1) << power for power, place in enumerate(places))


def write_bits(data: bytes, places: Sequence[int], number: int) -> bytes:
    """The payload with a number in these bits."""
    out = bytearray(data)
    for power, place in enumerate(places):
        out[place // 8] = out[place // 8] & ~(1 << place % 8) | (number >> power & 1) << place % 8
    return bytes(out)


def _without(data: bytes, places: Sequence[int]) -> bytes:
    """The payload without the bytes that are all checksum."""
    whole = {byte for byte in range(len(data)) if all(8 * byte + bit in places for bit in range(8))}
    return bytes(byte for number, byte in enumerate(data) if number not in whole)
