"""The certificate of a user, with which a client of another machine says who it is."""

from __future__ import annotations

import base64
import os
import re
from pathlib import Path
from typing import NamedTuple

from ecatd.base.errors import NotPermittedError, UsageError
from ecatd.base.openssl import openssl

_BLOCK = re.compile("-----BEGIN ([A-Z ]+)-----.*?-----END \\1-----\n?", re.DOTALL)
_USER = re.compile("^ecatd user: (.+)$", re.MULTILINE)
_MOST = 1 << 20
"""Bytes of a file that are read."""
USER_LINE = "ecatd user: {}\n"
"""First line of a file with an identity."""


class Identity(NamedTuple):
    """Who a client is.

    Attributes:
        path: The file.
        user: Name of the user: the common name of the certificate.
        certificate: The certificate, in PEM.
        key: Its private key, in PEM.
        authorities: Certificates of those who sign the certificates of daemons, in PEM.
    """

    path: Path
    user: str
    certificate: str
    key: str
    authorities: str

    @property
    def is_locked(self) -> bool:
        """Whether its private key needs a password first; see `unlock`."""
        return "BEGIN ENCRYPTED" in self.key

    def unlock(self, password: str) -> Identity:
        """The identity with its private key.

        Raises:
            StateError: The password is wrong, or the program openssl is missing.
        """
        arguments = ("pkcs8", "-in", self.path, "-passin", "stdin")
        return self._replace(key=openssl(*arguments, given=f"{password}\n"))

    @property
    def settings(self) -> dict[str, object]:
        """Settings of Zenoh."""
        parts = {
            "connect_certificate_base64": self.certificate,
            "connect_private_key_base64": self.key,
            "root_ca_certificate_base64": self.authorities,
        }
        found: dict[str, object] = {
            f"transport/link/tls/{name}": base64.b64encode(text.encode()).decode()
            for name, text in parts.items()
        }
        return {**found, "transport/link/tls/enable_mtls": True}


def find_identity(path: Path | None) -> Identity | None:
    """Reads an identity; None if there is none.

    Args:
        path: The file; None for `$ECATD_IDENTITY`, or `identity.pem` in `~/.config/ecatd`, if that
            exists.

    Raises:
        UsageError: The file is missing, or no identity.
        NotPermittedError: The file cannot be read.
    """
    given = path or os.environ.get("ECATD_IDENTITY")
    home = os.environ.get("XDG_CONFIG_HOME") or Path("~/.config").expanduser()
    usual = Path(home) / "ecatd" / "identity.pem"
    if not given and not usual.exists():
        return None
    found = read_identity(Path(given or usual))
    if found.is_locked:
        raise UsageError(
            f"{found.path} is a login of `ecatctl web`: its key is locked with a password. "
            f"`ecatctl remote user {found.user}` makes an identity for other commands"
        )
    return found


def read_identity(path: Path) -> Identity:
    """Reads a file that `ecatctl remote user` has written; raises as `find_identity`."""
    try:
        with path.open("rb") as file:
            text = file.read(_MOST).decode(errors="replace")
    except PermissionError as error:
        raise NotPermittedError(f"{path} cannot be read: {error.strerror}") from error
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    blocks = [(match[1], match[0]) for match in _BLOCK.finditer(text)]
    certificates = [block for kind, block in blocks if kind == "CERTIFICATE"]
    keys = [block for kind, block in blocks if kind.endswith("PRIVATE KEY")]
    user = _USER.search(text)
    if user is None or len(certificates) < 2 or len(keys) != 1:
        raise UsageError(
            f"{path} is not an identity: it needs a line '{USER_LINE.strip().format('NAME')}', the "
            "certificate of the user, its private key, and the certificate of the authority that "
            "signs those of daemons, in this order, as `ecatctl remote user` writes them"
        )
    return Identity(path, user[1].strip(), certificates[0], keys[0], "".join(certificates[1:]))


def who() -> str:
    """This process, for the log of the daemon."""
    program = Path("/proc/self/comm").read_text(errors="replace").strip()
    name = "".join(letter if letter.isprintable() else "?" for letter in program)
    return f"{name} (pid {os.getpid()}, uid {os.getuid()})"
