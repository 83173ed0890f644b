"""SOEM's scan of a bus, through pysoem. This is the only module that uses pysoem.

SOEM resets the slaves, gives them station addresses and reads their names. It opens the interfaces
itself, and closes them before ecatd sends any other frame. `scan.py` checks the result, and
numbers the slaves itself if SOEM could not.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import pysoem

from ecatd.base.errors import NotPermittedError
from ecatd.base.process import CAP_NET_ADMIN, raised

from .interface import look, needs_rights

SLAVES_MAX = 199
"""The most slaves that SOEM has room for."""

_TOO_MANY = -4
"""The return value of `config_init` if there are more slaves."""

_TRIES = 3
_ANSWER_US = 20_000
"""Microseconds that SOEM waits for an answer. SOEM accepts any frame with one of its 16 indices.
So it must not repeat a frame while the first one may still come back: a busy machine delays it."""

_FIRST_ANSWER = 1.0
"""Seconds that the first slave has to answer, after the interface has a carrier."""


def scan(interfaces: Sequence[str]) -> list[str]:
    """Has SOEM scan the interfaces: one, or two with cable redundancy.

    Returns:
        The names of the slaves, in their order on the wire. The slaves then have station addresses
        and are in INIT. The list is empty if SOEM finds no slave, or more than `SLAVES_MAX`.

    Raises:
        UnreachableError: There is no such interface.
        NotPermittedError: The process may not use raw sockets.
    """
    answering = _answering(interfaces)
    if not answering:
        return []
    pysoem.settings.timeouts.ret = _ANSWER_US
    master = pysoem.Master()
    master.always_release_gil = True
    # Otherwise SOEM would request PREOP by itself. `Master` requests the states instead.
    master.manual_state_change = 1
    try:
        with raised(CAP_NET_ADMIN):  # SOEM sets flags of the interface
            master.open(*answering)
    except ConnectionError as error:
        raise NotPermittedError(needs_rights(answering[0])) from error
    try:
        for _ in range(_TRIES):  # the first may fail because the machine is busy for a moment
            count = master.config_init()
            if count > 0:
                return [_name(slave) for slave in master.slaves]
            if count == _TOO_MANY:
                break
        return []
    finally:
        master.close()


def _answering(interfaces: Sequence[str]) -> list[str]:
    """Returns the interfaces at which slaves answer.

    SOEM waits for each frame at both interfaces. If one is dead, a scan of 8 slaves takes seconds.
    On a closed ring, frames come back at the other interface, so no slave seems to answer at
    either. Then both are returned.
    """
    if len(interfaces) > 1:
        return [name for name in interfaces if look(name).wkc] or list(interfaces)
    deadline = time.monotonic() + _FIRST_ANSWER
    while not look(interfaces[0]).wkc:
        if time.monotonic() > deadline:
            return []
    return list(interfaces)


def _name(slave: Any) -> str:
    try:
        return str(slave.name)
    except UnicodeDecodeError:
        return ""  # pysoem decodes UTF-8 only; the SII reader decodes Latin-1
