"""kickcat's loop, on command: `python -m benchmarks.masters.kickcat_worker INTERFACE`.

kickcat is a master in C++ with Python bindings; `process_data()` exchanges once.
"""

from __future__ import annotations

import sys

import kickcat

from .gate import Gate
from .python_loop import Loop
from .worker import serve

_TIMEOUT = 0.01
_PATIENCE = 10.0


def _start(interface: str) -> kickcat.Bus:
    """Slaves in OP."""
    link = kickcat.create_link(interface, "")
    link.set_timeout(_TIMEOUT)
    bus = kickcat.Bus(link)
    bus.init(0.0)  # no watchdogs: others have their turns, too
    bus.create_mapping()
    bus.request_state(kickcat.State.SAFE_OP)
    bus.wait_for_state(kickcat.State.SAFE_OP, _PATIENCE)
    for slave in bus.slaves():
        slave.set_output_bytes(bytes(slave.output_size))
    bus.request_state(kickcat.State.OPERATIONAL)
    bus.wait_for_state(kickcat.State.OPERATIONAL, _PATIENCE, bus.process_data)
    return bus


def main() -> None:
    """Starts the slaves, then measures on command."""
    bus = _start(sys.argv[1])

    def exchange() -> bool:
        try:
            bus.process_data()
        except RuntimeError:  # a working counter is wrong
            return False
        return True

    serve({"ready": True}, Loop(exchange, Gate()).run)


if __name__ == "__main__":
    main()
