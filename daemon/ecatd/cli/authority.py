"""Makes certificates with the program `openssl`: of an authority, daemons, routers and users."""

from __future__ import annotations

import grp
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.client.identity import USER_LINE

from .saving import save_bytes

AUTHORITY, AUTHORITY_KEY = "authority.pem", "authority.key"
_GROUP = "ecatd-gateway"
_AUTHORITY_DAYS = 3650
_NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
_PUBLIC, _OF_GROUP, _OWN = 0o644, 0o640, 0o600


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
    names = ",".join(f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
    extensions = f"subjectAltName={names}\nextendedKeyUsage=serverAuth,clientAuth\n"
    certificate, key = _signed(authority, name, extensions, days)
    if folder != authority:
        save_bytes(folder / AUTHORITY, (authority / AUTHORITY).read_bytes())
    _save(folder / f"{file}.pem", certificate, _PUBLIC)
    _save(folder / f"{file}.key", key, _OF_GROUP)


def make_identity(authority: Path, out: Path, name: str, days: int) -> None:
    """Makes the file with which a user connects; see `client/identity.py`."""
    parts = _signed(authority, name, "extendedKeyUsage=clientAuth\n", days)
    line = USER_LINE.format(name).encode()
    _save(out, b"".join((line, *parts, (authority / AUTHORITY).read_bytes())), _OWN)


def openssl(*arguments: str | Path) -> str:
    """Runs `openssl`; returns what it prints.

    Raises:
        StateError: It is not installed, or fails.
    """
    program = shutil.which("openssl")
    if program is None:
        raise StateError("the program openssl is missing: sudo apt install openssl")
    command = [program, *arguments]
    found = subprocess.run(command, capture_output=True, text=True, errors="replace", umask=0o077)
    if found.returncode:
        lines = found.stderr.strip().splitlines() or ["no reason given"]
        raise StateError(f"openssl {arguments[0]} fails: {lines[-1]}")
    return found.stdout


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


def _is_address(host: str) -> bool:
    for family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError):
            socket.inet_pton(family, host)
            return True
    return False


def _save(path: Path, data: bytes, mode: int) -> None:
    old = os.umask(0o077)  # nobody else may read a key, not even for a moment
    try:
        save_bytes(path, data)
    finally:
        os.umask(old)
    path.chmod(mode)
    if mode == _OF_GROUP:
        with suppress(KeyError, PermissionError):  # without the service there is no such group
            os.chown(path, -1, grp.getgrnam(_GROUP).gr_gid)
