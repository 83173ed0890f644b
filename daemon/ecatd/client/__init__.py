"""Clients of the daemon.

`Client` reads and writes the process image in shared memory; `docs/clients.md` has an example.
`ecatd.client.remote.Remote` sends requests over Zenoh; it is not imported from here, so that
programs that only use shared memory need not load Zenoh.
"""

from .shared_memory import Client, DomainInfo, Signal, SlaveInfo

__all__ = ["Client", "DomainInfo", "Signal", "SlaveInfo"]
