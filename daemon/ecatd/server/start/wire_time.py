"""Computes the time that the frames of a cycle take on the wire, and whether they fit into it.

EtherCAT runs at 100 Mbit/s (ETG.1000.2), even if the master's interface is faster: 80 ns per byte.
Preamble, check sum and gap of each frame count, too (IEEE 802.3). The cycle with the longest time
must fit.

Dividers and phases determine which domains are due in the same cycle. Two domains meet in some
cycle if their phases differ by a multiple of the greatest common divisor of their dividers. Several
domains meet in a cycle if every two of them meet in some cycle (Chinese remainder theorem).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import gcd

from ecatd.base.errors import StateError
from ecatd.etg.frame_sizes import DATAGRAM_FRAMING, ETHERNET_MIN, FIRST_DATAGRAM
from ecatd.master.engine.process_image import (
    MAX_DOMAIN_DATAGRAMS,
    MAX_FRAMES,
    STATUS_BYTES,
    TIME_BYTES,
    DomainImage,
    Image,
    pack,
)

_NS_PER_BYTE = 80
_PREAMBLE, _CHECK_SUM, _GAP = 8, 4, 12
_SLAVE_DELAY_NS = 1000
"""Delay of a slave with MII ports, out and back: its processing unit once, its PHYs four times."""

_PATIENCE = 9, 10
"""Share of the cycle for which the engine waits for its frames: nine tenths."""

_WARNING = 8, 10
"""Share of the cycle above which there is a warning."""


@dataclass(frozen=True, slots=True)
class WireTime:
    """The frames of the longest cycle.

    Attributes:
        cycle_us: The base cycle in microseconds.
        frames: Number of frames.
        datagrams: Number of datagrams of domains.
        data_bytes: Bytes of process data in them.
        wire_bytes: All bytes, with headers, padding, preambles, check sums and gaps.
        delay_ns: Time of a bit through all slaves and back, in nanoseconds; twice this time if the
            cycle has a second turn (`Datagram.closes`).
        crowd: Numbers of the domains in this cycle that other phases could move to other cycles.
    """

    cycle_us: int
    frames: int
    datagrams: int
    data_bytes: int
    wire_bytes: int
    delay_ns: int
    crowd: tuple[int, ...] = ()

    @property
    def frames_us(self) -> float:
        """Time in which the master sends, in microseconds."""
        return self.wire_bytes * _NS_PER_BYTE / 1000

    @property
    def round_trip_us(self) -> float:
        """Time from the first bit sent to the last bit received, in microseconds."""
        return (self.wire_bytes * _NS_PER_BYTE + self.delay_ns) / 1000

    def shortest_cycle_us(self, share: tuple[int, int] = _PATIENCE) -> int:
        """Returns the shortest base cycle in µs in which the round trip takes at most `share`."""
        part, whole = share
        round_trip_ns = self.wire_bytes * _NS_PER_BYTE + self.delay_ns
        return -(-round_trip_ns * whole // (part * 1000))

    def check(self) -> str:
        """Checks that the frames fit into the cycle.

        Returns:
            A warning if there is little time left, else an empty text.

        Raises:
            StateError: They do not fit; the message has the numbers and the remedies.
        """
        sums = (
            f"{self.data_bytes} bytes of process data, {self.frames} "
            f"frame{'s' * (self.frames != 1)}, {self.wire_bytes} bytes with framing, are "
            f"{self.frames_us:.1f} µs on a wire of 100 Mbit/s"
        )
        trip = (
            f"{sums}, and the way through the slaves takes {self.delay_ns / 1000:.1f} µs: "
            f"{self.round_trip_us:.1f} µs"
        )
        remedy = f"set cycle_time_us to {self.shortest_cycle_us()} or more, or assign fewer PDOs"
        if self.crowd:
            remedy += (
                f", or give domains {', '.join(map(str, self.crowd))}, which share a cycle, "
                f"different phases"
            )
        cycle, round_trip = self.cycle_us, self.round_trip_us
        if self.frames_us > cycle:
            raise StateError(
                f"IO larger than the wire allows at this cycle: {sums}, but the cycle is "
                f"{cycle} µs; {remedy}"
            )
        if round_trip * _PATIENCE[1] > cycle * _PATIENCE[0]:
            raise StateError(
                f"cycle time too short for the bus: {trip}, more than nine tenths of the cycle "
                f"of {cycle} µs; {remedy}"
            )
        if round_trip * _WARNING[1] > cycle * _WARNING[0]:
            return (
                f"little room in the cycle of {cycle} µs: {trip}; late wake-ups will lose frames, "
                f"and mailbox traffic is slow; a cycle_time_us of "
                f"{self.shortest_cycle_us(_WARNING)} or more leaves a fifth free"
            )
        return ""


def wire_time(
    image: Image, cycle_us: int, slaves: int, *, clock: bool, delay_ns: int | None = None
) -> WireTime:
    """Computes the frames of the longest cycle of a bus.

    Args:
        image: The process image.
        cycle_us: The base cycle in microseconds.
        slaves: Number of slaves on the wire.
        clock: Whether each cycle distributes the time of a reference clock.
        delay_ns: Time of a bit through all slaves and back in nanoseconds, if it was measured.

    Raises:
        StateError: The engine has no room for so many frames or datagrams.
    """
    delay = slaves * _SLAVE_DELAY_NS if delay_ns is None else delay_ns
    times = []
    for domains in (image.domains, *_meetings(image.domains)):
        data = [item.length for domain in domains for item in domain.datagrams]
        own = [STATUS_BYTES, *([TIME_BYTES] if clock else [])]
        turns = [own + _lengths(domains, closes=False), _lengths(domains, closes=True)]
        frames = [[turn[number] for number in frame] for turn in turns for frame in pack(turn)]
        wire_bytes = sum(map(_on_wire, frames))
        delays = delay * sum(map(bool, turns))
        crowd = _crowd(domains)
        times.append(
            WireTime(cycle_us, len(frames), len(data), sum(data), wire_bytes, delays, crowd)
        )
    everything, *cycles = times
    if everything.frames > MAX_FRAMES or everything.datagrams > MAX_DOMAIN_DATAGRAMS:
        raise StateError(
            f"IO larger than the engine can exchange: {everything.data_bytes} bytes of process "
            f"data take {everything.datagrams} datagrams in {everything.frames} frames, but there "
            f"can be {MAX_DOMAIN_DATAGRAMS} in {MAX_FRAMES}: assign fewer PDOs"
        )
    return max(cycles, key=lambda time: time.round_trip_us)


def _lengths(domains: Iterable[DomainImage], *, closes: bool) -> list[int]:
    """Returns the bytes of the datagrams of one turn of a cycle."""
    datagrams = (item for domain in domains for item in domain.datagrams)
    return [item.length for item in datagrams if item.closes is closes]


def _meetings(domains: Sequence[DomainImage]) -> list[list[DomainImage]]:
    """Returns the groups of domains that meet in some cycle; no group is part of another one."""
    groups: set[tuple[int, ...]] = {()}
    for number, domain in enumerate(domains):
        met = {n for n in range(number) if _meet(domain, domains[n])}
        joined = {(*(n for n in group if n in met), number) for group in groups}
        groups = {group for group in groups if not met.issuperset(group)} | joined
    return [[domains[number] for number in group] for group in groups]


def _meet(one: DomainImage, other: DomainImage) -> bool:
    """Whether there are cycles in which both domains are due."""
    return (one.phase - other.phase) % gcd(one.divider, other.divider) == 0


def _crowd(domains: Sequence[DomainImage]) -> tuple[int, ...]:
    """Returns the numbers of those domains of a cycle that other phases could separate."""
    pairs = combinations(domains, 2)
    apart = {d.number for pair in pairs if gcd(*(d.divider for d in pair)) > 1 for d in pair}
    return tuple(sorted(apart))


def _on_wire(lengths: Sequence[int]) -> int:
    """Returns the bytes of a frame with these datagrams on the wire, with preamble and gap."""
    payload = sum(lengths) + len(lengths) * DATAGRAM_FRAMING
    return _PREAMBLE + max(FIRST_DATAGRAM + payload, ETHERNET_MIN) + _CHECK_SUM + _GAP
