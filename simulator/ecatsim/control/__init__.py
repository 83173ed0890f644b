"""Controls running simulators from another process, over a Unix socket.

A simulator listens on a socket of its user. A client sends one JSON document per line and gets one
back for each:

    {"schema": 1, "command": "break-link", "arguments": {"slave": 3, "at_cycle": 1000}}
    {"schema": 1, "result": {"id": 1}}

The commands are the faults (`ecatsim.faults`) and the requests of `ecatsim.control.requests`.
"""

from .client import Simulator
from .server import Server
from .status import SlaveStatus, Status

__all__ = ["Server", "Simulator", "SlaveStatus", "Status"]
