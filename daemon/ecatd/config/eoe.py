"""Ethernet over EtherCAT: the keys of `[eoe]` and `[slave.eoe]`, and how they are read."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

from ecatd.base.toml_file import Key, Limits, Table, accepts
from ecatd.etg.eoe import (
    NAME_MAX,
    IpParameters,
    parse_address,
    parse_interface,
    parse_mac,
    parse_name,
)

from .placed import Placed, read
from .references import read_interface


def _text(parse: Callable[[str], object], words: str) -> Limits[str]:
    """A rule for a text that `parse` accepts, or an empty one."""

    @accepts(words)
    def rule(table: Table, key: Key) -> str:
        text = table.text(key)
        if text:
            table.explain(key, lambda: parse(text))
        return text

    return rule


@dataclass(slots=True)
class EoeConfig(Placed):
    """`[eoe]`: the network interface to the slaves with [Ethernet over EtherCAT](ethernet.md).

    Attributes:
        interface: Name of the interface (TAP), which ecatd makes; `""`: none.
        address: IP address of this interface with the size of the network; `""`: another program
            sets it.
    """

    interface: Annotated[str, read_interface] = ""
    address: Annotated[str, _text(parse_interface, 'such as `"192.168.7.1/24"`')] = ""


@dataclass(slots=True)
class SlaveEoeConfig(Placed):
    """`[slave.eoe]`: the [IP parameters](ethernet.md#ip-parameters) of a slave.

    A slave with Ethernet over EtherCAT gets them when it starts or comes back. Without this table
    it keeps those that it has.

    Attributes:
        mac: MAC address; `""`: ecatd chooses one.
        address: IP address with the size of the network; `""`: none.
        gateway: Default gateway; `""`: none.
        dns: DNS server; `""`: none.
        name: DNS name; `""`: none.
    """

    mac: Annotated[str, _text(parse_mac, 'such as `"02:00:00:00:00:01"`')] = ""
    address: Annotated[str, _text(parse_interface, 'such as `"192.168.7.2/24"`')] = ""
    gateway: Annotated[str, _text(parse_address, "an IP address")] = ""
    dns: Annotated[str, _text(parse_address, "an IP address")] = ""
    name: Annotated[str, _text(parse_name, f"at most {NAME_MAX} letters, digits, `-`, `.`")] = ""

    def with_mac(self, bus: str, position: int) -> SlaveEoeConfig:
        """The same with a MAC address, if it has none.

        The address stays the same, and no other slave of any bus is likely to have it.
        """
        if self.mac:
            return self
        text = f"{socket.gethostname()}/{bus}/{position}"
        # 0x02: it is administered locally (IEEE 802).
        data = b"\x02" + hashlib.blake2b(text.encode(), digest_size=5).digest()
        return replace(self, mac=data.hex(":"))

    @property
    def parameters(self) -> IpParameters:
        """The parameters for the slave."""
        address, mask = parse_interface(self.address) if self.address else (None, None)
        return IpParameters(
            mac=parse_mac(self.mac) if self.mac else None,
            address=address,
            mask=mask,
            gateway=parse_address(self.gateway) if self.gateway else None,
            dns=parse_address(self.dns) if self.dns else None,
            name=self.name or None,
        )


def read_eoe(top: Table, key: Key) -> EoeConfig:
    """Reads `[eoe]`."""
    table = top.table(key)
    config = read(EoeConfig, table)
    if config.address and not config.interface:
        table.fail("interface", "is missing: write the name of the interface that has the address")
    return config


def read_slave_eoe(row: Table, key: Key) -> SlaveEoeConfig:
    """Reads `[slave.eoe]`."""
    table = row.table(key)
    config = read(SlaveEoeConfig, table)
    for part in ("gateway", "dns", "name"):
        if getattr(config, part) and not config.address:
            table.fail(part, "needs an address: write address as well, as 192.168.7.2/24")
    return config
