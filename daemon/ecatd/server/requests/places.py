"""Places for requests that wait for slaves, so that nobody takes the daemon from everybody else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from ecatd.base.errors import BusyError
from ecatd.description.bus import Slave

_MAX, _OF_ONE_SLAVE_MAX = 128, 32
"""Requests that may wait, in all and for one slave; further ones are refused with BusyError."""
_FOR_CHANGES = 0.25
"""The share of these places that only requests which change something may take. Everybody who may
read can ask for as much as he likes, and must not keep others from their changes."""


class Places:
    """The places of a bus: for conversations with mailboxes, and for EEPROMs."""

    def __init__(self) -> None:
        self._taken: Counter[int] = Counter()  # by position

    @contextmanager
    def take(self, slave: Slave, *, changes: bool) -> Iterator[None]:
        """Takes a place for the block.

        Args:
            slave: The slave that the request is about.
            changes: Whether the request changes something.

        Raises:
            BusyError: There is no place left.
        """
        share = 1 if changes else 1 - _FOR_CHANGES
        of_slave, of_all = self._taken[slave.position], self._taken.total()
        if of_slave >= _OF_ONE_SLAVE_MAX * share:
            raise BusyError(f"{slave.label} has {of_slave} requests waiting already; try again")
        if of_all >= _MAX * share:
            raise BusyError(f"busy: {of_all} requests are waiting for slaves already; try again")
        self._taken[slave.position] += 1
        try:
            yield
        finally:
            self._taken[slave.position] -= 1
