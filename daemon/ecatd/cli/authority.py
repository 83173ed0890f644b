"""Makes certificates with the program `openssl`: of an authority, daemons, routers and users."""

from __future__ import annotations

import grp
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
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
    with _scratch() as at:
        openssl(
            *("req", "-x509", *_NEW_KEY, "-days", str(_AUTHORITY_DAYS)),
            *("-keyout", at / AUTHORITY_KEY, "-out", at / AUTHORITY),
            *("-subj", f"/CN=ecatd of {socket.gethostname()[:48]}"),
            *("-addext", "keyUsage=critical,keyCertSign,cRLSign"),
        )
        _save(folder / AUTHORITY, at / AUTHORITY, _PUBLIC)
        _save(folder / AUTHORITY_KEY, at / AUTHORITY_KEY, _OWN)


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
    """Makes the certificate and the key of a daemon or router.

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
    with _scratch() as at:
        _sign(authority, at, file, name, extensions, days)
        _save(folder / f"{file}.pem", at / f"{file}.pem", _PUBLIC)
        _save(folder / f"{file}.key", at / f"{file}.key", _OF_GROUP)


def make_identity(authority: Path, out: Path, name: str, days: int) -> None:
    """Makes the file with which a user connects; see `client/identity.py`."""
    with _scratch() as at:
        _sign(authority, at, "user", name, "extendedKeyUsage=clientAuth\n", days)
        parts = (at / "user.pem", at / "user.key", authority / AUTHORITY)
        text = USER_LINE.format(name) + "".join(part.read_text() for part in parts)
    _write(out, text.encode(), _OWN)


def make_folder(folder: Path) -> None:
    """Makes a folder for certificates, if it does not exist.

    Raises:
        NotPermittedError: This user may not.
        StateError: That does not work.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except PermissionError as error:
        raise NotPermittedError(f"{folder} cannot be made: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{folder} cannot be made: {error.strerror}") from error


def openssl(*arguments: str | Path) -> str:
    """Runs `openssl`; returns what it prints.

    Raises:
        StateError: It is not installed, or fails.
    """
    program = shutil.which("openssl")
    if program is None:
        raise StateError("the program openssl is missing: sudo apt install openssl")
    old = os.umask(0o077)
    try:
        found = subprocess.run(
            [program, *arguments], capture_output=True, text=True, errors="replace", check=False
        )
    finally:
        os.umask(old)
    if found.returncode:
        lines = found.stderr.strip().splitlines() or ["no reason given"]
        raise StateError(f"openssl {arguments[0]} fails: {lines[-1]}")
    return found.stdout


@contextmanager
def _scratch() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def _sign(authority: Path, at: Path, file: str, name: str, extensions: str, days: int) -> None:
    """Makes a key and a certificate `file`.pem with a common name, in the folder `at`."""
    (at / "extensions").write_text(extensions)
    request = at / f"{file}.csr"
    openssl(
        *("req", *_NEW_KEY, "-keyout", at / f"{file}.key", "-out", request),
        *("-subj", f"/CN={name}"),
    )
    openssl(
        *("x509", "-req", "-in", request, "-days", str(days), "-out", at / f"{file}.pem"),
        *("-CA", authority / AUTHORITY, "-CAkey", authority / AUTHORITY_KEY),
        *("-set_serial", f"0x{os.urandom(15).hex()}", "-extfile", at / "extensions"),
    )


def _is_address(host: str) -> bool:
    for family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError):
            socket.inet_pton(family, host)
            return True
    return False


def _save(path: Path, source: Path, mode: int) -> None:
    _write(path, source.read_bytes(), mode)
    if mode == _OF_GROUP:
        with suppress(KeyError, PermissionError):  # without the service there is no such group
            os.chown(path, -1, grp.getgrnam(_GROUP).gr_gid)


def _write(path: Path, data: bytes, mode: int) -> None:
    old = os.umask(0o077)  # nobody else may read a key, not even for a moment
    try:
        save_bytes(path, data)
    finally:
        os.umask(old)
    path.chmod(mode)
