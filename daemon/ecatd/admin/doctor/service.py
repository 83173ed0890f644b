"""Checks whether a bus and its gateway run."""

from __future__ import annotations

import grp
import pwd
from collections.abc import Iterator

from ecatd.base.errors import EcatError, NotPermittedError, UnreachableError
from ecatd.base.paths import takes_connections
from ecatd.linux.systemd_services import (
    gateway,
    how_to_start,
    other_version,
    service,
    why_no_gateway,
    why_not_running,
)
from ecatd.shm.statistics import read

from .findings import Area, Finding

_AREA = Area("service")


def look_at_service(bus: str) -> Iterator[Finding]:
    """Checks whether a bus of this machine and its gateway run, and have what they need."""
    yield from _bus_and_gateway(bus)
    yield from _accounts()


def _bus_and_gateway(bus: str) -> Iterator[Finding]:
    name = f"bus {bus}"
    try:
        running = read(bus).version
    except UnreachableError:
        if advice := why_not_running(bus):
            yield _AREA.problem(name, advice.text, advice.remedy)
        else:  # nothing says that it should run on this machine
            yield _AREA.hint(name, "it is not running", how_to_start(bus))
        return
    except NotPermittedError:  # the rights of this user are checked, too
        return
    except EcatError as error:
        yield _AREA.problem(name, str(error), f"'systemctl restart {service(bus)}'")
        return
    yield _AREA.ok(name, "runs")
    advice = why_no_gateway(bus)
    if advice is None and takes_connections(bus):
        yield _AREA.ok("gateway", "runs")
    elif advice := advice or other_version(bus, running):
        yield _AREA.problem("gateway", advice.text, advice.remedy)
    else:
        remedy = f"'journalctl -u {gateway(bus)} -n 20', or the log of ecatd, says why"
        yield _AREA.problem("gateway", "it does not answer", remedy)


def _accounts() -> Iterator[Finding]:
    """Checks the users and groups of the service, since one of them may have been deleted."""
    missing, there = [], 0
    for kind, names, find in (
        ("user", ("ecatd", "ecatd-gateway"), pwd.getpwnam),
        ("group", ("ecat", "ecatd-gateway"), grp.getgrnam),
    ):
        for name in names:
            try:
                find(name)
                there += 1
            except KeyError:
                missing.append(f"{kind} '{name}'")
    if there and missing:
        what = "without it, systemd does not start the bus or its gateway"
        text = f"there is no {', no '.join(missing)}: {what}"
        yield _AREA.problem("users and groups", text, "`systemd-sysusers` as root makes them")
    elif there:
        yield _AREA.ok("users and groups", "they exist")
