"""The protection of one message (checksum, counter) as decoder and encoder use it, whatever its kind."""

from collections.abc import Callable
from dataclasses import dataclass

Payload = bytes | bytearray
NO_COUNTER = -1
"""What `Protection.read_counter` returns where the message has no counter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Protection:
    """A checksum, a counter, or both."""

    intact: Callable[[bytes], bool]
    """Checks whether a payload of full length carries the right checksum; always true without a checksum."""
    read_counter: Callable[[bytes], int]
    """Reads the counter of a payload, which may be invalid; `NO_COUNTER` if the message has none."""
    protect: Callable[[bytearray, int], None]
    """Writes the counter and then the checksum into a payload, in place."""
    counter_states: int
    """Number of valid counter values, which are 0 … counter_states − 1; 1 without a counter."""
    max_step: int
    """The largest accepted step of the counter; 0 without a counter."""

    @property
    def has_counter(self) -> bool:
        return self.counter_states > 1

    def next_counter(self, counter: int) -> int:
        """Return the counter after `counter`."""
        return (counter + 1) % self.counter_states
