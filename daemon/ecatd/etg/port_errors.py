"""Error counters of slaves, and the links that they are about (ETG.1000.4, registers 0x0300 on).

A slave that receives a damaged frame counts it at the port where it came in, and marks the frame.
Slaves behind it count the mark as a forwarded error. So `invalid` and `physical` of a port are
about the link that ends there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

PORT_ORDER = (0, 3, 1, 2)
"""Ports in the order in which a slave forwards a frame."""

MOST = 0xFF
"""The maximum of a counter, at which it stops."""


class PortErrors(NamedTuple):
    """One port of a slave, and its counters.

    Attributes:
        port: Its number, 0 to 3.
        invalid: Invalid frames that it received.
        physical: Errors of the physical layer.
        forwarded: Errors that an earlier slave had found already.
        lost_links: How often the link was lost.
        to: Position and port at the other end of the link; -1 for the master; None if there is no
            link now, or if it is not known where it leads.
    """

    port: int
    invalid: int
    physical: int
    forwarded: int
    lost_links: int
    to: tuple[int, int] | None = None

    @staticmethod
    def of(port: int, counts: Iterable[int], to: tuple[int, int] | None) -> PortErrors:
        """Makes it of its `counts`."""
        invalid, physical, forwarded, lost_links = counts
        return PortErrors(port, invalid, physical, forwarded, lost_links, to)

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The counters, in the order of the attributes."""
        return self.invalid, self.physical, self.forwarded, self.lost_links

    @property
    def damaged(self) -> int:
        """How many errors are about the link that ends here."""
        return self.invalid + self.physical


class SlaveErrors(NamedTuple):
    """The counters of a slave.

    Attributes:
        position: Its position.
        ports: Those of its ports, by number.
        processing: Errors of the processing unit: frames that are not EtherCAT, or malformed.
        pdi: Errors of the process data interface.
        since: Unix time at which ecatd cleared them; None if it has not: they count from power-on,
            or since another program cleared them.
    """

    position: int
    ports: list[PortErrors]
    processing: int
    pdi: int
    since: float | None = None

    @property
    def text(self) -> str:
        """The counters that are not 0, in words; empty if all are."""
        names = ("invalid", "physical", "forwarded", "lost links")
        parts = [
            f"port {port.port}: {count} {name}"
            for port in self.ports
            for name, count in zip(names, port.counts, strict=True)
            if count
        ]
        whole = (("processing", self.processing), ("PDI", self.pdi))
        parts += [f"{count} {name}" for name, count in whole if count]
        return f"slave {self.position}: {', '.join(parts)}" if parts else ""

    def to_map(self) -> dict[str, Any]:
        """The counters as a map, for replies and JSON."""
        return {**self._asdict(), "ports": [port._asdict() for port in self.ports]}

    @staticmethod
    def from_map(data: Mapping[str, Any]) -> SlaveErrors:
        """Makes it of what `to_map` has returned."""
        ports = [
            PortErrors(**{**port, "to": port["to"] and tuple(port["to"])}) for port in data["ports"]
        ]
        return SlaveErrors(data["position"], ports, data["processing"], data["pdi"], data["since"])


class LinkErrors(NamedTuple):
    """A link with errors.

    Attributes:
        ends: Position and port at both ends, that on the side of the master first; position -1 for
            the master, or None if it is not known.
        invalid: Invalid frames, at both ends.
        physical: Errors of the physical layer, at both ends.
        lost_links: How often the link was lost.
        full: Whether a counter has reached its maximum, so that there may have been more errors.
    """

    ends: tuple[tuple[int, int] | None, tuple[int, int]]
    invalid: int
    physical: int
    lost_links: int
    full: bool


def links_with_errors(slaves: Iterable[SlaveErrors]) -> Iterator[LinkErrors]:
    """Yields the links with errors, each once, in the order of the wire."""
    ports = {(item.position, port.port): port for item in slaves for port in item.ports}
    for end, port in ports.items():
        other = port.to if port.to in ports else None
        if other is not None and other < end and ports[other].to == end:
            continue  # the other end has reported it
        both = [port, *([ports[other]] if other is not None else [])]
        lost = max(item.lost_links for item in both)
        if any(item.damaged for item in both) or lost:
            yield LinkErrors(
                (port.to, end) if other is None else (end, other),
                sum(item.invalid for item in both),
                sum(item.physical for item in both),
                lost,
                any(MOST in item.counts for item in both),
            )
