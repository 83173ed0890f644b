"""The scan: counts the slaves, and gives each its station address.

Station addresses are 0x1001 and up, in the order on the wire, as SOEM assigns them. A broadcast
read counts the slaves: each adds one to the working counter. Slaves without a station address are
addressed by their position (auto-increment addressing, ETG.1000.4). With two interfaces the relay
sends such frames over both, so the slaves of a broken ring get the same numbers as those of a
closed one.
"""

from __future__ import annotations

import struct
import time

from ecatd.base.errors import StateError
from ecatd.base.timeouts import Timeout

from .datagrams import Datagrams, aprd, apwr, brd, bwr

_FIRST_STATION = 0x1001
_STATION_ADDRESS, _AL_CONTROL, _AL_STATUS = 0x0010, 0x0120, 0x0130
_TRIES = 3
FIRST_ANSWER = Timeout(2.0)
"""Time that the first slave has to answer."""

_RESET = (
    (_AL_CONTROL, b"\x11\x00"),  # INIT, errors acknowledged
    (0x0103, bytes(1)),  # DL control: no addressing by alias
    (_STATION_ADDRESS, bytes(2)),  # else a slave of an earlier bus could share its address
    (0x0800, bytes(128)),  # 16 sync managers
    (0x0980, bytes(2)),  # no SYNC signals, controlled by the master
)
"""Register and data of each write to all slaves before they are numbered."""


def count_slaves(registers: Datagrams) -> int:
    """Counts the slaves that answer a broadcast read.

    If none answers, it asks again for up to 2 s, because a busy machine delays frames.
    """
    deadline = time.monotonic() + FIRST_ANSWER.seconds
    while True:
        # On a broken ring, a lost copy of the frame makes the count too small.
        count = max(registers.exchange([brd(_AL_STATUS, 2)])[0].wkc for _ in range(_TRIES))
        if count or time.monotonic() > deadline:
            return count


def has_stations(registers: Datagrams, count: int) -> bool:
    """Whether the first `count` slaves on the wire have the station addresses of `stations`."""
    wanted = [(struct.pack("<H", station), 1) for station in stations(count)]
    places = [aprd(place, _STATION_ADDRESS, 2) for place in range(count)]
    # On a broken ring, a frame that comes back late counts as lost, and the relay then counts the
    # slaves after the break from 0. The next try corrects such a wrong answer.
    return any(registers.exchange(places) == wanted for _ in range(_TRIES))


def number_slaves(registers: Datagrams, count: int) -> None:
    """Resets all slaves, requests INIT, and writes their station addresses.

    Raises:
        StateError: The addresses cannot be verified: slaves come or go, or frames get lost.
    """
    for _ in range(_TRIES):
        registers.exchange([bwr(register, data) for register, data in _RESET])
        registers.exchange(
            [
                apwr(place, _STATION_ADDRESS, struct.pack("<H", station))
                for place, station in enumerate(stations(count))
            ]
        )
        answers = registers.read_all(stations(count), _STATION_ADDRESS, 2)
        alone = all(answer.wkc == 1 for answer in answers)  # else two slaves have one address
        if alone and has_stations(registers, count) and count_slaves(registers) == count:
            return
    raise StateError(
        f"{count} slaves cannot be numbered: slaves come and go meanwhile, or frames get lost; is "
        f"the connection reliable, and is there no other master?"
    )


def stations(count: int) -> range:
    """Returns the station addresses of `count` slaves."""
    return range(_FIRST_STATION, _FIRST_STATION + count)
