"""What is sent besides the fields of commands: fixed values, counts, complements and echoes."""

import math
from collections import deque
from collections.abc import Iterator, Mapping

from vehicle_bus_contract.reference import DecodedFrame, S

from hil_bench.peer.signals import echoed_signals, initial_of, sent_values
from hil_bench.peer.wire import PeerWire

ECHO_NS = round(0.15 * S)
"""An echo is of a value that the vehicle still sent within this time before it."""


class Besides:
    """Fed with every sound frame in the order of time; `find_faults` judges one of the device's."""

    def __init__(self, wire: PeerWire) -> None:
        self._wire = wire
        self._values = sent_values(wire.profile)
        self._echoed: dict[str, deque[tuple[int, float]]] = {name: deque() for name in echoed_signals(wire.profile)}
        self._counts: dict[str, float] = {}

    def note(self, decoded: DecodedFrame) -> None:
        """A frame of the vehicle. A device may reject one with an undefined value, and go on with an older echo."""
        is_defined = all(map(self._is_defined, decoded.signals, decoded.signals.values()))
        for dotted, sent in self._echoed.items():
            if dotted in decoded.signals:
                sent.append((decoded.stamp_ns, decoded[dotted]))
                while is_defined and sent[0][0] < decoded.stamp_ns - ECHO_NS:
                    sent.popleft()

    def _is_defined(self, dotted: str, value: float) -> bool:
        names = self._wire.signals[dotted].names if dotted in self._wire.signals else {}
        return not names or int(value) in names.values()

    def find_faults(self, decoded: DecodedFrame) -> Iterator[str]:
        """Values that are not the profile's."""
        for dotted, wanted in self._values.items():
            if dotted not in decoded.signals or isinstance(wanted, str):
                continue
            if not self._fits(dotted, wanted, decoded[dotted], decoded):
                yield f"{dotted} is {decoded[dotted]:g}, where the profile has {wanted}"

    def find_gaps(self, decoded: DecodedFrame) -> Iterator[str]:
        """Counts that did not advance by one: as gaps of a counter, frames that the bus has lost explain them."""
        for dotted, wanted in self._values.items():
            if dotted not in decoded.signals or not isinstance(wanted, str):
                continue
            signal, value = self._wire.signals[dotted], decoded[dotted]
            before, self._counts[dotted] = self._counts.get(dotted), value
            states = 1 << signal.signal.length
            if before is not None and abs((value - before) / signal.count % states - 1.0) >= 1e-6:
                yield f"{dotted} from {before:g} to {value:g}"

    def _fits(self, dotted: str, wanted: object, value: float, decoded: DecodedFrame) -> bool:
        signal = self._wire.signals[dotted]
        slack = signal.count / 2.0 + 1e-9
        if isinstance(wanted, int | float):
            return abs(value - wanted) <= slack
        if not isinstance(wanted, Mapping):
            return True
        if "complement" in wanted:
            own = f"{decoded.name}.{wanted['complement']}"
            other = decoded.signals.get(own, decoded.signals.get("COUNTER", math.nan))
            return int(value) == ~int(other) & (1 << signal.signal.length) - 1
        if "echo" in wanted:
            return any(abs(value - sent) <= slack for _, sent in self._echoed[str(wanted["echo"])])
        return min(abs(value - float(wanted["value"])), abs(value - initial_of(signal.signal))) <= slack
