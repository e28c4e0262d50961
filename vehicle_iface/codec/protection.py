"""The protection of one message (checksum, counter) as decoder and encoder see it, of whatever kind."""

from collections.abc import Callable
from dataclasses import dataclass

Payload = bytes | bytearray
NO_COUNTER = -1
"""What `Protection.read_counter` returns where the message has no counter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Protection:
    """A checksum, a counter, or both."""

    intact: Callable[[bytes], bool]
    """Whether a payload of full length carries the checksum of its content; always true without a checksum."""
    read_counter: Callable[[bytes], int]
    """The counter in a payload, which may be an invalid one; `NO_COUNTER` where the message has none."""
    protect: Callable[[bytearray, int], None]
    """Write a counter, then the checksum, into a payload, in place."""
    counter_states: int
    """Valid counters are 0 … counter_states − 1; 1 where the message has none."""
    max_step: int
    """A greater step of the counter is a wrong sequence; 0 where the message has none."""

    @property
    def has_counter(self) -> bool:
        return self.counter_states > 1

    def next_counter(self, counter: int) -> int:
        """The counter after `counter`."""
        return (counter + 1) % self.counter_states
