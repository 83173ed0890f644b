"""How the PDO assignment of CoE slaves is read. This file is a rig file as well."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from test_simulator_topology import FIRST, run

from ecatd.bus.master import Master
from ecatd.bus.start.mapping import scan_slaves
from ecatd.model.al import AlState
from ecatd.model.bus import Entry, Pdo
from ecatsim import Rig
from ecatsim.slave import sii
from ecatsim.slave.device import Device

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

HERE = Path(__file__)


class Single(Device):
    """Eight entries in each of two PDOs a direction, to be read one by one."""

    vendor, product, revision, order = 0x0000FFFF, 0x1, 1, "Single"
    mailbox = sii.Mailbox(coe_details=0x0F)
    rx_pdos = tuple(
        Pdo(0x1600 + i, f"Out {i}", 2, [Entry(0x7000 + i, n, "", 6, 16) for n in range(1, 9)])
        for i in range(2)
    )
    tx_pdos = tuple(
        Pdo(0x1A00 + i, f"In {i}", 3, [Entry(0x6000 + i, n, "", 7, 32) for n in range(1, 9)])
        for i in range(2)
    )


class Whole(Single):
    """The same with complete access."""

    order = "Whole"
    mailbox = sii.Mailbox(coe_details=0x2F)


class Boaster(Single):
    """One that promises complete access, and refuses it."""

    order = "Boaster"

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = 0x80
        while int.from_bytes(image[at : at + 2], "little") != sii.Category.GENERAL:
            at += 4 + 2 * int.from_bytes(image[at + 2 : at + 4], "little")
        image[at + 4 + 5] |= 0x20
        return bytes(image)


def rig() -> Rig:
    return Rig("lists", [Single(), Whole(), Boaster()])


class Counting(Master):
    """Counts uploads by slave."""

    uploads = (0, 0, 0)

    def sdo_read(
        self, position: int, index: int, subindex: int, *, complete: bool = False
    ) -> bytes:
        self.uploads = tuple(n + (i == position) for i, n in enumerate(self.uploads))
        return super().sdo_read(position, index, subindex, complete=complete)


def master_that_scans() -> Any:
    master = Counting([FIRST])
    try:
        count = master.scan()
        master.reach(AlState.PREOP, 5)
        slaves = [item.slave for item in scan_slaves(master, count)]
        found = [
            [
                [pdo.index, [[e.index, e.subindex, e.bit_length] for e in pdo.entries]]
                for pdo in pdos
            ]
            for slave in slaves
            for pdos in (slave.outputs, slave.inputs)
        ]
        return [found, master.uploads]
    finally:
        master.close()


def test_lists_are_read_at_once_where_the_slave_can() -> None:
    found, (single, whole, boaster) = run(HERE, master_that_scans)
    wanted = [
        [[pdo.index, [[e.index, e.subindex, e.bit_length] for e in pdo.entries]] for pdo in pdos]
        for pdos in (Single.rx_pdos, Single.tx_pdos)
    ]
    assert found == wanted * 3
    lists, values = 2 + 4, 2 * 2 + 4 * 8
    assert single == lists + values
    assert whole == lists
    assert boaster == 2 * lists + values
