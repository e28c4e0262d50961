"""What a browser remembers of its page, and what the page's address says: as the query of a URL.

The address wins over the memory. A browser also says whether its user prefers a light page. All it answers is text from
outside: whoever asks must check each value.

This relies on private names of exactly viser 1.1.1; `tests/browser/test_plots.py` fails when they change.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from urllib.parse import parse_qsl, urlencode

import viser
from viser import _messages as messages

PREFERS = "prefers"
"""In an answer: `light` or `dark`."""
_MAX_CHARACTERS = 1000
_MEMORY, _ANSWER = "page", "page-now"
_PREFIX = "viser-user:"
"""viser's, of all that it keeps in a browser."""
_ASK = """
const wanted = new URLSearchParams(localStorage.getItem("%(prefix)s%(memory)s") ?? "");
for (const [name, value] of new URLSearchParams(location.search))
    if (%(names)s.includes(name)) wanted.set(name, value);
wanted.set("prefers", matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
localStorage.setItem("%(prefix)s%(answer)s", wanted);
"""
_SHOW = """
const shown = new URLSearchParams(location.search);
for (const [name, value] of new URLSearchParams(%(query)s)) shown.set(name, value);
history.replaceState(null, "", "?" + shown);
"""


def ask(client: viser.ClientHandle, names: Sequence[str], on_answer: Callable[[Mapping[str, str]], None]) -> None:
    """Call `on_answer` with what the browser knows of `names`, and with `PREFERS`; once, from another thread."""
    request = str(uuid.uuid4())

    def receive(_: int, message: Any) -> None:
        if message.request_uuid != request:
            return
        connection.unregister_handler(messages.LocalStorageGetItemResponseMessage, receive)
        if isinstance(message.value, str) and len(message.value) <= _MAX_CHARACTERS:
            found = dict(parse_qsl(message.value))
            on_answer({name: found[name] for name in (*names, PREFERS) if name in found})

    connection = client._websock_connection
    connection.register_handler(messages.LocalStorageGetItemResponseMessage, receive)
    places = {"prefix": _PREFIX, "memory": _MEMORY, "answer": _ANSWER, "names": json.dumps(list(names))}
    connection.queue_message(messages.RunJavascriptMessage(_ASK % places))
    connection.queue_message(messages.LocalStorageGetItemRequestMessage(key=_ANSWER, request_uuid=request))


def remember(client: viser.ClientHandle, values: Mapping[str, str]) -> None:
    """Keep the values in the browser, and in the address of its page."""
    query = urlencode(values)
    client.local_storage.set_item(_MEMORY, query)
    show_in_address(client, values)


def show_in_address(client: viser.ClientHandle, values: Mapping[str, str]) -> None:
    """Show the values in the address of the page, beside others that it has."""
    script = _SHOW % {"query": json.dumps(urlencode(values))}
    client._websock_connection.queue_message(messages.RunJavascriptMessage(script))
