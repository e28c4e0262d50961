"""Find the checksum rule of a signal: every kind of a profile is tried on the frames of a log.

Of payloads of one length, a CRC with another initial value, another final value or constant bytes before the payload
differs by the same constant in every frame. So each polynomial is tried once; the constant gives the rest. For a sum it
is a difference.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from vehicle_iface.codec.checksums import (
    BitPlace,
    CoveredMessage,
    build_cover,
    crc_function,
    sum_function,
    xor_function,
)

CRC8_POLYNOMIALS = (0x1D, 0x2F, 0x07, 0x31, 0x9B, 0xD5)
CRC16_POLYNOMIALS = (0x1021, 0x8005, 0x3D65, 0xC867)
OVERS = (
    ("bytes",),
    ("id", "bytes"),
    ("id", "length", "bytes"),
    ("length", "bytes"),
    ("bytes", "id"),
    ("bytes", "length"),
)
"""Coverages that are tried, the simplest first."""
MAX_FRAMES = 1500
_FIRST = 40
"""Number of frames that rules out most kinds."""
_FEWEST_PAYLOADS = 16
"""Minimum number of different payloads; fewer fit by chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchedMessage:
    """A message with a signal that may be a checksum."""

    can_id: int
    is_extended: bool
    length: int
    place: BitPlace


@dataclass(frozen=True, slots=True)
class ChecksumFit:
    """One rule that fits."""

    kind: str
    over: tuple[str, ...]
    poly: int
    init: int
    xor_out: int
    reflect: bool
    width: int

    @property
    def is_natural(self) -> bool:
        """Return whether its constants are common ones."""
        mask = (1 << self.width) - 1
        return self.init in (0, mask) and self.xor_out in (0, mask)

    def describe(self) -> str:
        """Describe the rule for a person."""
        kind = {"sum": "a sum", "xor": "an exclusive or"}.get(
            self.kind, f"{self.kind} with polynomial {self.poly:#04x}"
        )
        words = " and ".join((", ".join(self.over[:-1]), self.over[-1])) if len(self.over) > 1 else self.over[0]
        constants = [f"init {self.init:#x}"] if self.init else []
        constants += [f"xor_out {self.xor_out:#x}"] if self.xor_out else []
        constants += ["reflected"] if self.reflect else []
        return f"{kind} over {words}" + (f" ({', '.join(constants)})" if constants else "")

    def write_rule(self, message: str, signal: str, counter: str = "") -> str:
        """Write the lines of a profile that check it, and a counter."""
        over = ", ".join(f'"{part}"' for part in self.over)
        parts = [f'signal = "{signal}"', f'kind = "{self.kind}"', f"over = [{over}]"]
        parts += [f"poly = {self.poly:#04x}"] if self.poly else []
        parts += [f"init = {self.init:#x}"] if self.init else []
        parts += [f"xor_out = {self.xor_out:#x}"] if self.xor_out else []
        parts += ["reflect = true"] if self.reflect else []
        rule = f"[protection.found]\nchecksum = {{ {', '.join(parts)} }}"
        rule += f'\ncounter = {{ signal = "{counter}" }}' if counter else ""
        return f'{rule}\n[protection.messages]\n{message} = "found"'


def search_checksum(message: SearchedMessage, data: Sequence[bytes], good_share: float) -> list[ChecksumFit]:
    """Return the rules that fit at least that share of the payloads, the simplest first."""
    step = max(1, len(data) // MAX_FRAMES)
    payloads = list(data[::step])
    values = [message.place.read(one) for one in payloads]
    if len(set(payloads)) < _FEWEST_PAYLOADS or len(set(values)) < 3:
        return []
    fits = [fit for candidate in _candidates(message) for fit in _try(candidate, message, payloads, values, good_share)]
    return sorted(fits, key=lambda fit: not fit.is_natural)


def choose_fits(of_messages: Sequence[Sequence[ChecksumFit]]) -> list[ChecksumFit | None]:
    """Return one fit for each message: that which fits most of the messages, since one maker uses one rule."""
    votes = Counter(fit for fits in of_messages for fit in set(fits))
    return [max(fits, key=lambda fit: (fit.is_natural, votes[fit])) if fits else None for fits in of_messages]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A checksum function, and how its constant is written."""

    kind: str
    over: tuple[str, ...]
    poly: int
    reflect: bool
    compute: Callable[[bytes | bytearray], int]


def _candidates(message: SearchedMessage) -> Iterator[_Candidate]:
    width = message.place.width
    for over in OVERS:
        yield _Candidate("sum", over, 0, False, sum_function(width))
        yield _Candidate("xor", over, 0, False, xor_function(width))
    polynomials = {8: CRC8_POLYNOMIALS, 16: CRC16_POLYNOMIALS}.get(width, ())
    for poly in polynomials:
        for reflect in (False, True):
            function = crc_function(width, poly, reflect=reflect)
            for over in OVERS:
                yield _Candidate(f"crc{width}", over, poly, reflect, function)


def _try(
    candidate: _Candidate,
    message: SearchedMessage,
    payloads: Sequence[bytes],
    values: Sequence[int],
    good_share: float,
) -> Iterator[ChecksumFit]:
    cover = build_cover(
        candidate.over,
        CoveredMessage(
            can_id=message.can_id,
            is_extended=message.is_extended,
            length=message.length,
            checksum=message.place,
            counter=None,
            data_id=None,
        ),
    )
    mask, is_sum = message.place.mask, candidate.kind == "sum"
    constants: Counter[int] = Counter()
    for number, (payload, value) in enumerate(zip(payloads, values, strict=True), 1):
        computed = candidate.compute(cover(payload))
        constants[(value - computed) & mask if is_sum else value ^ computed] += 1
        if number == _FIRST and constants.most_common(1)[0][1] < 0.8 * _FIRST:
            return
    constant, count = constants.most_common(1)[0]
    if count < good_share * len(payloads):
        return
    width = message.place.width
    for init, xor_out in _constants(candidate, cover(payloads[0]), constant, width, mask):
        yield ChecksumFit(candidate.kind, candidate.over, candidate.poly, init, xor_out, candidate.reflect, width)


def _constants(
    candidate: _Candidate, covered: bytes | bytearray, constant: int, width: int, mask: int
) -> Iterator[tuple[int, int]]:
    """Return initial value and final exclusive or that give the constant."""
    if constant == 0:
        yield 0, 0
    elif candidate.kind == "sum":
        yield constant, 0
    elif candidate.kind == "xor":
        yield 0, constant
    else:
        for init, xor_out in ((0, mask), (mask, 0), (mask, mask)):
            other = crc_function(width, candidate.poly, init, xor_out, reflect=candidate.reflect)
            if other(covered) ^ candidate.compute(covered) == constant:
                yield init, xor_out
                return
        yield 0, constant
