"""The operation for the bus description."""

from __future__ import annotations

from ecatd.description.bus import Domain, Slave

from .operation import Map, Operation


class BusDescription(Map):
    """The bus as it was set up at the start.

    Attributes:
        fingerprint: 16 hex digits that change with the identities, the order or the PDOs of the
            slaves.
        name: Name of the bus.
        cycle_time_us: Base cycle in microseconds.
        slaves: Slaves by position.
        domains: Domains by number; empty if there is only domain 0.
    """

    fingerprint: str
    name: str
    cycle_time_us: int
    slaves: list[Slave]
    domains: list[Domain]


class Describe(Operation[BusDescription]):
    """Asks for the bus description. Only a reload changes it, in limits of outputs."""

    op = "describe"
    key = "ro/slaves"
