"""The operation for the bus description."""

from __future__ import annotations

from ecatd.description.bus import Domain, Slave

from .operation import Map, Operation


class BusDescription(Map):
    """The bus as it was set up at the start."""

    #: 16 hex digits that change with the identities, the order or the PDOs of the slaves.
    fingerprint: str
    name: str  #: Name of the bus.
    cycle_time_us: int  #: Base cycle in microseconds.
    slaves: list[Slave]  #: Slaves by position.
    domains: list[Domain]  #: Domains by number; empty if there is only domain 0.


class Describe(Operation[BusDescription]):
    """Asks for the bus description. Only a reload changes it, in limits of outputs."""

    op = "describe"
    key = "ro/slaves"
