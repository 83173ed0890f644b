"""Measures the time of a frame through all slaves and back, with the clock of the first slave.

A write to register 0x0900 makes a slave store the times at which this frame arrived at its ports
(ETG.1000.4, "DC - receive time port"). So the first slave has the time at which the frame came in,
and the time at which it came back from all other slaves.
"""

from __future__ import annotations

from ecatd.master.frames.datagrams import bwr
from ecatd.master.master import Master

_FEATURES, _HAS_CLOCK = 0x0008, 0x0004
_DL_STATUS = 0x0110
_PORT_TIMES = 0x0900
_TRIES = 3
_PORTS = range(1, 4)
_OWN_NS = 1000
"""Delay within the first slave itself, in its processing unit and PHY, on the way in and out."""

_LONGEST_NS = 1_000_000
"""Longer than any frame takes. A port that the frame did not pass has the time of an older frame,
which shows by this limit."""


def measure_round_trip(master: Master) -> int | None:
    """Returns the time of a frame through all slaves and back, in ns.

    Returns None if there is no slave, the first slave has no receive times, or frames get lost.

    Raises:
        StateError: The first slave does not answer.
    """
    if not master.wire:
        return None
    first, read = master.wire[0], master.register_read
    if not int.from_bytes(read(first, _FEATURES, 2), "little") & _HAS_CLOCK:
        return None
    for _ in range(_TRIES):
        (latch,) = master.registers.exchange([bwr(_PORT_TIMES, bytes(4))], repeat=False)
        if latch.wkc == 0:
            continue  # lost: at least the first slave, which has a clock, counts the frame
        status = int.from_bytes(read(first, _DL_STATUS, 2), "little")
        data = read(first, _PORT_TIMES, 16)
        times = [int.from_bytes(data[4 * port : 4 * port + 4], "little") for port in range(4)]
        # Two bits a port: loop closed, communication established.
        behind = [times[port] for port in _PORTS if status >> 8 + 2 * port & 3 == 2]
        spent = max((time - times[0] & 0xFFFFFFFF for time in behind), default=0)
        if spent < _LONGEST_NS:
            return spent + _OWN_NS
    return None
