"""Counters of a run, written by the loop and read by all others."""

from dataclasses import dataclass, field, fields

from vehicle_iface.runtime.histogram import LatencyHistogram


@dataclass(slots=True)
class Counters:
    """Counters that only increase."""

    samples: int = 0
    """Complete samples received."""
    samples_before_engagement: int = 0
    """Complete samples without a command because another commander drove the vehicle, or might have."""
    commands: int = 0
    """Commands of which all frames were sent."""
    commands_late: int = 0
    """Samples whose command was sent later than one command period after they were complete."""
    samples_expired: int = 0
    """Samples without a command because they had waited too long in this process."""
    samples_held_up: int = 0
    """Samples not used because they were, or may have been, delayed before they reached this machine."""
    stops_on_stale_state: int = 0
    """Stop commands sent because no sample arrived."""
    frames_sent: int = 0
    frames_not_sent: int = 0
    """Frames that the bus had no room for; they are lost, not kept."""
    commands_refused: int = 0
    """Commands that were not sent because an earlier one still waited in the transmit queue."""
    messages_not_encoded: int = 0
    """Commands and other messages that were not sent because a value or a checksum could not be encoded."""
    foreign_commands: int = 0
    """Frames of other nodes that carried an identifier of ours."""
    controller_errors: int = 0
    controller_too_slow: int = 0
    """Commands that took the controller longer than its budget; the vehicle was stopped instead."""
    trajectories: int = 0
    trajectories_rejected: int = 0
    link_losses: int = 0
    latency: LatencyHistogram = field(default_factory=LatencyHistogram)
    """From the arrival of the message that completed a sample to the sending of the command."""

    @property
    def deadline_misses(self) -> int:
        """Samples without a command within a period."""
        return self.commands_late + self.samples_expired

    def as_dict(self) -> dict[str, int]:
        """The plain counts by name."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "latency"}
        return values | {"deadline_misses": self.deadline_misses}
