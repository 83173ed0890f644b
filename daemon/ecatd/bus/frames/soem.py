"""SOEM's scan, through pysoem: the first look at a bus. The only module that knows pysoem.

SOEM resets the slaves, gives them station addresses and learns their names. It opens the interfaces
itself and closes them again, before anything else of ours is on the wire. What it has found is
checked by `scan.py`, which numbers the slaves where SOEM cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pysoem

from ecatd.model.errors import NotPermittedError

from .interface import look, needs_rights

SLAVES_MAX = 199
"""The most slaves that SOEM has room for."""

_TOO_MANY = -4
"""What `config_init` returns for more."""

_TRIES = 3
_ANSWER_US = 20_000
"""What SOEM takes for an answer is whatever comes with one of its 16 indices. So it must not send a
frame again while the first one may still come, which on a busy machine can take a while."""


def scan(interfaces: Sequence[str]) -> list[str]:
    """Has SOEM scan the interfaces: one, or two with cable redundancy.

    Returns:
        The names of the slaves, in their order on the wire; empty if SOEM finds none, or more than
        `SLAVES_MAX`. Slaves have station addresses then, and are in INIT.

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
    # SOEM would ask for PREOP by itself; the state machine is ours.
    master.manual_state_change = 1
    try:
        master.open(*answering)
    except ConnectionError as error:
        raise NotPermittedError(needs_rights(answering[0])) from error
    try:
        for _ in range(_TRIES):  # a machine that is busy for a moment is no reason to give it up
            count = master.config_init()
            if count > 0:
                return [_name(slave) for slave in master.slaves]
            if count == _TOO_MANY:
                break
        return []
    finally:
        master.close()


def _answering(interfaces: Sequence[str]) -> list[str]:
    """The interfaces at which slaves answer.

    SOEM waits for each frame at both interfaces; where one is dead, the scan of 8 slaves takes
    seconds. On a closed ring frames come back at the other interface, so that neither seems to
    answer.
    """
    found = [name for name in interfaces if look(name).wkc]
    return found or (list(interfaces) if len(interfaces) > 1 else [])


def _name(slave: Any) -> str:
    try:
        return str(slave.name)
    except UnicodeDecodeError:
        return ""  # pysoem insists on UTF-8; the SII reader takes Latin-1
