"""Asks slaves for their explicit device identification, as of a rotary switch (ETG.1020).

A slave tells it in one of two ways (SII category general, ETG.1000.6):

- On request (AL control, bit 5) it sets bit 5 of its AL status, and gives the identification in
  place of the AL status code. A slave that does not know the request only repeats its state.
- It has it at an address of its ESC, often among its inputs.

The request keeps the state of the slave, but it writes AL control: it must reach only the slave
that is meant. So slaves are asked at their station addresses.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterable, Mapping

from ecatd.model.al import AL_ERROR_FLAG
from ecatd.model.bus import Slave
from ecatd.model.config import Config, SlaveConfig
from ecatd.model.sii import Sii

from .datagrams import Datagrams, fprd, fpwr

_AL_CONTROL, _AL_STATUS, _STATE = 0x0120, 0x0130, 0x0F
_IDENTIFY = 0x20
"""AL control: asks for the identification. AL status: the AL status code is the identification."""

_PATIENCE_S = 0.5
_PAUSE_S = 0.001


def ask_identifications(
    registers: Datagrams, ways: Mapping[int, int], patience_s: float = _PATIENCE_S
) -> dict[int, int]:
    """Asks slaves for their identifications, all at the same time; blocks.

    Args:
        registers: The way to the slaves.
        ways: By station address, the address in the ESC of the slave where its identification is;
            0: it is asked for it.
        patience_s: Seconds that slaves have to tell it.

    Returns:
        Identifications by station address. Slaves that have none, or 0, are left out.
    """
    direct = [station for station, register in ways.items() if register]
    answers = registers.exchange([fprd(station, ways[station], 2) for station in direct])
    found = {
        station: int.from_bytes(answer.data, "little")
        for station, answer in zip(direct, answers, strict=True)
        if answer.wkc == 1
    }
    asked = [station for station, register in ways.items() if not register]
    keep = {}  # AL control that keeps the state; an error is acknowledged, else nothing is heard
    for station, (status, _) in _status(registers, asked).items():
        acknowledge = status & AL_ERROR_FLAG
        keep[station] = status & _STATE | acknowledge
    _control(registers, {station: state | _IDENTIFY for station, state in keep.items()})
    waiting, deadline = set(keep), time.monotonic() + patience_s
    while waiting and time.monotonic() < deadline:
        for station, (status, code) in _status(registers, waiting).items():
            if status & _IDENTIFY:
                waiting.discard(station)
                found[station] = 0 if status & AL_ERROR_FLAG else code
        time.sleep(_PAUSE_S)
    _control(registers, keep)
    told, deadline = set(keep) - waiting, time.monotonic() + patience_s
    while told and time.monotonic() < deadline:  # their AL status is as before from then on
        now = _status(registers, told)
        told = {station for station, (status, _) in now.items() if status & _IDENTIFY}
    return {station: value for station, value in found.items() if value}


def _status(registers: Datagrams, stations: Iterable[int]) -> dict[int, tuple[int, int]]:
    """AL status and AL status code of the slaves that answer."""
    chosen = list(stations)
    answers = registers.exchange([fprd(station, _AL_STATUS, 6) for station in chosen])
    return {
        station: struct.unpack("<H2xH", answer.data)
        for station, answer in zip(chosen, answers, strict=True)
        if answer.wkc == 1 and answer.data[0] & _STATE
    }


def _control(registers: Datagrams, wanted: Mapping[int, int]) -> None:
    registers.exchange(
        [fpwr(station, _AL_CONTROL, struct.pack("<H", bits)) for station, bits in wanted.items()]
    )


def ways_to_ask(config: Config, found: Iterable[tuple[Slave, Sii]]) -> dict[int, int]:
    """How to ask the slaves that say that they have an identification, or that should.

    Slaves of which the EEPROM says nothing are asked only if the configuration may mean them.

    Returns:
        By position, the address in the ESC; 0: the slave is asked. See `ask_identifications`.
    """
    wanted = [item for item in config.slave if item.identification is not None]
    ways = {}
    for slave, sii in found:
        meant = [one for one in wanted if _may_be(one, slave)]
        register = max((one.identification_register or 0 for one in meant), default=0)
        register = register or sii.identification_register
        if meant or register or sii.tells_identification:
            ways[slave.position] = register
    return ways


def _may_be(wanted: SlaveConfig, slave: Slave) -> bool:
    if wanted.product is None:
        return True
    return (wanted.vendor, wanted.product) == (slave.vendor, slave.product)
