"""Computes where PDOs lie in the process data of a slave.

Each sync manager has its own whole bytes; the sync managers follow each other by number. Within a
sync manager the PDOs follow each other without padding. So the FMMUs of a slave map whole bytes
only. FMMUs that map bits must be three logical bytes apart in real ESCs (Beckhoff, ESC data sheet,
section I, "Restrictions on FMMU settings"), and some ESCs cannot map bits at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

from .pdo import Entry, Pdo


@dataclass(frozen=True, slots=True)
class SyncManagerBytes:
    """The bytes of one sync manager.

    Attributes:
        number: Number of the sync manager.
        offset: First byte among the outputs, or the inputs, of the slave.
        bits: Number of bits of its PDOs.
    """

    number: int
    offset: int
    bits: int

    @property
    def size(self) -> int:
        """Number of whole bytes."""
        return (self.bits + 7) // 8

    @property
    def end(self) -> int:
        """Offset of the first byte after them."""
        return self.offset + self.size


def sync_manager_bytes(pdos: Iterable[Pdo]) -> list[SyncManagerBytes]:
    """The bytes of each sync manager that carries some of these PDOs, all of one direction."""
    found: list[SyncManagerBytes] = []
    for number, group in _by_sync_manager(pdos):
        bits = sum(pdo.bit_length for pdo in group)
        if bits:
            found.append(SyncManagerBytes(number, found[-1].end if found else 0, bits))
    return found


def byte_length(pdos: Iterable[Pdo]) -> int:
    """Number of bytes of all PDOs of one direction."""
    areas = sync_manager_bytes(pdos)
    return areas[-1].end if areas else 0


def places(pdos: Iterable[Pdo]) -> Iterator[tuple[Pdo, Entry, int]]:
    """Yields PDO, entry and first bit of all entries of one direction, gaps included.

    Bits count from the first byte of the outputs, or the inputs, of the slave.
    """
    bit = 0
    for _, group in _by_sync_manager(pdos):
        bit = (bit + 7) // 8 * 8
        for pdo in group:
            for entry in pdo.entries:
                yield pdo, entry, bit
                bit += entry.bit_length


def _by_sync_manager(pdos: Iterable[Pdo]) -> Iterator[tuple[int, list[Pdo]]]:
    in_order = sorted(pdos, key=lambda pdo: pdo.sync_manager)
    for number, group in groupby(in_order, lambda pdo: pdo.sync_manager):
        yield number, list(group)
