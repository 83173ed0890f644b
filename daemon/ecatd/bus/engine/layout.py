"""The logical address space: each domain has a window, and each slave has whole bytes in it.

ecatd assigns the addresses itself instead of taking SOEM's, so that there can be several domains,
and the bits of two slaves never share a byte.

The image of a domain has four parts, each with one slave after the other. "No LRW" are the slaves
that do not support the LRW command:

    outputs, no LRW | outputs, other slaves | inputs, other slaves | inputs, no LRW

Outputs lie before inputs, as clients expect. The first part is exchanged by LWR, the two in the
middle together by LRW, and the last by LRD. So only slaves without LRW cost extra datagrams. A
datagram always ends at the boundary of a slave, so that its working counter is known.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence, Set
from dataclasses import dataclass, field

from ecatd.model.bus import Bus, Domain, Slave
from ecatd.model.config import DomainConfig
from ecatd.model.errors import ConfigError, StateError

from .framing import DOMAIN_DATAGRAM_MAX

WINDOW = 0x0010_0000
"""Logical addresses of one domain: domain d begins at (d + 1) * WINDOW."""

LRD, LWR, LRW = 10, 11, 12

_COUNTS = {LWR: (1, 0), LRW: (2, 1), LRD: (0, 1)}
"""What one slave adds to the working counter: for outputs, and for inputs (ETG.1000.4)."""


@dataclass(slots=True)
class Datagram:
    """A piece of a domain's image that one datagram carries. Offset and length are in bytes."""

    command: int
    offset: int
    length: int
    wkc_expected: int


@dataclass(slots=True)
class DomainImage:
    """Sizes and datagrams of one domain."""

    number: int
    output_base: int
    output_bytes: int = 0
    input_bytes: int = 0
    name: str = ""
    divider: int = 1
    phase: int = 0
    datagrams: list[Datagram] = field(default_factory=list)

    @property
    def address(self) -> int:
        """Logical address of the first byte of the image."""
        return (self.number + 1) * WINDOW

    @property
    def wkc_expected(self) -> int:
        """Sum of the working counters of all datagrams when every slave takes part."""
        return sum(datagram.wkc_expected for datagram in self.datagrams)


@dataclass(slots=True)
class Image:
    """The process image of a bus."""

    domains: list[DomainImage]

    @property
    def output_bytes(self) -> int:
        """Bytes of outputs of all domains together, as clients commit them."""
        return sum(domain.output_bytes for domain in self.domains)


def assign_domains(
    bus: Bus, configured: Sequence[DomainConfig], idle: Collection[int] = ()
) -> None:
    """Puts every slave into its configured domain, or into domain 0 if none is configured.

    Args:
        bus: Scanned slaves with their PDOs; `domains` and the `domain` of each slave are set.
        configured: Domains of the configuration.
        idle: Positions of slaves whose process data are unknown. A domain of such slaves is
            accepted, although nothing is known to be exchanged in it.

    Raises:
        ConfigError: A domain names a slave that does not exist.
        StateError: There are several domains, and one has no process data.
    """
    bus.domains = [Domain(item.name, item.divider, item.phase) for item in configured] or [Domain()]
    for slave in bus.slaves:
        slave.domain = 0
    for number, item in enumerate(configured):
        for position in item.slaves:
            if position >= len(bus.slaves):
                raise ConfigError(
                    f"{bus.domain_label(number)} names slave {position}, but bus '{bus.name}' has "
                    f"{len(bus.slaves)} slaves, 0 to {len(bus.slaves) - 1}: correct 'slaves' of "
                    f"this [[domain]], or look for the slave that is missing on the wire"
                )
            bus.slaves[position].domain = number
    if len(bus.domains) > 1:
        used = {slave.domain for slave in bus.slaves if slave.output_bytes or slave.input_bytes}
        used |= {bus.slaves[position].domain for position in idle}
        for number in range(len(bus.domains)):
            if number not in used:
                raise StateError(
                    f"{bus.domain_label(number)} has nothing to exchange: none of its slaves has "
                    f"process data; give it others with 'slaves', or remove this [[domain]]"
                )


def lay_out(bus: Bus, without_lrw: Set[int]) -> Image:
    """Places every slave in the process image, and plans the datagrams that exchange it.

    Args:
        bus: Slaves with their PDOs and domains; `output_offset` and `input_offset` are set here.
        without_lrw: Positions of slaves that do not support LRW.

    Raises:
        StateError: A slave has more process data than one datagram can carry.
    """
    count = max([len(bus.domains), 1, *(slave.domain + 1 for slave in bus.slaves)])
    image = Image([])
    for number in range(count):
        facts = bus.domains[number] if number < len(bus.domains) else Domain()
        domain = DomainImage(
            number,
            image.output_bytes,
            name=facts.name,
            divider=facts.divider,
            phase=facts.phase,
        )
        slaves = [slave for slave in bus.slaves if slave.domain == number]
        _place(domain, slaves, without_lrw)
        image.domains.append(domain)
    return image


def _place(domain: DomainImage, slaves: list[Slave], without_lrw: Set[int]) -> None:
    """Places the slaves of a domain in its image, and adds the datagrams that carry it."""
    whole = [slave for slave in slaves if slave.position not in without_lrw]
    split = [slave for slave in slaves if slave.position in without_lrw]
    rows: dict[int, list[_Part]] = {LWR: [], LRW: [], LRD: []}
    offset = 0
    for command, group in ((LWR, split), (LRW, whole)):
        for slave in group:
            slave.output_offset = offset
            offset = _append(rows[command], slave, offset, output=True)
    domain.output_bytes = offset
    for command, group in ((LRW, whole), (LRD, split)):
        for slave in group:
            slave.input_offset = offset
            offset = _append(rows[command], slave, offset, output=False)
    domain.input_bytes = offset - domain.output_bytes
    for command, parts in rows.items():
        domain.datagrams += _datagrams(command, parts)


@dataclass(slots=True)
class _Part:
    """The outputs or the inputs of one slave in the image."""

    output: bool
    offset: int
    length: int


def _append(parts: list[_Part], slave: Slave, offset: int, *, output: bool) -> int:
    """Adds a slave's outputs or inputs to `parts`, if it has any; returns the offset after them.

    Raises:
        StateError: One datagram cannot carry that many bytes.
    """
    length = slave.output_bytes if output else slave.input_bytes
    if length > DOMAIN_DATAGRAM_MAX:
        raise StateError(
            f"{slave.label} has {length} bytes of {'outputs' if output else 'inputs'}, but one "
            f"datagram carries at most {DOMAIN_DATAGRAM_MAX}: choose a smaller PDO assignment"
        )
    if length:
        parts.append(_Part(output, offset, length))
    return offset + length


def _datagrams(command: int, parts: Iterable[_Part]) -> list[Datagram]:
    """Makes datagrams of `parts`, each as long as possible; one slave's bytes stay together."""
    written, read = _COUNTS[command]
    datagrams: list[Datagram] = []
    for part in parts:
        if not datagrams or datagrams[-1].length + part.length > DOMAIN_DATAGRAM_MAX:
            datagrams.append(Datagram(command, part.offset, 0, 0))
        datagrams[-1].length += part.length
        datagrams[-1].wkc_expected += written if part.output else read
    return datagrams
