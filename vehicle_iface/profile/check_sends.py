"""Checks periods, `[command.values]` and `[[send]]` beyond their types; each fault as `place: text`."""

from collections.abc import Iterator, Mapping

from vehicle_iface.profile.forms import SIGNAL_NAME
from vehicle_iface.profile.schema import Profile
from vehicle_iface.profile.sends import COUNT, ENABLING, WHEN, SentValue, ValueTable

_TOLERANCE = 1e-6
"""Maximum deviation of a ratio of decimal periods from a whole number, in samples."""


def check_sends(profile: Profile) -> Iterator[str]:
    """Check that periods are compatible, and that messages and values state when they are sent."""
    yield from _check_periods(profile)
    yield from _check_enable(profile)
    yield from _check_values("$.command.values", profile.command.values)
    for dotted in profile.command.values:
        if not SIGNAL_NAME.fullmatch(dotted):
            yield f"$.command.values: {dotted!r}: must be MESSAGE.SIGNAL"
        if dotted in profile.constants:
            yield f"$.constants.{dotted}: $.command.values has it as well; remove one of them"
    sample_s = profile.timing.sample_period_s
    for index, sent in enumerate(profile.send):
        place = f"$.send[{index}]"
        if sent.when not in WHEN:
            yield f"{place}.when: {sent.when!r}: must be one of: {', '.join(WHEN)}"
        if sent.once is (sent.period_s is not None):
            yield f"{place}: must have one of once = true and period_s"
        if sent.period_s is not None and sent.period_s < sample_s * (1.0 - _TOLERANCE):
            text = f"{sent.period_s}: must be at least $.timing.sample_period_s = {sample_s}"
            yield f"{place}.period_s: {text}; it is sent behind the answers to samples"
        if any(other.message == sent.message for other in profile.send[:index]):
            yield f"{place}.message: {sent.message} is in $.send already; give it values with when instead"
        yield from _check_values(f"{place}.values", sent.values)
        for signal in sent.values:
            if f"{sent.message}.{signal}" in profile.constants:
                yield f"$.constants.{sent.message}.{signal}: {place}.values has it as well; remove one of them"


def _check_enable(profile: Profile) -> Iterator[str]:
    """Check that a signal or message enables the vehicle."""
    values = [*profile.command.values.values(), *(source for sent in profile.send for source in sent.values.values())]
    tables = (source for source in values if isinstance(source, ValueTable))
    words = {sent.when for sent in profile.send} | {table.when for table in tables}
    if not profile.only_watches and profile.command.signals.enable is None and words.isdisjoint(ENABLING):
        yield (
            "$.command.signals: enable is missing; bind it, or say what enables the vehicle "
            'in [[send]] or [command.values] with when = "engaging" or "enabled"'
        )


def _check_periods(profile: Profile) -> Iterator[str]:
    """Check that each command period is a whole number of samples."""
    sample_s = profile.timing.sample_period_s
    periods_s = {f"$.command.periods.{name}": period_s for name, period_s in profile.command.periods.items()}
    for place, period_s in ({"$.timing.command_period_s": profile.timing.command_period_s} | periods_s).items():
        count = period_s / sample_s
        if count > 1.0 - _TOLERANCE and abs(count - round(count)) <= _TOLERANCE * count:
            continue
        lower = max(1, int(count))
        allowed = " or ".join(f"{number * sample_s:.10g}" for number in (lower, lower + 1))
        text = f"{period_s}: must be a whole multiple of $.timing.sample_period_s = {sample_s}, such as {allowed}"
        if count < 1.0:
            text += (
                "; each command is computed from a new sample. Where the vehicle needs commands more often, let a "
                "faster message complete the samples: $.state.trigger"
            )
        yield f"{place}: {text}"


def _check_values(place: str, values: Mapping[str, SentValue]) -> Iterator[str]:
    for name, source in values.items():
        there = f"{place}.{name}"
        if isinstance(source, str) and source != COUNT:
            allowed = f'a number, "{COUNT}", or a table with value and when, complement, or echo'
            yield f"{there}: {source!r}: must be {allowed}"
        if not isinstance(source, ValueTable):
            continue
        kinds = [kind for kind in ("value", "complement", "echo") if getattr(source, kind) is not None]
        if len(kinds) != 1:
            yield f"{there}: must have one of value, complement and echo"
        elif (source.when is None) is (source.value is not None):
            yield f"{there}: value and when must stand together; a value that never changes is a plain number"
        if source.when is not None and source.when not in WHEN:
            yield f"{there}.when: {source.when!r}: must be one of: {', '.join(WHEN)}"
        if source.echo is not None and not SIGNAL_NAME.fullmatch(source.echo):
            yield f"{there}.echo: {source.echo!r}: must be MESSAGE.SIGNAL"
