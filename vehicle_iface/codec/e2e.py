"""AUTOSAR end-to-end protection, profiles 1, 2, 5 and 11: a checksum over payload and data id, and a counter.

See AUTOSAR PRS E2E Protocol. The checksums are computed by the autosar-e2e package; the rule for the counter is here.
"""

from collections.abc import Callable
from enum import Enum
from functools import partial

import e2e.p01
import e2e.p02
import e2e.p05
import e2e.p11

from vehicle_iface.codec.protection import (
    NO_COUNTER,
    ChecksumRecipe,
    CoveredPart,
    PartKind,
    PayloadBits,
    Protection,
    ProtectionRecipe,
    Reduction,
)
from vehicle_iface.errors import ConfigError
from vehicle_iface.value import Value

_HEADER_BYTES = {1: 2, 2: 2, 5: 3, 11: 2}
_COUNTER_BYTE = {1: 1, 2: 1, 5: 2, 11: 1}
_COUNTER_MASK = {1: 0x0F, 2: 0x0F, 5: 0xFF, 11: 0x0F}
_COUNTER_STATES = {1: 15, 2: 16, 5: 256, 11: 15}
_CRC_BITS = {1: 8, 2: 8, 5: 16, 11: 8}
_CRCS = {1: (0x1D, 0, 0), 2: (0x2F, 0xFF, 0xFF), 5: (0x1021, 0xFFFF, 0), 11: (0x1D, 0, 0)}
"""Polynomial, first value, and what is combined with the result."""
_MODES = {
    1: {
        "BOTH": e2e.p01.E2E_P01_DATAID_BOTH,
        "ALT": e2e.p01.E2E_P01_DATAID_ALT,
        "LOW": e2e.p01.E2E_P01_DATAID_LOW,
        "NIBBLE": e2e.p01.E2E_P01_DATAID_NIBBLE,
    },
    11: {"BOTH": e2e.p11.E2E_P11_DATAID_BOTH, "NIBBLE": e2e.p11.E2E_P11_DATAID_NIBBLE},
}


class HeaderBits(Value, frozen=True):
    """The places of an E2E profile's header: start bits in little-endian numbering, and lengths in bits."""

    checksum: tuple[int, int]
    counter: tuple[int, int]


def header_bits(profile: int) -> HeaderBits:
    """Return the places of checksum and counter in `profile`."""
    return HeaderBits((0, _CRC_BITS[profile]), (8 * _COUNTER_BYTE[profile], _COUNTER_MASK[profile].bit_length()))


def autosar_protection(
    profile: int,
    data_id: int | tuple[int, ...],
    length: int,
    data_id_mode: str = "BOTH",
    max_step: int = 3,
) -> Protection:
    """Build the protection of one message for an E2E profile.

    Raises `ConfigError` for an unknown profile, data id or mode, or a payload shorter than the header.
    """
    if profile not in _HEADER_BYTES:
        raise ConfigError(f"E2E profile {profile}: must be one of 1, 2, 5, 11")
    if length < _HEADER_BYTES[profile]:
        raise ConfigError(f"{length} bytes: E2E profile {profile} needs {_HEADER_BYTES[profile]}")
    place, mask, states = _COUNTER_BYTE[profile], _COUNTER_MASK[profile], _COUNTER_STATES[profile]
    step_and_seal, seal, intact = _functions(profile, data_id, data_id_mode)

    def protect(data: bytearray, counter: int) -> None:
        if counter < states:
            data[place] = data[place] & ~mask | (counter - 1) % states
            step_and_seal(data)
        else:
            data[place] = data[place] & ~mask | counter
            seal(data)

    return Protection(
        intact=intact,
        read_counter=lambda data: data[place] & mask,
        protect=protect,
        counter_states=_COUNTER_STATES[profile],
        max_step=max_step,
        recipe=_recipe(profile, data_id, length, data_id_mode),
    )


def _recipe(profile: int, data_id: int | tuple[int, ...], length: int, mode: str) -> ProtectionRecipe | None:
    """Return what the package computes for a profile as numbers; None for the mode NIBBLE."""
    crc_bytes = _CRC_BITS[profile] // 8
    payload = CoveredPart(PartKind.PAYLOAD, b"\xff" * length, 0, crc_bytes)
    ids = bytes(data_id) if isinstance(data_id, tuple) else data_id.to_bytes(2, "little")
    cover: tuple[CoveredPart, ...]
    if profile == 2:
        cover = (payload, CoveredPart(PartKind.TABLE, ids))
    elif profile == 5:
        cover = (payload, CoveredPart(PartKind.CONSTANT, ids))
    elif mode == "ALT":
        cover = (CoveredPart(PartKind.TABLE, ids), payload)
    elif mode == "NIBBLE":
        return None
    else:
        cover = (CoveredPart(PartKind.CONSTANT, ids[:1] if mode == "LOW" else ids), payload)
    poly, init, xor_out = _CRCS[profile]
    place = PayloadBits(0, _CRC_BITS[profile], False)
    bits = header_bits(profile)
    checksum = ChecksumRecipe(place, Reduction.CRC, _CRC_BITS[profile], poly, init, xor_out, cover)
    return ProtectionRecipe(PayloadBits(*bits.counter, False), checksum)


def _functions(
    profile: int, data_id: int | tuple[int, ...], mode: str
) -> tuple[Callable[[bytearray], None], Callable[[bytearray], None], Callable[[bytes], bool]]:
    """Return the functions of a profile that protect and check a payload, with data id and mode bound.

    Of the two that protect, the first one steps the counter before: told by a keyword to leave it, the package's
    function takes five times as long. The second one is for invalid counters, which profiles 2 and 5 do not have.

    The package's own check of profiles 1 and 11 also rejects an invalid counter. Only the checksum is checked here, so
    that the two faults are counted separately.
    """
    if profile == 2:
        return _functions_p02(data_id)
    if not isinstance(data_id, int) or not 0 <= data_id <= 0xFFFF:
        raise ConfigError(f"E2E data id {data_id!r}: must be a number of 16 bits")
    if profile == 5:
        protect_p05, check_p05 = e2e.p05.e2e_p05_protect, e2e.p05.e2e_p05_check

        def seal_p05(data: bytearray) -> None:
            protect_p05(data, data_id)

        return seal_p05, seal_p05, lambda data: check_p05(data, data_id)
    if mode not in _MODES[profile]:
        raise ConfigError(f"E2E data-id mode {mode!r}: profile {profile} has {', '.join(_MODES[profile])}")
    number = _MODES[profile][mode]
    module_protect, module_check = (
        (e2e.p01.e2e_p01_protect, e2e.p01.e2e_p01_check)
        if profile == 1
        else (e2e.p11.e2e_p11_protect, e2e.p11.e2e_p11_check)
    )

    # BOTH is the package's default; without a keyword the call takes half the time.
    check_quickly = module_check if mode == "BOTH" else partial(module_check, data_id_mode=number)
    protect_quickly = module_protect if mode == "BOTH" else partial(module_protect, data_id_mode=number)
    seal = partial(module_protect, data_id=data_id, data_id_mode=number, increment_counter=False)

    def check(data: bytes) -> bool:
        again = bytearray(data)
        if check_quickly(again, data_id):
            return True
        seal(again)
        return again == data

    return lambda data: protect_quickly(data, data_id), seal, check


def _functions_p02(
    data_id: int | tuple[int, ...],
) -> tuple[Callable[[bytearray], None], Callable[[bytearray], None], Callable[[bytes], bool]]:
    if isinstance(data_id, int) or len(data_id) != 16:
        raise ConfigError(f"E2E data id {data_id!r}: profile 2 needs a list of 16 bytes")
    ids = bytes(data_id)

    def seal(data: bytearray) -> None:
        e2e.p02.e2e_p02_protect(data, ids)

    return seal, seal, lambda data: e2e.p02.e2e_p02_check(data, ids, length=0)


WINDOW = 16
"""Number of recent frames of a message that are considered; fewer than half of them intact is too few."""
MOST_WIDENED = 4
"""Largest number of damaged frames that widen the next step; more of them are not the sender's."""
_ALL_GOOD = (1 << WINDOW) - 1


class Sequence(Enum):
    """The verdict on a frame by its counter."""

    INITIAL = "initial"
    """The first frame has nothing to compare with; accepted."""
    OK = "ok"
    """The next counter, or one after a few lost frames; accepted."""
    REPEATED = "repeated"
    """The same counter again; dropped."""
    WRONG = "wrong sequence"
    """The step is too large; dropped, but the next frame is compared with this one."""
    INVALID = "invalid counter"
    """The counter's value is not a valid one; dropped, and otherwise ignored."""
    UNTRUSTED = "too many damaged"
    """The frame is intact, but most recent frames were not; dropped."""


class DamageCheck:
    """The rule for a message without a counter: while most of its last frames were damaged, none is accepted (AUTOSAR's
    E2E state machine, with a window of `WINDOW` checks). With enough noise, some damaged frames have a valid checksum.
    """

    __slots__ = ("_history", "expected", "following")

    following: tuple[int, ...]
    """The counter after each."""

    def __init__(self) -> None:
        self._history = _ALL_GOOD
        self.following = (NO_COUNTER,)
        self.expected: int | None = NO_COUNTER
        """The counter that an intact frame may have without `step`, by `expected = following[expected]`: the usual case
        costs no call. None where each frame has to be judged."""

    def step(self, _counter: int) -> Sequence:
        """Judge the next intact frame."""
        self._history = (self._history << 1 | 1) & _ALL_GOOD
        if self._history == _ALL_GOOD:
            self.expected = NO_COUNTER
        return Sequence.OK if self._is_trusted() else Sequence.UNTRUSTED

    def note_damaged(self) -> None:
        """Count a frame whose checksum was wrong."""
        self._history = self._history << 1 & _ALL_GOOD
        self.expected = None

    def reset(self) -> None:
        """Forget the last frames."""
        self._history, self.expected = _ALL_GOOD, NO_COUNTER

    def _is_trusted(self) -> bool:
        return self._history.bit_count() >= WINDOW // 2


class CounterCheck(DamageCheck):
    """The sequence rule of one message.

    Steps of 1 … `max_step` are accepted. Each damaged frame in between widens the limit by one, because its counter was
    used (AUTOSAR E2E profile 1 widens its MaxDeltaCounter likewise). A frame with a larger step is dropped, but its
    counter is remembered: one jump costs one or two frames, not all that follow.
    """

    __slots__ = ("_damaged", "_last", "_max_step", "_states", "lost")

    def __init__(self, states: int, max_step: int) -> None:
        if not 1 <= max_step < states - 1:
            raise ConfigError(f"max_counter_step = {max_step}: must be in [1, {states - 2}]")
        super().__init__()
        self._states = states
        self._max_step = max_step
        self.following, self.expected = (*range(1, states), 0), None
        self._last = -1
        self._damaged = 0
        self.lost = 0
        """Frames that must have been sent between accepted ones."""

    def step(self, counter: int) -> Sequence:
        """Judge the next frame by its counter, and remember the counter."""
        self._expect_nothing()
        verdict = self._judge(counter)
        if self._last >= 0 and self._history == _ALL_GOOD and not self._damaged:
            self.expected = self.following[self._last]
        return verdict

    def _expect_nothing(self) -> None:
        if self.expected is not None:
            self._last, self.expected = (self.expected - 1) % self._states, None

    def _judge(self, counter: int) -> Sequence:
        last = self._last
        if not 0 <= counter < self._states:
            return Sequence.INVALID
        self._last = counter
        self._history = (self._history << 1 | 1) & _ALL_GOOD
        is_trusted = self._is_trusted()
        if last < 0:
            return Sequence.INITIAL if is_trusted else Sequence.UNTRUSTED
        step = (counter - last) % self._states
        if step == 0:
            return Sequence.REPEATED
        widest = min(self._max_step + self._damaged, self._states - 2)
        self._damaged = 0
        if step > widest:
            return Sequence.WRONG
        self.lost += step - 1
        return Sequence.OK if is_trusted else Sequence.UNTRUSTED

    def note_damaged(self) -> None:
        """Count a frame whose checksum was wrong, so that its counter is unknown."""
        self._expect_nothing()
        super().note_damaged()
        self._damaged = min(self._damaged + 1, MOST_WIDENED)

    def reset(self) -> None:
        """Forget the last frame: the next one is accepted as the first."""
        super().reset()
        self.expected = None
        self._last = -1
        self._damaged = 0
