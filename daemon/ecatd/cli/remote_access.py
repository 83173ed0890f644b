"""Command `remote`: certificates for daemons, routers and users, and what a user may do.

An organisation that has its own authority can use that instead: the daemon only needs the files
that `[gateway]` names.
"""

from __future__ import annotations

import argparse
import re
import socket
import sys
import tempfile
from collections.abc import Iterable, Sequence
from getpass import getpass
from pathlib import Path
from typing import Any

from ecatd.base.bus_name import HOST_NAME, HOST_NAME_RULE
from ecatd.base.errors import StateError, UsageError
from ecatd.base.openssl import openssl
from ecatd.client.identity import find_identity, read_identity
from ecatd.config.gateway import USER_NAME, USER_NAME_RULE
from ecatd.operations.bus import ReadInfo

from .arguments import bounded, connect
from .authority import (
    AUTHORITY,
    AUTHORITY_KEY,
    LOGINS,
    check_authority,
    make_authority,
    make_identity,
    make_login,
    make_server,
    make_web_server,
)
from .output import print_json
from .router_config import router_config
from .saving import save, writing

COMMANDS = {"machine": {"remote": "Make certificates for users of other machines, and test them."}}

_ACTIONS = """\
actions:
  init            make an authority, and a certificate for the daemon of this machine
  user NAME       make an identity: a file with which a user of another machine connects
  machine NAME    make a certificate for the daemon of another machine
  router NAME     make a certificate and the configuration of a Zenoh router, through which users
                  reach the buses of several machines
  show [FILE]     show whose identity a file is, and when it expires
  web             make a certificate for `ecatctl web --address`, in place of an earlier one
  login NAME      make, or change, the password with which a user logs in there
  test            connect, and say what the user may do

First run `init` on the machine of the daemon, then `user` for each user. Both print the
lines that you add to the configuration. On the other machine, give the identity with --identity or
$ECATD_IDENTITY, or save it as ~/.config/ecatd/identity.pem.
"""
_FOLDER = Path("/etc/ecatd/tls")
_DAEMON, _ROUTER = "daemon", "router"
_PASSWORD_MIN, _PASSWORD_MAX = 10, 200
_ROUTER_CONFIG = "zenohd.json5"
_ROUTER_PORT = 7447
_SERVER_DAYS, _USER_DAYS = 1825, 365
_HOST_HELP = "init, machine, router, web: another name or address by which users reach that machine"
_HOST = re.compile("[A-Za-z0-9:.*_-]{1,253}")


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _ACTIONS
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.add_argument("action", choices=_RUN, metavar="ACTION", help="one of the actions below")
    command.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="user, login, machine, router: the name; show: a file",
    )
    command.add_argument(
        "--dir",
        type=Path,
        default=_FOLDER,
        metavar="DIR",
        help=f"the folder of the authority (default: {_FOLDER})",
    )
    for option, what, text in (
        ("--host", "HOST", _HOST_HELP),
        (
            "--machine",
            "NAME",
            "router: a machine whose buses users reach there; can be given several times",
        ),
        ("--user", "NAME", "router: a user whom the router lets in; can be given several times"),
    ):
        command.add_argument(option, action="append", default=[], metavar=what, help=text)
    command.add_argument(
        "--days",
        type=bounded(1, 36500),
        metavar="N",
        help=f"days until the certificate expires (default: {_SERVER_DAYS}; user, login: "
        f"{_USER_DAYS}; web: always 825)",
    )
    command.add_argument(
        "-o",
        dest="out",
        type=Path,
        metavar="PATH",
        help="user: the file (default: NAME.pem); machine, router: the folder (default: NAME); "
        "web: the folder (default: that of the authority); login: the file (default: "
        "logins/NAME.pem there)",
    )


_Done = tuple[dict[str, Any], str]
"""What an action has done: what `--json` prints, and what is printed else."""


def remote(options: argparse.Namespace) -> None:
    """Carries out one action.

    Raises:
        EcatError: It cannot be done, or what it shows cannot be used.
    """
    action = options.action
    if options.name is not None and action in ("init", "web", "test"):
        raise UsageError(f"remote {action} takes no NAME")
    if options.name is None and action in ("user", "login", "machine", "router"):
        of = "user" if action == "login" else action
        raise UsageError(f"remote {action} needs the NAME of the {of}")
    document, text = _RUN[action](options)
    if options.json:
        print_json(document)
    else:
        print(text)
    if problems := document.get("problems"):
        raise StateError(f"{document['file']} cannot be used: {'; '.join(problems)}")


# --- init, machine, router -----------------------------------------------------------------------


def _init(options: argparse.Namespace) -> _Done:
    folder: Path = options.dir.resolve()
    _check_new(
        [folder / name for name in (AUTHORITY, AUTHORITY_KEY, *_pair(_DAEMON))],
        "identities that it has signed would no longer hold. Remove the files of this folder "
        "first, or give another --dir",
    )
    hosts, name = _hosts(options.host, _usual_hosts()), socket.gethostname()[:63]
    days = options.days or _SERVER_DAYS
    _make_folder(folder)
    make_authority(folder)
    make_server(folder, folder, _DAEMON, name, hosts, days)
    return (
        _document(folder, hosts, days, folder),
        f"{folder}: an authority, and a certificate of the daemon of '{name}' for\n"
        f"{', '.join(hosts)}\n\n"
        f"This belongs into the configuration of the daemon:\n\n{_gateway(folder)}\n"
        f"Keep {folder / AUTHORITY_KEY} to yourself: who has it can make users.\n"
        "Next: ecatctl remote user NAME",
    )


def _usual_hosts() -> tuple[str, ...]:
    return (socket.gethostname(), socket.getfqdn(), "localhost", "127.0.0.1")


def _document(out: Path, hosts: list[str], days: int, there: Path) -> dict[str, Any]:
    return {"folder": str(out), "hosts": hosts, "days": days, "configuration": _gateway(there)}


def _gateway(folder: Path) -> str:
    """The lines of a configuration that name the files of a daemon."""
    return (
        "[gateway]\n"
        'listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]\n'
        f'certificate = "{folder / _DAEMON}.pem"\n'
        f'key = "{folder / _DAEMON}.key"\n'
        f'users_ca = "{folder / AUTHORITY}"\n'
    )


def _machine(options: argparse.Namespace) -> _Done:
    (name,) = _machines([options.name])
    authority, out = options.dir.resolve(), (options.out or Path(name)).resolve()
    check_authority(authority)
    _check_new([out / file for file in (AUTHORITY, *_pair(_DAEMON))], "give another folder with -o")
    hosts, days = _hosts(options.host, (name,)), options.days or _SERVER_DAYS
    _make_folder(out)
    make_server(authority, out, _DAEMON, name, hosts, days)
    return (
        _document(out, hosts, days, _FOLDER),
        f"{out}: a certificate of the daemon of '{name}' for {', '.join(hosts)}\n\n"
        f"Bring these files to {_FOLDER} on '{name}': {_DAEMON}.pem, {_DAEMON}.key, {AUTHORITY}.\n"
        f"This belongs into the configuration there:\n\n{_gateway(_FOLDER)}",
    )


def _router(options: argparse.Namespace) -> _Done:
    name, *machines = _machines([options.name, *options.machine])
    users = _users(options.user)
    if not machines:
        raise UsageError(
            "say with --machine whose buses are to be reached at the router, and with --user who "
            "is let in; both can be given several times"
        )
    authority, out = options.dir.resolve(), (options.out or Path(name)).resolve()
    check_authority(authority)
    hosts = _hosts(options.host, (name,))
    made = not all((out / file).exists() for file in _pair(_ROUTER))
    _make_folder(out)
    if made:  # else only who is let in has changed
        make_server(authority, out, _ROUTER, name, hosts, options.days or _SERVER_DAYS)
    config, (certificate, key) = out / _ROUTER_CONFIG, (out / file for file in _pair(_ROUTER))
    listen = f"tls/0.0.0.0:{_ROUTER_PORT}"
    save(config, router_config(listen, machines, users, certificate, key, out / AUTHORITY))
    first, endpoint = machines[0], f"tls/{name}:{_ROUTER_PORT}"
    made_text = f"{out}: a certificate of the router for {', '.join(hosts)}\n" if made else ""
    return (
        {"file": str(config), "hosts": hosts, "machines": machines, "users": users},
        f"{made_text}{config}: lets in the machines {', '.join(machines)}; "
        f"users: {', '.join(users) or '-'}\n\n"
        f"Start the router with: zenohd -c {config}\n"
        f"This belongs into [gateway] of '{first}', and likewise of all others:\n\n"
        f'host = "{first}"\nconnect = ["{endpoint}"]\n\n'
        f"Users connect with: ecatctl --connect {endpoint} --bus {first}/ecat0 --identity FILE ...",
    )


def _make_folder(folder: Path) -> None:
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def _pair(name: str) -> tuple[str, str]:
    return f"{name}.pem", f"{name}.key"


def _check_new(files: Iterable[Path], remedy: str) -> None:
    for file in files:
        if file.exists():
            raise UsageError(f"{file} exists already, and nothing was made: {remedy}")


def _checked(names: Sequence[str], rule: re.Pattern[str], remedy: str) -> list[str]:
    for name in names:
        if not rule.fullmatch(name):
            raise UsageError(f"'{name}' is no {remedy}")
    return list(names)


def _hosts(given: Sequence[str], usual: Sequence[str]) -> list[str]:
    return list(dict.fromkeys((*_checked(given, _HOST, "name or address of a machine"), *usual)))


def _machines(names: Sequence[str]) -> list[str]:
    return _checked(names, HOST_NAME, f"name of a machine: it {HOST_NAME_RULE}")


def _users(names: Sequence[str]) -> list[str]:
    return _checked(names, USER_NAME, f"name of a user: {USER_NAME_RULE}")


# --- user ----------------------------------------------------------------------------------------


def _user(options: argparse.Namespace) -> _Done:
    (name,) = _users([options.name])
    days, out = options.days or _USER_DAYS, options.out or Path(f"{name}.pem")
    if out.exists():
        raise UsageError(f"{out} exists already: give another -o FILE")
    folder = options.dir.resolve()
    check_authority(folder)
    make_identity(folder, out, name, days)
    table = (
        f'[[gateway.user]]\nname = "{name}"\nwrite = []   # what it may change, as "sdo", "state"\n'
    )
    return (
        {"user": name, "file": str(out), "days": days, "configuration": table},
        f"{out}: the identity of user '{name}', for {days} days\n\n"
        f"This belongs into the configuration of the daemon:\n\n{table}\n"
        f"Bring {out} to the user in a way that nobody else can read it: it is like a password.\n"
        "The user connects with: "
        f"ecatctl --connect tls/HOST:7448 --identity {out} remote test",
    )


# --- web, login ---------------------------------------------------------------------------------


def _web(options: argparse.Namespace) -> _Done:
    authority = options.dir.resolve()
    out = (options.out or authority).resolve()
    check_authority(authority)
    hosts = _hosts(options.host, _usual_hosts())
    _make_folder(out)
    days = make_web_server(authority, out, socket.gethostname(), hosts)
    return (
        {"folder": str(out), "hosts": hosts, "days": days},
        f"{out}: a certificate of `ecatctl web`, for {days} days, for\n{', '.join(hosts)}\n\n"
        f"Browsers trust it once {authority / AUTHORITY} is among their authorities.\n"
        "Next: ecatctl remote login NAME; then ecatctl web --address 0.0.0.0\n"
        "A server that runs uses it after its next start: systemctl restart ecatd-web",
    )


def _login(options: argparse.Namespace) -> _Done:
    (name,) = _users([options.name])
    folder = options.dir.resolve()
    check_authority(folder)
    out = options.out or folder / LOGINS / f"{name}.pem"
    days = options.days or _USER_DAYS
    password = _ask_password(name)
    make_login(folder, out, name, password, days)
    return (
        {"user": name, "file": str(out), "days": days},
        f"{out}: user '{name}' logs in to `ecatctl web --address` with this password, for {days} "
        "days.\nWhat the user may do is in [[gateway.user]] of the daemon's configuration: "
        f"nothing if '{name}' is not there.",
    )


def _ask_password(name: str) -> str:
    """The password of a user, from the terminal, or the first line of standard input."""
    if sys.stdin.isatty():
        password = getpass(f"Password of '{name}': ")
        if getpass("Once more: ") != password:
            raise UsageError("the two passwords differ; nothing was changed")
    else:
        password = sys.stdin.readline().rstrip("\n")
    if not _PASSWORD_MIN <= len(password) <= _PASSWORD_MAX or not password.isprintable():
        raise UsageError(
            f"a password has {_PASSWORD_MIN} to {_PASSWORD_MAX} printable characters; nothing was "
            "changed"
        )
    return password


# --- show, test ----------------------------------------------------------------------------------


def _show(options: argparse.Namespace) -> _Done:
    identity = read_identity(Path(options.name)) if options.name else find_identity(None)
    if identity is None:
        raise UsageError(
            "you have no identity here: name its file as FILE, with --identity, or "
            "in $ECATD_IDENTITY"
        )
    with tempfile.TemporaryDirectory() as scratch:
        certificate, key, authority = (Path(scratch, part) for part in "cka")
        certificate.write_text(identity.certificate)
        key.write_text(identity.key)
        authority.write_text(identity.authorities)
        try:
            facts, signer = _facts(certificate), _facts(authority)["sha256 fingerprint"]
            of_certificate = openssl("x509", "-in", certificate, "-noout", "-pubkey")
            fits = of_certificate == openssl("pkey", "-in", key, "-pubout")
        except StateError as error:
            raise UsageError(f"{identity.path}: {error}") from error
        valid = _succeeds("verify", "-CAfile", authority, certificate)
        holds = _succeeds("x509", "-in", certificate, "-noout", "-checkend", "0")
    name, until = facts["subject"].partition("CN=")[2], facts["notafter"]
    issuer = facts["issuer"].partition("CN=")[2]
    problems = [
        text
        for text, is_so in (
            (f"it has expired, at {until}", not holds),
            (f"its certificate is of '{name}', not of '{identity.user}'", name != identity.user),
            ("its key does not belong to its certificate", not fits),
            ("its authority has not signed its certificate", holds and not valid),
        )
        if is_so
    ]
    document = {"file": str(identity.path), "user": name, "until": until, "issuer": issuer}
    return (
        {**document, "authority_sha256": signer, "problems": problems},
        f"{identity.path}: user '{name}', until {until}, signed by '{issuer}'\nauthority {signer}",
    )


def _facts(certificate: Path) -> dict[str, str]:
    what = ("-subject", "-issuer", "-enddate", "-fingerprint", "-sha256", "-nameopt", "RFC2253")
    lines = openssl("x509", "-in", certificate, "-noout", *what).splitlines()
    return {line.partition("=")[0].lower(): line.partition("=")[2].strip() for line in lines}


def _succeeds(*arguments: str | Path) -> bool:
    try:
        openssl(*arguments)
    except StateError:
        return False
    return True


def _test(options: argparse.Namespace) -> _Done:
    with connect(options) as session:
        info = session.request(ReadInfo())
        found = session.rights() if session.user else None
    text = f"bus '{options.bus}' of {info['host']}: "
    if found is not None:
        may = ", ".join(found["write"]) or "nothing"
        slaves = ", ".join(map(str, found["slaves"]))
        of = f", of {f'slaves {slaves}' if slaves else 'all slaves'}" if found["write"] else ""
        text += (
            f"user '{found['user']}' reads everything but files of slaves and frames; further "
            f"rights: {may}{of}"
        )
    elif options.connect is None:
        text += "this connection reads and changes, as a member of the group 'ecat'"
    else:
        text += "this connection reads, without a name"
    return {"bus": options.bus, "host": info["host"], "rights": found}, text


_RUN = {
    "init": _init,
    "user": _user,
    "machine": _machine,
    "router": _router,
    "web": _web,
    "login": _login,
    "show": _show,
    "test": _test,
}
