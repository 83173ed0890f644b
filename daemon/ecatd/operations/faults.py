"""What is wrong with the exchange of a bus, its interfaces, cables, drives or CAN buses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

WORKING_COUNTER, LOST, LATE, UNSENT = "working_counter", "lost", "late", "unsent"
EXCHANGE = (UNSENT, LOST, LATE, WORKING_COUNTER)
"""Kinds of faults of the exchange, causes before consequences."""
CABLE = "cable"
"""The kind of fault of a cable that is much worse than it was."""
DRIVE = "drive"
"""The kind of fault that a drive itself reports."""
CAN = "can"
"""The kind of fault of a CAN bus behind a terminal."""
RECORDER = "recorder"
"""The kind of fault of a condition of the flight recorder that is not used."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that is wrong now."""

    #: One of `EXCHANGE`; or what is wrong with an interface: `link`, `sending`, `mtu`, `duplex`,
    #: `speed`, `bridge`, `vlan`, `ring`, `foreign_master`; `clock`; `CABLE`; `DRIVE`; `CAN`;
    #: or `RECORDER`.
    kind: str
    text: str  #: What is wrong, why, and what to do.
    since: float = 0.0  #: Unix time in seconds since which it is so.
    domain: int | None = None  #: Number of the domain; None if it is not about one.
    interface: str = ""  #: Name of the interface; empty if it is not about one.
    share: float = 0.0  #: Share of the exchanges that it spoils, 0 to 1.
    #: Whether no exchange succeeds while it is so, whatever spoils the others.
    none_succeeds: bool = False
    slaves: tuple[int, ...] = ()  #: Positions of the slaves that explain it.
    #: Whether no frame can come back because of it, so that nothing is known of slaves.
    blinds: bool = False

    @property
    def stops(self) -> bool:
        """Whether no exchange succeeds because of it."""
        return self.blinds or self.none_succeeds

    def to_map(self) -> dict[str, Any]:
        """The fault as the bus server tells it."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {**found, "slaves": list(self.slaves)}

    @staticmethod
    def of(row: Mapping[str, Any]) -> Fault:
        """The fault that `to_map` has made a map of."""
        return Fault(**{**row, "slaves": tuple(row["slaves"])})
