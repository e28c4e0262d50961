"""A bus for tests in the loop's process: it has what a test puts into its inbox, and always room."""

from vehicle_iface.frame import CanFrame


class InboxBus:
    """A `Bus` without `wait` and `send`, which each kind of other end does in its own way."""

    description = "inbox"

    def __init__(self) -> None:
        self.inbox: list[CanFrame] = []

    def drain(self) -> list[CanFrame]:
        frames, self.inbox = self.inbox, []
        return frames

    def has_room(self) -> bool:
        return True

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        self.inbox = []
