"""Sends frames through the transmit filter to the link; gate and encoder commit only what was sent."""

import logging
from collections.abc import Callable, Iterable
from enum import Enum, auto

from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.codec.sent_values import SendContext
from vehicle_iface.command import WireCommand
from vehicle_iface.command_forms import CommandFormer, MeasuredMotion
from vehicle_iface.errors import SignalError
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.command_pace import CommandPace
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import Decision
from vehicle_iface.runtime.link import Link
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.gate import Gate
from vehicle_iface.safety.transmit_filter import TransmitFilter

log = logging.getLogger(__name__)


class Outcome(Enum):
    """The outcome of sending a command."""

    SENT = auto()
    """All frames that were due were sent."""
    NOT_DUE = auto()
    """No frame was due: the sample lies between two sent commands, or nothing may be sent yet."""
    NOT_SENT = auto()


SENT, NOT_DUE, NOT_SENT = Outcome.SENT, Outcome.NOT_DUE, Outcome.NOT_SENT
"""Enumerations are slow to read."""


class Transmitter:
    """Encodes, sends and commits; each frame is sent at most once."""

    def __init__(
        self,
        encoder: Encoder,
        pace: CommandPace,
        transmit_filter: TransmitFilter,
        link: Link,
        gate: Gate,
        engagement: Engagement,
        counters: Counters,
        now_ns: Callable[[], int],
        read_context: Callable[[int], SendContext],
        former: CommandFormer | None = None,
    ) -> None:
        """`read_context` gives phases and received values at a time, for values that depend on them.

        Without a `former` commands are encoded as they were permitted.
        """
        self._former = former
        self._encoder, self._pace, self._transmit_filter = encoder, pace, transmit_filter
        self._link, self._gate = link, gate
        self._engagement, self._counters, self._now_ns = engagement, counters, now_ns
        self._read_context = read_context
        self.decided_ns = now_ns()
        """When the newest command was decided, sent or not."""
        self._has_room: bool | None = None

    def begin_pass(self) -> None:
        """Ask the link again whether it has room."""
        self._has_room = None

    def has_room(self) -> bool:
        """Whether what is sent now leaves now; asked once a pass."""
        if self._has_room is None:
            self._has_room = self._link.has_room()
        return self._has_room

    def send_command(self, decision: Decision, now_ns: int, *, is_newest: bool = True) -> Outcome:
        """The command frames of one decision that are due.

        Nothing while the command of an earlier pass still waits to leave: however dead the bus is, no more of them
        than one pass sends are under way. `is_newest`: no younger sample is answered in this pass.
        """
        self.decided_ns = now_ns
        if not self._engagement.mode.may_send:
            self._gate.commit()  # a shadow counts its rates from what it would have sent
            return NOT_SENT
        if not self.has_room():
            return NOT_SENT
        permitted = decision.permitted
        names = self._pace.select(permitted, now_ns, is_newest=is_newest)
        if not names or not self._prepare(names, now_ns):
            return NOT_DUE
        former, is_all = self._former, names == self._pace.all_names
        command = permitted if former is None else _form(former, decision, now_ns)
        try:
            frames = self._encoder.encode_command(command, None if is_all else names)
        except SignalError as error:
            self._note_unencodable(error)
            return NOT_SENT
        sent = self._send(frames)
        if sent == len(frames):
            self._pace.commit(permitted, now_ns, names)
            self._counters.commands += 1
        if sent == len(frames) and is_all:
            self._gate.commit()
            if former is not None:
                former.commit()
        elif sent and permitted.enable:
            fields = self._encoder.fields_of(frames[:sent])
            self._gate.commit_fields(fields if former is None else former.commit_fields(fields))
        return SENT if sent == len(frames) else NOT_SENT

    def send(self, message: str, source: object) -> bool:
        """One message, its values taken from the attributes of `source`; whether it left."""
        if not self._prepare((message,), self._now_ns()):
            return False
        try:
            frame = self._encoder.encode(message, source)
        except SignalError as error:
            self._note_unencodable(error)
            return False
        return self._send((frame,)) == 1

    def _note_unencodable(self, error: SignalError) -> None:
        """Nothing is sent instead; without commands the vehicle's own watchdog acts."""
        if not self._counters.messages_not_encoded:
            log.error("not sent: %s (further ones are counted)", error)
        self._counters.messages_not_encoded += 1

    def _prepare(self, names: Iterable[str], now_ns: int) -> bool:
        """Read what the values of these messages depend on; whether all of it is there."""
        if not self._encoder.depends_on_context:
            return True
        self._encoder.context = self._read_context(now_ns)
        return self._encoder.has_echoes(names)

    def _send(self, frames: tuple[CanFrame, ...]) -> int:
        """Return how many were sent: those before the first that is rejected. Only they step a counter."""
        now_ns, transmit_filter = self._now_ns(), self._transmit_filter
        allowed = frames
        for count, frame in enumerate(frames):
            if not transmit_filter.allows(frame, now_ns):
                allowed = frames[:count]
                break
        sent = self._link.send(*allowed) if allowed else 0
        self._encoder.commit(frames[:sent])
        return sent


def _form(former: CommandFormer, decision: Decision, now_ns: int) -> WireCommand:
    accel_mps2 = decision.state.accel_mps2 if decision.state is not None else 0.0
    motion = MeasuredMotion(decision.speed_mps, accel_mps2, decision.reversing, decision.engaging)
    return former.form(decision.permitted, motion, now_ns)
