"""Conversations with slaves of a running bus: late answers, queues, and emergencies."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest
from wire_bench import FIRST_STATION, Wire, in_preop

from conftest import PATIENCE, names, naming
from ecatd.base.batch import Batch
from ecatd.base.errors import BusyError, NoAnswerError, SdoAbortError, UsageError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.description.bus import Bus, Slave
from ecatd.description.cables import Cables
from ecatd.etg.datatypes import DataType
from ecatd.master.emergencies import Emergency, log_emergencies
from ecatd.master.mailbox import coe as coe_module
from ecatd.master.mailbox import mailbox_queue as queue_module
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, converse
from ecatd.master.mailbox.mailbox_queue import MailboxQueue
from ecatd.master.master import Master
from ecatd.master.worker import Worker
from ecatd.operations.bus import ReadWaiting
from ecatd.operations.objects import DescribeObject, SdoRead, SdoWrite
from ecatd.server.requests.changes import Changes
from ecatd.server.requests.conversations import Conversations
from ecatd.server.requests.files import States
from ecatd.server.requests.requests import Requests
from ecatsim.slave import sii
from ecatsim.slave.device import Device
from ecatsim.slave.mailbox import MailboxError, MailboxFault, RefusedMailError
from ecatsim.slave.objects import Access
from ecatsim.slave.sdo_information import InformationServer

NUMBER, OTHER = 0x2000, 0x2001
SLAVES = [Slave(n, "Number", 0xFFFF, 1, 1, coe=True) for n in range(3)]


class Number(Device):
    """Two numbers."""

    vendor, product, revision, order = 0xFFFF, 1, 1, "Number"
    mailbox = sii.Mailbox(receive_size=48, send=0x1030, send_size=48, coe_details=0x2F)

    def describe(self) -> None:
        self.dictionary.variable(NUMBER, "Number", DataType.UNSIGNED16, 0, Access.RW)
        self.dictionary.variable(OTHER, "Other", DataType.UNSIGNED8, 0, Access.RW)


class Bench:
    """Objects of simulated slaves in PREOP; the master has no more than they need."""

    def __init__(self, devices: list[Device], registers: Any, wire: Wire) -> None:
        self.devices, self.registers, self.wire = devices, registers, wire
        self.queues = [MailboxQueue() for _ in devices]
        self.said: list[str] = []
        self.worker = Worker()
        log = cast("Log", SimpleNamespace(warning=lambda text, *_: self.said.append(text)))
        master = cast(
            "Master",
            SimpleNamespace(
                coe=self.coe,
                registers=registers,
                stations=[FIRST_STATION + n for n in range(len(devices))],
            ),
        )
        self.emergencies = Batch[Emergency](
            lambda found, left_out: log_emergencies(log, found, left_out)
        )
        bus = Bus("bench", 1000, SLAVES)
        self.conversations = conversations = Conversations(
            master, self.worker, self.emergencies.note
        )
        own = Log("ecatd")
        states = cast("States", None)  # only transfers of files need them
        self.requests = Requests(
            *(bus, master, Config(), self.worker, conversations, states),
            *(lambda _, entry: entry, Changes(own), own, Cables(bus)),
        )

    def coe(self, position: int, *, alone: bool = False) -> Coe:
        return Coe(position, FIRST_STATION + position, self.queues[position], alone=alone)

    def patient(self) -> None:
        """From now on slaves may take as long as a busy machine does."""
        for queue in self.queues:
            queue.answer_s = PATIENCE

    async def read(self, position: int = 0, index: int = NUMBER) -> int:
        answer = await self.requests.answer(SdoRead(position, index))
        return int.from_bytes(answer["data"], "little")

    async def read_bytes(self) -> bytes:
        return bytes((await self.requests.answer(SdoRead(0, NUMBER)))["data"])

    async def write(self, data: bytes, position: int = 0, index: int = NUMBER) -> None:
        # `Objects.write` would read the object before.
        slave = SLAVES[position]
        with self.conversations.places.take(slave, changes=True):
            await self.conversations.coe(slave, lambda coe: coe.download(index, 0, data))


@contextmanager
def bench(count: int = 1) -> Iterator[Bench]:
    devices: list[Device] = [Number() for _ in range(count)]
    with in_preop(*devices, timeout=0.5) as (registers, wire):
        made = Bench(devices, registers, wire)
        try:
            yield made
        finally:
            made.worker.close()


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slaves that do not answer are given up soon, until `made.patient()`."""
    monkeypatch.setattr(queue_module, "_ANSWER_S", 0.1)
    monkeypatch.setattr(coe_module, "_DOWNLOAD_S", 0.1)
    monkeypatch.setattr(coe_module, "_SYNCHRONIZE_S", 0.1)


NEVER = MailboxFault("slow", math.inf)
"""The answers to what is asked meanwhile wait until `come_late`, and those after them, too."""


def come_late(device: Device) -> None:
    """Has the answers that wait come, some time after the call, as if they were only late."""

    def come() -> None:
        services = device._services
        assert services is not None
        queue = services.server._queue
        for n in reversed(range(len(queue))):  # none comes before all may
            queue[n] = (0.0, queue[n][1])

    device.mailbox_fault = MailboxFault()
    asyncio.get_running_loop().call_later(0.05, come)


@pytest.mark.parametrize("describes", [True, False])
def test_a_slave_is_asked_once_for_the_type_of_an_object(
    describes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If it describes nothing, the size of its objects decides."""
    asked = 0
    answer = InformationServer.handle

    def count(server: InformationServer, request: bytes) -> list[bytes]:
        nonlocal asked
        asked += 1
        if not describes:
            raise RefusedMailError(MailboxError.UNSUPPORTED_SERVICE)
        return answer(server, request)

    monkeypatch.setattr(InformationServer, "handle", count)
    with bench() as made:
        made.patient()

        async def use() -> None:
            for value in ("6", "7"):
                written = await made.requests.answer(SdoWrite(0, NUMBER, value=value))
                assert written["data"] == await made.read_bytes() == bytes([int(value), 0])
                assert written["name"] == ("Number" if describes else "")
            with pytest.raises(UsageError, match=naming("-5", "UNSIGNED16")):
                await made.requests.answer(SdoWrite(0, NUMBER, value="-5"))
            assert asked == 1
            if describes:
                await made.requests.answer(DescribeObject(0, OTHER))
                before = asked
                assert await made.read(index=OTHER) == 0
                assert asked == before, "the dictionary has the object"

        asyncio.run(use())


def test_an_answer_that_comes_too_late_is_not_that_to_the_same_question(short: None) -> None:
    with bench() as made:
        (device,) = made.devices

        async def use() -> list[int]:
            device.mailbox_fault = NEVER
            with pytest.raises(NoAnswerError):
                await made.read()
            made.patient()
            come_late(device)
            found = []
            for value in (1, 2, 3, 4):
                device[NUMBER, 0] = value
                found.append(await made.read())
            return found

        assert asyncio.run(use()) == [1, 2, 3, 4]


def test_a_refusal_is_not_taken_for_the_success_of_an_earlier_write(short: None) -> None:
    with bench() as made:
        (device,) = made.devices

        async def use() -> None:
            device.mailbox_fault = NEVER
            with pytest.raises(NoAnswerError):
                await made.write(struct.pack("<H", 8888))
            made.patient()
            come_late(device)
            with pytest.raises(SdoAbortError) as refused:
                await made.write(b"\x05")
            assert refused.value.code == 0x06070013  # too short
            assert await made.read() == 8888, "written after all"

        asyncio.run(use())


def test_a_request_that_was_cancelled_leaves_no_answer_behind() -> None:
    with bench() as made:
        made.patient()
        (device,) = made.devices

        async def use() -> list[int]:
            found = []
            for value in range(1, 6):
                device.mailbox_fault = MailboxFault("slow", 0.1)
                given_up = asyncio.create_task(made.read())
                await asyncio.sleep(0.03)
                given_up.cancel()
                device.mailbox_fault = MailboxFault()
                device[NUMBER, 0] = value
                found.append(await made.read())
            return found

        assert asyncio.run(use()) == [1, 2, 3, 4, 5]


def test_conversations_with_a_slave_take_turns() -> None:
    """Those of requests and those of a recovery, which do not know of each other."""
    with bench(2) as made:
        made.patient()
        for device in made.devices:
            device[NUMBER, 0] = 7
            device[OTHER, 0] = 9

        def again_and_again(coe: Coe, index: int) -> Conversation[set[bytes]]:
            found = set()
            for _ in range(20):
                found.add((yield from coe.upload(index, 0)))
            return found

        conversations = []
        for position in (0, 1, 0, 1, 0):
            coe = made.coe(position)
            index = OTHER if len(conversations) % 2 else NUMBER
            conversations.append(
                coe.converse(lambda coe=coe, index=index: again_and_again(coe, index))
            )  # type: ignore[misc]
        found = converse(made.registers, conversations)
        assert found == [{b"\7\0"}, {b"\x09"}] * 2 + [{b"\7\0"}]


def test_r24_too_many_requests_are_told_so_and_take_no_place_from_others() -> None:
    with bench(3) as made:
        made.devices[0].mailbox_fault = MailboxFault("stuck")

        async def use() -> None:
            made.devices[1][NUMBER, 0] = 5
            waiting = [asyncio.create_task(made.read(0)) for _ in range(24)]
            await asyncio.sleep(0)
            for _ in range(3):
                with pytest.raises(BusyError, match=naming("slave 0 (Number)", "24 requests")):
                    await made.read(0)
            rows = (await made.requests.answer(ReadWaiting()))["requests"]
            assert [(row["slave"], row["request"]) for row in rows] == [(0, "sdo_read")] * 24
            assert rows[0]["seconds"] >= rows[-1]["seconds"] >= 0
            # The other places are for changes: whoever reads too much keeps nobody from them.
            changes = [asyncio.create_task(made.write(b"\6\0", 0)) for _ in range(8)]
            await asyncio.sleep(0)
            with pytest.raises(BusyError, match=naming("slave 0 (Number)", "32 requests")):
                await made.write(b"\6\0", 0)
            assert not any(task.done() for task in changes)
            for task in changes:
                task.cancel()
            await asyncio.wait(changes)
            assert await made.read(1) == 5
            waiting[3].cancel()
            await asyncio.wait([waiting[3]])
            waiting.append(asyncio.create_task(made.read(0)))
            await asyncio.sleep(0)
            assert not waiting[-1].done(), "there was a place again"
            for task in waiting:
                task.cancel()
            await asyncio.gather(*waiting, return_exceptions=True)
            assert await made.requests.answer(ReadWaiting()) == {"requests": []}

        asyncio.run(use())


def test_what_waited_for_too_long_is_not_carried_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecatd.server.requests.conversations._PATIENCE", Timeout(0.1))
    with bench() as made:
        made.patient()
        (device,) = made.devices
        device.mailbox_fault = MailboxFault("stuck")

        async def use() -> None:
            first = asyncio.create_task(made.read())
            await asyncio.sleep(0)
            with pytest.raises(
                BusyError, match=naming("slave 0 (Number)", "0.1 s", "nothing was done")
            ):
                await made.write(b"\5\0")
            first.cancel()
            await asyncio.wait([first])
            device.mailbox_fault = MailboxFault()
            assert await made.read() == 0

        asyncio.run(use())


def test_a_slave_that_is_missing_is_told_at_once() -> None:
    with bench() as made:
        made.wire.lose = lambda _number: True
        with pytest.raises(NoAnswerError, match=naming("slave 0 (Number)", "answer")):
            asyncio.run(made.read())


def test_a_storm_of_different_emergencies_has_few_lines() -> None:
    said: list[str] = []
    log = cast("Log", SimpleNamespace(warning=lambda text, *_: said.append(text)))
    log_emergencies(log, [(SLAVES[n % 2], 0x1000 + n, 1) for n in range(1000)], 7)
    assert len(said) < 25
    names("\n".join(said), "7 emergencies are left out", "slave 1 (Number) sent 492 other")


def test_equal_emergencies_are_told_together() -> None:
    with bench() as made:
        (device,) = made.devices

        async def use() -> None:
            for _ in range(20):
                device.emergency(0x3220, 4)
                await made.read()
            made.emergencies.close()

        asyncio.run(use())
    assert len(made.said) < 10
    for line in made.said:
        names(line, "slave 0 (Number)", "emergency", "0x3220", "0x04")
    assert any("times" in line for line in made.said)
