"""Find the messages of a DBC that the program would send, by names of nodes and messages, and by receivers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vehicle_iface.drafting.words import split_words, word_set

_PLACEHOLDERS = frozenset({"", "XXX", "Vector__XXX", "VECTOR__XXX", "Vector_XXX"})
"""Names that editors and people use for an unknown sender."""
_CONTROLLER_WORDS = frozenset(
    {
        "computer",
        "controller",
        "autonomous",
        "av",
        "client",
        "user",
        "agent",
        "ad",
        "ai",
        "acu",
        "das",
        "dsu",
        "customer",
    }
)
_VEHICLE_WORDS = word_set(
    "vehicle inertial vcu ecu eps esp abs bcm gateway sensor chassis platform dbw robot brake steering engine "
    "transmission base gw cgw body ems tcu tcm ecm pcm mdps epas esc vsm hcu mcu bms clu cluster srs"
)
_COMMAND_WORDS = frozenset({"request"})
_REPORT_WORDS = frozenset({"report", "state", "actual", "sensor"})
_NAME_WEIGHT, _MESSAGE_WEIGHT = 4.0, 2.0
_COMMAND_SCORE = 0.5
"""Minimum score of a command that is judged alone: by its name, or half of its signals."""
_SMALL_NETWORK = 4
"""Maximum number of nodes; in a larger network units send requests to one another, so messages are judged alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageSource:
    """Sender and receivers of a message."""

    name: str
    senders: tuple[str, ...]
    receivers: frozenset[str]
    signal_words: tuple[tuple[str, ...], ...]


def find_sent_messages(messages: Sequence[MessageSource]) -> frozenset[str]:
    """Return the names of the messages that the program sends; the vehicle sends the others.

    A node sends either commands or reports. Where one placeholder stands for all nodes, each message is judged alone.
    """
    by_node: dict[str, list[MessageSource]] = {}
    for message in messages:
        by_node.setdefault(message.senders[0] if message.senders else "", []).append(message)
    sent: set[str] = set()
    judged = {node: _judge_node(node, own) for node, own in by_node.items()}
    for node, own in by_node.items():
        if _is_mixed(node, own, nodes=len(by_node)):
            sent.update(message.name for message in own if _judge_alone(message, judged) >= _COMMAND_SCORE)
        elif judged[node] > 0.0:
            sent.update(message.name for message in own)
    return frozenset(sent)


def _is_mixed(node: str, own: Sequence[MessageSource], *, nodes: int) -> bool:
    """Return whether messages of this node may go in both directions."""
    if node in _PLACEHOLDERS or nodes == 1:
        return True
    votes = [_judge_message(message) for message in own]
    return _judge_name(node) == 0.0 and (nodes > _SMALL_NETWORK or min(votes) < 0.0 < max(votes))


def _judge_name(node: str) -> float:
    words = set(split_words(node))
    return _NAME_WEIGHT * (bool(words & _CONTROLLER_WORDS) - bool(words & _VEHICLE_WORDS))


def _judge_node(node: str, own: Sequence[MessageSource]) -> float:
    """Score a node: above 0 for one that commands."""
    if node in _PLACEHOLDERS:
        return 0.0
    return _judge_name(node) or sum(map(_judge_message, own))


def _judge_message(message: MessageSource) -> float:
    """Score a message: above 0 for a command, by its name and those of its signals."""
    words = set(split_words(message.name))
    named = _MESSAGE_WEIGHT * (bool(words & _COMMAND_WORDS) - bool(words & _REPORT_WORDS))
    requests = sum(bool(set(signal) & _COMMAND_WORDS) for signal in message.signal_words)
    return named + (requests / len(message.signal_words) if message.signal_words else 0.0)


def _judge_alone(message: MessageSource, judged: Mapping[str, float]) -> float:
    """Score a message also by its receivers: commands go to the vehicle."""
    receivers = {
        node: judged[node] if judged.get(node) else _judge_name(node) for node in message.receivers - _PLACEHOLDERS
    }
    votes = _judge_message(message)
    is_for_vehicle = any(score < 0.0 for score in receivers.values()) and votes > 0.0
    is_for_controller = any(score > 0.0 for score in receivers.values())
    return votes + is_for_vehicle - is_for_controller
