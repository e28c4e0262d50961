"""What a browser remembers of its page, and what the page's address says: as the query of a URL.

The address wins over the memory. A browser also says whether its user prefers a light page, and whether it has a GPU.
All it answers is text from outside: whoever asks must check each value.

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

PREFERS, DRAWS = "prefers", "draws"
"""In an answer: `light` or `dark`, and `gpu` or `software`: what draws its pictures."""
LEFT, RIGHT, TAB = "left", "right", "tab"
"""In an answer: widths of the panels in pixels, and the name of the open tab, as its user has left them."""
_MAX_CHARACTERS = 2000
_MEMORY, _LAYOUT, _ANSWER = "page", "layout", "page-now"
_PREFIX = "viser-user:"
"""viser's, of all that it keeps in a browser."""
_ASK = """
const wanted = new URLSearchParams(["%(memory)s", "%(layout)s"].map(
    name => localStorage.getItem("%(prefix)s" + name) ?? "").join("&"));
for (const [name, value] of new URLSearchParams(location.search))
    if (%(names)s.includes(name)) wanted.set(name, value);
wanted.set("prefers", matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
window.drawsWith ??= (() => {
    const gl = document.createElement("canvas").getContext("webgl2");
    const name = gl?.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return !gl || /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name) ? "software" : "gpu";
})();
wanted.set("draws", window.drawsWith);
localStorage.setItem("%(prefix)s%(answer)s", wanted);
"""
_SHOW = """
const shown = new URLSearchParams(location.search);
for (const [name, value] of new URLSearchParams(%(query)s)) shown.set(name, value);
history.replaceState(null, "", "?" + shown);
"""
# Widths and tab are known to the browser only. They are kept when its user has changed them, not when the window has.
_KEEP_LAYOUT = """
const tabOf = name => [...document.querySelectorAll("[data-dock-tab]")].find(tab => tab.innerText.trim() === name);
const widths = () => Object.fromEntries(["left", "right"].map(
    side => [side, document.querySelector(`[data-dock-region="${side}"]`)?.offsetWidth ?? 0]));
let before = widths(), left = %(tab)s ? 50 : 0;
const open = setInterval(() => {
    const tab = tabOf(%(tab)s);
    tab?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
    if (tab || left-- <= 0) clearInterval(open);
}, 200);
const keep = () => setTimeout(() => {
    const kept = new URLSearchParams(localStorage.getItem("%(prefix)s%(layout)s") ?? ""), now = widths();
    for (const [side, width] of Object.entries(now)) if (width >= 200 && width !== before[side]) kept.set(side, width);
    const tab = %(tabs)s.find(name => tabOf(name)?.ariaSelected === "true");
    if (tab) kept.set("tab", tab);
    if (kept.size) localStorage.setItem("%(prefix)s%(layout)s", kept);
    const shown = new URLSearchParams(location.search);
    for (const [name, value] of kept) shown.set(name, value);
    history.replaceState(null, "", "?" + shown);
}, 400);
if (!window.keepsLayout) {  // another viewer may have answered this page before
    window.keepsLayout = true;
    addEventListener("pointerdown", () => before = widths(), true);
    for (const event of ["pointerup", "keyup"]) addEventListener(event, keep, true);
    // What is between the panels, for the style sheet: a map in the middle is as large.
    const find = setInterval(() => {
        const area = document.querySelector("canvas[data-engine]")?.closest("[data-dock-root] > *");
        if (!area) return;
        clearInterval(find);
        new ResizeObserver(() => {
            const box = area.getBoundingClientRect(), style = document.documentElement.style;
            style.setProperty("--vi-left", `${box.left}px`);
            style.setProperty("--vi-width", `${box.width}px`);
        }).observe(area);
    }, 200);
    // Where our note says that there is no GPU, viser's does not cover the map.
    let tries = 60;
    const close = setInterval(() => {
        const notes = document.querySelector("#no-gpu") ? document.querySelectorAll(".mantine-Notification-root") : [];
        const note = [...notes].find(each => each.innerText.startsWith("Software WebGL"));
        note?.querySelector("button").click();
        if (note || tries-- <= 0) clearInterval(close);
    }, 500);
}
"""
_FORGET = """
for (const name of ["%(memory)s", "%(layout)s"]) localStorage.removeItem("%(prefix)s" + name);
const shown = new URLSearchParams(location.search);
for (const name of %(names)s) shown.delete(name);
location.replace("?" + shown);
"""
_PLACES = {"prefix": _PREFIX, "memory": _MEMORY, "layout": _LAYOUT, "answer": _ANSWER}


def ask(client: viser.ClientHandle, names: Sequence[str], on_answer: Callable[[Mapping[str, str]], None]) -> None:
    """Call `on_answer` with what the browser knows of `names`, `PREFERS` and `DRAWS`; once, from another thread."""
    request = str(uuid.uuid4())

    def receive(_: int, message: Any) -> None:
        if message.request_uuid != request:
            return
        connection.unregister_handler(messages.LocalStorageGetItemResponseMessage, receive)
        if isinstance(message.value, str) and len(message.value) <= _MAX_CHARACTERS:
            found = dict(parse_qsl(message.value))
            on_answer({name: found[name] for name in (*names, PREFERS, DRAWS) if name in found})

    connection = client._websock_connection
    connection.register_handler(messages.LocalStorageGetItemResponseMessage, receive)
    _run(client, _ASK, names=list(names))
    connection.queue_message(messages.LocalStorageGetItemRequestMessage(key=_ANSWER, request_uuid=request))


def remember(client: viser.ClientHandle, values: Mapping[str, str]) -> None:
    """Keep the values in the browser, and in the address of its page."""
    client.local_storage.set_item(_MEMORY, urlencode(values))
    show_in_address(client, values)


def show_in_address(client: viser.ClientHandle, values: Mapping[str, str]) -> None:
    """Show the values in the address of the page, beside others that it has."""
    _run(client, _SHOW, query=urlencode(values))


def keep_layout(client: viser.ClientHandle, tabs: Sequence[str], tab: str) -> None:
    """Open the tab `tab`, if there is one of that name; then have the browser remember which of `tabs` is open, and how
    wide its user has made the panels. Once for each page."""
    _run(client, _KEEP_LAYOUT, tabs=list(tabs), tab=tab)


def forget(client: viser.ClientHandle, names: Sequence[str]) -> None:
    """Forget all, and load the page again without `names` in its address."""
    _run(client, _FORGET, names=list(names))


def _run(client: viser.ClientHandle, script: str, **values: str | list[str]) -> None:
    """Run a script in the browser; the values are text in it, whatever they contain."""
    places = _PLACES | {name: json.dumps(value) for name, value in values.items()}
    client._websock_connection.queue_message(messages.RunJavascriptMessage(script % places))
