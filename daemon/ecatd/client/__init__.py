"""Clients of the daemon.

`Client` reads and writes the process image in shared memory; `docs/process-image.md` has examples.
`ecatd.client.remote.Remote` sends requests over Zenoh; it is not imported from here, so that
programs that only use shared memory need not load Zenoh.
"""

from ecatd.shm import Direction, Outputs, Reason, Validity, WkcState

from .claims import Claim
from .client import Client
from .group import SignalGroup
from .info import DomainInfo, OutputInfo, Owner, SlaveInfo
from .requests import Request
from .signals import Signal

__all__ = [
    "Claim",
    "Client",
    "Direction",
    "DomainInfo",
    "OutputInfo",
    "Outputs",
    "Owner",
    "Reason",
    "Request",
    "Signal",
    "SignalGroup",
    "SlaveInfo",
    "Validity",
    "WkcState",
]
