"""What a profile and its DBC disagree about in `[command.periods]`, `[command.values]` and `[[send]]`."""

from collections.abc import Iterator

from vehicle_iface.codec.binding import Binding, Role, suggest
from vehicle_iface.errors import ConfigError


def send_faults(binding: Binding) -> Iterator[ConfigError]:
    """Periods and values of command messages, and messages besides."""
    for name in binding.profile.command.periods:
        yield from _command_faults(binding, name, f"$.command.periods.{name}")


def _command_faults(binding: Binding, name: str, place: str) -> Iterator[ConfigError]:
    """The message carries a command."""
    commands = [one for one, role in binding.roles.items() if role is Role.COMMAND]
    if name not in binding.messages:
        yield binding.fault(place, f"no message {name!r} in {binding.file.name}{suggest(name, binding.messages)}")
    elif name not in commands:
        yield binding.fault(place, f"must be a command message: {' or '.join(commands)}")
