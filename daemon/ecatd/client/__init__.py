"""Clients of the daemon.

`Client` reads and writes the process image in shared memory; `docs/process-image.md` has examples.
`ecatd.client.remote.Remote` sends requests over Zenoh; it is not imported from here, so that
programs that only use shared memory need not load Zenoh. All names are imported on first use, so
that commands that only send requests need not load the shared memory.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecatd.shm.contract import Direction, Outputs, Reason, Validity, WkcState

    from .claims import Claim
    from .client import Client
    from .group import SignalGroup, Summaries
    from .info import DomainInfo, OutputInfo, Owner, SlaveInfo, Summary
    from .requests import Request
    from .signals import Signal

_HOME = {
    **dict.fromkeys(
        ("Direction", "Outputs", "Reason", "Validity", "WkcState"), "ecatd.shm.contract"
    ),
    "Claim": ".claims",
    "Client": ".client",
    "SignalGroup": ".group",
    **dict.fromkeys(("DomainInfo", "OutputInfo", "Owner", "SlaveInfo", "Summary"), ".info"),
    "Request": ".requests",
    "Signal": ".signals",
    "Summaries": ".group",
}

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
    "Summaries",
    "Summary",
    "Validity",
    "WkcState",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name], __name__), name)
