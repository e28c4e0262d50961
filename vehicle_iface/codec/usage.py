"""Determines which parts of a DBC a profile uses. Faults elsewhere in the DBC do not matter."""

from collections.abc import Iterator

from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.dbc_findings import ERROR, DbcFinding
from vehicle_iface.errors import ConfigError

_SENT_SECTIONS = ("command", "body", "report")


class Usage:
    """The names that a profile uses, including names that its DBC does not have."""

    def __init__(self, binding: Binding) -> None:
        profile = binding.profile
        bound = {
            section: {dotted for signals in fields.values() for dotted in signals}
            for section, fields in binding.sections.items()
        }
        self._signals = {*profile.constants}.union(*bound.values())
        self._messages = {*profile.state.sample, *(dotted.partition(".")[0] for dotted in self._signals)}
        self._sent = {dotted.partition(".")[0] for section in _SENT_SECTIONS for dotted in bound[section]}
        self._signals |= binding.protection_signals

    def concerns(self, finding: DbcFinding) -> bool:
        """Whether a finding concerns a used message or signal, or any bit of a sent message."""
        for place in finding.about:
            message, _, signal = place.partition(".")
            if message in self._sent or place in self._signals or (not signal and message in self._messages):
                return True
        return False


def used_dbc_faults(binding: Binding) -> Iterator[ConfigError]:
    """Yield the faults of the DBC in the parts that its profile uses."""
    usage = Usage(binding)
    for finding in binding.file.findings:
        if finding.severity == ERROR and usage.concerns(finding):
            yield binding.file.error_of(finding)
