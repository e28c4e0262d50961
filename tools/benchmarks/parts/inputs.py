"""Values that a DBC allows, the same on each run."""

import random
from pathlib import Path

from cantools.database import Message, Signal

DBC_FOLDER = Path(__file__).resolve().parents[3] / "dbc"


def random_values(message: Message, count: int) -> list[dict[str, float]]:
    """In range and on the grid of each signal; whole numbers where scale and offset are whole."""
    dice = random.Random(message.frame_id)
    return [{signal.name: _value(signal, dice) for signal in message.signals} for _ in range(count)]


def is_same(one: object, other: object) -> bool:
    """To the last bit, whole numbers as whole numbers."""
    return repr(one) == repr(other)


def _value(signal: Signal, dice: random.Random) -> float:
    """Of a name where there are names, else anywhere between the limits."""
    raw_low = -(1 << signal.length - 1) if signal.is_signed else 0
    raw_high = raw_low + (1 << signal.length) - 1
    while True:
        raw = dice.choice(list(signal.choices)) if signal.choices else dice.randint(raw_low, raw_high)
        value = raw * signal.scale + signal.offset
        above = signal.minimum is None or value >= signal.minimum
        if above and (signal.maximum is None or value <= signal.maximum):
            return value
