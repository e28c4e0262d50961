"""Shadow: compares the command that this loop would have sent with the other commander's, for the same sample.

The shadow's rate limits have a history of their own. It restarts when the other commander takes the vehicle over: from
the measured state, with the limits of engaging until the vehicle reports AUTONOMOUS. From then on rates are limited
from the shadow's previous command. While nobody commands, the shadow computes as if this loop drove.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from vehicle_iface.codec.database import BoundMessage
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.command import SafeCommand
from vehicle_iface.command_forms import CommandReader
from vehicle_iface.decoded import DecodedMessage
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.histogram import LogHistogram
from vehicle_iface.state import VehicleState
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import VehicleMode, VehicleStatus
from vehicle_iface.telemetry.details import ShadowSummary, Spread
from vehicle_iface.units import NS_PER_MS

HISTORY = 16
"""Number of own commands to which a foreign command may belong."""
TAKEOVER_GAP_NS = 100 * NS_PER_MS
"""After this time without an enabled command, the next one takes the vehicle over."""


class DifferenceStats:
    """Statistics of absolute differences, from 1e-6 to 16 in the quantity's unit."""

    def __init__(self) -> None:
        self._sizes = LogHistogram(smallest=1e-6, octaves=24)

    def add(self, difference: float) -> None:
        """Count one difference, regardless of its sign."""
        self._sizes.add(abs(difference))

    def summary(self) -> Spread:
        """Return the statistics in the quantity's unit; zeros if there are none."""
        sizes = self._sizes
        mean = sizes.total / sizes.count if sizes.count else 0.0
        return Spread(mean=mean, p50=sizes.quantile(0.50), p95=sizes.quantile(0.95), max=sizes.max)


class OwnCommand(NamedTuple):
    """The command that this loop would have sent for a sample."""

    completed_ns: int
    """Time at which the sample was complete."""
    state: VehicleState
    decided_ns: int
    permitted: SafeCommand


class ForeignCommand(NamedTuple):
    """A complete command of the other commander."""

    begun_ns: int
    """Time at which its first frame was received."""
    fields: dict[str, float | int]


class Shadow:
    """Pairs own and foreign commands by sample, and counts. Values are compared while both are enabled."""

    def __init__(
        self, commands: Sequence[BoundMessage], reader: CommandReader, *, together_ns: int, longest_ns: int
    ) -> None:
        """`commands` are the messages that make one command: they come within `together_ns`.

        Ours and theirs are compared in acceleration and wheel angle. `reader` computes those of a command in another
        form: a curvature, a yaw rate of a vehicle that moves, drive and brake. What cannot be computed is not compared:
        the acceleration of a speed command. A command later than `longest_ns` after a sample does not belong to it.
        """
        self._fields = {message.name: message.fields for message in commands}
        self._keys = {message.key for message in commands}
        self._decoder, self._reader = Decoder(commands), reader
        self._together_ns, self._longest_ns = together_ns, longest_ns
        self._ours: deque[OwnCommand] = deque(maxlen=HISTORY)
        self._parts: dict[str, DecodedMessage] = {}
        self._theirs: list[ForeignCommand] = []
        self._enabled_ns: int | None = None
        self._compared_ns = 0
        self.is_taking_over = False
        """The other commander has enabled its commands, and the vehicle does not say yet that it is autonomous."""
        self.compared = 0
        self.takeovers = 0
        """Commands that took the vehicle over; with them our history begins, and they are not compared."""
        self.unmatched_commands = 0
        """Commands that belong to no sample, or to one that another command belongs to."""
        self.mismatches = dict.fromkeys(("enable", "safe_stop", "reason"), 0)
        self.accel_mps2, self.front_wheel_angle_rad = DifferenceStats(), DifferenceStats()

    def on_foreign_frame(self, frame: CanFrame) -> None:
        """Receive a frame of another node with one of our identifiers; a frame that is not intact is dropped and
        counted."""
        is_command = (frame.can_id, frame.is_extended, frame.bus) in self._keys
        received = self._decoder.decode(frame) if is_command else None
        if received is None:
            return
        since_ns = received.stamp_ns - self._together_ns
        self._parts = {name: part for name, part in self._parts.items() if part.stamp_ns >= since_ns}
        self._parts[received.name] = received
        if len(self._parts) == len(self._fields):
            self._theirs.append(self._whole(self._parts))
            self._parts = {}

    def record(self, sample: Sample, permitted: SafeCommand, now_ns: int) -> None:
        """Record the command that this loop would have sent for a sample, at `now_ns`."""
        self._ours.append(OwnCommand(sample.completed_ns, sample.state, now_ns, permitted))

    def compare(self) -> OwnCommand | None:
        """Pair received and recorded commands; our command where the other commander takes over, or None."""
        taken: OwnCommand | None = None
        for theirs in self._theirs:
            ours = self._sample_of(theirs)
            is_enabled = bool(theirs.fields.get("enable", True))
            drives_on = self._enabled_ns is not None and theirs.begun_ns - self._enabled_ns <= TAKEOVER_GAP_NS
            if ours is None:
                self.unmatched_commands += 1
                is_enabled = is_enabled and drives_on
            elif is_enabled and not drives_on:
                self.takeovers += 1
                taken = ours
            else:
                self._count(ours, theirs.fields)
            self._enabled_ns = theirs.begun_ns if is_enabled else None
        self._theirs.clear()
        self.is_taking_over = self._enabled_ns is not None and (self.is_taking_over or taken is not None)
        return taken

    def on_status(self, status: VehicleStatus) -> bool:
        """Return whether the vehicle now reports that it has been taken over."""
        has_been = self.is_taking_over and status.mode is VehicleMode.AUTONOMOUS
        self.is_taking_over = self.is_taking_over and not has_been
        return has_been

    def reset(self) -> None:
        """Reset, as after a loss of the link; the counts stay."""
        self._decoder.reset()
        self._ours.clear()
        self._parts.clear()
        self._theirs.clear()
        self._enabled_ns = None
        self.is_taking_over = False

    def summary(self) -> ShadowSummary:
        """Return all counts; differences are in m/s² and rad."""
        return ShadowSummary(
            compared=self.compared,
            takeovers=self.takeovers,
            unmatched_commands=self.unmatched_commands,
            drops={f"{cause.value} {name}".strip(): count for (cause, name), count in self._decoder.drops.items()},
            mismatches=dict(self.mismatches),
            accel_mps2=self.accel_mps2.summary(),
            front_wheel_angle_rad=self.front_wheel_angle_rad.summary(),
        )

    def _whole(self, parts: dict[str, DecodedMessage]) -> ForeignCommand:
        fields: dict[str, float | int] = {}
        for received in parts.values():
            for name, value in zip(self._fields[received.name], received.values, strict=True):
                if name and value is not None:  # a field in several signals: the least, so ENABLE = 0 anywhere is off
                    fields[name] = min(value, fields.get(name, value))
        return ForeignCommand(min(received.stamp_ns for received in parts.values()), fields)

    def _sample_of(self, theirs: ForeignCommand) -> OwnCommand | None:
        """The newest sample before the command, unless another command belongs to it, or it is too old."""
        before = (ours for ours in reversed(self._ours) if ours.completed_ns <= theirs.begun_ns)
        ours = next(before, None)
        if ours is None or theirs.begun_ns - ours.completed_ns > self._longest_ns:
            return None
        if ours.completed_ns <= self._compared_ns:
            return None
        self._compared_ns = ours.completed_ns
        return ours

    def _count(self, own: OwnCommand, theirs: dict[str, float | int]) -> None:
        ours, speed_mps = own.permitted, own.state.speed_mps
        self.compared += 1
        for name in self.mismatches:
            if name in theirs:
                self.mismatches[name] += getattr(ours, name) != theirs[name]
        if not (ours.enable and theirs.get("enable", True)):
            return
        direction = -1.0 if ours.speed_mps < 0.0 else 1.0
        requested = self._reader.read(theirs, speed_mps=speed_mps, direction=direction)
        if requested.accel_mps2 is not None:
            self.accel_mps2.add(ours.accel_mps2 - requested.accel_mps2)
        if requested.front_wheel_angle_rad is not None:
            self.front_wheel_angle_rad.add(ours.front_wheel_angle_rad - requested.front_wheel_angle_rad)
