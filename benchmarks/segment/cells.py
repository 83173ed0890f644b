"""The slaves that the engine is measured with: "cells", whose outputs come back as inputs.

The number of cells and their number of bytes can be chosen. Each has enough FMMUs for three masters
that take turns on one segment.
"""

from __future__ import annotations

from pathlib import Path

from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import Rig
from ecatsim.devices.generic import Loopback
from ecatsim.esc import Chip

from ..machine import ROOT

FMMUS = 6
_VENDOR, _PRODUCT = 0x0000FFFF, 0x000CE110


def _pdo(index: int, manager: int, object_index: int, size: int) -> Pdo:
    step, kind = (4, DataType.UNSIGNED32) if size % 4 == 0 else (1, DataType.UNSIGNED8)
    entries = [Entry(object_index, i + 1, f"{i + 1}", kind, 8 * step) for i in range(size // step)]
    return Pdo(index, "Data", manager, entries)


def _pdos(size: int) -> tuple[Pdo, Pdo]:
    return _pdo(0x1600, 0, 0x7000, size), _pdo(0x1A00, 1, 0x6000, size)


class Cell(Loopback):
    """A slave with `size` bytes of outputs, which come back as inputs."""

    vendor = _VENDOR
    product = _PRODUCT
    order = "Cell"
    name = "Cell"
    chip = Chip(fmmus=FMMUS, sync_managers=4)

    def __init__(self, size: int) -> None:
        outputs, inputs = _pdos(size)
        self.rx_pdos, self.tx_pdos = (outputs,), (inputs,)
        self._data = bytes(size)
        super().__init__()


def line(count: int, size: int) -> Rig:
    """Returns a rig of `count` cells with `size` bytes of outputs, and of inputs, each."""
    return Rig(f"cells {count}x{size}", [Cell(size) for _ in range(count)])


def write_rig(folder: Path, count: int, size: int) -> Path:
    """Writes a rig file for `ecatsim run`, and returns its path."""
    file = folder / f"cells_{count}x{size}.py"
    file.write_text(
        f"import sys\nsys.path.append({str(ROOT)!r})\n"
        f"from benchmarks.segment.cells import line\n\n"
        f"def rig():\n    return line({count}, {size})\n"
    )
    return file


def bus(name: str, count: int, size: int, cycle_time_us: int) -> Bus:
    """Returns the bus as the daemon would describe it after a scan of these slaves."""
    result = Bus(name, cycle_time_us)
    for position in range(count):
        outputs, inputs = _pdos(size)
        result.slaves.append(
            Slave(position, Cell.name, _VENDOR, _PRODUCT, 1, outputs=[outputs], inputs=[inputs])
        )
    return result
