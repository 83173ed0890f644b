"""pysoem's loop, on command: `python -m benchmarks.masters.soem_worker INTERFACE`.

pysoem is SOEM behind Python, as most Python programs use EtherCAT: `send_processdata()`,
`receive_processdata()`, on a socket as it sets it up.
"""

from __future__ import annotations

import sys
import time

import pysoem

from ecatd.model.errors import StateError

from .gate import Gate
from .python_loop import Loop
from .worker import serve

_WATCHDOG = 0x0420
_TIMEOUT_US = 10_000
_PATIENCE = 10.0


def _start(interface: str) -> tuple[pysoem.Master, int]:
    """Slaves in OP, and the working counter that they give."""
    master = pysoem.Master()
    master.open(interface)
    count = master.config_init()
    if count <= 0:
        raise StateError("pysoem finds no slaves")
    for slave in master.slaves:
        slave._fpwr(_WATCHDOG, bytes(2))
    master.config_map()
    master.state_check(pysoem.SAFEOP_STATE, 2_000_000)
    master.state = pysoem.OP_STATE
    master.write_state()
    end = time.monotonic() + _PATIENCE
    while master.read_state() != pysoem.OP_STATE:
        master.send_processdata()
        master.receive_processdata(_TIMEOUT_US)
        if time.monotonic() > end:
            raise StateError("pysoem does not bring the slaves to OP")
    return master, 3 * count  # LRW: each slave is written to (2) and read from (1)


def main() -> None:
    """Starts the slaves, then measures on command."""
    master, expected = _start(sys.argv[1])

    def exchange() -> bool:
        master.send_processdata()
        return bool(master.receive_processdata(_TIMEOUT_US) == expected)

    serve({"ready": True}, Loop(exchange, Gate()).run)


if __name__ == "__main__":
    main()
