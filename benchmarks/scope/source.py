"""Serves the page with made-up signals at 1 kHz: `python -m benchmarks.scope.source MINUTES`.

It prints the address of the page. Each page gets the last minutes as fast as it takes them, and
then each cycle in time, as from a bus.
"""

from __future__ import annotations

import asyncio
import math
import random
import sys
import time
from array import array
from collections.abc import Mapping, Sequence
from typing import Any

from ecatd.base.errors import EcatError, StateError
from ecatd.operations.traces import TYPES
from ecatd.web.batch import Cycles
from ecatd.web.files import read_files
from ecatd.web.hub import Hub
from ecatd.web.listening import Address
from ecatd.web.page import Page
from ecatd.web.server import for_this_machine

_PERIOD = 8192
"""Cycles after which the values come again."""
_BATCH, _FILL = 50, 1000
"""Cycles of a batch in time, as the gateway sends them, and of one of the past."""
_KINDS = (
    *[("float32", "A")] * 4,
    *[("int16", "V")] * 4,
    *[("int32", "mm")] * 4,
    *[("uint64", "")] * 2,
    *[("uint8", "named")] * 2,
    *[("uint8", "bit")] * 4,
)


class Signals:
    """A source of twenty signals.

    Args:
        minutes: How much of the past pages get at once.
    """

    kind = "bus"
    title = "benchmark"
    may: tuple[str, ...] = ()
    user = ""
    buses: tuple[str, ...] = ()

    def __init__(self, minutes: float) -> None:
        self._past = round(minutes * 60_000)
        self._signals = [_described(at, *kind) for at, kind in enumerate(_KINDS)]
        self._types = {item["name"]: item["type"] for item in self._signals}
        chance = random.Random(1)
        # Twice, so that a batch never wraps.
        self._values = {
            item["name"]: array(TYPES[item["type"]], 2 * _values(at, *_KINDS[at], chance))
            for at, item in enumerate(self._signals)
        }
        self._senders: dict[Page, asyncio.Task[None]] = {}

    async def run(self, hub: Hub) -> None:
        """See `Source`."""
        hub.link(True, "made-up signals")
        hub.describe(self._signals)
        await asyncio.Event().wait()

    async def ask(
        self, key: str, parameters: Mapping[str, Any], payload: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """See `Source`."""
        raise StateError("this is no bus")

    def wish(self, page: Page) -> None:
        """See `Source`."""
        if (before := self._senders.pop(page, None)) is not None:
            before.cancel()
        if page.signals:
            self._senders[page] = asyncio.create_task(
                self._send(page, page.signals, page.generation)
            )

    async def _send(self, page: Page, names: Sequence[str], generation: int) -> None:
        cycle, began = 0, time.time() - self._past / 1000
        while cycle < self._past:
            page.tell_cycles(self._cycles(cycle, _FILL, began, names), names, generation)
            cycle += _FILL
            await page.drained()
        while True:
            while time.time() < began + (cycle + _BATCH) / 1000:
                await asyncio.sleep(0.005)
            page.tell_cycles(self._cycles(cycle, _BATCH, began, names), names, generation)
            cycle += _BATCH

    def _cycles(self, first: int, count: int, began: float, names: Sequence[str]) -> Cycles:
        at = first % _PERIOD
        return Cycles(
            array("d", range(first, first + count)),
            array("d", [began * 1000 + cycle for cycle in range(first, first + count)]),
            {name: self._values[name][at : at + count] for name in names},
            self._types,
            {},
            lost=False,
        )


def _described(at: int, kind: str, unit: str) -> dict[str, Any]:
    return {
        "name": f"{at}/0x6000:01",
        "label": f"Slave {at}/Value {at}",
        "path": f"{at}/Value {at}",
        "slave": at,
        "address": "0x6000:01",
        "output": False,
        "type": kind,
        "bits": 1 if unit == "bit" else 64,
        "scale": 1.0,
        "offset": 0.0,
        "unit": "" if unit in ("named", "bit") else unit,
        "minimum": None,
        "maximum": None,
        "values": {"0": "off", "1": "on", "2": "fault"} if unit == "named" else {},
    }


def _values(at: int, kind: str, unit: str, chance: random.Random) -> list[Any]:
    """Sines with noise and rare peaks, counters, and states."""
    if unit == "bit":
        return [cycle >> (at % 8) & 1 for cycle in range(_PERIOD)]
    if unit == "named":
        return [cycle // 700 % 3 for cycle in range(_PERIOD)]
    if kind == "uint64":
        return [2**53 + cycle for cycle in range(_PERIOD)]
    waves = 2.0 ** (at % 7)
    found = [
        1000 * math.sin(2 * math.pi * waves * cycle / _PERIOD)
        + chance.gauss(0, 20)
        + (3000 if chance.random() < 0.0005 else 0)
        for cycle in range(_PERIOD)
    ]
    return found if kind.startswith("float") else [round(value) for value in found]


async def _serve(minutes: float) -> None:
    server = for_this_machine(
        lambda _: Hub(Signals(minutes)), read_files(), Address("127.0.0.1", 0)
    )
    await server.run(lambda: print(server.address, flush=True))


if __name__ == "__main__":
    try:
        asyncio.run(_serve(float(sys.argv[1])))
    except EcatError as error:
        sys.exit(str(error))
