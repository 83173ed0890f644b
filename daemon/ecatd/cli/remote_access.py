"""Command `remote`: certificates for a daemon and for users of other machines.

The certificates are made by the program `openssl`. An organisation that has its own authority can
use that instead: the daemon only needs the files that `[gateway]` names.
"""

from __future__ import annotations

import argparse
import grp
import os
import re
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ecatd.client.identity import USER_LINE, find_identity, read_identity
from ecatd.model.config.gateway import USER_NAME, USER_NAME_RULE
from ecatd.model.errors import NotPermittedError, StateError, UsageError

from .arguments import bounded
from .output import print_json
from .saving import save_bytes

_ACTIONS = """\
actions:
  init            make an authority, and a certificate for the daemon of this machine
  user NAME       make an identity, with which a user of another machine connects
  show [FILE]     show whose an identity is, and until when it holds
  test            connect, and say what the user may do

First run `init` on the machine of the daemon, then `user` for each user. Both print what belongs
into the configuration. On the other machine, the identity is given with --identity, in
$ECATD_IDENTITY, or as ~/.config/ecatd/identity.pem.
"""
_FOLDER = Path("/etc/ecatd/tls")
_AUTHORITY, _AUTHORITY_KEY = "authority.pem", "authority.key"
_DAEMON, _DAEMON_KEY = "daemon.pem", "daemon.key"
_GROUP = "ecatd-gateway"
_AUTHORITY_DAYS, _DAEMON_DAYS, _USER_DAYS = 3650, 1825, 365
_HOST = re.compile("[A-Za-z0-9:.*_-]{1,253}")
_NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
_PUBLIC, _OF_GROUP, _OWN = 0o644, 0o640, 0o600


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _ACTIONS
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.set_defaults(alone=remote)
    command.add_argument("action", choices=_RUN, metavar="ACTION", help="see below")
    command.add_argument("name", nargs="?", metavar="NAME", help="user: its name; show: a file")
    command.add_argument(
        "--dir",
        type=Path,
        default=_FOLDER,
        metavar="DIR",
        help=f"init, user: the folder of the certificates (default: {_FOLDER})",
    )
    command.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="HOST",
        help="init: a further name or address by which others reach this machine",
    )
    command.add_argument(
        "--days",
        type=bounded(1, 36500),
        metavar="N",
        help=f"init, user: how long the certificate holds (default: daemon {_DAEMON_DAYS}, user "
        f"{_USER_DAYS} days)",
    )
    command.add_argument(
        "-o", dest="out", type=Path, metavar="FILE", help="user: the file (default: NAME.pem)"
    )


def remote(options: argparse.Namespace) -> None:
    """Carries out one action."""
    wants_name = options.action in ("user", "show")
    if options.name is not None and not wants_name:
        raise UsageError(f"remote {options.action} takes no NAME")
    _RUN[options.action](options)


# --- init ----------------------------------------------------------------------------------------


def _init(options: argparse.Namespace) -> None:
    folder: Path = options.dir.resolve()
    for name in (_AUTHORITY, _AUTHORITY_KEY, _DAEMON, _DAEMON_KEY):
        if (folder / name).exists():
            raise UsageError(
                f"{folder / name} exists already, and nothing was made: identities that it has "
                "signed would no longer hold. Remove the files of this folder first, or give "
                "another --dir"
            )
    hosts = _hosts(options.host)
    days = options.days or _DAEMON_DAYS
    _make_folder(folder)
    with tempfile.TemporaryDirectory() as scratch:
        at = Path(scratch)
        _openssl(
            *("req", "-x509", *_NEW_KEY, "-days", str(_AUTHORITY_DAYS)),
            *("-keyout", at / _AUTHORITY_KEY, "-out", at / _AUTHORITY),
            *("-subj", f"/CN=ecatd of {socket.gethostname()[:48]}"),
            *("-addext", "keyUsage=critical,keyCertSign,cRLSign"),
        )
        names = ",".join(f"{'IP' if _is_address(host) else 'DNS'}:{host}" for host in hosts)
        extensions = f"subjectAltName={names}\nextendedKeyUsage=serverAuth\n"
        _sign(at, at, "daemon", "ecatd", extensions, days)
        _save(folder / _AUTHORITY, at / _AUTHORITY, _PUBLIC)
        _save(folder / _AUTHORITY_KEY, at / _AUTHORITY_KEY, _OWN)
        _save(folder / _DAEMON, at / _DAEMON, _PUBLIC)
        _save(folder / _DAEMON_KEY, at / _DAEMON_KEY, _OF_GROUP)
    text = (
        "[gateway]\n"
        'listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]\n'
        f'certificate = "{folder / _DAEMON}"\n'
        f'key = "{folder / _DAEMON_KEY}"\n'
        f'users_ca = "{folder / _AUTHORITY}"\n'
    )
    if options.json:
        print_json({"folder": str(folder), "hosts": hosts, "days": days, "configuration": text})
        return
    print(f"{folder}: an authority, and a certificate of the daemon for {', '.join(hosts)}\n")
    print(f"This belongs into the configuration of the daemon:\n\n{text}")
    print(f"Keep {folder / _AUTHORITY_KEY} to yourself: who has it can make users.")
    print("Next: ecatctl remote user NAME")


def _hosts(given: Sequence[str]) -> list[str]:
    for host in given:
        if not _HOST.fullmatch(host):
            raise UsageError(f"'{host}' is no name or address of a machine")
    usual = (socket.gethostname(), socket.getfqdn(), "localhost", "127.0.0.1")
    return list(dict.fromkeys([*given, *usual]))


def _is_address(host: str) -> bool:
    for family in (socket.AF_INET, socket.AF_INET6):
        with suppress(OSError):
            socket.inet_pton(family, host)
            return True
    return False


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except PermissionError as error:
        raise NotPermittedError(f"{folder} cannot be made: {error.strerror}") from error
    except OSError as error:
        raise StateError(f"{folder} cannot be made: {error.strerror}") from error


# --- user ----------------------------------------------------------------------------------------


def _user(options: argparse.Namespace) -> None:
    name, folder = options.name, options.dir.resolve()
    if name is None:
        raise UsageError("remote user needs the NAME of the user")
    if not USER_NAME.fullmatch(name):
        raise UsageError(f"'{name}' is no name of a user: {USER_NAME_RULE}")
    days = options.days or _USER_DAYS
    out = options.out or Path(f"{name}.pem")
    if out.exists():
        raise UsageError(f"{out} exists already: give another -o FILE")
    for file in (_AUTHORITY, _AUTHORITY_KEY):
        if not (folder / file).exists():
            raise StateError(f"{folder / file} is missing: run `ecatctl remote init` first")
        if not os.access(folder / file, os.R_OK):
            raise NotPermittedError(
                f"{folder / file} cannot be read: run this command as the user who has run "
                "`ecatctl remote init`"
            )
    with tempfile.TemporaryDirectory() as scratch:
        at = Path(scratch)
        _sign(folder, at, "user", name, "extendedKeyUsage=clientAuth\n", days)
        parts = (at / "user.pem", at / "user.key", folder / _AUTHORITY)
        text = USER_LINE.format(name) + "".join(part.read_text() for part in parts)
    _write(out, text.encode(), _OWN)
    table = (
        f'[[gateway.user]]\nname = "{name}"\nwrite = []   # what it may change, as "sdo", "state"\n'
    )
    if options.json:
        print_json({"user": name, "file": str(out), "days": days, "configuration": table})
        return
    print(f"{out}: the identity of user '{name}', for {days} days\n")
    print(f"This belongs into the configuration of the daemon:\n\n{table}")
    print(f"Bring {out} to the user in a way that nobody else can read it: it is like a password.")
    print(f"The user connects with: ecatctl --connect tls/HOST:7448 --identity {out} remote test")


def _sign(authority: Path, at: Path, file: str, name: str, extensions: str, days: int) -> None:
    """Makes a key and a certificate `file`.pem with a common name, in the folder `at`."""
    (at / "extensions").write_text(extensions)
    request = at / f"{file}.csr"
    _openssl(
        *("req", *_NEW_KEY, "-keyout", at / f"{file}.key", "-out", request),
        *("-subj", f"/CN={name}"),
    )
    _openssl(
        *("x509", "-req", "-in", request, "-days", str(days), "-out", at / f"{file}.pem"),
        *("-CA", authority / _AUTHORITY, "-CAkey", authority / _AUTHORITY_KEY),
        *("-set_serial", f"0x{os.urandom(15).hex()}", "-extfile", at / "extensions"),
    )


def _openssl(*arguments: str | Path) -> str:
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


def _save(path: Path, source: Path, mode: int) -> None:
    _write(path, source.read_bytes(), mode)
    if mode == _OF_GROUP:
        with suppress(KeyError, PermissionError):  # without the service there is no such group
            os.chown(path, -1, grp.getgrnam(_GROUP).gr_gid)


def _write(path: Path, data: bytes, mode: int) -> None:
    save_bytes(path, data)
    path.chmod(mode)


# --- show, test ----------------------------------------------------------------------------------


def _show(options: argparse.Namespace) -> None:
    identity = read_identity(Path(options.name)) if options.name else find_identity(None)
    if identity is None:
        raise UsageError("there is no identity: give a FILE, --identity or $ECATD_IDENTITY")
    with tempfile.TemporaryDirectory() as scratch:
        certificate, key, authority = (Path(scratch) / n for n in ("c.pem", "k.pem", "a.pem"))
        certificate.write_text(identity.certificate)
        key.write_text(identity.key)
        authority.write_text(identity.authorities)
        try:
            facts = _facts(certificate)
            signer = _facts(authority)["sha256 fingerprint"]
            fits = _openssl("x509", "-in", certificate, "-noout", "-pubkey") == _openssl(
                "pkey", "-in", key, "-pubout"
            )
            valid = _runs("verify", "-CAfile", authority, certificate)
            holds = _runs("x509", "-in", certificate, "-noout", "-checkend", "0")
        except StateError as error:
            raise UsageError(f"{identity.path}: {error}") from error
    name = facts["subject"].partition("CN=")[2]
    problems = [
        text
        for text, is_so in (
            (f"it has expired, at {facts['notafter']}", not holds),
            (f"its certificate is of '{name}', not of '{identity.user}'", name != identity.user),
            ("its key does not belong to its certificate", not fits),
            ("its authority has not signed its certificate", holds and not valid),
        )
        if is_so
    ]
    until, issuer = facts["notafter"], facts["issuer"].partition("CN=")[2]
    if options.json:
        document = {"file": str(identity.path), "user": name, "until": until, "issuer": issuer}
        print_json({**document, "authority_sha256": signer, "problems": problems})
    else:
        print(f"{identity.path}: user '{name}', until {until}, signed by '{issuer}'")
        print(f"authority {signer}")
    if problems:
        raise StateError(f"{identity.path} cannot be used: {'; '.join(problems)}")


def _facts(certificate: Path) -> dict[str, str]:
    what = ("-subject", "-issuer", "-enddate", "-fingerprint", "-sha256", "-nameopt", "RFC2253")
    lines = _openssl("x509", "-in", certificate, "-noout", *what).splitlines()
    return {line.partition("=")[0].lower(): line.partition("=")[2].strip() for line in lines}


def _runs(*arguments: str | Path) -> bool:
    try:
        _openssl(*arguments)
    except StateError:
        return False
    return True


def _test(options: argparse.Namespace) -> None:
    from ecatd.client.remote import Remote  # Zenoh takes longest of all to load

    with Remote(options.bus, options.connect, options.timeout) as session:
        info = session.info()
        found = session.rights() if session.user else None
    if options.json:
        print_json({"bus": options.bus, "host": info["host"], "rights": found})
        return
    if found is None:
        where = "as a member of the group 'ecat'" if options.connect is None else "without a name"
        may = "reads and changes" if options.connect is None else "reads"
        print(f"bus '{options.bus}' of {info['host']}: this connection {may}, {where}")
        return
    changes = ", ".join(found["write"]) or "nothing"
    slaves = f"slaves {', '.join(map(str, found['slaves']))}" if found["slaves"] else "all slaves"
    print(
        f"bus '{options.bus}' of {info['host']}: user '{found['user']}' reads everything but files "
        f"of slaves, and changes {changes}" + (f" of {slaves}" if found["write"] else "")
    )


_RUN = {"init": _init, "user": _user, "show": _show, "test": _test}
