"""Periodic work on an absolute time grid."""


class PeriodicTimer:
    """Instants `start_ns + k · period_ns`. One late tick does not shift the ones after it.

    Instants that have gone by unserved are counted and left out: there is no catching up.
    """

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self.period_ns = period_ns
        self.next_ns = start_ns + period_ns
        self.ticks = 0
        self.overruns = 0

    def restart(self, start_ns: int) -> None:
        """Begin a new grid; the instants until now count neither as served nor as left out."""
        self.next_ns = start_ns + self.period_ns

    def is_due(self, now_ns: int) -> bool:
        """Whether an instant has come that was not served yet; moves on to the first one after `now_ns`."""
        if now_ns < self.next_ns:
            return False
        skipped = (now_ns - self.next_ns) // self.period_ns
        self.next_ns += (skipped + 1) * self.period_ns
        self.overruns += skipped
        self.ticks += 1
        return True
