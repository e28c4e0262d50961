"""What a rerun found."""

from collections import Counter

import msgspec

MAX_DIFFERENCES = 1000
"""Differences that are kept; all are counted."""


class FieldDifference(msgspec.Struct, kw_only=True, frozen=True):
    """A signal whose value differs, in the DBC's unit."""

    signal: str
    recorded: float | str
    today: float | str


class Difference(msgspec.Struct, kw_only=True, frozen=True):
    """A frame that differs from the recorded one."""

    number: int
    """Number of the pass."""
    at_s: float
    """Seconds since the loop was started."""
    message: str
    recorded: str
    """Payload in hexadecimal digits; empty where none was sent."""
    today: str
    fields: list[FieldDifference]
    """Empty where only a checksum, a counter or unused bits differ, or where one of the frames is missing."""
    is_in_log: bool = False
    """Whether it differs from `frames.log`, and not from what the loop handed to the bus."""

    @property
    def text(self) -> str:
        """Describe it in one line."""
        return f"at {self.at_s:.3f} s (pass {self.number}): {self.message}: {self.what}"

    @property
    def what(self) -> str:
        """Describe what differs, without its place."""
        if not self.recorded:
            return f"sent today, not recorded: {self.today}"
        if not self.today:
            return f"recorded, not sent today: {self.recorded}"
        fields = ", ".join(f"{one.signal} {one.recorded} recorded, {one.today} today" for one in self.fields)
        log = ", in frames.log" if self.is_in_log else ""
        return f"{fields or 'no bound signal'} ({self.recorded} recorded{log}, {self.today} today)"


class RerunReport(msgspec.Struct, kw_only=True):
    """Everything that a rerun found."""

    folder: str
    passes: int = 0
    frames: int = 0
    """Frames that were recorded as sent."""
    log_frames: int = 0
    """Frames of ours that were found in `frames.log` as they were sent today."""
    count: int = 0
    by_message: dict[str, int] = {}
    differences: list[Difference] = []
    """The first `MAX_DIFFERENCES`."""
    gap: str = ""
    """Why not all of the recording was compared; empty where all was."""

    def add(self, difference: Difference) -> None:
        """Add one difference."""
        self.count += 1
        self.by_message[difference.message] = self.by_message.get(difference.message, 0) + 1
        if len(self.differences) < MAX_DIFFERENCES:
            self.differences.append(difference)

    @property
    def text(self) -> str:
        """Describe the result, for a person."""
        compared = f"{self.passes:,} passes, {self.frames:,} frames sent"
        if self.log_frames:
            compared += f", {self.log_frames:,} of them found in frames.log"
        lines = [f"{self.folder}: {compared}: {'no difference' if not self.count else 'DIFFERENT'}"]
        if self.count:
            messages = ", ".join(f"{name} {count:,}" for name, count in Counter(self.by_message).most_common())
            lines += [f"first difference {self.differences[0].text}", f"{self.count:,} frames differ: {messages}"]
        return "\n".join([*lines, *([self.gap] if self.gap else [])])
