"""What a daemon publishes over Zenoh, as a client sees it: streams of values, lines of the log."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Self

import zenoh

from ecatd.base.errors import NoAnswerError, UnreachableError
from ecatd.base.timeouts import Timeout
from ecatd.operations.encoding import MAX_REPLY, unpack
from ecatd.operations.streams import Stream as Opened
from ecatd.operations.zenoh_keys import bus_key, bus_of

_ROWS = 100
"""Rows that may wait; older ones are dropped."""
_LINES, _PAUSE = 1000, 0.05
"""Lines of the log that may wait, and seconds between two looks for one."""


class Published:
    """Messages that a gateway publishes under a key as long as somebody listens.

    Iterating gives maps, in order; it waits for the next one.

    Args:
        session: The session.
        key: The key.
        waiting: How many messages may wait; older ones are dropped.
        patience: How long a message may take to come.
        pause: Seconds between two looks for a message.

    Raises:
        UnreachableError: While iterating: the gateway has ended, or the connection is broken.
        NoAnswerError: As above; no message comes any more.
    """

    def __init__(
        self, session: zenoh.Session, key: str, waiting: int, patience: Timeout, pause: float
    ) -> None:
        self._patience = patience
        self._pause = pause
        self._has_ended = threading.Event()
        ring: Any = zenoh.handlers.RingChannel(waiting)
        try:
            self._subscriber = session.declare_subscriber(key, ring)
            self._token = session.liveliness().declare_subscriber(
                bus_key(bus_of(key), "alive"),
                self._look_at,
                history=True,  # else nobody tells of the end of a token that is there already
            )
        except zenoh.ZError as error:  # it was closed meanwhile, by another thread
            raise UnreachableError(f"the connection to the daemon has ended: {error}") from error

    def __iter__(self) -> Iterator[dict[str, Any]]:
        while True:
            deadline = time.monotonic() + self._patience.seconds
            while (sample := self._received()) is None:
                if self._has_ended.is_set():
                    raise UnreachableError(
                        "no more values come: the gateway or the daemon has ended, or the "
                        "connection is broken"
                    )
                if time.monotonic() > deadline:
                    raise NoAnswerError(
                        f"no values have come for {self._patience}: the daemon stands still, "
                        "or the connection is broken"
                    )
                time.sleep(self._pause)
            yield unpack(bytes(sample.payload), MAX_REPLY)

    def _received(self) -> zenoh.Sample | None:
        try:
            return self._subscriber.try_recv()
        except zenoh.ZError as error:  # the session was closed meanwhile, by another thread
            raise UnreachableError(f"the connection to the daemon has ended: {error}") from error

    def _look_at(self, token: zenoh.Sample) -> None:
        if token.kind == zenoh.SampleKind.DELETE:
            self._has_ended.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(zenoh.ZError):  # the session was closed before
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
            self._token.undeclare()  # type: ignore[no-untyped-call]


class Stream(Published):
    """Values of some entries at regular intervals.

    Iterating gives maps with `cycle`, the number of the last cycle, and `values`: for each entry
    its minimum, mean and maximum (None if it could not be trusted in any cycle), and the number of
    cycles in which it could be trusted.

    Args:
        session: The session.
        opened: The answer of the daemon.
        patience_s: Seconds for which a row may be late, in addition to the time between two.

    Attributes:
        signals: The entries, in the order of the values: `name`, `slave`, `address`, `unit`.
        rate: Rows a second.
        cycles: Number of cycles that each row covers.

    Raises:
        UnreachableError: See `Published`.
        NoAnswerError: See `Published`.
    """

    def __init__(self, session: zenoh.Session, opened: Opened, patience_s: float) -> None:
        self.signals = list(opened["signals"])
        self.rate = float(opened["rate"])
        self.cycles = int(opened["cycles"])
        patience = Timeout(patience_s + 1 / self.rate, "--timeout")
        super().__init__(session, opened["key"], _ROWS, patience, min(0.01, 0.2 / self.rate))


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
