"""The scan: which slaves there are, and the station address of each.

Station addresses are 0x1001 and up in the order on the wire, as SOEM gives them. Slaves are counted
by a broadcast read, whose working counter each of them raises, and found by their position
(auto-increment addresses, ETG.1000.4). With two interfaces the relay does that over both, so a
broken ring is numbered as a whole one.
"""

from __future__ import annotations

import struct

from ecatd.model.errors import StateError

from .datagrams import Datagrams, aprd, apwr, brd, bwr

_FIRST_STATION = 0x1001
_STATION_ADDRESS, _AL_CONTROL, _AL_STATUS = 0x0010, 0x0120, 0x0130
_TRIES = 3

_RESET = (
    (_AL_CONTROL, b"\x11\x00"),  # INIT, errors acknowledged
    (0x0103, bytes(1)),  # DL control: no addressing by alias
    (_STATION_ADDRESS, bytes(2)),  # else a slave of an earlier bus could share its address
    (0x0800, bytes(128)),  # 16 sync managers
    (0x0980, bytes(2)),  # no SYNC signals, controlled by the master
)
"""What all slaves are told before they are numbered; register and data."""


def count_slaves(registers: Datagrams) -> int:
    """How many slaves answer."""
    # A copy that is lost on a broken ring makes the answer too small.
    return max(registers.exchange([brd(_AL_STATUS, 2)])[0].wkc for _ in range(_TRIES))


def has_stations(registers: Datagrams, count: int) -> bool:
    """Whether the first `count` slaves on the wire have their station addresses."""
    wanted = [(struct.pack("<H", station), 1) for station in stations(count)]
    places = [aprd(place, _STATION_ADDRESS, 2) for place in range(count)]
    # On a broken ring a frame that comes back late is taken for one that was lost, and the slaves
    # behind the break are counted from 0 then: that is seen by the next look.
    return any(registers.exchange(places) == wanted for _ in range(_TRIES))


def number_slaves(registers: Datagrams, count: int) -> None:
    """Resets all slaves, asks them for INIT, and gives them their station addresses.

    Raises:
        StateError: Slaves come and go meanwhile, or frames get lost.
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
    """The station addresses of so many slaves."""
    return range(_FIRST_STATION, _FIRST_STATION + count)
