"""Who may open the page.

The server is for one user of this machine. Three kinds of strangers can reach its port: other users
of the machine, and web sites that the user visits in the same browser, with their own name or with
one that they have pointed at this machine (DNS rebinding). So each request must name this machine
as its host, a WebSocket must come from our own page, and it needs a cookie. The page gets it for a
token, which stands behind the `#` of the address that `ecatctl web` prints: browsers send that part
to nobody.
"""

from __future__ import annotations

import re
import secrets
from http.cookies import CookieError, SimpleCookie

from websockets.datastructures import Headers, MultipleValuesError

_HOST = re.compile(r"(localhost|127\.0\.0\.1|\[::1\])(:[0-9]{1,5})?", re.ASCII)
"""Any port: `ssh -L` gives the page another one than ours. A name of somebody else is refused."""
_BEARER = "Bearer "

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

    Attributes:
        token: What the page shows to get its cookie.
    """

    def __init__(self, port: int) -> None:
        self.token = secrets.token_urlsafe(32)
        self._name = f"ecatd-{port}"
        self._secret = secrets.token_urlsafe(32)

    def is_for_us(self, headers: Headers) -> bool:
        """Whether the browser has asked this machine by its own name."""
        return _HOST.fullmatch(_only(headers, "Host")) is not None

    def is_from_us(self, headers: Headers) -> bool:
        """Whether our own page opens a WebSocket; a program without `Origin` does not count."""
        return _only(headers, "Origin") == f"http://{_only(headers, 'Host')}"

    def has_cookie(self, headers: Headers) -> bool:
        """Whether the browser has shown the token before."""
        try:
            cookie = SimpleCookie(_only(headers, "Cookie")).get(self._name)
        except CookieError:
            return False
        return cookie is not None and _equal(cookie.value, self._secret)

    def has_token(self, headers: Headers) -> bool:
        """Whether the page shows the token now."""
        shown = _only(headers, "Authorization")
        return shown.startswith(_BEARER) and _equal(shown.removeprefix(_BEARER), self.token)

    @property
    def cookie(self) -> str:
        """The header that gives the browser its cookie."""
        return f"{self._name}={self._secret}; HttpOnly; SameSite=Strict; Path=/"


def _only(headers: Headers, name: str) -> str:
    """The one value of a header; empty if there is none, or several that contradict each other."""
    try:
        return headers.get(name, "")
    except MultipleValuesError:
        return ""


def _equal(one: str, other: str) -> bool:
    return secrets.compare_digest(one.encode(errors="replace"), other.encode())
