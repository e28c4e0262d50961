"""The controls of one browser: what its user does to them is handled, each value checked; all else is ignored.

They are the buttons of the camera, the filter of the signals, the time of its plots, and what it remembers of them.
They change nothing for another browser. The page of a recording has more controls, for its own place in it; no loop is
behind it.

This relies on private names of exactly viser 1.1.1; `tests/viewer/test_access.py` fails when they change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser
from viser import _messages as messages


def handle_checkbox(client: viser.ClientHandle, uuid: str, on_change: Callable[[bool], None]) -> None:
    """Call `on_change` with the new value of one checkbox of this client; all else is still ignored."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid == uuid and isinstance(value, bool):
            on_change(value)

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_slider(
    client: viser.ClientHandle, uuid: str, lowest: float, highest: float, on_change: Callable[[float], None]
) -> None:
    """Call `on_change` with the new value of one slider of this client, within its range."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid != uuid or isinstance(value, bool) or not isinstance(value, int | float):
            return
        if lowest <= value <= highest:  # false for NaN
            on_change(float(value))

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_text(client: viser.ClientHandle, uuid: str, longest: int, on_change: Callable[[str], None]) -> None:
    """Call `on_change` with the new text of one field of this client, if it has at most `longest` characters."""

    def on_update(_: int, message: Any) -> None:
        value = message.updates.get("value") if isinstance(message.updates, dict) else None
        if message.uuid == uuid and isinstance(value, str) and len(value) <= longest:
            on_change(value)

    client._websock_connection.register_handler(messages.GuiUpdateMessage, on_update)


def handle_key(client: viser.ClientHandle, label: str, key: messages.HotkeyKey, on_press: Callable[[], None]) -> None:
    """Call `on_press` when this client presses `key` outside of a text field, or chooses `label` in its palette."""
    uuid = client.gui.add_command(label, hotkey=key)._impl.uuid

    def on_trigger(_: int, message: Any) -> None:
        if message.uuid == uuid:
            on_press()

    client._websock_connection.register_handler(messages.CommandTriggerMessage, on_trigger)
