"""Reads the error counters of all ports, and which of them have a link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ecatd.base.errors import StateError
from ecatd.description.cables import Reading
from ecatd.etg.port_errors import PortErrors, SlaveErrors

from .frames.topology import Ports, links, way_out
from .master import Master

_DL_STATUS = 0x0110
_COUNTERS, _COUNTERS_SIZE = 0x0300, 0x14
_FORWARDED, _PROCESSING, _PDI, _LOST_LINKS = 0x08, 0x0C, 0x0D, 0x10


def read_port_errors(master: Master, since: Mapping[int, float] | None = None) -> Reading:
    """Reads them, with two datagrams for each slave; on the worker.

    Args:
        master: The master.
        since: Unix time at which ecatd has cleared the counters of a slave, by position.
    """
    registers, stations = master.registers, master.stations
    counters = registers.read_all(stations, _COUNTERS, _COUNTERS_SIZE)
    status = registers.read_all(stations, _DL_STATUS, 2)
    there = [at for at in master.wire if counters[at].wkc and status[at].wkc]
    ports = [Ports.with_status(int.from_bytes(status[at].data, "little")) for at in there]
    leads = _leads(there, ports)
    out = None
    if leads and len(master.interfaces) > 1 and (end := way_out(ports)) is not None:
        out = there[end[0]], end[1]
    cleared = since or {}
    return Reading(
        [_slave_errors(at, counters[at].data, leads, cleared.get(at)) for at in sorted(there)],
        {(at, port) for at, item in zip(there, ports, strict=True) for port in item.open},
        out,
    )


def _slave_errors(
    position: int,
    data: bytes,
    leads: Mapping[tuple[int, int], tuple[int, int]],
    since: float | None,
) -> SlaveErrors:
    ports = [
        PortErrors(
            port,
            data[2 * port],
            data[2 * port + 1],
            data[_FORWARDED + port],
            data[_LOST_LINKS + port],
            leads.get((position, port)),
        )
        for port in range(4)
    ]
    return SlaveErrors(position, ports, data[_PROCESSING], data[_PDI], since)


def _leads(there: Sequence[int], ports: Sequence[Ports]) -> dict[tuple[int, int], tuple[int, int]]:
    """Returns where each port with a link leads: position and port; position -1 is the master.

    Returns nothing if links and slaves contradict each other, as while a slave is being connected.
    """
    found: dict[tuple[int, int], tuple[int, int]] = {}
    try:
        for first, (place, port) in links(ports):
            end = there[place], port
            before = (-1, 0) if first is None else (there[first[0]], first[1])
            found[end] = before
            if first is not None:
                found[before] = end
    except StateError:
        return {}
    return found
