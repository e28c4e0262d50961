"""Signals of a message that lie on the same bits."""

from collections.abc import Iterator

from cantools.database import Message, Signal

from vehicle_iface.codec.layout import bits_of


def find_overlaps(message: Message) -> Iterator[tuple[Signal, Signal]]:
    """Each signal with an earlier one whose bits it shares while both are there."""
    taken: list[tuple[Signal, int]] = []
    union = 0
    for signal in message.signals:
        mask = _mask(signal)
        if mask & union:
            for other, bits in taken:
                if mask & bits and not _is_apart(message, signal, other):
                    yield signal, other
        taken.append((signal, mask))
        union |= mask


def _mask(signal: Signal) -> int:
    if signal.byte_order == "little_endian":
        return ((1 << signal.length) - 1) << signal.start
    return sum(1 << bit for bit in bits_of(signal))


def _is_apart(message: Message, one: Signal, other: Signal) -> bool:
    """Whether some multiplexer never shows both."""
    ids = dict(_multiplexers(message, one))
    return any(name in ids and not ids[name] & shown for name, shown in _multiplexers(message, other))


def _multiplexers(message: Message, signal: Signal) -> Iterator[tuple[str, frozenset[int]]]:
    """Each multiplexer that the signal depends on, with the ids that show it."""
    by_name = {one.name: one for one in message.signals}
    seen: set[str] = set()
    while signal.multiplexer_signal in by_name and signal.multiplexer_signal not in seen:
        seen.add(signal.multiplexer_signal)
        yield signal.multiplexer_signal, frozenset(signal.multiplexer_ids or ())
        signal = by_name[signal.multiplexer_signal]
