"""What a run counts: one object that the loop writes and everybody else reads."""

from dataclasses import dataclass, field, fields

from vehicle_iface.runtime.latency import LatencyHistogram


@dataclass(slots=True)
class Counts:
    """Grows only. The cause is in the name."""

    samples: int = 0
    """Complete samples received."""
    samples_heard_only: int = 0
    """Of these, those that were not answered because somebody else drove the vehicle, or that was not known yet."""
    commands: int = 0
    """Command pairs that left whole."""
    answered_late: int = 0
    """Samples answered later than one command period after they were complete."""
    too_old_to_answer: int = 0
    """Samples that were not answered because they had waited too long here."""
    stale_stops: int = 0
    """Stop commands sent because no sample came."""
    frames_sent: int = 0
    frames_not_sent: int = 0
    """Frames that the bus had no room for; they are lost, not kept."""
    commands_refused: int = 0
    """Commands that were not sent because an earlier one still waited to leave."""
    foreign_commands: int = 0
    """Frames of other nodes that carried an identifier of ours."""
    controller_errors: int = 0
    controller_too_slow: int = 0
    """Commands that took the controller longer than its budget; the vehicle was stopped instead."""
    trajectories: int = 0
    trajectories_rejected: int = 0
    link_losses: int = 0
    latency: LatencyHistogram = field(default_factory=LatencyHistogram)
    """From the arrival of the message that completed a sample to the command's hand-over."""

    @property
    def deadline_misses(self) -> int:
        """Samples that were not answered within a period."""
        return self.answered_late + self.too_old_to_answer

    def as_dict(self) -> dict[str, int]:
        """The plain counts by name."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "latency"}
        return values | {"deadline_misses": self.deadline_misses}
