"""The logical address space: each domain has a window, and each slave has whole bytes in it.

ecatd assigns the addresses itself instead of taking SOEM's, so that there can be several domains,
and the bits of two slaves never share a byte.

The image of a domain has six parts, each with one slave after the other. "No LRW" are the slaves
that do not support the LRW command, "optional" those that come and go:

    outputs, no LRW | outputs, optional | outputs, other slaves
    inputs, other slaves | inputs, optional | inputs, no LRW

Outputs lie before inputs, as clients expect. The two parts in the middle are exchanged together by
LRW, those before by LWR, and those behind by LRD. So only slaves without LRW and optional slaves
cost extra datagrams. A datagram always ends at the boundary of a slave, so that its working counter
is known. If one datagram cannot carry the outputs or the inputs of a slave, they are split: several
datagrams have nothing else, and are exchanged in one cycle, all or none (`Datagram.split`). Each
group of optional slaves has datagrams of its own: their working counters show in every cycle
whether the group is there, and the working counters of other datagrams do not depend on it.

`pack` is the rule by which datagrams share frames. The engine packs the frames of the cycle in C
(`daemon/cyclic/frames.c`, `engine.h`), by the same rule and with the same sizes. A test compares
both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, field, replace

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus, Domain, Slave
from ecatd.etg.frame_sizes import DATAGRAM_FRAMING, DATAGRAM_MAX, PAYLOAD_MAX
from ecatd.etg.pdo_layout import sync_manager_bytes
from ecatd.operations.image import ProcessImage
from ecatd.shm.contract import MAX_GROUPS

STATUS_BYTES = 2
TIME_BYTES = 8
"""Data bytes of the two datagrams at the start of each cycle: AL status, and reference clock."""

DOMAIN_DATAGRAM_MAX = DATAGRAM_MAX - STATUS_BYTES - TIME_BYTES - 2 * DATAGRAM_FRAMING
"""Most process data in one datagram, so that it fits into one frame with those two."""

MAX_FRAMES = 64
MAX_DATAGRAMS = 256
MAX_DOMAIN_DATAGRAMS = MAX_DATAGRAMS - 2
"""What the engine has room for in one cycle; two datagrams are its own (status and time)."""


WINDOW = 0x0010_0000
"""Logical addresses of one domain: domain d begins at (d + 1) * WINDOW."""

LRD, LWR, LRW = 10, 11, 12

COUNTS = {LWR: (1, 0), LRW: (2, 1), LRD: (0, 1)}
"""What one slave adds to the working counter: for outputs, and for inputs (ETG.1000.4)."""


@dataclass(slots=True)
class Datagram:
    """A piece of a domain's image that one datagram carries.

    Attributes:
        command: `LRD`, `LWR` or `LRW`.
        offset: Its first byte in the image.
        length: Its bytes.
        wkc_expected: Working counter when all its slaves take part.
        group: Number of the group of optional slaves in the domain that it carries; -1: none.
        split: Number, in the domain and from 1 on, of the outputs or the inputs of one slave that
            several datagrams carry together; 0: it carries all bytes of its slaves.
        closes: It has the last byte of a sync manager that several datagrams write. A slave takes
            outputs over when it has their last byte (ESC data sheet, section I, "Buffered Mode"),
            so this one is sent when the others have come back.
    """

    command: int
    offset: int
    length: int
    wkc_expected: int
    group: int = -1
    split: int = 0
    closes: bool = False


@dataclass(slots=True)
class DomainImage:
    """Sizes and datagrams of one domain.

    Attributes:
        number: Number of the domain, 0 first.
        output_base: Where its outputs begin in the output image of all domains.
        output_bytes: Bytes of outputs, at the start of its image.
        input_bytes: Bytes of inputs.
        name: Name from the configuration; may be empty.
        divider: It is exchanged in every n-th base cycle; this is n.
        phase: Remainder of cycle number / divider in these cycles.
        groups: Its groups of optional slaves, see `Slave.group`; their places are their numbers.
        datagrams: What is exchanged.
    """

    number: int
    output_base: int
    output_bytes: int = 0
    input_bytes: int = 0
    name: str = ""
    divider: int = 1
    phase: int = 0
    groups: list[str] = field(default_factory=list)
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

    def to_map(self) -> ProcessImage:
        """The form that clients get."""
        return {
            "domains": [
                {
                    "output_bytes": domain.output_bytes,
                    "input_bytes": domain.input_bytes,
                    "datagrams": [
                        {
                            "command": datagram.command,
                            "address": domain.address + datagram.offset,
                            "offset": datagram.offset,
                            "length": datagram.length,
                            "wkc_expected": datagram.wkc_expected,
                            "group": datagram.group,
                            "split": datagram.split,
                        }
                        for datagram in domain.datagrams
                    ],
                }
                for domain in self.domains
            ]
        }


def lay_out(bus: Bus, without_lrw: Set[int], alone: Set[int] = frozenset()) -> Image:
    """Places every slave in the process image, and plans the datagrams that exchange it.

    Args:
        bus: Slaves with their PDOs and domains; `output_offset` and `input_offset` are set here.
        without_lrw: Positions of slaves that do not support LRW.
        alone: Positions of slaves with datagrams of their own: their data are exchanged whatever
            other slaves do.

    Raises:
        StateError: A domain has too many groups of optional slaves.
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
        domain.groups = list(dict.fromkeys(slave.group for slave in slaves if slave.group))
        if len(domain.groups) > MAX_GROUPS:
            raise StateError(
                f"{bus.domain_label(number)} has {len(domain.groups)} groups of optional slaves, "
                f"but at most {MAX_GROUPS} are possible: give slaves that come and go together the "
                "same group, or put some into another [[domain]]"
            )
        _place(domain, slaves, without_lrw, alone)
        image.domains.append(domain)
    return image


def _place(
    domain: DomainImage, slaves: list[Slave], without_lrw: Set[int], alone: Set[int]
) -> None:
    """Places the slaves of a domain in its image, and adds the datagrams that carry it."""
    always = [slave for slave in slaves if not slave.group]
    whole = [slave for slave in always if slave.position not in without_lrw | alone]
    apart = [[slave for slave in always if slave.position in without_lrw - alone]]
    apart += [[slave] for slave in always if slave.position in alone]
    groups = [[slave for slave in slaves if slave.group == group] for group in domain.groups]
    lrw: list[_Part] = []
    offset = 0
    for number, members in [*((-1, members) for members in apart), *enumerate(groups)]:
        parts: list[_Part] = []
        offset = _append(parts, members, offset, output=True)
        _add_datagrams(domain, LWR, parts, number)
    offset = domain.output_bytes = _append(lrw, whole, offset, output=True)
    offset = _append(lrw, whole, offset, output=False)
    _add_datagrams(domain, LRW, lrw)
    for number, members in [*enumerate(groups), *((-1, members) for members in apart)]:
        parts = []
        offset = _append(parts, members, offset, output=False)
        _add_datagrams(domain, LRD, parts, number)
    domain.input_bytes = offset - domain.output_bytes


@dataclass(slots=True)
class _Part:
    """The outputs or the inputs of one slave in the image."""

    output: bool
    offset: int
    length: int
    areas: list[int]
    """Bytes of its sync managers."""


def _append(parts: list[_Part], slaves: Iterable[Slave], offset: int, *, output: bool) -> int:
    """Places the outputs or the inputs of slaves from `offset` on; returns the offset behind."""
    for slave in slaves:
        if output:
            slave.output_offset, pdos = offset, slave.outputs
        else:
            slave.input_offset, pdos = offset, slave.inputs
        areas = [area.size for area in sync_manager_bytes(pdos)]
        if areas:
            parts.append(_Part(output, offset, sum(areas), areas))
        offset += sum(areas)
    return offset


def _add_datagrams(
    domain: DomainImage, command: int, parts: Iterable[_Part], group: int = -1
) -> None:
    """Adds datagrams of `parts`, each as long as possible; one slave's bytes stay together."""
    written, read = COUNTS[command]
    datagram: Datagram | None = None
    for part in parts:
        wkc = written if part.output else read
        if part.length > DOMAIN_DATAGRAM_MAX:
            domain.datagrams += _split(domain, command, part, wkc, group)
            datagram = None
            continue
        if datagram is None or datagram.length + part.length > DOMAIN_DATAGRAM_MAX:
            datagram = Datagram(command, part.offset, 0, 0, group)
            domain.datagrams.append(datagram)
        datagram.length += part.length
        datagram.wkc_expected += wkc


def _split(
    domain: DomainImage, command: int, part: _Part, wkc: int, group: int
) -> Iterator[Datagram]:
    """Makes datagrams of a part that is too long for one.

    Sync managers that fit into one datagram stay whole.
    """
    number = 1 + max((datagram.split for datagram in domain.datagrams), default=0)
    datagram = Datagram(command, part.offset, 0, wkc, group, number)
    for area in part.areas:
        if datagram.length and datagram.length + area > DOMAIN_DATAGRAM_MAX:
            yield datagram
            datagram = replace(datagram, offset=datagram.offset + datagram.length, length=0)
        left = area
        while left > DOMAIN_DATAGRAM_MAX:
            yield replace(datagram, length=DOMAIN_DATAGRAM_MAX)
            datagram = replace(datagram, offset=datagram.offset + DOMAIN_DATAGRAM_MAX)
            left -= DOMAIN_DATAGRAM_MAX
        if left < area:
            yield replace(datagram, length=left, closes=part.output)
            datagram = replace(datagram, offset=datagram.offset + left)
        else:
            datagram = replace(datagram, length=datagram.length + left)
    if datagram.length:
        yield datagram


def pack(lengths: Iterable[int]) -> list[range]:
    """Distributes datagrams over frames: each frame takes as many as fit, in the given order.

    Args:
        lengths: Bytes of data of each datagram.

    Returns:
        For each frame, the numbers of its datagrams, counted from 0.

    Raises:
        ValueError: A datagram has more data than `DATAGRAM_MAX`.
    """
    frames: list[range] = []
    payload = PAYLOAD_MAX
    for number, length in enumerate(lengths):
        if length > DATAGRAM_MAX:
            raise ValueError(f"{length} bytes are more than the {DATAGRAM_MAX} of a datagram")
        payload += DATAGRAM_FRAMING + length
        if payload > PAYLOAD_MAX:
            frames.append(range(number, number))
            payload = DATAGRAM_FRAMING + length
        frames[-1] = range(frames[-1].start, number + 1)
    return frames
