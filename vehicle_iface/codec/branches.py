"""The branches of a multiplexed message that a simulated vehicle sends in turn."""

from collections.abc import Iterable, Mapping

from vehicle_iface.codec.cantools_classes import Signal

Branch = Mapping[str, int]
"""Maps the name of a multiplexer to the value that selects the branch."""


def find_branches(signals: Iterable[Signal]) -> tuple[Branch, ...]:
    """Return branches that together show all signals, multiplexers included.

    A message without multiplexers has one empty branch.
    """
    by_name = {signal.name: signal for signal in signals}
    chains = [_chain(signal, by_name) for signal in by_name.values()]
    longest = [one for one in chains if not any(one != other and one.items() <= other.items() for other in chains)]
    distinct = [one for place, one in enumerate(longest) if one not in longest[:place]]
    return tuple(_complete(branch, chains, by_name) for branch in distinct)


def is_shown(signal: Signal, branch: Branch, by_name: Mapping[str, Signal]) -> bool:
    """Whether a frame of this branch contains the signal."""
    parent = signal.multiplexer_signal
    if parent is None:
        return True
    return branch.get(parent) in (signal.multiplexer_ids or ()) and is_shown(by_name[parent], branch, by_name)


def _chain(signal: Signal, by_name: Mapping[str, Signal]) -> dict[str, int]:
    """Map each multiplexer above the signal to the first value that shows the signal."""
    parent = signal.multiplexer_signal
    if parent is None:
        return {}
    return {parent: (signal.multiplexer_ids or [0])[0], **_chain(by_name[parent], by_name)}


def _complete(branch: dict[str, int], chains: list[dict[str, int]], by_name: Mapping[str, Signal]) -> Branch:
    """Add a value for each further multiplexer that the branch shows."""
    numbers = {name: number for chain in reversed(chains) for name, number in chain.items()}
    while more := [n for n in numbers if n not in branch and is_shown(by_name[n], branch, by_name)]:
        branch = branch | {name: numbers[name] for name in more}
    return branch
