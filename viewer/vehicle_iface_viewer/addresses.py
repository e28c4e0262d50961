"""Names, addresses and URLs of the machine that serves the page."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import ipaddress
import socket
import struct
from collections.abc import Iterator
from urllib.parse import quote

_SIOCGIFADDR = 0x8915
"""Linux, netdevice(7): the IPv4 address of an interface."""
_ROUTE_TARGETS = {socket.AF_INET: "198.51.100.1", socket.AF_INET6: "2001:db8::1"}
"""Addresses for documentation (RFC 5737, RFC 3849): what has no route of its own takes the default route."""


def find_reachable_host(host: str) -> str:
    """Return a name or address under which others reach a server that listens on `host`.

    For a wildcard (`0.0.0.0`, `::`) it is an address of this machine: the one on its default route, otherwise that of
    its first interface; loopback where it has none.
    """
    try:
        bound = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][4][0]
    except OSError:  # reported where it cannot be listened on
        return host
    if not ipaddress.ip_address(bound).is_unspecified:
        return host
    # A socket on `::` takes IPv4 connections as well.
    families = (socket.AF_INET, socket.AF_INET6) if bound == "::" else (socket.AF_INET,)
    found = [*map(_find_route_address, families), *_list_interface_addresses()]
    return next(
        (address for address in found if address and not ipaddress.ip_address(address).is_loopback), "127.0.0.1"
    )


def _find_route_address(family: socket.AddressFamily) -> str | None:
    """Return this machine's address on its default route. Nothing is sent."""
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.connect((_ROUTE_TARGETS[family], 9))
        return str(probe.getsockname()[0])
    return None


def _list_interface_addresses() -> Iterator[str]:
    """Give the IPv4 address of each interface that has one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            with contextlib.suppress(OSError):
                answer = fcntl.ioctl(probe, _SIOCGIFADDR, struct.pack("256s", name.encode()))
                yield socket.inet_ntoa(answer[20:24])


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
