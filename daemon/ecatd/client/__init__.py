"""Clients of the daemon: the process image in shared memory, and requests over Zenoh."""

from .shared_memory import Client, DomainInfo, Signal, SlaveInfo

__all__ = ["Client", "DomainInfo", "Signal", "SlaveInfo"]
