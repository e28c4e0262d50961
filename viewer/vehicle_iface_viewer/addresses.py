"""Names, addresses and URLs of the machine that serves the page."""

from __future__ import annotations

import functools
import socket
from urllib.parse import quote


def bracket(host: str) -> str:
    """Return a name or an address as it stands in a URL."""
    return f"[{host}]" if ":" in host else host


def format_url(host: str, port: int, token: str | None = None) -> str:
    """Return the address of the page, with the token if there is one."""
    return f"http://{bracket(host)}:{port}/" + (f"?token={quote(token, safe='')}" if token else "")


def is_lan_name(name: str) -> bool:
    """Return whether a name is this machine's, or one that no public DNS server answers for: `car`, `car.local`."""
    return bool(name) and ("." not in name or name.endswith(".local") or name in find_own_names())


@functools.cache
def find_own_names() -> frozenset[str]:
    """Return this machine's names in lower case. The first call may ask a DNS server, which can take seconds."""
    return frozenset({socket.gethostname().lower(), socket.getfqdn().lower()})
