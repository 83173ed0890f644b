"""Reads `at` and `ring` of a rig file, which say where slaves are plugged in."""

from __future__ import annotations

from functools import partial

from ecatd.base.toml_file import Table

from ..rig import Rig


def connect(table: Table, rows: list[Table], rig: Rig) -> None:
    """Plugs in the slaves with `at`, and closes the ring.

    Args:
        table: The outermost table.
        rows: Tables of the slaves.
        rig: The rig, which has its devices already.

    Raises:
        ConfigError: There is no such port, it is taken, or the slaves are not in wire order.
    """
    slaves = list(rig.devices)
    for number, row in enumerate(rows):
        if "at" not in row:
            continue
        place = row.table("at")
        place.only(("slave", "port"))
        if number == 0:
            row.fail("at", "does not belong to slave 0, which is at the interface")
        parent = slaves[place.integer("slave", 0, number - 1)]
        port = place.integer("port", 1, 3)
        row.explain("at", partial(rig.connect, slaves[number], parent, port))
    for number, (row, device) in enumerate(zip(rows, slaves, strict=True)):
        if rig.devices[number] is not device:
            row.fail(
                "at",
                "is not in the order of the frames: behind a slave come those at its port 3, then "
                f"at port 1, then at port 2; this one must be slave {rig.devices.index(device)}",
            )
    _close_ring(table, rig)
    table.explain("ring" if rig.ring else "slave", rig.wiring)


def _close_ring(table: Table, rig: Rig) -> None:
    """Reads `ring`: true or false, or the slave and the port at the second interface."""
    if isinstance(table.data.get("ring"), dict):
        place = table.table("ring")
        place.only(("slave", "port"))
        slave = place.integer("slave", 0, max(0, len(rig.devices) - 1))
        port = place.integer("port", 0, 3)
        if rig.devices:
            table.explain("ring", partial(rig.close_ring, rig.devices[slave], port))
    else:
        rig.ring = table.boolean("ring", False)
