"""Starts the exchange, with all outputs at their safe values."""

from __future__ import annotations

import time

from ecatd.base.coroutine_steps import Steps
from ecatd.base.log import Log
from ecatd.config import Config
from ecatd.config.resolve import ResolvedConfig
from ecatd.description.bus import Bus
from ecatd.master.engine.engine import Engine, RealTime
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm.real_time import warnings

from .process_data import ProcessData

_PROOFS, _PROOF_S = 5, 0.5
"""Exchanges, and seconds, in which one must succeed for a start to say that the bus works."""


def leases(config: Config) -> tuple[int, int]:
    """Returns the shortest and the longest lease, in ns."""
    longest = config.outputs.lease_max_ms * 1_000_000
    return min(config.outputs.lease_cycles * config.cycle_time_us * 1000, longest), longest


def start_exchange(
    engine: Engine, shared: SharedMemory, data: ProcessData, config: Config, log: Log
) -> None:
    """Configures the engine and starts it.

    Args:
        engine: The engine.
        shared: The shared memory, filled already.
        data: The process data.
        config: The configuration.
        log: The log for refused real-time settings.
    """
    for domain in data.image.domains:
        engine.add_domain(domain)
    if data.clocks is not None:
        engine.set_clock(data.clocks.engine_clock)
    _guard(engine, shared, data.resolved)
    for channel in data.resolved.can:
        engine.add_can(channel)
    wanted = config.realtime
    grants = engine.start(
        RealTime(
            wanted.priority,
            wanted.cpu,
            wanted.lock_memory,
            wanted.busy_receive,
            wanted.poll_us,
            wanted.dma_latency_us,
            config.outputs.wkc_limit,
        )
    )
    shared.set_grants(grants)
    for text in warnings((grant for grant in grants if grant.error), config.bus):
        log.warning(text)


def find_failing(shared: SharedMemory, bus: Bus) -> Steps[list[str]]:
    """Waits for the first exchanges since the engine has begun to count, half a second at most.

    Returns:
        A text for each domain of which no exchange has succeeded; a domain that has not been
        exchanged yet is not among them.
    """
    divider = max((domain.divider for domain in bus.domains), default=1)
    # Counting begins with the next cycle.
    enough = shared.header.cycle + 2 + _PROOFS * divider
    deadline = time.monotonic() + _PROOF_S
    while shared.header.cycle < enough and time.monotonic() < deadline:
        yield
    return [
        f"{bus.domain_label(number)} ({row.wkc_bad} of {row.exchanges} failed)"
        for number, row in enumerate(shared.domain_status)
        if row.exchanges and row.wkc_bad >= row.exchanges
    ]


def _guard(engine: Engine, shared: SharedMemory, resolved: ResolvedConfig) -> None:
    """Gives the engine the safe values, the stops of drives, and the copies."""
    numbers: dict[tuple[int, int, int, int], int] = {}
    if resolved.safe.stops or resolved.safe.follows or resolved.copies:
        rows = enumerate(shared.signals[: shared.header.signal_count])
        numbers = {(row.slave, row.index, row.subindex, row.output): n for n, row in rows}
    for position, (value, hold) in resolved.safe.images.items():
        engine.set_safe(position, value, hold)
    for stop in resolved.safe.stops:
        engine.set_stop(
            numbers[stop.slave, stop.controlword, 0, 1],
            numbers[stop.slave, stop.statusword, 0, 0],
            stop.value,
            stop.timeout,
        )
    for follow in resolved.safe.follows:
        engine.set_follow(
            numbers[follow.slave, follow.actual, 0, 0],
            numbers[follow.slave, follow.target, 0, 1],
            -1 if follow.stop is None else numbers[follow.slave, follow.stop.controlword, 0, 1],
        )
    for copy in resolved.copies:
        engine.set_copy(
            None if copy.source is None else numbers[*copy.source, 0],
            numbers[*copy.target, 1],
            copy.factor,
            copy.offset,
            -1 if copy.stop is None else numbers[copy.target[0], copy.stop.controlword, 0, 1],
        )
