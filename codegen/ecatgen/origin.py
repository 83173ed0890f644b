"""The bus that a library or an FMU is made from, and contains as a file."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from ecatd.base.errors import UsageError
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Slave


def essence(bus: Bus) -> Bus:
    """Returns the bus without all facts that may differ on another bus of the same slaves.

    A library must not change when a slave is replaced by one of the same type, or when the clocks
    are measured again. Serial numbers, addresses, delays and places in the process image are
    therefore left out.
    """
    return replace(bus, slaves=[_essence(slave) for slave in bus.slaves])


def dump_origin(bus: Bus) -> bytes:
    """Returns the content of the file in a library or an FMU that describes its bus."""
    return bus_file.dump(bus).encode()


def read_origin(data: bytes | None) -> Bus | None:
    """Returns the bus in such a file; None if `data` is None or not a bus description."""
    if data is None:
        return None
    with suppress(UsageError, UnicodeDecodeError):
        return essence(bus_file.parse(data.decode(), "bus.json"))
    return None


def _essence(slave: Slave) -> Slave:
    return Slave(
        slave.position,
        slave.name,
        slave.vendor,
        slave.product,
        slave.revision,
        coe=slave.coe,
        profiles=slave.profiles,
        given_name=slave.given_name,
        outputs=slave.outputs,
        inputs=slave.inputs,
        domain=slave.domain,
    )
