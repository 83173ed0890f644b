"""The logical address space (decision D2): a window per domain, whole bytes per slave.

A domain's image is its outputs, slave after slave, followed by its inputs. It is exchanged by
datagrams that end at slave boundaries, so that the working counter of each is known.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ecatd.model.bus import Bus, Slave
from ecatd.model.errors import StateError

DATAGRAM_BYTES = 1452
"""Process data in one datagram: what the bus's own datagrams leave of a frame (`engine.h`)."""

WINDOW = 0x0010_0000
"""Logical addresses of one domain: domain d begins at (d + 1) * WINDOW."""

LRD, LWR, LRW = 10, 11, 12


@dataclass(slots=True)
class Datagram:
    """A row of bytes of a domain's image that travels together."""

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
    datagrams: list[Datagram] = field(default_factory=list)

    @property
    def address(self) -> int:
        """Logical address of the first byte of the image."""
        return (self.number + 1) * WINDOW

    @property
    def wkc_expected(self) -> int:
        """Working counter of all datagrams when every slave takes part."""
        return sum(datagram.wkc_expected for datagram in self.datagrams)


@dataclass(slots=True)
class Image:
    """The process image of a bus."""

    domains: list[DomainImage]

    @property
    def output_bytes(self) -> int:
        """Outputs of all domains in a row, as clients commit them."""
        return sum(domain.output_bytes for domain in self.domains)


def lay_out(bus: Bus, without_lrw: set[int]) -> Image:
    """Gives every slave its bytes, and says how they are exchanged.

    Args:
        bus: Slaves with their PDOs; `output_offset` and `input_offset` are set.
        without_lrw: Positions of slaves that cannot do LRW (SII category 30); a domain with one
            of them is exchanged with LWR and LRD.

    Raises:
        StateError: A slave has more process data than one datagram can carry.
    """
    image = Image([])
    base = 0
    for number in range(max((slave.domain for slave in bus.slaves), default=0) + 1):
        slaves = [slave for slave in bus.slaves if slave.domain == number]
        domain = DomainImage(number, base)
        for slave in slaves:
            for size, what in ((slave.output_bytes, "outputs"), (slave.input_bytes, "inputs")):
                if size > DATAGRAM_BYTES:
                    raise StateError(
                        f"{slave.label} has {size} bytes of {what}, but one frame carries at most "
                        f"{DATAGRAM_BYTES}: choose a smaller PDO assignment"
                    )
            slave.output_offset = domain.output_bytes
            domain.output_bytes += slave.output_bytes
        offset = domain.output_bytes
        for slave in slaves:
            slave.input_offset = offset
            offset += slave.input_bytes
        domain.input_bytes = offset - domain.output_bytes
        split = any(slave.position in without_lrw for slave in slaves)
        domain.datagrams = _datagrams(slaves, separate=split)
        base += domain.output_bytes
        image.domains.append(domain)
    return image


def _datagrams(slaves: list[Slave], *, separate: bool) -> list[Datagram]:
    """Cuts the image at slave boundaries; `separate` keeps outputs and inputs apart.

    The working counter grows by 1 for each slave that was read from, and by 2 for each that was
    written to by LRW (by 1 with LWR), however many of its bytes lie in the datagram.
    """
    parts = [
        (slave.position, True, slave.output_offset, slave.output_bytes)
        for slave in slaves
        if slave.output_bytes
    ] + [
        (slave.position, False, slave.input_offset, slave.input_bytes)
        for slave in slaves
        if slave.input_bytes
    ]
    groups: list[list[tuple[int, bool, int, int]]] = []
    for part in parts:
        if (
            not groups
            or part[2] + part[3] - groups[-1][0][2] > DATAGRAM_BYTES
            or (separate and part[1] != groups[-1][0][1])
        ):
            groups.append([])
        groups[-1].append(part)
    datagrams = []
    for group in groups:
        written = {position for position, output, _, _ in group if output}
        read = {position for position, output, _, _ in group if not output}
        if separate:
            command = LWR if written else LRD
            expected = len(written) + len(read)
        else:
            command = LRW
            expected = 2 * len(written) + len(read)
        start = group[0][2]
        length = group[-1][2] + group[-1][3] - start
        datagrams.append(Datagram(command, start, length, expected))
    return datagrams
