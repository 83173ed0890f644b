"""The bus description: what the scan found and how it is mapped.

It is the one document from which the shared-memory directory, `ecatctl slaves` and `pdos` and the
generated Modelica library are made. It travels as msgpack (`to_dict`; `bus_reader` reads it) and as
a file in JSON (`bus_file`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from itertools import groupby
from typing import Any

from .pdo import Entry, Pdo
from .pdo_layout import byte_length, places

SCHEMA = 1


@dataclass(slots=True)
class Slave:
    """One slave.

    Attributes:
        position: 0-based position on the wire.
        name: Name from SII, as the vendor wrote it.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number (0 where the vendor writes none).
        alias: Configured station alias.
        address: Configured station address that the master assigned.
        coe: Whether the slave answers CoE requests.
        problems: What is wrong with its EEPROM, and what is done about it.
        profiles: Device profiles that meanings of its entries are from, each with its source.
        outputs: RxPDOs; `pdo_layout` says where they lie.
        inputs: TxPDOs.
        domain: Number of the domain, 0 first.
        output_offset: First byte of its outputs in the output part of the domain's image.
        input_offset: First byte of its inputs in the domain's image.
        dc_bits: Width of its distributed clock: 64, 32, or 0 for none.
        dc_delay_ns: Propagation delay from the reference clock, as it was measured.
        sync0_ns: Period of SYNC0, 0 without SYNC signals.
        sync1_ns: SYNC1 after SYNC0, 0 without SYNC1.
        sync_shift_ns: Phase of SYNC0 in the cycle of the reference clock.
    """

    position: int
    name: str
    vendor: int
    product: int
    revision: int
    serial: int = 0
    alias: int = 0
    address: int = 0
    coe: bool = False
    problems: list[str] = field(default_factory=list)
    profiles: list[str] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    domain: int = 0
    output_offset: int = 0
    input_offset: int = 0
    dc_bits: int = 0
    dc_delay_ns: int = 0
    sync0_ns: int = 0
    sync1_ns: int = 0
    sync_shift_ns: int = 0

    @property
    def output_bytes(self) -> int:
        """Bytes of the outputs in the process image, see `pdo_layout`."""
        return byte_length(self.outputs)

    @property
    def input_bytes(self) -> int:
        """Bytes of the inputs in the process image, see `pdo_layout`."""
        return byte_length(self.inputs)

    @property
    def label(self) -> str:
        """How messages name the slave: `slave 2 (EL1018)`."""
        return f"slave {self.position} ({self.name})" if self.name else f"slave {self.position}"

    def entries(self, *, outputs: bool) -> Iterator[tuple[Pdo, Entry, int]]:
        """Entries of one direction without gaps, with the bit offset within the slave's bytes."""
        for pdo, entry, bit in places(self.outputs if outputs else self.inputs):
            if not entry.is_gap:
                yield pdo, entry, bit


def positions_text(positions: Iterable[int]) -> str:
    """Positions as messages write them: `0, 3-7`."""
    ranges = []
    for _, run in groupby(enumerate(sorted(positions)), lambda pair: pair[1] - pair[0]):
        numbers = [position for _, position in run]
        ranges.append(f"{numbers[0]}-{numbers[-1]}" if len(numbers) > 1 else f"{numbers[0]}")
    return ", ".join(ranges)


@dataclass(slots=True)
class Domain:
    """Slaves that are exchanged together.

    Attributes:
        name: Name from the configuration; may be empty.
        divider: Exchanged every so many base cycles.
        phase: In those whose number leaves this remainder, 0 to divider - 1.
    """

    name: str = ""
    divider: int = 1
    phase: int = 0


@dataclass(slots=True)
class Bus:
    """A scanned bus.

    Attributes:
        name: Name of the bus.
        cycle_time_us: Base cycle in microseconds.
        slaves: Slaves by position.
        domains: Domains by number; empty in descriptions that know of one only.
    """

    name: str
    cycle_time_us: int
    slaves: list[Slave] = field(default_factory=list)
    domains: list[Domain] = field(default_factory=list)

    def domain_name(self, number: int) -> str:
        """Name of a domain, empty if it has none."""
        return self.domains[number].name if number < len(self.domains) else ""

    def domain_label(self, number: int) -> str:
        """How messages name a domain: `domain 1 (slow)`."""
        name = self.domain_name(number)
        return f"domain {number} ({name})" if name else f"domain {number}"

    @property
    def output_cycles(self) -> int:
        """Base cycles in which the outputs of every slave are sent at least once."""
        used = {slave.domain for slave in self.slaves if slave.output_bytes}
        dividers = [domain.divider for n, domain in enumerate(self.domains) if n in used]
        return max(dividers, default=1)

    @property
    def fingerprint(self) -> int:
        """64 bits that differ when identities, order or mappings of the slaves differ.

        Names, serial numbers, addresses, sync managers, domains and the cycle time do not count:
        clients find values by slave and entry, and these do not change what a value means.
        """
        facts = [
            [
                [slave.vendor, slave.product, slave.revision],
                *(
                    [
                        [pdo.index, [[e.index, e.subindex, e.bit_length] for e in pdo.entries]]
                        for pdo in pdos
                    ]
                    for pdos in (slave.outputs, slave.inputs)
                ),
            ]
            for slave in self.slaves
        ]
        digest = hashlib.sha256(json.dumps(facts, separators=(",", ":")).encode()).digest()
        return int.from_bytes(digest[:8], "big")

    def to_dict(self) -> dict[str, Any]:
        """The description as maps and lists, with `schema` and `fingerprint` (16 hex digits)."""
        return {"schema": SCHEMA, "fingerprint": f"{self.fingerprint:016x}", **asdict(self)}
