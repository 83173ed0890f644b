"""Ethernet over EtherCAT: the keys of `[eoe]` and `[slave.eoe]`, and how they are read."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace

from ..eoe import IpParameters, parse_address, parse_interface, parse_mac, parse_name
from ..toml_file import Key, Rules, Table
from .interface import read_interface
from .placed import Placed


@dataclass(slots=True)
class EoeConfig(Placed):
    """`[eoe]`: the network interface of this computer to the slaves with EoE.

    Attributes:
        interface: Name of the interface (TAP), which ecatd makes; empty for none.
        address: Its IP address with the size of the network; empty: others set it.
    """

    interface: str = ""
    address: str = ""


@dataclass(slots=True)
class SlaveEoeConfig(Placed):
    """`[slave.eoe]`: the IP parameters that a slave gets when it starts or comes back.

    Attributes:
        mac: Its MAC address; empty: ecatd chooses one.
        address: Its IP address with the size of the network; empty for none.
        gateway: Its default gateway; empty for none.
        dns: Its DNS server; empty for none.
        name: Its DNS name; empty for none.
    """

    mac: str = ""
    address: str = ""
    gateway: str = ""
    dns: str = ""
    name: str = ""

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
    config = EoeConfig(**table.read(_EOE), table=table)
    if config.address and not config.interface:
        table.fail("interface", "is missing: write the name of the interface that has the address")
    return config


def read_slave_eoe(row: Table, key: Key) -> SlaveEoeConfig:
    """Reads `[slave.eoe]`."""
    table = row.table(key)
    config = SlaveEoeConfig(**table.read(_SLAVE_EOE), table=table)
    for part in ("gateway", "dns", "name"):
        if getattr(config, part) and not config.address:
            table.fail(part, "needs an address: write address as well, as 192.168.7.2/24")
    return config


def _text(parse: Callable[[str], object]) -> Callable[[Table, Key], str]:
    """A rule for a text that `parse` accepts, or an empty one."""

    def rule(table: Table, key: Key) -> str:
        text = table.text(key)
        if text:
            table.explain(key, lambda: parse(text))
        return text

    return rule


_EOE: Rules = {"interface": read_interface, "address": _text(parse_interface)}
_SLAVE_EOE: Rules = {
    "mac": _text(parse_mac),
    "address": _text(parse_interface),
    "gateway": _text(parse_address),
    "dns": _text(parse_address),
    "name": _text(parse_name),
}
