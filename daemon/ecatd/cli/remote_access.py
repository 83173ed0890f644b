"""Command `remote`: certificates for daemons, routers and users, and what a user may do.

An organisation that has its own authority can use that instead: the daemon only needs the files
that `[gateway]` names.
"""

from __future__ import annotations

import argparse
import re
import socket
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ecatd.base.bus_name import HOST_NAME, HOST_NAME_RULE
from ecatd.base.errors import StateError, UsageError
from ecatd.client.identity import find_identity, read_identity
from ecatd.config.gateway import USER_NAME, USER_NAME_RULE
from ecatd.operations.bus import ReadInfo

from .arguments import bounded
from .authority import (
    AUTHORITY,
    AUTHORITY_KEY,
    check_authority,
    make_authority,
    make_folder,
    make_identity,
    make_server,
    openssl,
)
from .output import print_json
from .router_config import router_config
from .saving import save, save_bytes

_ACTIONS = """\
actions:
  init            make an authority, and a certificate for the daemon of this machine
  user NAME       make an identity, with which a user of another machine connects
  machine NAME    make a certificate for the daemon of another machine
  router NAME     make a certificate and the configuration of a Zenoh router, at which the
                  buses of several machines meet
  show [FILE]     show to whom an identity belongs, and when it expires
  test            connect, and say what the user may do

First run `init` on the machine of the daemon, then `user` for each user. Both print what belongs
into the configuration. On the other machine, the identity is given with --identity, in
$ECATD_IDENTITY, or as ~/.config/ecatd/identity.pem.
"""
_FOLDER = Path("/etc/ecatd/tls")
_DAEMON, _ROUTER = "daemon", "router"
_ROUTER_CONFIG = "zenohd.json5"
_ROUTER_PORT = 7447
_SERVER_DAYS, _USER_DAYS = 1825, 365
_HOST = re.compile("[A-Za-z0-9:.*_-]{1,253}")


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.epilog = _ACTIONS
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.set_defaults(alone=remote)
    command.add_argument("action", choices=_RUN, metavar="ACTION", help="see below")
    command.add_argument(
        "name", nargs="?", metavar="NAME", help="user, machine, router: its name; show: a file"
    )
    command.add_argument(
        "--dir",
        type=Path,
        default=_FOLDER,
        metavar="DIR",
        help=f"the folder of the authority (default: {_FOLDER})",
    )
    command.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="HOST",
        help="init, machine, router: a further name or address by which others reach it",
    )
    command.add_argument(
        "--machine",
        action="append",
        default=[],
        metavar="NAME",
        help="router: a machine whose buses are to be reached there",
    )
    command.add_argument(
        "--user",
        action="append",
        default=[],
        metavar="NAME",
        help="router: a user who is let in",
    )
    command.add_argument(
        "--days",
        type=bounded(1, 36500),
        metavar="N",
        help=f"how long the certificate holds (default: {_SERVER_DAYS} days, user: {_USER_DAYS})",
    )
    command.add_argument(
        "-o",
        dest="out",
        type=Path,
        metavar="PATH",
        help="user: the file (default: NAME.pem); machine, router: the folder (default: NAME)",
    )


def remote(options: argparse.Namespace) -> None:
    """Carries out one action."""
    action = options.action
    if options.name is not None and action in ("init", "test"):
        raise UsageError(f"remote {action} takes no NAME")
    if options.name is None and action in ("user", "machine", "router"):
        raise UsageError(f"remote {action} needs the NAME of the {action}")
    _RUN[action](options)


# --- init, machine, router -----------------------------------------------------------------------


def _init(options: argparse.Namespace) -> None:
    folder: Path = options.dir.resolve()
    _check_new(
        [folder / name for name in (AUTHORITY, AUTHORITY_KEY, *_pair(_DAEMON))],
        "identities that it has signed would no longer hold. Remove the files of this folder "
        "first, or give another --dir",
    )
    usual = (socket.gethostname(), socket.getfqdn(), "localhost", "127.0.0.1")
    hosts = _hosts(options.host, usual)
    days = options.days or _SERVER_DAYS
    make_folder(folder)
    make_authority(folder)
    name = socket.gethostname()[:63]
    make_server(folder, folder, _DAEMON, name, hosts, days)
    text = _gateway(folder)
    if options.json:
        print_json({"folder": str(folder), "hosts": hosts, "days": days, "configuration": text})
        return
    print(f"{folder}: an authority, and a certificate of the daemon of '{name}' for")
    print(f"{', '.join(hosts)}\n")
    print(f"This belongs into the configuration of the daemon:\n\n{text}")
    print(f"Keep {folder / AUTHORITY_KEY} to yourself: who has it can make users.")
    print("Next: ecatctl remote user NAME")


def _gateway(folder: Path) -> str:
    """The lines of a configuration that name the files of a daemon."""
    return (
        "[gateway]\n"
        'listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448"]\n'
        f'certificate = "{folder / _DAEMON}.pem"\n'
        f'key = "{folder / _DAEMON}.key"\n'
        f'users_ca = "{folder / AUTHORITY}"\n'
    )


def _machine(options: argparse.Namespace) -> None:
    name = _checked_host(options.name)
    authority, out = options.dir.resolve(), (options.out or Path(name)).resolve()
    check_authority(authority)
    _check_new([out / file for file in (AUTHORITY, *_pair(_DAEMON))], "give another folder with -o")
    hosts = _hosts(options.host, (name,))
    days = options.days or _SERVER_DAYS
    make_folder(out)
    save_bytes(out / AUTHORITY, (authority / AUTHORITY).read_bytes())
    make_server(authority, out, _DAEMON, name, hosts, days)
    text = _gateway(_FOLDER)
    if options.json:
        print_json({"folder": str(out), "hosts": hosts, "days": days, "configuration": text})
        return
    print(f"{out}: a certificate of the daemon of '{name}' for {', '.join(hosts)}\n")
    print(f"Bring these files to {_FOLDER} on '{name}': {_DAEMON}.pem, {_DAEMON}.key, {AUTHORITY}.")
    print(f"This belongs into the configuration there:\n\n{text}")


def _router(options: argparse.Namespace) -> None:
    name = _checked_host(options.name)
    machines = [_checked_host(item) for item in options.machine]
    users = [_checked_user(item) for item in options.user]
    if not machines:
        raise UsageError(
            "say with --machine whose buses are to be reached at the router, and with --user who "
            "is let in; both can be given several times"
        )
    authority, out = options.dir.resolve(), (options.out or Path(name)).resolve()
    check_authority(authority)
    hosts = _hosts(options.host, (name,))
    days = options.days or _SERVER_DAYS
    made = not all((out / file).exists() for file in _pair(_ROUTER))
    make_folder(out)
    if made:  # else only who is let in has changed
        save_bytes(out / AUTHORITY, (authority / AUTHORITY).read_bytes())
        make_server(authority, out, _ROUTER, name, hosts, days)
    config = out / _ROUTER_CONFIG
    listen = f"tls/0.0.0.0:{_ROUTER_PORT}"
    files = {"certificate": f"{_ROUTER}.pem", "key": f"{_ROUTER}.key", "authority": AUTHORITY}
    paths = {key: str(out / file) for key, file in files.items()}
    save(config, router_config(listen, machines, users, **paths))
    text = f'host = "{machines[0]}"\nconnect = ["tls/{name}:{_ROUTER_PORT}"]\n'
    if options.json:
        print_json({"file": str(config), "hosts": hosts, "machines": machines, "users": users})
        return
    if made:
        print(f"{out}: a certificate of the router for {', '.join(hosts)}")
    print(
        f"{config}: lets in the machines {', '.join(machines)}; users: {', '.join(users) or '-'}\n"
    )
    print(f"Start the router with: zenohd -c {config}")
    print(f"This belongs into [gateway] of '{machines[0]}', and likewise of all others:\n\n{text}")
    where = f"--connect tls/{name}:{_ROUTER_PORT} --bus {machines[0]}/ecat0"
    print(f"Users connect with: ecatctl {where} --identity FILE ...")


def _pair(name: str) -> tuple[str, str]:
    return f"{name}.pem", f"{name}.key"


def _check_new(files: Sequence[Path], remedy: str) -> None:
    for file in files:
        if file.exists():
            raise UsageError(f"{file} exists already, and nothing was made: {remedy}")


def _hosts(given: Sequence[str], usual: Sequence[str]) -> list[str]:
    for host in given:
        if not _HOST.fullmatch(host):
            raise UsageError(f"'{host}' is no name or address of a machine")
    return list(dict.fromkeys([*given, *usual]))


def _checked_host(name: str) -> str:
    if not HOST_NAME.fullmatch(name):
        raise UsageError(f"'{name}' is no name of a machine: it {HOST_NAME_RULE}")
    return name


def _checked_user(name: str) -> str:
    if not USER_NAME.fullmatch(name):
        raise UsageError(f"'{name}' is no name of a user: {USER_NAME_RULE}")
    return name


# --- user ----------------------------------------------------------------------------------------


def _user(options: argparse.Namespace) -> None:
    name, folder = _checked_user(options.name), options.dir.resolve()
    days = options.days or _USER_DAYS
    out = options.out or Path(f"{name}.pem")
    if out.exists():
        raise UsageError(f"{out} exists already: give another -o FILE")
    check_authority(folder)
    make_identity(folder, out, name, days)
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
            fits = openssl("x509", "-in", certificate, "-noout", "-pubkey") == openssl(
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
    lines = openssl("x509", "-in", certificate, "-noout", *what).splitlines()
    return {line.partition("=")[0].lower(): line.partition("=")[2].strip() for line in lines}


def _runs(*arguments: str | Path) -> bool:
    try:
        openssl(*arguments)
    except StateError:
        return False
    return True


def _test(options: argparse.Namespace) -> None:
    from ecatd.client.remote import Remote  # Zenoh takes longest of all to load

    with Remote(options.bus, options.connect, options.timeout) as session:
        info = session.request(ReadInfo())
        found = session.rights() if session.user else None
    if options.json:
        print_json({"bus": options.bus, "host": info["host"], "rights": found})
        return
    if found is None:
        where = "as a member of the group 'ecat'" if options.connect is None else "without a name"
        may = "reads and changes" if options.connect is None else "reads"
        print(f"bus '{options.bus}' of {info['host']}: this connection {may}, {where}")
        return
    may = ", ".join(found["write"]) or "nothing"
    slaves = f"slaves {', '.join(map(str, found['slaves']))}" if found["slaves"] else "all slaves"
    print(
        f"bus '{options.bus}' of {info['host']}: user '{found['user']}' reads everything but files "
        f"of slaves and frames; further rights: {may}"
        + (f", of {slaves}" if found["write"] else "")
    )


_RUN = {
    "init": _init,
    "user": _user,
    "machine": _machine,
    "router": _router,
    "show": _show,
    "test": _test,
}
