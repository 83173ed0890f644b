"""Claims as objects: outputs that this client owns for a while."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ecatd.model.errors import EcatError, UnreachableError

from .signals import Signal

if TYPE_CHECKING:
    from .client import Client


class Claim:
    """Outputs that this client owns; `Client.claim` makes it.

    As a context manager it gives them back at the end of the block.

    Attributes:
        lease: Seconds without a sample or commit after which they fall to their safe values; 0: the
            daemon's default.
    """

    def __init__(
        self, client: Client, what: int | str | Signal | Iterable[str | Signal], lease: float
    ) -> None:
        self._client = client
        self._slave: int | None = None
        self.lease = lease
        if isinstance(what, int):
            client.claim_slave(what, lease)
            self._slave = what
            return
        entries = (what,) if isinstance(what, (str, Signal)) else tuple(what)
        self._entries = tuple(client.signal(e) if isinstance(e, str) else e for e in entries)
        for n, signal in enumerate(self._entries):
            try:
                client.claim_entry(signal.number, lease)
            except EcatError:
                for granted in self._entries[:n]:
                    with suppress(EcatError):
                        client.release_entry(granted.number)
                raise

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """What was claimed."""
        if self._slave is None:
            return self._entries
        return tuple(signal for signal in self._client.signals(self._slave) if signal.output)

    def release(self) -> None:
        """Gives the outputs back; they go to their safe values."""
        if self._slave is not None:
            self._client.release_slave(self._slave)
            return
        for signal in self._entries:
            self._client.release_entry(signal.number)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._client.closed:
            return  # which has released everything
        with suppress(UnreachableError):  # no daemon, no claims
            self.release()
