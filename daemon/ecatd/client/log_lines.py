"""The log of a daemon over Zenoh, as a client sees it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import zenoh

from ecatd.base.errors import NoAnswerError
from ecatd.operations.encoding import MAX_REPLY, unpack
from ecatd.operations.zenoh_keys import bus_key

_LINES = 1000
"""Lines that may wait; older ones are dropped."""
_PAUSE = 0.05


def log_lines(session: zenoh.Session, bus: str) -> Iterator[dict[str, Any]]:
    """Returns an iterator over lines of the log from now on; see LogLine in docs/zenoh-keys.md.

    Args:
        session: The session.
        bus: BUS or HOST/BUS.

    Raises:
        NoAnswerError: The daemon has ended, or the connection is broken.
    """
    ring = zenoh.handlers.RingChannel
    alive = session.liveliness().declare_subscriber(bus_key(bus, "alive"), ring(1), history=True)
    lines = session.declare_subscriber(bus_key(bus, "ro", "log", "lines"), ring(_LINES))
    return _follow(lines, alive)


def _follow(lines: Any, alive: Any) -> Iterator[dict[str, Any]]:
    with lines, alive:
        while True:
            if (sample := lines.try_recv()) is not None:
                yield unpack(bytes(sample.payload), MAX_REPLY)
            elif (sign := alive.try_recv()) and sign.kind == zenoh.SampleKind.DELETE:
                raise NoAnswerError("the daemon has ended, or the connection is broken")
            else:
                time.sleep(_PAUSE)
