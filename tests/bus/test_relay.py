"""The relay: mailbox and register frames beside the cycle, lost ones, and rings."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from test_simulator_topology import FIRST, SECOND, run

from conftest import SHM
from ecatd.base.errors import NoAnswerError, StateError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.config import read_config
from ecatd.description.cables import Cables
from ecatd.etg.al import AlState
from ecatd.master import master as master_module
from ecatd.master.frames.datagrams import brd, fprd
from ecatd.master.mailbox.conversation import converse
from ecatd.master.master import Master
from ecatd.master.worker import Worker
from ecatd.operations.registers import ReadRegister
from ecatd.server.requests.changes import Changes
from ecatd.server.requests.registers import Registers
from ecatd.server.start.bring_up import BringUp
from ecatd.server.start.running_bus import RunningBus
from ecatd.shm import statistics as stats
from ecatsim.control import Simulator

if TYPE_CHECKING:
    from conftest import Daemon

pytestmark = [pytest.mark.bus, pytest.mark.long]

IDENTITY = 0x1018
VENDORS = {0: 0x9A, 4: 2, 5: 2, 6: 2, 7: 2}  # slaves of `troll` with CoE
GONE = 5
COUNT = 100
MAILBOX = ("mailbox_frames", "mailbox_lost", "mailbox_wire_ns")


def test_r24_requests_of_many_clients_cost_no_cyclic_frame(
    start_daemon: Callable[..., Daemon],
) -> None:
    # A cycle so long that a frame is lost only if the simulator does not run for 18 milliseconds.
    daemon = start_daemon("troll", "--cycle-time-us", "20000")
    answers: list[tuple[int, bytes]] = []

    def ask(slave: int) -> None:
        with daemon.client() as client:
            for _ in range(COUNT // 4):
                requests = [client.sdo_upload(slave, IDENTITY, 1) for _ in range(4)]
                for request in requests:
                    while (data := request.poll()) is None:
                        client.wait()
                    answers.append((slave, data))

    before = stats.read(daemon.bus).counters
    threads = [threading.Thread(target=ask, args=(slave,)) for slave in VENDORS]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    after = stats.read(daemon.bus).counters
    wanted = [(slave, vendor.to_bytes(4, "little")) for slave, vendor in VENDORS.items()]
    assert sorted(answers) == sorted(wanted * COUNT)
    # On a busy machine answers come too late; those that came at all were not lost.
    assert after["lost"] - before["lost"] <= after["late"] - before["late"]
    sent = after["mailbox_frames"] - before["mailbox_frames"]
    assert sent > len(answers), "two frames or more each"


@contextlib.contextmanager
def bus(**settings: Any) -> Iterator[RunningBus]:
    """A bus in OP, in this process."""
    config = read_config(
        {
            "bus": f"r{os.getpid()}",
            "interface": FIRST,
            "realtime": {"lock_memory": False},
            **settings,
        }
    )
    running = BringUp(config, FIRST, Log("test")).run(SHM)
    try:
        yield running
    finally:
        running.close()


def read_vendor(master: Master, slave: int) -> int:
    coe = master.coe(slave)

    conversation = coe.converse(lambda: coe.upload(IDENTITY, 1))
    return int.from_bytes(converse(master.registers, [conversation])[0], "little")


def counters(up: RunningBus) -> dict[str, int]:
    return {name: int(getattr(up.shared.health, name)) for name in MAILBOX}


def master_with_losses() -> Any:
    with Simulator() as simulator, bus() as up:
        master = up.master
        for way_back in (False, True):
            simulator.faults.drop(
                every=1, count=0, probability=0.05, all_frames=True, way_back=way_back, seed=7
            )
        found, silent = [], 0
        for _ in range(60):
            for slave in VENDORS:
                try:
                    found.append([slave, read_vendor(master, slave)])
                except (NoAnswerError, StateError):
                    silent += 1
        registers = [
            [data.hex() for data in master.read_registers([(i, 0x0130, 1) for i in range(8)])]
            for _ in range(20)
        ]
        during = counters(up)
        simulator.faults.clear()
        return {
            "found": found,
            "silent": silent,
            "registers": registers,
            "lost": during["mailbox_lost"],
            "after": [[slave, read_vendor(master, slave)] for slave in VENDORS],
        }


def test_lost_frames_are_answered_later_or_reported() -> None:
    found = run("troll", master_with_losses)
    right = [[slave, vendor] for slave, vendor in VENDORS.items()]
    assert found["lost"] > 10
    assert all(item in right for item in found["found"])
    assert len(found["found"]) + found["silent"] == 60 * len(VENDORS)
    assert len(found["found"]) > 30 * len(VENDORS), "most are answered"
    assert found["registers"] == [["08"] * 8] * 20
    assert found["after"] == right


def master_with_share(share: float) -> Any:
    with bus(mailbox={"share": share}) as up:
        before, begin = counters(up), time.monotonic()
        for _ in range(150):
            read_vendor(up.master, 0)
        elapsed = time.monotonic() - begin
        after = counters(up)
        return (after["mailbox_wire_ns"] - before["mailbox_wire_ns"]) * 1e-9 / elapsed


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_r24_the_share_is_respected(share: float) -> None:
    part = run("troll", master_with_share, share)
    assert 0 < part < 1.1 * share  # what the last frames owe has not been paid yet


def master_beside_long_exchanges(share: float) -> Any:
    with Simulator() as simulator, bus(mailbox={"share": share}, cycle_time_us=10_000) as up:
        simulator.faults.delay(6000, every=1, count=0)
        cycle = up.shared.health.cycle
        before, busy_ns, begin = counters(up), cycle.sum_ns, time.monotonic()
        for _ in range(150):
            read_vendor(up.master, 0)
        elapsed = time.monotonic() - begin
        free = 1 - (cycle.sum_ns - busy_ns) * 1e-9 / elapsed
        on_wire_ns = counters(up)["mailbox_wire_ns"] - before["mailbox_wire_ns"]
        return [free, on_wire_ns * 1e-9 / elapsed]


def test_the_share_is_one_of_the_free_time() -> None:
    free, part = run("troll", master_beside_long_exchanges, 0.05)
    assert 0 < part < 1.1 * 0.05 * free


def master_with_a_slave_that_is_gone() -> Any:
    master_module._REPEAT_S = 3600  # the slave is asked without end

    async def ask(up: RunningBus) -> Any:
        worker = Worker()
        try:
            changes, cables = Changes(Log("test")), Cables(up.bus)
            registers = Registers(up.bus, up.master, worker, changes, cables)
            waiting = asyncio.create_task(registers.read(ReadRegister(GONE, 0x0130, 2)))
            await asyncio.sleep(0)
            found = await registers.read(ReadRegister(0, 0x0130, 2))
            done = waiting.done()
            waiting.cancel()
            return [found["data"].hex(), done]
        finally:
            worker.close()

    with Simulator() as simulator, bus() as up:
        simulator.faults.power_off(GONE)
        return asyncio.run(ask(up))


def test_a_slave_that_is_gone_holds_up_no_other() -> None:
    assert run("troll", master_with_a_slave_that_is_gone) == ["0800", False]


def left_over() -> list[Any]:
    """Threads and files of this process, without numbers: sockets and shared memory have others."""
    tasks = Path("/proc/self/task").iterdir()
    threads = sorted((task / "comm").read_text() for task in tasks)
    files = []
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            files.append(re.split(r":|#\d+", str(link.readlink()))[0])
    return [threads, sorted(files)]


def master_again_and_again() -> Any:
    found = []
    for _ in range(3):
        with bus() as up:
            found.append(read_vendor(up.master, 0))
            during = left_over()
        found.append(left_over())
    return [found, during]


def test_nothing_is_left_of_a_relay() -> None:
    (*found,), during = run("troll", master_again_and_again)
    assert found[::2] == [0x9A] * 3
    assert found[1] == found[3] == found[5]
    assert "ecat-relay\n" in during[0]
    assert "ecat-relay\n" not in found[1][0]


def master_on_a_ring() -> Any:
    with Simulator() as simulator:
        master = Master([FIRST, SECOND])
        try:
            master.scan(Timeout(60))
            count = len(master.stations)
            master.al_states.wait_for(AlState.PREOP, Timeout(60))
            found = [count, looks(master)]
            for broken in (1, 4, 7):
                simulator.faults.break_link(broken)
                wait_for_link(simulator, broken, 0, False)
                found.append(looks(master))
                simulator.faults.heal_link(broken)
                wait_for_link(simulator, broken, 0, True)
            found.append(looks(master))
        finally:
            master.close()
    return found


def wait_for_link(simulator: Simulator, slave: int, port: int, there: bool) -> None:
    """Until a slave sees a link at one of its ports, or none (0x0110, from bit 4 on)."""
    while bool(simulator.registers(slave, 0x0110, 1)[0] & 0x10 << port) != there:
        time.sleep(0.001)


def looks(master: Master) -> Any:
    """What a master sees: by broadcast, by station address, and through mailboxes."""
    registers = master.registers
    everybody = registers.exchange([brd(0x0130, 2), brd(0x0010, 2), brd(0x0130, 2)])
    stations = registers.exchange([fprd(station, 0x0010, 2) for station in master.stations])
    for position in range(len(master.stations)):
        master.register_write(position, 0x0F80, bytes([position + 1]))
    return [
        [answer.wkc for answer in everybody],
        everybody[1].data.hex(),
        [answer.data.hex() + f"/{answer.wkc}" for answer in stations],
        [data[0] for data in master.read_registers([(i, 0x0F80, 1) for i in range(8)])],
        [item.al_state for item in master.al_states.read()],
        [read_vendor(master, slave) for slave in VENDORS],
    ]


def test_a_broken_ring_is_none_of_the_masters_business() -> None:
    count, *found = run("troll", master_on_a_ring, options=["--ring"])
    assert count == 8
    stations = [0x1001 + i for i in range(8)]
    ored = 0
    for station in stations:
        ored |= station
    assert found[0] == [
        [8, 8, 8],
        ored.to_bytes(2, "little").hex(),
        [station.to_bytes(2, "little").hex() + "/1" for station in stations],
        [1, 2, 3, 4, 5, 6, 7, 8],
        [AlState.PREOP] * 8,
        list(VENDORS.values()),
    ]
    assert found[1:] == [found[0]] * 4
