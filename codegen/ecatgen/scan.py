"""The scan that a library is made from, and carries in itself as `Resources/bus.json`."""

from __future__ import annotations

from dataclasses import replace

from ecatd.model.bus import Bus, Slave
from ecatd.model.bus_file import dump

PATH = "Resources/bus.json"
"""Place of the scan in a generated library."""


def essence(bus: Bus) -> Bus:
    """The description without what another bus of the same slaves would have otherwise.

    A library must not change when a slave is replaced by another one of its type, or when the
    clocks are measured again: serial numbers, addresses, delays and places in the process image
    are left out. The generator sees nothing else, so the file in a library says all that the
    library depends on.
    """
    return replace(bus, slaves=[_essence(slave) for slave in bus.slaves])


def _essence(slave: Slave) -> Slave:
    return Slave(
        slave.position,
        slave.name,
        slave.vendor,
        slave.product,
        slave.revision,
        coe=slave.coe,
        outputs=slave.outputs,
        inputs=slave.inputs,
        domain=slave.domain,
    )


def scan_file(bus: Bus) -> bytes:
    """The content of the file."""
    return dump(bus).encode()
