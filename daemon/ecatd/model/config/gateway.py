"""Reads `[gateway]`: where others can read the bus."""

from __future__ import annotations

import ipaddress
import re

from ..toml_file import Key, Rules, Table, number, show
from .tables import GatewayConfig

PROTOCOLS = ("tcp", "tls", "ws", "udp", "quic")
"""Protocols of Zenoh with host and port."""

_LOCAL = "unixsock-stream/"
_SOCKET_PATH_MAX = 107  # of a Unix socket in Linux


def read_gateway(top: Table, key: Key) -> GatewayConfig:
    """Reads `[gateway]`."""
    return GatewayConfig(**top.table(key).read(_GATEWAY))


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
            f'"tcp/127.0.0.1:7447", with one of the protocols {", ".join(PROTOCOLS)}; or '
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


_GATEWAY: Rules = {
    "listen": _endpoints,
    "publish_hz": number(0, 1000),
    "metrics": _metrics_address,
}
