"""The Python client in asyncio: cycles, leases, ends of all kinds."""

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from conftest import PATIENCE, Daemon
from ecatd import LeaseError, SdoAbortError, UnreachableError
from ecatd.base.errors import NoAnswerError, StateError
from ecatd.client import Client, Outputs

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
"""These tests wait for many cycles."""

DRIVE, EL2008 = 0, 3
FOREVER = 1 << 40


def run(program: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(program, PATIENCE))


def threads_of(bus: Client) -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == f"ecatd-{bus.name}"]


async def no_threads(bus: Client) -> None:
    while threads_of(bus):
        await asyncio.sleep(0.01)


def test_cycles_come_with_fresh_samples(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus:
            seen: list[int] = []
            fresh = 0
            async for cycle in bus.cycles():
                seen.append(cycle)
                fresh += bus.domain().cycle >= cycle
                if len(seen) == 200:
                    break
            assert seen == sorted(set(seen))
            assert fresh > 100  # frames may be late on a busy machine, not most of them
            assert await bus.next_cycle(50) >= cycle + 50
            assert len(threads_of(bus)) == 1
        await no_threads(bus)

    run(program())


def test_the_event_loop_goes_on(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus:
            turns = 0

            async def turn() -> None:
                nonlocal turns
                while True:
                    await asyncio.sleep(0)
                    turns += 1

            other = asyncio.create_task(turn())
            await bus.next_cycle(500)
            assert turns > 20
            turns = 0
            async for cycle in bus.cycles():
                time.sleep(0.003)  # a body that takes longer than a cycle
                if cycle % 5 == 0:
                    break
            assert turns > 0
            other.cancel()

    run(program())


def test_tasks_share_a_client(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus:

            async def follow(count: int) -> list[int]:
                return [await bus.next_cycle() for _ in range(count)]

            for seen in await asyncio.gather(*(follow(30) for _ in range(8))):
                assert seen == sorted(seen)
                assert len(threads_of(bus)) == 1

    run(program())


@pytest.mark.long
def test_who_waits_keeps_the_outputs(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus, troll.client() as other, bus.claim(EL2008, lease=2):
            output = bus.signal(EL2008, 0x7000, 1)
            output.raw = 1
            bus.commit()
            await bus.next_cycle(3000)
            bus.commit()
            assert bus.output(output).state is Outputs.ACTIVE
            while other.slaves()[EL2008].outputs is not Outputs.SAFE:  # the event loop hangs
                other.wait()
            with pytest.raises(LeaseError):
                bus.commit()

    run(program())


class Counting(Client):
    """Counts its samples."""

    samples = 0

    def sample(self) -> None:
        self.samples += 1
        super().sample()


def test_who_owns_nothing_samples_only_when_the_wait_is_over(troll: Daemon) -> None:
    async def program() -> None:
        async def samples(bus: Counting) -> int:
            before = bus.samples
            await bus.next_cycle(500, timeout=PATIENCE)
            return bus.samples - before

        with Counting(troll.bus) as bus:
            assert await samples(bus) == 1
            with bus.claim(EL2008, lease=30):
                assert await samples(bus) > 1
            assert await samples(bus) == 1

    run(program())


def test_waiting_in_vain_ends_in_time(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus:
            with pytest.raises(NoAnswerError, match=r"did not come within [\d.e-]+ s \(timeout\)"):
                await bus.next_cycle(FOREVER, timeout=0.05)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(bus.next_cycle(FOREVER, timeout=FOREVER), 0.05)
            assert await bus.next_cycle() > 0

    run(program())


def test_a_cancelled_task_leaves_nothing(troll: Daemon) -> None:
    async def program() -> None:
        bus = troll.client()
        task = asyncio.create_task(bus.next_cycle(FOREVER, timeout=FOREVER))
        while bus._waiter is None or not bus._waiter._waiters:
            await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert bus._waiter._waiters == []
        await no_threads(bus)  # without anybody who waits it ends by itself
        assert await bus.next_cycle() > 0
        bus.close()
        await no_threads(bus)

    run(program())


def test_closing_ends_who_waits(troll: Daemon) -> None:
    async def program() -> None:
        bus = troll.client()
        task = asyncio.create_task(bus.next_cycle(FOREVER, timeout=FOREVER))
        await bus.next_cycle()
        bus.close()
        with pytest.raises(StateError, match="was closed"):
            await task
        with pytest.raises(StateError, match="is closed"):
            await bus.next_cycle()
        await no_threads(bus)

    run(program())


def test_a_loop_that_is_gone_does_no_harm(troll: Daemon) -> None:
    """Somebody closes an event loop with a task in it, and goes on in another."""
    with troll.client() as bus:
        loop = asyncio.new_event_loop()
        task = loop.create_task(bus.next_cycle(200, timeout=FOREVER))
        loop.run_until_complete(asyncio.sleep(0.01))
        loop.close()
        bus.wait(400)
        task._log_destroy_pending = False  # type: ignore[attr-defined]
        del task

        async def program() -> None:
            assert await bus.next_cycle() > 0

        run(program())


def test_requests_are_awaited(troll: Daemon) -> None:
    async def program() -> None:
        with troll.client() as bus:
            answers = await asyncio.gather(
                *(bus.sdo_upload(DRIVE, 0x1018, sub)._wait() for sub in (1, 1, 1))
            )
            assert answers == 3 * [b"\x9a\0\0\0"]
            assert await bus.sdo_upload(DRIVE, 0x1018, 1) == b"\x9a\0\0\0"
            with pytest.raises(SdoAbortError):
                await bus.sdo_upload(DRIVE, 0x7777)

    run(program())


def test_the_daemon_ends_and_comes_back(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")

    async def program() -> None:
        with daemon.client() as bus:
            tasks = [
                asyncio.create_task(bus.next_cycle(cycles, timeout=FOREVER))
                for cycles in (FOREVER, FOREVER + 1)
            ]
            await bus.next_cycle()
            daemon.kill_all()
            for task in tasks:
                with pytest.raises(UnreachableError, match=r"has ended|stands still"):
                    await task
            with pytest.raises(UnreachableError):
                await bus.next_cycle(timeout=0.2)
            begin = bus.instance
            again = asyncio.create_task(bus.next_cycle())
            await asyncio.to_thread(start_daemon, "troll", "--bus", daemon.bus)
            first = await again
            assert bus.instance != begin
            assert await bus.next_cycle(10) >= first + 10
        await no_threads(bus)

    run(program())


def test_a_daemon_that_is_stopped_ends_who_waits(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")

    async def program() -> None:
        with daemon.client() as bus:
            task = asyncio.create_task(bus.next_cycle(FOREVER, timeout=FOREVER))
            await bus.next_cycle()
            assert await asyncio.to_thread(daemon.stop) == 0
            with pytest.raises(UnreachableError):
                await task

    run(program())
