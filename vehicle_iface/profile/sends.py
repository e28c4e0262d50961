"""The tables `[[send]]`, `[command.periods]` and `[command.values]`: messages and values that no field fills."""

from typing import Annotated

import msgspec

WHEN = ("armed", "engaging", "enabled", "released", "always")
"""The words of `when`, explained in `command.Phases`."""
ENABLING = ("engaging", "enabled")
COUNT = "count"
"""The value that steps by one from frame to frame."""


class ValueTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A variable value: one of `value` with `when`, `complement`, `echo`."""

    value: float | None = None
    """Value in the DBC's unit. While `when` does not hold, the DBC's initial value is sent."""
    when: str | None = None
    complement: str | None = None
    """The signal of the same message whose bits are inverted here."""
    echo: str | None = None
    """The received MESSAGE.SIGNAL whose newest value is sent back. The message is not sent before there is one."""


SentValue = float | str | ValueTable
"""A number in the DBC's unit, `"count"`, or a table."""


class SentMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One message in addition to the commands."""

    message: str
    when: str
    once: bool = False
    """Send once each time that `when` begins to hold."""
    period_s: Annotated[float, msgspec.Meta(gt=0.0)] | None = None
    """Period while `when` holds."""
    values: dict[str, SentValue] = {}
    """Values by signal; those that are left out have the DBC's initial value."""
