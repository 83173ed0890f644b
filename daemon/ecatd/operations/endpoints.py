"""Zenoh endpoints: `tls/HOST:7448#iface=eth0`, `unixsock-stream/PATH`."""

from __future__ import annotations

from typing import NamedTuple

PLAIN, ENCRYPTED = ("tcp", "ws", "udp"), ("tls", "quic")
PROTOCOLS = (*PLAIN, *ENCRYPTED)
"""Protocols of Zenoh with host and port; only the encrypted ones know users."""
LOCAL = "unixsock-stream"
"""The protocol of Unix sockets."""


class Endpoint(NamedTuple):
    """The parts of an endpoint `PROTOCOL/ADDRESS?METADATA#OPTION=VALUE;…`."""

    protocol: str  #: One of `PROTOCOLS`, `LOCAL`, or another one.
    address: str  #: `HOST:PORT`, or a path.
    metadata: str  #: What Zenoh compares of two endpoints; usually empty.
    options: tuple[str, ...]  #: Options of the connection, each `NAME=VALUE`.

    @classmethod
    def of(cls, text: str) -> Endpoint:
        """Takes an endpoint apart; whether it is one, its user finds out."""
        protocol, _, rest = text.partition("/")
        place, _, options = rest.partition("#")
        address, _, metadata = place.partition("?")
        return cls(protocol, address, metadata, tuple(filter(None, options.split(";"))))

    def __str__(self) -> str:
        metadata = f"?{self.metadata}" if self.metadata else ""
        options = f"#{';'.join(self.options)}" if self.options else ""
        return f"{self.protocol}/{self.address}{metadata}{options}"

    @property
    def host(self) -> str:
        """Name or address, without the brackets of IPv6."""
        return self.address.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> str:
        """The port, as it is written."""
        return self.address.rpartition(":")[2]

    @property
    def interface(self) -> str:
        """The network interface that its options name; empty for any."""
        return dict(item.partition("=")[::2] for item in self.options).get("iface", "")

    @property
    def is_encrypted(self) -> bool:
        """Whether the connection is encrypted, and knows users."""
        return self.protocol in ENCRYPTED
