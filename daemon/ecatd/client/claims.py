"""Claims as objects: outputs that this client owns for a while.

The daemon knows only whether a client owns an output. Where a program claims one that it owns
already, the claim that was first goes on holding it: each gives back only what it has added.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ecatd.model.errors import UnreachableError, UsageError

from .signals import Signal

if TYPE_CHECKING:
    from .client import Client


class Claim:
    """Outputs that this client owns; `Client.claim` makes it.

    As a context manager it gives them back at the end of the block, but for those that this client
    owned before by another claim.

    Attributes:
        outputs: What was claimed.
        lease: Seconds without a sample or commit after which they fall to their safe values; 0: the
            daemon's default.
    """

    def __init__(
        self, client: Client, what: int | str | Signal | Iterable[str | Signal], lease: float
    ) -> None:
        self._client = client
        self._mark = object()  # stands for this claim; the client must not hold the claim itself
        self.lease = lease
        self.outputs = _outputs(client, what)
        instance = client.instance
        before = {s.number for s in self.outputs if s.output and client.output(s).owned}
        if isinstance(what, int):
            client.claim_slave(what, lease)
        else:
            client.claim_entries(self._numbers, lease)
        if client.instance != instance:
            before = set()  # of a daemon that is gone
        new = (number for number in self._numbers if number not in before)
        client._holders.update(dict.fromkeys(new, self._mark))

    @property
    def _numbers(self) -> list[int]:
        return [signal.number for signal in self.outputs]

    def release(self) -> None:
        """Gives the outputs back; they go to their safe values."""
        client = self._client
        mine = [n for n in self._numbers if client._holders.get(n) is self._mark]
        for number in mine:
            del client._holders[number]
        client.release_entries(mine)

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


def _outputs(
    client: Client, what: int | str | Signal | Iterable[str | Signal]
) -> tuple[Signal, ...]:
    """What is to be claimed, each once.

    Raises:
        StateError: There is no such entry.
        UsageError: It is nothing.
    """
    if isinstance(what, int):
        return tuple(signal for signal in client.signals(what) if signal.output)
    entries = (what,) if isinstance(what, (str, Signal)) else tuple(what)
    if not entries:
        raise UsageError("there is nothing to claim: the list of outputs is empty")
    found = (client.signal(entry) if isinstance(entry, str) else entry for entry in entries)
    return tuple(dict.fromkeys(found))
