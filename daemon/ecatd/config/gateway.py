"""Where others can read the bus: `[gateway]`, and how it is read."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.bus_name import HOST_NAME, HOST_NAME_RULE
from ecatd.base.errors import LOOPBACK
from ecatd.base.toml_file import Key, Table, accepts, any_of, integer, number, show
from ecatd.description.limits import POSITION_MAX
from ecatd.operations.catalog import RIGHT_NAMES
from ecatd.operations.endpoints import ENCRYPTED, LOCAL, PLAIN, PROTOCOLS, Endpoint

from .placed import Placed, each, read
from .references import position_or_name

_SOCKET_PATH_MAX = 107  # of a Unix socket in Linux

USER_NAME = re.compile("[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")
USER_NAME_RULE = "letters, digits, and behind the first one also _ . @ -, at most 64 in all"


@accepts(HOST_NAME_RULE)
def _host(table: Table, key: Key) -> str:
    text = table.text(key)
    if text and not HOST_NAME.fullmatch(text):
        table.fail(key, f"{show(text)} cannot be the name of a machine: it {HOST_NAME_RULE}")
    return text


def _endpoints(table: Table, key: Key) -> list[str]:
    elements = table.elements(key)
    for at, endpoint in elements.data.items():
        _check_endpoint(elements, at)
        if endpoint in list(elements.data.values())[:at]:
            elements.fail(at, f"{show(endpoint)} is there twice: remove one")
    return list(elements.data.values())


_ENDPOINT = (
    f"`PROTOCOL/HOST:PORT` with one of the protocols {', '.join(PROTOCOLS)}, and a port from 1 to "
    "65535"
)
_LISTEN = accepts(f"{_ENDPOINT}; `{LOCAL}//PATH`")(_endpoints)
_CONNECT = accepts(_ENDPOINT)(_endpoints)
_ROUTER_NAMES = accepts("names of hosts")(lambda table, key: table.array(key, _router_name))


def _check_socket_path(table: Table, key: Key, path: str) -> None:
    if not path.startswith("/") or path.endswith("/") or not path.isprintable():
        table.fail(key, f"{show(path)} is not the path of a socket: write an absolute path")
    if len(path.encode()) > _SOCKET_PATH_MAX:
        table.fail(key, f"{show(path)} is too long for a socket: at most {_SOCKET_PATH_MAX} bytes")


def _router_name(table: Table, key: Key) -> str:
    text = table.text(key)
    if not HOST_NAME.fullmatch(text):
        table.fail(key, f"{show(text)} cannot be the name of a router: it {HOST_NAME_RULE}")
    return text


def _check_endpoint(table: Table, key: Key) -> None:
    endpoint = table.text(key)
    place = Endpoint.of(endpoint)
    if endpoint.startswith(f"{LOCAL}//"):
        _check_socket_path(table, key, endpoint.removeprefix(f"{LOCAL}/"))
        return
    if place.protocol not in PROTOCOLS or not place.host:
        table.fail(
            key,
            f"{show(endpoint)} is not a Zenoh endpoint: write PROTOCOL/HOST:PORT, such as "
            f'"{LOOPBACK}", with one of the protocols {", ".join(PROTOCOLS)}; or '
            f'"{LOCAL}//PATH"',
        )
    if not is_port(place.port):
        port = show(place.port)
        table.fail(key, f"{show(endpoint)}: {port} is not a port: write one from 1 to 65535")


def is_port(text: str) -> bool:
    """Whether a text is a port from 1 to 65535."""
    return bool(re.fullmatch("[0-9]{1,5}", text)) and 0 < int(text) < 1 << 16


def is_loopback(host: str) -> bool:
    """Whether a host is this machine, and reached by nobody else."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@accepts("`HOST:PORT` with a loopback address, or `unix:PATH`")
def _metrics_address(table: Table, key: Key) -> str:
    text = table.text(key)
    if not text:
        return text
    if text.startswith("unix:/"):
        _check_socket_path(table, key, text.removeprefix("unix:"))
        return text
    host, _, port = text.rpartition(":")
    if not is_port(port):
        table.fail(
            key,
            f'{show(text)} is not an address: write "127.0.0.1:9754", or '
            f'"unix:/run/ecatd/ecat0/gateway/metrics"',
        )
    if not is_loopback(host.strip("[]")):
        table.fail(
            key,
            f"{show(text)} can be reached from other machines, and everybody may read metrics: use "
            f"127.0.0.1, and a proxy that knows users where others are to read them",
        )
    return text


@accepts("a whole path")
def _path(table: Table, key: Key) -> str:
    text = table.text(key)
    if text and not text.startswith("/"):
        table.fail(key, f"{show(text)} is not an absolute path: it must begin with /")
    return text


@accepts(USER_NAME_RULE)
def _user_name(table: Table, key: Key) -> str:
    text = table.text(key)
    if not USER_NAME.fullmatch(text):
        table.fail(key, f"{show(text)} cannot be the name of a user: {USER_NAME_RULE}")
    return text


@accepts(f"0 to {POSITION_MAX}, or names")
def _slaves(table: Table, key: Key) -> list[int | str]:
    return table.array(key, position_or_name)


@dataclass(slots=True)
class UserConfig(Placed):
    """`[[gateway.user]]`: one table for each user of other machines, who has a certificate.

    `ecatctl remote user` makes [certificates](zenoh.md#users-of-other-machines).

    Attributes:
        name: Common name of the certificate.
        write: Kinds of changes that the user may request; none: only reading. Reading files needs
            `foe`, and reading frames (`ecatctl capture`) needs `frames`.
        slaves: The slaves that the user may change, by position or name; none: all. With some,
            requests that are about all slaves at once are refused. Requests that are about no
            slave, such as levels of the log and frames, need only `write`.
        changes_max: Number of changes that the user may request in a second. The changes of one
            second may come at once. Further ones wait; if more than those of two seconds are
            waiting, the answer is `busy`.
        sessions_max: Number of sessions that the user may have at the same time over TCP addresses:
            programs with this certificate. A further one is closed.
    """

    name: Annotated[str, _user_name]
    write: Annotated[list[str], any_of(RIGHT_NAMES)] = field(default_factory=list)
    slaves: Annotated[list[int | str], _slaves] = field(default_factory=list)
    changes_max: Annotated[float, number(0.1, 10_000)] = 100.0
    sessions_max: Annotated[int, integer(1, 1000)] = 20


@dataclass(slots=True)
class GatewayConfig(Placed):
    """`[gateway]`: access to the bus over [Zenoh](zenoh.md), and metrics.

    Attributes:
        host: Name of this machine in the keys of the bus, where
            [several machines meet at a router](zenoh.md#several-machines-at-a-router). `""`: the
            keys have no machine.
        listen: Zenoh endpoints for others, in addition to the Unix socket for users of this
            machine. Other machines need `tls` or `quic`, unless `anonymous_reading` is true. If an
            address does not exist yet, because the network comes up later, ecatd tries again until
            it does.
        connect: Zenoh routers that the gateway connects to, again and again until it succeeds.
            Needs `host`, and a `certificate` that the authority of the router has signed.
        router_names: Names (common names) in the certificates of routers, where the addresses in
            `connect` have others, such as an IP address.
        certificate: File with the certificate of the daemon, in PEM, for `tls` and `quic`;
            [`ecatctl remote init`](zenoh.md#users-of-other-machines) makes it, and `key`. The
            gateway must be able to read both. `""`: none.
        key: File with the private key of the daemon, in PEM.
        users_ca: File with the certificates of those who may sign certificates of users and
            routers.
        user: The users.
        guests_max: Number of sessions over TCP addresses of all those together whom no
            `[[gateway.user]]` names: users of this machine at a loopback address, and others with
            `anonymous_reading`. Half of them may come from one address. A further one is closed.
        anonymous_reading: Everybody who can reach an address of `listen` may read the bus without a
            certificate.
        publish_hz: Rate at which values are published over Zenoh; 0: never.
        metrics: Where [metrics](command-line.md#metrics) are served over HTTP, such as
            `"127.0.0.1:9754"` or `"unix:/run/ecatd/ecat0/gateway/metrics"`; `""`: nowhere.
    """

    host: Annotated[str, _host] = ""
    listen: Annotated[list[str], _LISTEN] = field(default_factory=lambda: [LOOPBACK])
    connect: Annotated[list[str], _CONNECT] = field(default_factory=list)
    router_names: Annotated[list[str], _ROUTER_NAMES] = field(default_factory=list)
    certificate: Annotated[str, _path] = ""
    key: Annotated[str, _path] = ""
    users_ca: Annotated[str, _path] = ""
    user: Annotated[list[UserConfig], each(UserConfig)] = field(default_factory=list)
    guests_max: Annotated[int, integer(2, 1000)] = 64
    anonymous_reading: Annotated[bool, Table.boolean] = False
    publish_hz: Annotated[float, number(0, 1000)] = 10.0
    metrics: Annotated[str, _metrics_address] = ""


def read_gateway(top: Table, key: Key) -> GatewayConfig:
    """Reads `[gateway]`."""
    table = top.table(key)
    config = read(GatewayConfig, table)
    _check_certificates(table, config)
    _check_readers(table, config)
    _check_routers(table, config)
    return config


def _check_certificates(table: Table, config: GatewayConfig) -> None:
    """Checks that what encrypted endpoints and users need is there."""
    for where, needed in (
        ("listen", ("certificate", "key")),
        ("connect", ("certificate", "key", "users_ca")),
    ):
        encrypted = [item for item in getattr(config, where) if Endpoint.of(item).is_encrypted]
        for name in needed:
            if encrypted and not getattr(config, name):
                keys = [f"gateway.{item}" for item in needed]
                table.fail(
                    where,
                    f"{show(encrypted[0])} needs {', '.join(keys[:-1])} and {keys[-1]}; "
                    "`ecatctl remote init` makes them",
                )
    if config.user and not config.users_ca:
        table.fail(
            "user",
            "users are known by their certificates: say in gateway.users_ca who signs them; "
            "`ecatctl remote init` makes such a file",
        )
    names = [item.name for item in config.user]
    for at, name in enumerate(names):
        if name in names[:at]:
            table.tables("user")[at].fail("name", f"{show(name)} is there twice: remove one")


def _check_readers(table: Table, config: GatewayConfig) -> None:
    """Checks that somebody may use each endpoint."""
    elements = table.elements("listen")
    for at, endpoint in enumerate(config.listen):
        protocol, host = Endpoint.of(endpoint).protocol, Endpoint.of(endpoint).host
        if config.anonymous_reading or (protocol in PLAIN and is_loopback(host)):
            continue
        if protocol in PLAIN:
            elements.fail(
                at,
                f"{show(endpoint)} can be reached from other machines, and has no encryption, so "
                'nobody could read there: use "tls/HOST:PORT" with certificates (`ecatctl remote '
                "init` makes them), or set gateway.anonymous_reading = true if everybody who "
                "reaches this address may read the bus",
            )
        if protocol in ENCRYPTED and not config.user:
            elements.fail(
                at,
                f"nobody could use {show(endpoint)}: name those who may in [[gateway.user]], or "
                "set gateway.anonymous_reading = true",
            )


def _check_routers(table: Table, config: GatewayConfig) -> None:
    """Checks that buses behind a router can be told apart, and that no secret gets there."""
    if config.connect and not config.host:
        table.fail(
            "connect",
            "other machines may have a bus of the same name at the router: add the name of this "
            'machine, such as gateway.host = "cell4"',
        )
    elements = table.elements("connect")
    for at, endpoint in enumerate(config.connect):
        if Endpoint.of(endpoint).protocol == LOCAL:
            elements.fail(at, f"{show(endpoint)} is not a router: write tls/HOST:PORT")
        if not (Endpoint.of(endpoint).is_encrypted or config.anonymous_reading):
            elements.fail(
                at,
                f"{show(endpoint)} has no encryption, so nobody could read there: use "
                "tls/HOST:PORT, or set gateway.anonymous_reading = true if everybody who reaches "
                "the router may read the bus",
            )
    if config.router_names and not config.connect:
        table.fail(
            "router_names", "there is no router: name one in gateway.connect, or remove this"
        )
    # Who has the certificate of a router may speak for every user.
    routers = {*(Endpoint.of(item).host for item in config.connect), *config.router_names}
    for at, user in enumerate(config.user):
        if user.name in routers:
            table.tables("user")[at].fail(
                "name",
                f"{show(user.name)} is the name of a router (gateway.connect or "
                "gateway.router_names): use another",
            )
