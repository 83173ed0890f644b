"""Checks by the shared memory of a bus whether another daemon serves it already."""

from __future__ import annotations

import os

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.file_locks import held
from ecatd.linux.systemd_services import service

from . import contract as shm
from .files import find


def check_free(bus: str) -> None:
    """Checks that no daemon serves a bus, as far as this user may open its shared memory.

    Raises:
        StateError: A daemon serves it.
    """
    try:
        fd, _ = find(bus)
    except (OSError, NotPermittedError, StateError):
        return  # there is none, or it is of somebody who is not believed
    try:
        if held(fd, shm.LOCK_DAEMON):
            raise already_served(bus, fd)
    finally:
        os.close(fd)


def already_served(bus: str, fd: int) -> StateError:
    """Returns the error for a bus that another daemon serves.

    Args:
        bus: Name of the bus.
        fd: File descriptor of its shared memory.
    """
    header = os.pread(fd, shm.size("ecat_shm_header"), 0)
    pid = ""  # unknown while that daemon is still starting
    if len(header) == shm.size("ecat_shm_header"):
        pid = f" (pid {shm.struct('ecat_shm_header').from_buffer_copy(header).pid})"
    return StateError(
        f"bus '{bus}' is already served by another ecatd{pid}; stop it first ('systemctl stop "
        f"{service(bus)}' if it is the service), or give this one another name with --bus"
    )
