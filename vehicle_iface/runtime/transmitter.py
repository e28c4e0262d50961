"""Frames on their way out: through the filter to the link; what left is committed, everything else has not happened."""

from collections.abc import Callable

from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.command import WireCommand
from vehicle_iface.command_forms import CommandFormer, MeasuredMotion
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.counters import Counters
from vehicle_iface.runtime.cycle import Decision
from vehicle_iface.runtime.link import Link
from vehicle_iface.safety.engagement import Engagement
from vehicle_iface.safety.gate import Gate
from vehicle_iface.safety.transmit_filter import TransmitFilter


class Transmitter:
    """Encodes, sends and commits; each frame is handed over at most once."""

    def __init__(
        self,
        encoder: Encoder,
        transmit_filter: TransmitFilter,
        link: Link,
        gate: Gate,
        engagement: Engagement,
        counters: Counters,
        now_ns: Callable[[], int],
        former: CommandFormer | None = None,
    ) -> None:
        """Without a `former` commands are encoded as they were permitted."""
        self._former = former
        self._encoder, self._transmit_filter, self._link, self._gate = encoder, transmit_filter, link, gate
        self._engagement, self._counters, self._now_ns = engagement, counters, now_ns
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

    def send_command(self, decision: Decision, now_ns: int) -> bool:
        """All command frames of one decision; whether all of them left.

        Nothing while the command of an earlier pass still waits to leave: however dead the bus is, no more of them
        than one pass sends are under way.
        """
        self.decided_ns = now_ns
        if not self._engagement.mode.may_send:
            self._gate.commit()  # a shadow counts its rates from what it would have sent
            return False
        if not self.has_room():
            return False
        former = self._former
        command = decision.permitted if former is None else _form(former, decision, now_ns)
        frames = self._encoder.encode_command(command)
        sent = self._send(frames)
        if sent == len(frames):
            self._gate.commit()
            if former is not None:
                former.commit()
            self._counters.commands += 1
            return True
        if sent and decision.permitted.enable:
            fields = self._encoder.fields_of(frames[:sent])
            self._gate.commit_fields(fields if former is None else former.commit_fields(fields))
        return False

    def send(self, message: str, source: object) -> None:
        """One message, its values taken from the attributes of `source`."""
        self._send((self._encoder.encode(message, source),))

    def _send(self, frames: tuple[CanFrame, ...]) -> int:
        """How many left: those before the first that is refused. Only they step a counter."""
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
