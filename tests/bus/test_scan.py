"""The scan: SOEM first, and where it cannot, or sees another bus than there is, ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from test_relay import IDENTITY, VENDORS, looks, read_vendor, wait_for_link
from test_simulator_topology import FIRST, SECOND, run

from ecatd.base.timeouts import Timeout
from ecatd.etg.al import AlState
from ecatd.master.frames import soem
from ecatd.master.master import Master
from ecatsim.control import Simulator

if TYPE_CHECKING:
    from conftest import Daemon

pytestmark = pytest.mark.bus

MAILBOXES = Path(__file__).parents[1] / "rigs" / "mailboxes.py"
_TRIES = 5
LAST = 7
"""The last slave of `troll`; from its port 1 a cable leads to the second interface of a ring."""


def scan_by_soem(simulator: Simulator, *interfaces: str) -> list[Any]:
    """As `scan`; again where SOEM has lost frames, which happens on a busy machine."""
    found = scan(simulator, *interfaces)
    for _ in range(_TRIES):
        if not found[0]:
            break
        found = scan(simulator, *interfaces)
    return found


def scan(simulator: Simulator, *interfaces: str) -> list[Any]:
    """Why SOEM's numbers were not taken, station addresses by slave, and what slaves answer."""
    master = Master(interfaces)
    try:
        why = master.scan(Timeout(60))
        master.al_states.wait_for(AlState.PREOP, Timeout(60))
        registers = [simulator.registers(place, 0x0010, 2) for place in range(LAST + 1)]
        return [
            why,
            [int.from_bytes(data, "little") for data in registers],
            [master.name(place) for place in range(LAST + 1)],
            [read_vendor(master, slave) for slave in VENDORS],
            looks(master)[3:5],
        ]
    finally:
        master.close()


def master_on_rings() -> Any:
    with Simulator() as simulator:
        found = [scan_by_soem(simulator, FIRST, SECOND)]
        for place in range(LAST + 2):
            cable = (place, 0) if place <= LAST else (LAST, 1)
            simulator.faults.break_link(*cable)
            wait_for_link(simulator, *cable, False)
            found.append(scan_by_soem(simulator, FIRST, SECOND))
            simulator.faults.heal_link(*cable)
            wait_for_link(simulator, *cable, True)
    return found


def test_soem_numbers_a_ring_wherever_it_is_broken() -> None:
    whole, *broken = run("troll", master_on_rings, options=["--ring"])
    names = ["Gold EtherCAT GCON Drive", "EK1100", "EL1018", "EL2008", *["EL3008", "EL6751"] * 2]
    assert whole == [
        "",
        [*range(0x1001, 0x1009)],
        [*names[:4], "EL3008", "EL3008", "EL6751", "EL6751"],
        list(VENDORS.values()),
        [[1, 2, 3, 4, 5, 6, 7, 8], [AlState.PREOP] * 8],
    ]
    assert broken == [whole] * (LAST + 2)


def master_that_sees_slaves_come() -> Any:
    with Simulator() as simulator:
        simulator.faults.break_link(4)
        wait_for_link(simulator, 4, 0, False)
        found = []
        first_scan = soem.scan

        def scan_too_early(interfaces: list[str]) -> list[str]:
            names = first_scan(interfaces)
            found.append(names)
            simulator.faults.heal_link(4)
            wait_for_link(simulator, 4, 0, True)
            return names

        soem.scan = scan_too_early  # type: ignore[assignment]
        return [*scan(simulator, FIRST), found]


def test_slaves_that_soem_has_not_seen_are_numbered() -> None:
    why, stations, names, vendors, answers, (seen,) = run("troll", master_that_sees_slaves_come)
    assert len(seen) == 4
    assert why == "SOEM's scan found 4"
    assert stations == [*range(0x1001, 0x1009)]
    assert names == [""] * 8, "names of another scan might be wrong"
    assert vendors == list(VENDORS.values())
    assert answers == [[1, 2, 3, 4, 5, 6, 7, 8], [AlState.PREOP] * 8]


@pytest.mark.long
def test_r12_more_slaves_than_soem_has_room_for(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("terminals:260")
    assert (
        "260 slaves found on ecat-master (numbered by ecatd: SOEM has room for 199)" in daemon.log
    )
    states = daemon.slave_rows("state")
    assert [row["text"] for row in states] == ["OP"] * 260
    with daemon.client() as client:
        pairs = [(place, place + 1) for place in range(1, 259, 2) if (place + 1) % 32]
        for output, _ in pairs:
            client.claim(output, lease=30)
        outputs = [client.signal(slave, 0x7000, 1) for slave, _ in pairs]
        inputs = [client.signal(slave, 0x6000, 1) for _, slave in pairs]
        wanted = [number % 3 == 0 for number in range(len(pairs))]
        while [item.raw for item in inputs] != wanted:
            for item, value in zip(outputs, wanted, strict=True):
                item.raw = value
            client.commit()
            client.wait()
            client.sample()


def master_with_mailboxes() -> Any:
    master = Master([FIRST])
    try:
        why = master.scan(Timeout(60))
        master.al_states.wait_for(AlState.PREOP, Timeout(60))
        return [why, [read_vendor(master, place) for place in range(0, 240, 8)]]
    finally:
        master.close()


def test_mailboxes_of_slaves_that_soem_has_no_room_for() -> None:
    assert IDENTITY == 0x1018
    why, vendors = run(MAILBOXES, master_with_mailboxes)
    assert why == "SOEM has room for 199"
    assert vendors == [0xFFFF] * 30
