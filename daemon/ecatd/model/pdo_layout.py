"""Where PDOs lie in the bytes of a slave.

Every sync manager has whole bytes of its own, one after the other by number, and in them its PDOs
bit after bit. So the FMMUs of a slave map whole bytes only: those of real slave controllers must be
three logical bytes apart if one of them maps bits (Beckhoff, ESC data sheet, section I,
"Restrictions on FMMU settings"), and some controllers map nothing but bytes.
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
        bits: Bits of its PDOs.
    """

    number: int
    offset: int
    bits: int

    @property
    def size(self) -> int:
        """Whole bytes."""
        return (self.bits + 7) // 8

    @property
    def end(self) -> int:
        """First byte behind them."""
        return self.offset + self.size


def sync_manager_bytes(pdos: Iterable[Pdo]) -> list[SyncManagerBytes]:
    """The bytes of each sync manager that carries any of these PDOs, which have one direction."""
    found: list[SyncManagerBytes] = []
    for number, group in _by_sync_manager(pdos):
        bits = sum(pdo.bit_length for pdo in group)
        if bits:
            found.append(SyncManagerBytes(number, found[-1].end if found else 0, bits))
    return found


def byte_length(pdos: Iterable[Pdo]) -> int:
    """Bytes of all PDOs of one direction."""
    areas = sync_manager_bytes(pdos)
    return areas[-1].end if areas else 0


def places(pdos: Iterable[Pdo]) -> Iterator[tuple[Pdo, Entry, int]]:
    """The entries of PDOs of one direction, gaps included, with their first bit.

    It counts from the first byte of the outputs, or the inputs, of the slave.
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
