"""Where others can read the bus: `[gateway]`, and how it is read."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, field

from ..bus_name import HOST_NAME, HOST_NAME_RULE
from ..errors import LOOPBACK
from ..queries import RIGHT_NAMES
from ..toml_file import Key, Rules, Table, number, show

PLAIN, ENCRYPTED = ("tcp", "ws", "udp"), ("tls", "quic")
PROTOCOLS = (*PLAIN, *ENCRYPTED)
"""Protocols of Zenoh with host and port; only the encrypted ones know users."""

_LOCAL = "unixsock-stream/"
_SOCKET_PATH_MAX = 107  # of a Unix socket in Linux


@dataclass(slots=True)
class UserConfig:
    """`[[gateway.user]]`: somebody who may use the bus from other machines, with a certificate.

    Attributes:
        name: Common name of the certificate.
        write: The rights of the user, of `RIGHT_NAMES`; none: only reading.
        slaves: The slaves that they may be about, by position or name; none: all. With
            some, the user may not change all slaves at once. What is about no slave, such as levels
            of the log or frames, needs only its kind in `write`.
        changes_max: Changes a second that the user may ask for in the long run.
    """

    name: str
    write: list[str] = field(default_factory=list)
    slaves: list[int | str] = field(default_factory=list)
    changes_max: float = 100.0


@dataclass(slots=True)
class GatewayConfig:
    """`[gateway]`: access to the bus over Zenoh.

    Attributes:
        host: Name of this machine in the keys of the bus; empty for keys without a machine.
        listen: Zenoh endpoints for others, in addition to the Unix socket for users of this
            machine.
        connect: Zenoh endpoints of routers, which this gateway connects to.
        certificate: File with the certificate of the daemon, in PEM; empty for none.
        key: File with its private key.
        users_ca: File with the certificates of those who may sign certificates of users and
            routers.
        user: The users.
        anonymous_reading: Whether other machines may read without a certificate.
        publish_hz: Rate in Hz at which values of signals are published, 0 for never.
        metrics: Where metrics are served over HTTP: `HOST:PORT` of a loopback address, or
            `unix:PATH`; empty: nowhere.
    """

    host: str = ""
    listen: list[str] = field(default_factory=lambda: [LOOPBACK])
    connect: list[str] = field(default_factory=list)
    certificate: str = ""
    key: str = ""
    users_ca: str = ""
    user: list[UserConfig] = field(default_factory=list)
    anonymous_reading: bool = False
    publish_hz: float = 10.0
    metrics: str = ""


def read_gateway(top: Table, key: Key) -> GatewayConfig:
    """Reads `[gateway]`."""
    table = top.table(key)
    config = GatewayConfig(**table.read(_GATEWAY))
    _check_certificates(table, config)
    _check_readers(table, config)
    _check_routers(table, config)
    return config


def host_of(endpoint: str) -> str:
    """The host of an endpoint `PROTOCOL/HOST:PORT`."""
    address = re.split("[?#]", endpoint.partition("/")[2], maxsplit=1)[0]
    return address.rpartition(":")[0].strip("[]")


def _check_certificates(table: Table, config: GatewayConfig) -> None:
    """Checks that what encrypted endpoints and users need is there."""
    for where, needed in (
        ("listen", ("certificate", "key")),
        ("connect", ("certificate", "key", "users_ca")),
    ):
        encrypted = [item for item in getattr(config, where) if is_encrypted(item)]
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
        protocol = endpoint.partition("/")[0]
        if config.anonymous_reading or (protocol in PLAIN and _is_loopback(host_of(endpoint))):
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
        if endpoint.startswith(_LOCAL):
            elements.fail(at, f"{show(endpoint)} is no router: write tls/HOST:PORT")
        if not (is_encrypted(endpoint) or config.anonymous_reading):
            elements.fail(
                at,
                f"{show(endpoint)} has no encryption, so nobody could read there: use "
                "tls/HOST:PORT, or set gateway.anonymous_reading = true if everybody who reaches "
                "the router may read the bus",
            )
    routers = {host_of(endpoint) for endpoint in config.connect}
    for at, user in enumerate(config.user):
        if user.name in routers:
            table.tables("user")[at].fail(
                "name", f"{show(user.name)} is the name of a router (gateway.connect): use another"
            )


def is_encrypted(endpoint: str) -> bool:
    """Whether an endpoint is encrypted, and knows users."""
    return endpoint.partition("/")[0] in ENCRYPTED


def _host(table: Table, key: Key) -> str:
    text = table.text(key)
    if text and not HOST_NAME.fullmatch(text):
        table.fail(key, f"{show(text)} is no name of a machine: it {HOST_NAME_RULE}")
    return text


def _endpoints(table: Table, key: Key) -> list[str]:
    elements = table.elements(key)
    for at, endpoint in elements.data.items():
        _check_endpoint(elements, at)
        if endpoint in list(elements.data.values())[:at]:
            elements.fail(at, f"{show(endpoint)} is there twice: remove one")
    return list(elements.data.values())


def _check_endpoint(table: Table, key: Key) -> None:
    endpoint = table.text(key)
    if endpoint.startswith(f"{_LOCAL}/"):
        return
    protocol, _, rest = endpoint.partition("/")
    host, _, port = re.split("[?#]", rest, maxsplit=1)[0].rpartition(":")
    if protocol not in PROTOCOLS or not host:
        table.fail(
            key,
            f"{show(endpoint)} is no Zenoh endpoint: write PROTOCOL/HOST:PORT, such as "
            f'"{LOOPBACK}", with one of the protocols {", ".join(PROTOCOLS)}; or '
            f'"{_LOCAL}/PATH"',
        )
    if not _is_port(port):
        table.fail(key, f"{show(endpoint)}: {show(port)} is no port: write one from 1 to 65535")


def _is_port(text: str) -> bool:
    return bool(re.fullmatch("[0-9]{1,5}", text)) and 0 < int(text) < 1 << 16


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _metrics_address(table: Table, key: Key) -> str:
    text = table.text(key)
    if not text or (text.startswith("unix:/") and len(text) <= len("unix:") + _SOCKET_PATH_MAX):
        return text
    host, _, port = text.rpartition(":")
    if not _is_port(port):
        table.fail(
            key,
            f'{show(text)} is no address: write "127.0.0.1:9754", or '
            f'"unix:/run/ecatd/ecat0/gateway/metrics"',
        )
    if not _is_loopback(host.strip("[]")):
        table.fail(
            key,
            f"{show(text)} can be reached from other machines, and everybody may read metrics: use "
            f"127.0.0.1, and a proxy that knows users where others are to read them",
        )
    return text


def _path(table: Table, key: Key) -> str:
    text = table.text(key)
    if text and not text.startswith("/"):
        table.fail(key, f"{show(text)} is no whole path: it must begin with /")
    return text


def _user(table: Table, key: Key) -> UserConfig:
    return UserConfig(**table.table(key).read(_USER, required=("name",)))


def _user_name(table: Table, key: Key) -> str:
    text = table.text(key)
    if not USER_NAME.fullmatch(text):
        table.fail(key, f"{show(text)} is no name of a user: {USER_NAME_RULE}")
    return text


def _changes(table: Table, key: Key) -> list[str]:
    return table.choices(key, {name: name for name in RIGHT_NAMES})


def _slave(table: Table, key: Key) -> int | str:
    if isinstance(table.data.get(key), str):
        return table.text(key)
    return table.integer(key, 0, _POSITION_MAX)


USER_NAME = re.compile("[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")
USER_NAME_RULE = "letters, digits, and behind the first one also _ . @ -, at most 64 in all"
_POSITION_MAX = 0xFFFF
_USER: Rules = {
    "name": _user_name,
    "write": _changes,
    "slaves": lambda table, key: table.array(key, _slave),
    "changes_max": number(0.1, 10_000),
}
_GATEWAY: Rules = {
    "host": _host,
    "listen": _endpoints,
    "connect": _endpoints,
    "certificate": _path,
    "key": _path,
    "users_ca": _path,
    "user": lambda table, key: table.array(key, _user, "tables"),
    "anonymous_reading": Table.boolean,
    "publish_hz": number(0, 1000),
    "metrics": _metrics_address,
}
