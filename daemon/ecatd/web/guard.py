"""What a request must be to be answered.

The server is for one user of this machine, or with TLS for those who log in. Strangers can reach
its port: other users of the machine, other machines, and web sites that the user visits in the same
browser, with their own name or with one that they have pointed at this machine (DNS rebinding). So
each request must name this machine as its host, a WebSocket must come from our own page, and it
needs the cookie of a session (`sessions.py`). The page gets it for a token, which stands behind the
`#` of the address that `ecatctl web` prints, since browsers send that part to nobody; or for the
password of a user.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable
from contextlib import suppress
from http.cookies import CookieError, SimpleCookie

from websockets.datastructures import Headers, MultipleValuesError

LOOPBACK = ("localhost", "127.0.0.1", "::1")
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([a-z0-9._-]+))(?::[0-9]{1,5})?", re.ASCII)
"""Any port: `ssh -L` gives the page another one than ours. A name of somebody else is refused."""

HEADERS = {
    "Content-Security-Policy": "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "connect-src 'self'",
            "img-src 'self' data: blob:",
            "worker-src 'self'",
            "frame-ancestors 'none'",
            "base-uri 'none'",
            "form-action 'none'",
            "require-trusted-types-for 'script'",
            "trusted-types ecatd",
        )
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of all answers."""


class Guard:
    """Checks requests.

    Args:
        port: The port of the server. Cookies do not know ports, so its name has it: servers for
            several buses do not spoil each other's.
        names: Names and addresses by which browsers may ask this machine, `*.example.org` too.
        encrypted: Whether connections have TLS.
    """

    def __init__(self, port: int, names: Iterable[str] = LOOPBACK, *, encrypted: bool) -> None:
        self._names = {_normal(name) for name in names}
        self._scheme = "https" if encrypted else "http"
        # Browsers keep a cookie of such a name only from this host over TLS, so nobody can set it
        # from beside (draft-ietf-httpbis-rfc6265bis, 4.1.3).
        self._cookie = f"__Host-ecatd-{port}" if encrypted else f"ecatd-{port}"
        self._flags = f"{'Secure; ' if encrypted else ''}HttpOnly; SameSite=Strict; Path=/"

    def is_for_us(self, headers: Headers) -> bool:
        """Whether the browser has asked this machine by its own name."""
        return self.is_our_name(only(headers, "Host"))

    def is_our_name(self, host: str) -> bool:
        """Whether a name or address of a host, with or without a port, is one of this machine."""
        found = _HOST.fullmatch(host.lower())
        if found is None:
            return False
        name = _normal(found[1] or found[2])
        return name in self._names or f"*.{name.partition('.')[2]}" in self._names

    def is_from_us(self, headers: Headers) -> bool:
        """Whether our own page opens a WebSocket; a program without `Origin` does not count."""
        return only(headers, "Origin") == f"{self._scheme}://{only(headers, 'Host')}"

    def is_from_elsewhere(self, headers: Headers) -> bool:
        """Whether the browser says that another site asks."""
        return only(headers, "Sec-Fetch-Site") not in ("", "same-origin")

    def secret(self, headers: Headers) -> str:
        """The secret of the cookie; empty if there is none."""
        with suppress(CookieError):
            cookie = SimpleCookie(only(headers, "Cookie")).get(self._cookie)
            return cookie.value if cookie is not None else ""
        return ""

    def cookie(self, secret: str, lasts_s: int | None = None) -> str:
        """The header that gives the browser its cookie; 0 s takes it away."""
        age = "" if lasts_s is None else f"; Max-Age={lasts_s}"
        return f"{self._cookie}={secret}; {self._flags}{age}"


def only(headers: Headers, name: str) -> str:
    """The one value of a header; empty if there is none, or several that contradict each other."""
    try:
        return headers.get(name, "")
    except MultipleValuesError:
        return ""


def _normal(name: str) -> str:
    with suppress(ValueError):
        return str(ipaddress.ip_address(name))
    return name.lower()
