"""The bus description: what the scan found and how it is mapped.

The tables of the shared memory, the output of `ecatctl slaves` and `pdos`, and the generated
Modelica library are all made from it. It is sent as msgpack (`to_dict`; `bus_reader` reads it) and
saved as a file in JSON (`bus_file`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

from ecatd.base.close_names import did_you_mean
from ecatd.base.dataclass_maps import to_maps
from ecatd.base.errors import StateError
from ecatd.base.sanitized_output import printable
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import byte_length, places

from .witnesses import Contradiction

SCHEMA = 1


@dataclass(slots=True)
class Module:
    """A module in a slot of a modular device (ETG.5001).

    Attributes:
        ident: Module ident, which says what kind of module it is; 0 for an empty slot.
        name: Its type, from the configuration; may be empty.
    """

    ident: int
    name: str = ""

    @property
    def label(self) -> str:
        """The module as messages name it: `DI8 (0x00000108)`, `empty`."""
        if not self.ident:
            return "empty"
        return f"{self.name} (0x{self.ident:08X})" if self.name else f"0x{self.ident:08X}"


@dataclass(frozen=True, slots=True)
class ProfileName:
    """A device profile that entries have their meanings from. Its text is for documentation.

    Attributes:
        description: The devices, in words.
        source: The documents with the facts of the profile; may be empty.
    """

    description: str
    source: str = ""

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.description, self.source)))


@dataclass(slots=True)
class Slave:
    """One slave, as ecatd found it at the start. `ecatctl state` has what it is now.

    Attributes:
        position: 0-based position on the wire.
        name: Order code from the SII, or the device name where there is none; may be empty.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number, 0 if the vendor has not written one.
        alias: Configured station alias at the start.
        address: Configured station address that the master assigned.
        coe: Whether the slave answers CoE requests.
        eoe: Whether it takes Ethernet frames (EoE).
        soe: Whether it answers SoE requests; without CoE, indices in its process data are IDNs.
        foe: Whether it has files (FoE), as its EEPROM says.
        problems: The errors in its EEPROM, and how the master handles them.
        profiles: Device profiles that its entries have their meanings from.
        given_name: Its name in this machine, from the configuration; empty for none.
        group: The optional slaves that come and go with it: the name of their group in the
            configuration, or `slave N` for a slave alone. Empty for a slave that must be there.
        identification: Its explicit device identification (ETG.1020), such as that of a rotary
            switch; 0 for none, or if it was not read.
        modules: The modules that it has detected in its slots (object 0xF050), slot 1 first; none
            for a device without slots.
        outputs: RxPDOs; `pdo_layout` computes where they lie.
        inputs: TxPDOs.
        contradictions: The PDOs of which witnesses say different things.
        domain: Number of the domain, 0 first.
        output_offset: First byte of its outputs in the output part of the domain's image.
        input_offset: First byte of its inputs in the domain's image.
        dc_bits: Width of its distributed clock: 64, 32, or 0 for none.
        dc_delay_ns: Measured propagation delay from the reference clock (register 0x0928).
        sync0_ns: Period of SYNC0, 0 without SYNC signals.
        sync1_ns: Time from SYNC0 to SYNC1, 0 without SYNC1.
        sync_shift_ns: Phase of SYNC0 in the cycle of the reference clock.
        watchdog_ms: Time of its process data watchdog in milliseconds, 0 if it is off; None if it
            has no outputs, or is not known.
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
    eoe: bool = False
    soe: bool = False
    foe: bool = False
    problems: list[str] = field(default_factory=list)
    profiles: list[ProfileName] = field(default_factory=list)
    given_name: str = ""
    group: str = ""
    identification: int = 0
    modules: list[Module] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    contradictions: list[Contradiction] = field(default_factory=list)
    domain: int = 0
    output_offset: int = 0
    input_offset: int = 0
    dc_bits: int = 0
    dc_delay_ns: int = 0
    sync0_ns: int = 0
    sync1_ns: int = 0
    sync_shift_ns: int = 0
    watchdog_ms: float | None = None

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
        """The slave as messages name it: `slave 2 (EL1018)`, `slave 2 (infeed, EL1018)`."""
        names = printable(", ".join(dict.fromkeys(filter(None, (self.given_name, self.name)))))
        return f"slave {self.position} ({names})" if names else f"slave {self.position}"

    @property
    def display_name(self) -> str:
        """The slave as tables name it; see `display_name`."""
        return display_name(self.given_name, self.name)

    def entries(self, *, outputs: bool) -> Iterator[tuple[Pdo, Entry, int]]:
        """Yields the entries of one direction without gaps: PDO, entry, and its first bit.

        Bits count from the first byte of the outputs, or the inputs, of the slave.
        """
        for pdo, entry, bit in places(self.outputs if outputs else self.inputs):
            if not entry.is_gap:
                yield pdo, entry, bit


def display_name(given_name: str, name: str) -> str:
    """A slave as tables name it: `EL1018`, `infeed (EL1018)`, `(no name)`."""
    if given_name and name and given_name != name:
        return printable(f"{given_name} ({name})")
    return printable(given_name or name) or "(no name)"


def positions_text(positions: Iterable[int]) -> str:
    """Positions in ascending order, as messages write them: `0, 3-7`."""
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
        divider: The domain is exchanged in every n-th base cycle; this is n.
        phase: Remainder of cycle number / divider in these cycles, 0 to divider - 1.
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
        domains: Domains by number; empty if there is only domain 0.
    """

    name: str
    cycle_time_us: int
    slaves: list[Slave] = field(default_factory=list)
    domains: list[Domain] = field(default_factory=list)

    def find(self, slave: int | str) -> Slave:
        """The slave at a position, or with a name.

        A name is that of the configuration, or an order code that only one slave has.

        Raises:
            StateError: There is no such slave, or several have this order code.
        """
        here = f"bus '{self.name}' has {len(self.slaves)} slaves"
        if isinstance(slave, int):
            if 0 <= slave < len(self.slaves):
                return self.slaves[slave]
            raise StateError(f"there is no slave {slave}: {here}, 0 to {len(self.slaves) - 1}")
        named = [item for item in self.slaves if item.given_name == slave]
        named = named or [item for item in self.slaves if item.name == slave]
        if len(named) == 1:
            return named[0]
        if named:
            positions = positions_text(item.position for item in named)
            raise StateError(
                f"slaves {positions} are all '{slave}': give the position instead, or give them "
                "names in the configuration"
            )
        names = {name for item in self.slaves for name in (item.given_name, item.name) if name}
        hint = did_you_mean(slave, names) or "`ecatctl slaves` lists positions and names"
        raise StateError(f"bus '{self.name}' has no slave '{slave}': {hint}")

    def find_coe(self, slave: int | str) -> Slave:
        """Finds a slave with an object dictionary, as `find` does.

        Raises:
            StateError: As `find`; or the slave has no object dictionary.
        """
        found = self.find(slave)
        if not found.coe:
            raise StateError(f"{found.label} has no object dictionary: it does not support CoE")
        return found

    def domain_name(self, number: int) -> str:
        """Name of a domain, empty if it has none."""
        return self.domains[number].name if number < len(self.domains) else ""

    def domain_label(self, number: int) -> str:
        """A domain as messages name it: `domain 1 (slow)`."""
        name = self.domain_name(number)
        return f"domain {number} ({name})" if name else f"domain {number}"

    @property
    def output_cycles(self) -> int:
        """Number of base cycles within which the outputs of every slave are sent at least once."""
        used = {slave.domain for slave in self.slaves if slave.output_bytes}
        dividers = [domain.divider for n, domain in enumerate(self.domains) if n in used]
        return max(dividers, default=1)

    @property
    def fingerprint(self) -> int:
        """64 bits that change with the identities, the order or the mappings of the slaves.

        They do not change with names, serial numbers, addresses, sync managers, domains or cycle
        time: clients find values by slave and entry, and the meaning of a value does not depend on
        these. The result is the first 64 bits of a SHA-256 hash.
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
        return {"schema": SCHEMA, "fingerprint": f"{self.fingerprint:016x}", **to_maps(self)}
