"""Options and commands that had other names in version 0.1. This version accepts the old names with a warning."""

import sys
from collections.abc import Sequence

_COMMANDS = {"pedals": "driver"}
_OPTIONS = {("run", "--trajectory-post"): "--trajectory-mailbox", ("sim", "--pedals"): "--driver-socket"}


def replace_renamed(arguments: Sequence[str]) -> list[str]:
    """Replace old names by the new ones, and report each on standard error."""
    command, *rest = arguments or [""]
    words = [_replace(command, _COMMANDS.get(command))] if arguments else []
    for word in rest:
        option, equals, value = word.partition("=")
        words.append(_replace(option, _OPTIONS.get((command, option))) + equals + value)
    return words


def _replace(old: str, new: str | None) -> str:
    if new is None:
        return old
    print(f"vehicle-iface: {old} is called {new} now; the next version accepts {new} only", file=sys.stderr)
    return new
