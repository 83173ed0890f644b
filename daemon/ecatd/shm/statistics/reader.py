"""Reads statistics from the shared memory of a bus."""

from __future__ import annotations

import array
import time
from typing import Any

from .. import contract as shm
from ..reader import Reader, opened
from .snapshot import Clock, Domain, Grant, Histogram, Snapshot

_TRIES = 5  # attempts to read while no cycle ends
_NONE = (1 << 64) - 1  # `min_ns` of an empty histogram


def read(bus: str = "ecat0") -> Snapshot:
    """Reads all statistics of a bus on this machine; never waits.

    Counters are read one by one. If a cycle ends during each attempt, some counters are of a later
    cycle than others.

    Raises:
        UsageError: `bus` is no valid name of a bus.
        UnreachableError: No daemon serves the bus, or the daemon is still starting.
        NotPermittedError: This user may not read the shared memory.
        StateError: The shared memory is damaged, or of another version.
    """
    with opened(bus) as shared:
        return snapshot(shared)


def snapshot(shared: Reader) -> Snapshot:
    """Reads all statistics from open shared memory; raises as `read`."""
    for _ in range(_TRIES):
        found = _read(shared)
        if shared.header().cycle == found.cycle_number:
            break
    return found


def _read(shared: Reader) -> Snapshot:
    head = shared.header()
    (health,) = shared.table(head, "health")
    settings = shared.table(head, "settings")
    domains = _domains(shared, head)
    read_ns = time.monotonic_ns()
    if head.cycle_time_ns == 0:
        raise shared.damaged("cycle time")
    return Snapshot(
        bus=shared.bus,
        version=shm.printable(head.version),
        state=shm.BusState(head.state),
        instance=head.instance,
        cycle_time_ns=head.cycle_time_ns,
        cycle_number=head.cycle,
        cycle_end_ns=head.cycle_end_ns,
        start_ns=health.start_ns,
        read_ns=read_ns,
        slaves_expected=head.slave_count,
        slaves_found=health.slaves_found,
        al_status=health.al_status,
        ring=shm.Ring(health.ring),
        ring_break=health.ring_break,
        links=(shm.Link(health.link_first), shm.Link(health.link_second)),
        clock=Clock(
            shm.DcState(health.dc_state),
            health.dc_reference,
            health.dc_time_ns,
            health.dc_offset_ns,
            health.dc_drift_ppb,
        ),
        counters={item.name: getattr(health, item.name) for item in shm.COUNTERS},
        delay_cycles=tuple(health.delay_cycles),
        times={name: _histogram(getattr(health, name)) for name in shm.TIMES},
        domains=domains,
        grants=tuple(
            Grant(kind, bool(row.wanted), bool(row.granted), row.value, row.error)
            for kind, row in zip(shm.Setting, settings, strict=True)
        ),
    )


def _domains(shared: Reader, head: Any) -> tuple[Domain, ...]:
    tables = shared.table(head, "domains")
    statuses = shared.table(head, "domain_status")
    made = []
    for number, (table, status) in enumerate(zip(tables, statuses, strict=True)):
        (page,) = shared.rows("ecat_shm_page", table.page_offset, 1)
        made.append(
            Domain(
                number=number,
                name=shm.printable(table.name),
                divider=table.divider,
                phase=table.phase,
                output_bytes=table.output_bytes,
                input_bytes=max(0, table.image_bytes - table.output_bytes),
                wkc_expected=table.wkc_expected,
                wkc=page.wkc,
                wkc_state=shm.WkcState(page.wkc_state),
                cycle_number=page.cycle,
                counters={item.name: getattr(status, item.name) for item in shm.DOMAIN_COUNTERS},
            )
        )
    return tuple(made)


def _histogram(raw: Any) -> Histogram:
    buckets = tuple(array.array("Q", bytes(raw.buckets)))
    smallest = 0 if raw.min_ns == _NONE else raw.min_ns
    return Histogram(buckets, raw.sum_ns, smallest, raw.max_ns)
