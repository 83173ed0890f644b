"""Makes certificates with the program `openssl`: of an authority, daemons, routers and users."""

from __future__ import annotations

import grp
import os
import socket
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.openssl import openssl
from ecatd.client.identity import USER_LINE

from .saving import save_bytes, writing

AUTHORITY, AUTHORITY_KEY = "authority.pem", "authority.key"
LOGINS = "logins"
"""The folder of those who log in to `ecatctl web`, in that of the authority."""
_GATEWAY, _WEB = "ecatd-gateway", "ecatd-web"
"""The groups of the processes that read a key."""
_AUTHORITY_DAYS = 3650
_NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
_PUBLIC, _OF_GROUP, _OWN = 0o644, 0o640, 0o600
_OLD_TABLETS_DAYS = 825
"""Browsers of Apple take no certificate of a server that holds for longer."""


def make_authority(folder: Path) -> None:
    """Makes an authority and its key in a folder."""
    with tempfile.TemporaryDirectory() as scratch:
        certificate, key = Path(scratch, AUTHORITY), Path(scratch, AUTHORITY_KEY)
        openssl(
            *("req", "-x509", *_NEW_KEY, "-days", str(_AUTHORITY_DAYS)),
            *("-keyout", key, "-out", certificate),
            *("-subj", f"/CN=ecatd of {socket.gethostname()[:48]}"),
            *("-addext", "keyUsage=critical,keyCertSign,cRLSign"),
        )
        _save(folder / AUTHORITY, certificate.read_bytes(), _PUBLIC)
        _save(folder / AUTHORITY_KEY, key.read_bytes(), _OWN)


def check_authority(folder: Path) -> None:
    """Checks that there is an authority that this user can use.

    Raises:
        StateError: There is none.
        NotPermittedError: It belongs to somebody else.
    """
    for file in (AUTHORITY, AUTHORITY_KEY):
        if not (folder / file).exists():
            raise StateError(f"{folder / file} is missing: run `ecatctl remote init` first")
        if not os.access(folder / file, os.R_OK):
            raise NotPermittedError(
                f"{folder / file} cannot be read: run this command as the user who has run "
                "`ecatctl remote init`"
            )


def make_server(
    authority: Path, folder: Path, file: str, name: str, hosts: Sequence[str], days: int
) -> None:
    """Makes the certificate and the key of a daemon or router, beside that of the authority.

    A daemon shows the same certificate to a router that it connects to.

    Args:
        authority: Folder of the authority.
        folder: Where the files belong.
        file: Their name without suffix.
        name: Who it is: the common name.
        hosts: Names and addresses by which others reach it.
        days: How long it holds.
    """
    extensions = f"{_alternative_names(hosts)}extendedKeyUsage=serverAuth,clientAuth\n"
    certificate, key = _signed(authority, name, extensions, days)
    if folder != authority:
        save_bytes(folder / AUTHORITY, (authority / AUTHORITY).read_bytes())
    _save(folder / f"{file}.pem", certificate, _PUBLIC)
    _save(folder / f"{file}.key", key, _OF_GROUP, _GATEWAY)


def make_web_server(authority: Path, folder: Path, name: str, hosts: Sequence[str]) -> int:
    """Makes the certificate and the key of `ecatctl web` in place of earlier ones.

    With this key nobody can be the daemon of a machine, nor a user: it is for browsers only.

    Args:
        authority: Folder of the authority.
        folder: Where the files belong.
        name: The machine.
        hosts: Names and addresses by which browsers reach it.

    Returns:
        The number of days for which it holds.
    """
    extensions = f"{_alternative_names(hosts)}extendedKeyUsage=serverAuth\n"
    common = f"ecatctl web of {name}"[:64]  # a space: no user can have this name
    certificate, key = _signed(authority, common, extensions, _OLD_TABLETS_DAYS)
    _save(folder / "web.pem", certificate, _PUBLIC)
    _save(folder / "web.key", key, _OF_GROUP, _WEB)
    return _OLD_TABLETS_DAYS


def make_login(authority: Path, out: Path, name: str, password: str, days: int) -> None:
    """Makes an identity whose private key only the password unlocks; replaces an earlier one."""
    certificate, key = _signed(authority, name, "extendedKeyUsage=clientAuth\n", days)
    with tempfile.NamedTemporaryFile() as plain:
        plain.write(key)
        plain.flush()
        locked = openssl(
            *("pkcs8", "-topk8", "-scrypt", "-in", plain.name, "-passout", "stdin"),
            given=f"{password}\n",
        )
    if not out.parent.exists():
        with writing(out.parent):
            out.parent.mkdir(parents=True)
        _restrict(out.parent, 0o750, _WEB)
    line = USER_LINE.format(name).encode()
    parts = (line, certificate, locked.encode(), (authority / AUTHORITY).read_bytes())
    _save(out, b"".join(parts), _OF_GROUP, _WEB)


def make_identity(authority: Path, out: Path, name: str, days: int) -> None:
    """Makes the file with which a user connects; see `client/identity.py`."""
    parts = _signed(authority, name, "extendedKeyUsage=clientAuth\n", days)
    line = USER_LINE.format(name).encode()
    _save(out, b"".join((line, *parts, (authority / AUTHORITY).read_bytes())), _OWN)


def _signed(authority: Path, name: str, extensions: str, days: int) -> tuple[bytes, bytes]:
    """Makes a certificate with a common name, and its key."""
    with tempfile.TemporaryDirectory() as scratch:
        certificate, key, request, details = (Path(scratch, part) for part in "ckrd")
        details.write_text(extensions)
        openssl("req", *_NEW_KEY, "-keyout", key, "-out", request, "-subj", f"/CN={name}")
        openssl(
            *("x509", "-req", "-in", request, "-days", str(days), "-out", certificate),
            *("-CA", authority / AUTHORITY, "-CAkey", authority / AUTHORITY_KEY),
            *("-set_serial", f"0x{os.urandom(15).hex()}", "-extfile", details),
        )
        return certificate.read_bytes(), key.read_bytes()


def _alternative_names(hosts: Sequence[str]) -> str:
    names = ",".join(f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
    return f"subjectAltName={names}\n"


def _is_address(host: str) -> bool:
    for family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError):
            socket.inet_pton(family, host)
            return True
    return False


def _save(path: Path, data: bytes, mode: int, group: str = "") -> None:
    old = os.umask(0o077)  # nobody else may read a key, not even for a moment
    try:
        save_bytes(path, data)
    finally:
        os.umask(old)
    _restrict(path, mode, group)


def _restrict(path: Path, mode: int, group: str) -> None:
    path.chmod(mode)
    if group:
        with suppress(KeyError, PermissionError):  # without the service there is no such group
            os.chown(path, -1, grp.getgrnam(group).gr_gid)
