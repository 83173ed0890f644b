"""A page that takes nothing for a while: its memory is bounded, and no peak is lost."""

import asyncio
import http.client
import itertools
import json
import struct
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import connect

from ecatd.base.errors import StateError
from ecatd.web.batch import Cycles
from ecatd.web.files import read_files
from ecatd.web.hub import Hub
from ecatd.web.listening import Address
from ecatd.web.page import Page
from ecatd.web.server import Server, for_this_machine

_BATCH, _BATCHES = 1000, 1200
"""More than the page keeps, and more than the kernel keeps."""


class Counting:
    """Gives pages a signal that counts cycles, as fast as it can, with a peak now and then."""

    kind, title = "bus", "counting"
    may: tuple[str, ...] = ()
    user = ""
    buses: tuple[str, ...] = ()

    async def run(self, hub: Hub) -> None:
        hub.describe([{"name": "a"}])
        await asyncio.Event().wait()

    async def ask(self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]) -> Any:
        raise AssertionError

    def wish(self, page: Page) -> None:
        if page.signals:
            self._task = asyncio.create_task(self._count(page))

    async def _count(self, page: Page) -> None:
        for number in itertools.count():
            first = number * _BATCH + 1
            numbers = array("d", range(first, first + _BATCH))
            values = array("d", [value if value % 777 else -value for value in numbers])
            page.tell_cycles(
                Cycles(numbers, numbers, {"a": values}, {"a": "float64"}, {}, lost=False), ["a"], 1
            )
            await asyncio.sleep(0 if number < _BATCHES else 0.02)


async def read(server: Server) -> list[tuple[str, list[tuple[float, float, float, float]]]]:
    """What a page gets that reads nothing at first: kind, and stretches with their extremes."""
    host, _, token = server.address.removeprefix("http://").partition("/#token=")

    def login() -> str:
        client = http.client.HTTPConnection(host)
        client.request("GET", "/login", headers={"Authorization": f"Bearer {token}"})
        return str(client.getresponse().headers["Set-Cookie"]).partition(";")[0]

    cookie = await asyncio.to_thread(login)
    found = []
    async with connect(
        f"ws://{host}/socket",
        additional_headers={"Cookie": cookie, "Origin": f"http://{host}"},
        max_queue=1,
        max_size=None,
        compression=None,
    ) as socket:
        while '"signals"' not in str(await socket.recv()):
            pass
        await socket.send(json.dumps({"type": "trace", "signals": ["a"], "generation": 1}))
        await asyncio.sleep(1.5)
        while len(found) < 2 or found[-1][0] != "raw" or found[-1][1][-1][1] < _BATCH * _BATCHES:
            data = await socket.recv()
            if isinstance(data, bytes):
                (length,) = struct.unpack_from("<I", data)
                header = json.loads(data[4 : 4 + length])
                column, form = header["columns"][0], f"<{header['count']}d"
                places = (
                    header["cycles"],
                    header.get("last_cycles", header["cycles"]),
                    column.get("min", column.get("at")),
                    column.get("max", column.get("at")),
                )
                arrays = [struct.unpack_from(form, data, at) for at in places]
                found.append((header["kind"], [*zip(*arrays, strict=True)]))
    return found


def test_a_page_that_takes_nothing_loses_no_peak_and_catches_up() -> None:
    async def run() -> list[tuple[str, list[tuple[float, float, float, float]]]]:
        server = for_this_machine(lambda _: Hub(Counting()), {}, Address(port=0))
        serving = asyncio.create_task(server.run(lambda: None))
        found = await read(server)
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
        return found

    found = asyncio.run(run())
    kinds = [kind for kind, _ in found]
    assert "minmax" in kinds
    assert kinds[-1] == "raw"
    expected = 1.0
    for _, stretches in found:
        for first, last, least, greatest in stretches:
            assert first == expected
            expected = last + 1
            stretch = [n if n % 777 else -n for n in range(int(first), int(last) + 1)]
            assert (least, greatest) == (min(stretch), max(stretch))


def test_a_build_without_the_page_says_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(StateError, match="make web"):
        read_files(tmp_path)


def test_only_files_of_the_page_are_served(tmp_path: Path) -> None:
    for name in ("index.html", "page.js", "notes.toml", "LEGAL.txt"):
        (tmp_path / name).write_text(name)
    assert {*read_files(tmp_path)} == {"/", "/index.html", "/page.js", "/LEGAL.txt"}
