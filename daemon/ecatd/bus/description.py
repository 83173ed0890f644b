"""What a bus is, without running it: for a library that is generated from a rig or ESI files."""

from __future__ import annotations

import signal
import threading
from contextlib import suppress

from ecatd.log import Log
from ecatd.model.al import AlState
from ecatd.model.bus import Bus
from ecatd.model.config import Config
from ecatd.model.errors import StateError

from .start.bring_up import BringUp

_STOP_TIMEOUT = 1.0


def describe(config: Config, interface: str, log: Log) -> Bus:
    """The description that a daemon with this configuration would share; SIGTERM ends it early.

    The slaves are taken to PREOP, read and set up as for a run, and back to INIT. There is no
    shared memory and no exchange, so a daemon that runs a bus of the same name does not notice.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator.
        log: Where steps are told.

    Raises:
        EcatError: The bus cannot be read, or SIGTERM came.
    """
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    up = BringUp(config, interface, log, stop.is_set)
    try:
        return up.describe()
    finally:
        if up.master is not None:
            if up.bus.slaves:
                with suppress(StateError):
                    up.master.wait_for_state(AlState.INIT, _STOP_TIMEOUT)
            up.master.close()
