"""Reads explicit device identifications, such as the positions of rotary switches (ETG.1020).

A slave has its identification in one of two places (SII category general, ETG.1000.6):

- In the register of the AL status code. On request (AL control, bit 5) the slave writes it there,
  and sets bit 5 of its AL status. A slave that does not support the request only repeats its state.
- At another address of its ESC, often among its inputs.

The request does not change the state of the slave, but it writes AL control, so it must reach this
slave only. Therefore requests use station addresses.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterable, Mapping

from ecatd.config import Config, SlaveConfig
from ecatd.description.bus import Slave
from ecatd.etg.al import AL_ERROR_FLAG
from ecatd.etg.sii import Sii

from .datagrams import Datagrams, fprd, fpwr

_AL_CONTROL, _AL_STATUS, _STATE = 0x0120, 0x0130, 0x0F
_IDENTIFY = 0x20
"""In AL control: the request. In AL status: the AL status code is the identification."""

_PATIENCE_S = 0.5
_PAUSE_S = 0.001


def ask_identifications(
    registers: Datagrams, ways: Mapping[int, int], patience_s: float = _PATIENCE_S
) -> dict[int, int]:
    """Reads the identifications of slaves, all at the same time; blocks.

    Args:
        registers: Access to the registers of the slaves.
        ways: By station address, the address of the identification in the ESC of the slave; 0 if
            the slave gives it on request.
        patience_s: Seconds that slaves have to answer the request.

    Returns:
        Identifications by station address, without the slaves that have none, or 0.
    """
    direct = [station for station, register in ways.items() if register]
    answers = registers.exchange([fprd(station, ways[station], 2) for station in direct])
    found = {
        station: int.from_bytes(answer.data, "little")
        for station, answer in zip(direct, answers, strict=True)
        if answer.wkc == 1
    }
    asked = [station for station, register in ways.items() if not register]
    # AL control that keeps the state. It acknowledges an error: else slaves ignore the request.
    keep = {}
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
    answered, deadline = set(keep) - waiting, time.monotonic() + patience_s
    while answered and time.monotonic() < deadline:  # until their AL status is as before again
        now = _status(registers, answered)
        answered = {station for station, (status, _) in now.items() if status & _IDENTIFY}
    return {station: value for station, value in found.items() if value}


def _status(registers: Datagrams, stations: Iterable[int]) -> dict[int, tuple[int, int]]:
    """Returns AL status and AL status code of the slaves that answer, by station address."""
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
    """Returns how to read the identifications of slaves that have one, or should have one.

    These are the slaves whose EEPROM mentions an identification, and those to which a table of the
    configuration with an identification may refer.

    Args:
        config: The configuration.
        found: The slaves that were found, with their EEPROMs.

    Returns:
        By position, the address in the ESC, or 0 for a request; see `ask_identifications`.
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
