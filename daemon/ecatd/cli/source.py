"""Source of statistics for commands: the shared memory of this machine, or the gateway."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Self

from ecatd.base.errors import EcatError, UnreachableError
from ecatd.shm.files import exists
from ecatd.shm.statistics import Snapshot, read

if TYPE_CHECKING:
    from ecatd.client.remote import Remote


class Source:
    """Reads statistics of the bus that the options name.

    If this machine has the shared memory of the bus, it is read, which works without a gateway.
    With `--connect`, or without shared memory, the gateway is asked.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._remote: Remote | None = None

    @property
    def local(self) -> bool:
        """Whether to read the shared memory: it exists, and `--connect` is not given."""
        bus = self._options.bus
        return self._options.connect is None and exists(bus)

    def read(self) -> Snapshot:
        """Reads the present statistics.

        Raises:
            EcatError: They are not available; a later try may succeed.
        """
        if not self.local:
            return self.ask()
        try:
            return read(self._options.bus)
        except UnreachableError as error:  # it is left over from a daemon that was killed
            from ecatd.client.why_no_daemon import why_no_daemon

            raise why_no_daemon(self._options.bus) from error

    def remote(self) -> Remote:
        """The session with the gateway; opens it on first use."""
        if self._remote is None:
            from ecatd.client.remote import Remote  # loading Zenoh is slow

            options = self._options
            self._remote = Remote(options.bus, options.connect, options.timeout)
        return self._remote

    def ask(self) -> Snapshot:
        """Asks the gateway for the present statistics; raises as `read`."""
        try:
            return self.remote().stats()
        except EcatError:
            self.close()  # the next try opens a new session
            raise

    def close(self) -> None:
        """Ends the session with the gateway."""
        if self._remote is not None:
            self._remote.close()
            self._remote = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
