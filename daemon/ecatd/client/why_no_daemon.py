"""Finds out why no daemon of this machine serves a bus, and what to do about it."""

from __future__ import annotations

import os
from typing import Any

from ecatd.base.errors import EcatError, NoAnswerError, UnreachableError
from ecatd.base.failure_record import find_record
from ecatd.base.paths import search_dirs, served_buses, takes_connections
from ecatd.linux.systemd_services import (
    how_to_start,
    other_version,
    service,
    why_no_gateway,
    why_not_running,
)
from ecatd.shm import contract as shm
from ecatd.shm.files import exists
from ecatd.shm.reader import opened
from ecatd.shm.statistics import read

_HANG_S = 1.0
"""Seconds without a cycle after which the daemon counts as hung."""


def has_shared_memory(bus: str) -> bool:
    """Whether shared memory of a bus exists, even if it is left over from a daemon that is gone."""
    return exists(bus)


def awaits_gateway(bus: str) -> bool:
    """Whether a bus runs on this machine, so that its gateway is started if it does not run."""
    try:
        with opened(bus) as shared:
            return shared.alive and shared.header().state == shm.BusState.RUNNING
    except EcatError:
        return False


def why_no_daemon(bus: str) -> EcatError:
    """Why no gateway of this machine answers for a bus."""
    if has_shared_memory(bus):
        try:
            with opened(bus) as shared:
                if shared.alive:
                    return _without_gateway(bus, shared.header())
        except UnreachableError as error:  # it is still starting
            record = find_record(bus)
            return UnreachableError(f"{error}; {record}") if record else error
        except EcatError as error:
            return error
    others = _running()
    hint = f" (running: {', '.join(others)}; choose one with --bus)" if others else ""
    advice = why_not_running(bus)
    why = f": {advice.text}; {advice.remedy}" if advice else f"; {how_to_start(bus)}"
    return UnreachableError(f"bus '{bus}' is not running{hint}{why}")


def _without_gateway(bus: str, header: Any) -> EcatError:
    """Returns the error for a daemon that runs without its gateway."""
    if header.state == shm.BusState.STOPPING:
        return UnreachableError(f"the daemon of bus '{bus}' is stopping")
    silence = read(bus).silence
    if silence > _HANG_S:
        return NoAnswerError(
            f"the daemon of bus '{bus}' hangs: there has been no cycle for {silence:.0f} s; "
            f"'systemctl restart {service(bus)}'"
        )
    silent = f"the gateway of bus '{bus}' does not answer"
    if advice := why_no_gateway(bus):
        return UnreachableError(f"{silent}: {advice.text}, while the bus runs on; {advice.remedy}")
    if advice := other_version(bus, shm.printable(header.version)):
        return UnreachableError(f"{silent}: {advice.text}; {advice.remedy}")
    if takes_connections(bus):
        return NoAnswerError(
            f"{silent}, though it is there: it is busy, or hangs. Then ecatd starts another one by "
            "itself, while the bus runs on: try again in some seconds"
        )
    return UnreachableError(
        f"{silent}; ecatd starts it again by itself, while the bus runs on: try again in some "
        f"seconds. After --no-gateway, start it with 'ecatd --only-gateway --bus {bus}'"
    )


def _running() -> list[str]:
    found: list[str] = []
    for folder in search_dirs():
        if os.access(folder, os.R_OK | os.X_OK):
            found += served_buses(folder)
    return found
