"""Describes a bus without running it, to generate a library from a rig or ESI files."""

from __future__ import annotations

import signal
import threading
from contextlib import suppress

from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.description.bus import Bus
from ecatd.etg.al import AlState

from .start.bring_up import BringUp

_STOP_PATIENCE = Timeout(1.0)


def describe(config: Config, interface: str, log: Log) -> Bus:
    """Returns the description that a daemon with this configuration would share.

    Brings the slaves to PREOP, reads and sets them up as for a run, and brings them back to INIT.
    It makes no shared memory and does not start the exchange, so it does not disturb a daemon that
    runs a bus of the same name on another interface. SIGTERM ends it early.

    Args:
        config: The configuration.
        interface: The interface, which may come from the simulator.
        log: The log for the steps.

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
                    up.master.al_states.wait_for(AlState.INIT, _STOP_PATIENCE)
            up.master.close()
