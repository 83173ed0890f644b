"""State of the distributed clocks of a bus, read from its shared memory."""

from __future__ import annotations

from typing import cast

from ecatd.operations.statistics import Clocks, Distribution, SlaveClock

from .. import contract as shm
from ..reader import Reader, opened
from . import Snapshot
from .maps import histogram_to_map
from .reader import snapshot as take_snapshot


def read_clocks(bus: str) -> Clocks:
    """Reads the state of the distributed clocks of a bus on this machine.

    Returns:
        A map, as it is sent over Zenoh (`ro/dc`) and printed by `ecatctl dc --json`: `bus`,
        `state`, `cycle_time_us`, `reference` (position, -1 for none), `time_ns` (of the reference
        clock), `offset` (phase of the last cycle in µs), `phase` (distribution of the offset
        without its sign, in µs), `drift_ppb`, and `slaves`. If a slave does not answer, its `gone`
        is `absent` if it is optional, else `missing`, and its clock has no delay and no difference.
        `dc_difference_ns` is also None if the clock does not follow the reference clock.

    Raises:
        EcatError: As `stats.read`.
    """
    with opened(bus) as shared:
        snapshot = take_snapshot(shared)
        clock = snapshot.clock
        if clock.state != shm.DcState.OFF and not 0 <= clock.reference < snapshot.slaves_expected:
            raise shared.damaged(f"reference clock {clock.reference}")
        return {
            "bus": bus,
            "state": clock.state.name.lower(),
            "cycle_time_us": snapshot.cycle_time_ns / 1000,
            "reference": clock.reference,
            "time_ns": clock.time_ns,
            "offset": clock.offset_ns / 1000,
            "phase": cast("Distribution", histogram_to_map(snapshot.times["dc_offset"])),
            "drift_ppb": clock.drift_ppb,
            "slaves": _slaves(shared, snapshot),
        }


def _slaves(shared: Reader, snapshot: Snapshot) -> list[SlaveClock]:
    head = shared.header()
    rows, statuses = shared.table(head, "slaves"), shared.table(head, "slave_status")
    clock = snapshot.clock
    slaves: list[SlaveClock] = []
    for row, status in zip(rows, statuses, strict=True):
        gone = "" if status.al_state else "missing" if row.group < 0 else "absent"
        behind = row.dc_bits and row.position > clock.reference
        follows = clock.state != shm.DcState.OFF and behind and not gone
        slaves.append(
            {
                "position": row.position,
                "name": shm.printable(row.name),
                "gone": gone,
                "dc_bits": row.dc_bits,
                "dc_delay_ns": None if gone else row.dc_delay_ns,
                "dc_difference_ns": status.dc_difference_ns if follows else None,
                "sync0_ns": row.sync0_ns,
                "sync1_ns": row.sync1_ns,
                "sync_shift_ns": row.sync_shift_ns,
            }
        )
    return slaves
