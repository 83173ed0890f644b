"""Reads statistics from the shared memory of a bus."""

from __future__ import annotations

import array
import time
from typing import Any

from .. import contract as shm
from ..reader import Reader, opened
from .snapshot import CanChannel, Clock, Domain, Grant, Histogram, LongCycle, Snapshot

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
        **shm.values(head, "version", "state", "instance", "cycle_time_ns", "cycle_end_ns"),
        cycle_number=head.cycle,
        read_ns=read_ns,
        slaves_expected=head.slave_count,
        **shm.values(health, "start_ns", "slaves_found", "al_status", "ring", "ring_break"),
        links=(shm.Link(health.link_first), shm.Link(health.link_second)),
        clock=Clock(
            shm.DcState(health.dc_state),
            health.dc_reference,
            health.dc_time_ns,
            health.dc_offset_ns,
            health.dc_drift_ppb,
        ),
        counters=shm.values(health, *(item.name for item in shm.COUNTERS)),
        delay_cycles=tuple(health.delay_cycles),
        times={name: _histogram(getattr(health, name)) for name in shm.TIMES},
        worst={name: _worst(health, name) for name in shm.WORST},
        domains=domains,
        channels=tuple(
            CanChannel(
                row.slave,
                row.bit_rate,
                shm.CanState(row.state),
                row.send_errors,
                row.receive_errors,
                shm.values(row, *(item.name for item in shm.CAN_COUNTERS)),
            )
            for row in shared.table(head, "can")
        ),
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
                **shm.values(table, "name", "divider", "phase", "output_bytes", "wkc_expected"),
                input_bytes=max(0, table.image_bytes - table.output_bytes),
                **shm.values(page, "wkc", "wkc_state"),
                cycle_number=page.cycle,
                counters=shm.values(status, *(item.name for item in shm.DOMAIN_COUNTERS)),
            )
        )
    return tuple(made)


def _worst(health: Any, name: str) -> tuple[LongCycle, ...]:
    """The cycles of which each took longer than all behind it, the oldest first."""
    found: list[LongCycle] = []
    whole = (
        row for row in getattr(health, shm.WORST[name]) if row.cycle and row.cycle == row.again
    )
    for row in sorted(whole, key=lambda row: row.end_ns, reverse=True):
        if not found or row.took_ns > found[-1].took_ns(name):
            found.append(
                LongCycle(
                    duration_ns=row.cycle_ns,
                    **shm.values(
                        row, "cycle", "wakeup_ns", "exchange_ns", "end_ns", "lost", "mailbox_frames"
                    ),
                )
            )
    return tuple(reversed(found))


def _histogram(raw: Any) -> Histogram:
    buckets = tuple(array.array("Q", bytes(raw.buckets)))
    smallest = 0 if raw.min_ns == _NONE else raw.min_ns
    return Histogram(buckets, raw.sum_ns, smallest, raw.max_ns)
