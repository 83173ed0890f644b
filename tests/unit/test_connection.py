"""The connection between gateway and bus server: messages however they are cut, and wrong ones."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from conftest import names
from ecatd.base.errors import UsageError
from ecatd.operations.connection import Connection
from ecatd.operations.encoding import MAX_REPLY, frame

LIMIT = 1000


class End(Connection):
    """Keeps what it gets; holds when it has `most` messages."""

    def __init__(self, most: int = 1 << 30) -> None:
        super().__init__(LIMIT)
        self.most = most
        self.messages: list[dict[str, Any]] = []
        self.problem: UsageError | None = None
        self.has_ended = False

    def message_received(self, message: dict[str, Any]) -> None:
        self.messages.append(message)
        if len(self.messages) >= self.most:
            self.hold()

    def ended(self, problem: UsageError | None) -> None:
        self.problem = problem
        self.has_ended = True


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.001)


@asynccontextmanager
async def connected(
    path: Path, end: End
) -> AsyncIterator[tuple[asyncio.StreamWriter, asyncio.StreamReader]]:
    server = await asyncio.get_running_loop().create_unix_server(lambda: end, path)
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        yield writer, reader
    finally:
        writer.close()
        server.close()
        await until(lambda: end.has_ended)


@pytest.mark.parametrize("size", [1, 3, 7, 64, 1 << 16])
def test_messages_arrive_however_they_are_cut(tmp_path: Path, size: int) -> None:
    messages = [{"n": number, "data": bytes(number)} for number in range(20)]

    async def use() -> None:
        end = End()
        async with connected(tmp_path / "socket", end) as (writer, reader):
            stream = b"".join(map(frame, messages))
            for at in range(0, len(stream), size):
                writer.write(stream[at : at + size])
                await writer.drain()
                await asyncio.sleep(0)
            await until(lambda: len(end.messages) == len(messages))
            assert end.messages == messages
            end.send({"n": -1})
            assert await reader.readexactly(len(frame({"n": -1}))) == frame({"n": -1})
            writer.close()
            await until(lambda: end.has_ended)
            assert end.problem is None
            end.send({"n": -2})  # nobody is there any more

    asyncio.run(use())


def test_what_is_held_comes_later(tmp_path: Path) -> None:
    async def use() -> None:
        end = End(most=3)
        async with connected(tmp_path / "socket", end) as (writer, _):
            writer.write(b"".join(frame({"n": number}) for number in range(10)))
            await until(lambda: len(end.messages) == 3)
            writer.write(frame({"n": 10}))
            await writer.drain()
            for _ in range(20):
                await asyncio.sleep(0.001)
            assert len(end.messages) == 3
            end.most = 1 << 30
            end.go_on()
            await until(lambda: len(end.messages) == 11)
            assert [message["n"] for message in end.messages] == list(range(11))

    asyncio.run(use())


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (struct.pack(">I", LIMIT + 1), "1001 bytes | 1000"),
        (struct.pack(">I", 1) + b"\xc1", "msgpack"),
        (struct.pack(">I", 1) + b"\x05", "map | string keys"),
        (struct.pack(">I", 0), "msgpack"),
    ],
)
def test_whoever_sends_nonsense_is_disconnected(tmp_path: Path, data: bytes, what: str) -> None:
    async def use() -> None:
        end = End()
        async with connected(tmp_path / "socket", end) as (writer, reader):
            writer.write(frame({"n": 1}) + data + frame({"n": 2}))
            assert await reader.read() == b""
            await until(lambda: end.has_ended)
            assert end.messages == [{"n": 1}]
            names(end.problem, *what.split(" | "))

    asyncio.run(use())


def test_an_end_that_does_not_read_is_known(tmp_path: Path) -> None:
    async def use() -> None:
        end = End()
        async with connected(tmp_path / "socket", end) as (writer, _):
            writer.write(frame({"n": 1}))
            await until(lambda: bool(end.messages))
            assert end.is_open
            assert not end.is_stuck
            end.send({"data": bytes(MAX_REPLY // 2)})  # the description of a very large bus
            assert not end.is_stuck
            for _ in range(2):
                end.send({"data": bytes(MAX_REPLY // 2)})
            assert end.is_stuck
            end.abort()
            await until(lambda: end.has_ended)
            assert not end.is_open

    asyncio.run(use())
