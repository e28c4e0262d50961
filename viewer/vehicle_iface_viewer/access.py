"""Access control of the viewer: where it listens, and which requests it accepts."""

from __future__ import annotations

import contextlib
import hmac
import http
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from websockets.http11 import Request

from vehicle_iface.errors import ConfigError
from vehicle_iface_viewer.access_token import require_sound_token
from vehicle_iface_viewer.addresses import bracket, format_url, is_lan_name

COOKIE = "vehicle_iface_token"


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejection:
    """Why a request is rejected, and what to do instead."""

    status: http.HTTPStatus
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Where the viewer listens and which clients it accepts.

    Raises `ConfigError` for an address that other machines can reach, unless `allow_remote` and a token are given.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    """0: any free port."""
    token: str | None = None
    """A browser sends it once, as `?token=…`, and then as a cookie."""
    allow_remote: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"--port {self.port}: must be within 0 … 65535")
        if self.token is not None:
            require_sound_token(self.token)
        if not self.is_local and not (self.allow_remote and self.token):
            raise ConfigError(
                f"--host {self.host}: others could watch; only this machine's own address (127.0.0.1) is allowed "
                "without --allow-remote and --token-file"
            )

    @property
    def is_local(self) -> bool:
        """Whether only this machine can connect."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def find_rejection(self, request: Request) -> Rejection | None:
        """Return why this request is rejected; None accepts it."""
        host = request.headers.get_all("Host")
        origin = request.headers.get_all("Origin")
        if len(host) != 1 or not self._is_own_host(host[0]):
            words = f"{quote(host)} is no name of this page; {self._describe_names()}"
            return Rejection(status=http.HTTPStatus.FORBIDDEN, reason=words)
        # Only browsers send an Origin, and every browser does when it opens a websocket; a page of another origin
        # cannot omit or forge it.
        if origin and origin != [f"http://{host[0]}"]:
            words = f"a page of {quote(origin)} may not read this one; open {quote(['http://' + host[0]])} itself"
            return Rejection(status=http.HTTPStatus.FORBIDDEN, reason=words)
        if self.token is not None and not self._has_token(request):
            words = "the token is missing or wrong; open the address that the viewer printed, with ?token=… at its end"
            return Rejection(status=http.HTTPStatus.UNAUTHORIZED, reason=words)
        return None

    def _is_own_host(self, host: str) -> bool:
        """Return whether `host` names this server. Any other name that resolves to it is DNS rebinding.

        The port may be another one: `ssh -L` and containers forward from any. No attack depends on it, as the Origin
        must have the same.
        """
        try:
            parts = urlsplit(f"//{host}")
            name, _ = parts.hostname or "", parts.port
        except ValueError:
            return False
        if name in {"localhost", self.host.lower()}:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return not self.is_local and is_lan_name(name)
        return address.is_loopback or not self.is_local

    def _describe_names(self) -> str:
        if not self.is_local:
            return "open it by an IP address, its machine's host name, a name without a dot, or one that ends in .local"
        tunnel = f"ssh -L 9000:{bracket(self.host)}:{self.port} MACHINE"
        return (
            f"open {format_url(self.host, self.port)} on its machine, or http://127.0.0.1:9000/ after `{tunnel}`; "
            "any port will do"
        )

    def _has_token(self, request: Request) -> bool:
        offered = [*parse_qs(request.path.partition("?")[2]).get("token", ())]
        with contextlib.suppress(CookieError):
            cookies = SimpleCookie("; ".join(request.headers.get_all("Cookie")))
            offered += [cookies[COOKIE].value] if COOKIE in cookies else []
        expected = (self.token or "").encode()
        return any(hmac.compare_digest(each.encode(errors="replace"), expected) for each in offered)


def quote(values: Sequence[str]) -> str:
    """Return what a client sent for a text: ASCII, and short."""
    return ascii(", ".join(values))[:100]
