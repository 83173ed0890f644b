"""The exchange beside requests about many slaves, and what the gateway needs of a core."""

from __future__ import annotations

import contextlib
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..bench import Bench
from ..engine.beside import compare
from ..machine import used
from ..masters.daemon import Daemon
from ..masters.worker import Worker
from ..segment.peers import ecatsim
from ..summary import total
from .workers import Files, Inventory, Values

_DRIVE = f"{Path(__file__).parents[1] / 'files/rig.py'}:WithFiles"
_VALUES_PER_SECOND = 100
_STREAM_END = 5.5
"""Seconds after which the gateway has ended a stream that nobody reads."""


def measure(
    bench: Bench,
    *,
    rounds: int,
    seconds: float,
    drives: int,
    size: int,
    terminals: int,
    slaves: int,
) -> list[dict[str, Any]]:
    """Compares the exchange with and without each load, in turns.

    Args:
        bench: Folder and processors for the measurement.
        rounds: How often each load is switched on and off.
        seconds: How long a load is on, and how long it is off.
        drives: Number of slaves to which files are written at the same time.
        size: Bytes of each file.
        terminals: Number of slaves whose EEPROMs and dictionaries are read.
        slaves: Number of slaves whose values are sent.
    """
    every = range(terminals)
    cases: tuple[tuple[str, object, Sequence[tuple[Any, ...]], float], ...] = (
        ("files", _rig(bench, "drives", _DRIVE, drives), [(Files, range(drives), size)], 0),
        (
            "inventory",
            _rig(bench, "terminals", "EL3008", terminals),
            [(Inventory, every[::2]), (Inventory, every[1::2])],
            0,
        ),
        ("values", f"terminals:{slaves}", [(Values, _VALUES_PER_SECOND)], _STREAM_END),
    )
    found = []
    for name, rig, workers, rest in cases:
        bench.say(f"the exchange beside requests: {name}")
        with ecatsim(rig, bench.processors), Daemon(bench) as daemon:
            shares: list[float] = []
            with _load(bench, daemon, workers, rest, shares) as load:
                result = compare(daemon.bus, load, rounds, seconds)
        found.append({"load": name, **result, "gateway": statistics.median(shares)})
    return found


def _rig(bench: Bench, name: str, device: str, count: int) -> Path:
    file = bench.folder / f"{name}.toml"
    file.write_text(f'name = "{name}"\n' + f'[[slave]]\ndevice = "{device}"\n' * count)
    return file


@contextlib.contextmanager
def _load(
    bench: Bench,
    daemon: Daemon,
    workers: Sequence[tuple[Any, ...]],
    rest: float,
    shares: list[float],
) -> Iterator[Callable[[float], contextlib.AbstractContextManager[dict[str, Any]]]]:
    """Prepares a load of clients.

    Args:
        bench: Processors for the clients.
        daemon: The daemon they ask.
        workers: For each client its class, and its arguments after the name of the bus.
        rest: Seconds that the daemon still works after they have ended.
        shares: Gets the share of a core that the gateway needs, each time the load is on.
    """
    with contextlib.ExitStack() as stack:
        clients = [
            stack.enter_context(
                Worker(kind, bench.processors, daemon.bus, *more, environment=daemon.environment)
            )
            for kind, *more in workers
        ]

        @contextlib.contextmanager
        def load(seconds: float) -> Iterator[dict[str, Any]]:
            done: dict[str, Any] = {}
            for client in clients:
                client.tell(seconds=seconds)
            begin = time.monotonic()
            before = used(daemon.gateway)
            yield done
            taken = used(daemon.gateway) - before
            shares.append(taken / (time.monotonic() - begin))
            done |= total([client.answer() for client in clients], "rate", "failed")
            time.sleep(rest)

        yield load
