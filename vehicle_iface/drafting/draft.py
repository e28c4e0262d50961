"""The draft of a profile before it is written: the signal of each field, and the reasons."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from vehicle_iface.drafting.rules import FieldRule, Section
from vehicle_iface.drafting.scoring import Candidate
from vehicle_iface.drafting.survey import MessageFacts, SignalFacts, Survey
from vehicle_iface.profile.forms import FieldForm

FieldValue = str | tuple[str, ...] | FieldForm
"""A signal, several that carry the same value, or a form."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldDraft:
    """One field of the profile."""

    rule: FieldRule
    value: FieldValue | None
    """None where no signal is bound."""
    chosen: tuple[Candidate, ...] = ()
    others: tuple[Candidate, ...] = ()
    """Further candidates, the best first."""
    remark: str = ""
    """Reason for the value, where the candidates do not show it."""
    is_question: bool = False
    """Whether a person has to choose among the candidates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeFlags:
    """The flags of subsystems that determine the mode."""

    enabled: tuple[SignalFacts, ...]
    override: tuple[SignalFacts, ...]
    fault: tuple[SignalFacts, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Draft:
    """One profile."""

    survey: Survey
    fields: Mapping[tuple[Section, str], FieldDraft]
    """By section and field, in the order in which they are written."""
    pose_source: Literal["local", "geographic", "odometry"]
    sample: tuple[str, ...]
    """Messages; the first one is the trigger."""
    flags: ModeFlags | None
    """Flags that replace a signal with the mode."""
    longitudinal: str
    lateral: str

    @property
    def bound_count(self) -> int:
        return sum(field.value is not None for field in self.fields.values())

    @property
    def open_count(self) -> int:
        return sum(field.is_question for field in self.fields.values())

    @property
    def mode_messages(self) -> frozenset[str]:
        """The names of the messages that the mode is read from."""
        if self.flags is not None:
            return frozenset(signal.message for signal in self.flags.enabled)
        return frozenset(one.signal.message for one in self.fields["status", "mode"].chosen)

    def bound_signals(self, *sections: Section) -> tuple[SignalFacts, ...]:
        """Return the signals of all bound fields of these sections, each once."""
        fields = (field for (section, _), field in self.fields.items() if section in sections)
        found = {one.signal.dotted: one.signal for field in fields if field.value for one in field.chosen}
        if self.flags is not None and "status" in sections:
            flags = (*self.flags.enabled, *self.flags.override, *self.flags.fault)
            found |= {signal.dotted: signal for signal in flags}
        return tuple(found.values())

    def bound_messages(self, *sections: Section) -> tuple[MessageFacts, ...]:
        """Return the messages of these signals, in the order of the DBC."""
        names = {signal.message for signal in self.bound_signals(*sections)}
        return tuple(message for name, message in self.survey.messages.items() if name in names)
