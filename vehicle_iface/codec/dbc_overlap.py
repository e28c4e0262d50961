"""Finds signals of a message that share bits."""

from collections.abc import Iterator, Mapping

from vehicle_iface.codec.cantools_classes import Message, Signal
from vehicle_iface.codec.layout import bits_of
from vehicle_iface.value import Value


class Overlap(Value, frozen=True):
    """A signal, and the earlier signals whose bits it shares in the same frame."""

    signal: str
    others: tuple[str, ...]


def find_overlaps(message: Message) -> Iterator[Overlap]:
    """Yield the overlap of each signal that has one."""
    by_name = {signal.name: signal for signal in message.signals}
    shown = {name: dict(_multiplexers(by_name, signal)) for name, signal in by_name.items()}
    taken: dict[str, int] = {}
    union = 0
    for name, signal in by_name.items():
        mask = _mask(signal)
        if mask & union:
            others = tuple(one for one, bits in taken.items() if mask & bits and not _is_apart(shown[name], shown[one]))
            if others:
                yield Overlap(name, others)
        taken[name] = mask
        union |= mask


def _mask(signal: Signal) -> int:
    if signal.byte_order == "little_endian":
        return ((1 << signal.length) - 1) << signal.start
    return sum(1 << bit for bit in bits_of(signal))


def _is_apart(one: Mapping[str, frozenset[int]], other: Mapping[str, frozenset[int]]) -> bool:
    """Whether some multiplexer never shows both signals, given the values that show each of them."""
    return any(name in other and not other[name] & ids for name, ids in one.items())


def _multiplexers(by_name: Mapping[str, Signal], signal: Signal) -> Iterator[tuple[str, frozenset[int]]]:
    """Yield each multiplexer that the signal depends on, with the values that show the signal."""
    seen: set[str] = set()
    while (parent := signal.multiplexer_signal) is not None and parent in by_name and parent not in seen:
        seen.add(parent)
        yield parent, frozenset(signal.multiplexer_ids or ())
        signal = by_name[parent]
