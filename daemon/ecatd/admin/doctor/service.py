"""Checks what runs: a bus and its gateway, their versions, and shared memory."""

from __future__ import annotations

import grp
import os
import pwd
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from ecatd.base.errors import EcatError, NotPermittedError, UnreachableError
from ecatd.base.paths import control_socket, search_dirs, takes_connections
from ecatd.base.version import VERSION
from ecatd.linux.systemd_services import (
    gateway,
    how_to_start,
    other_version,
    service,
    why_no_gateway,
    why_not_running,
)
from ecatd.shm.files import MEMORY, folders, problem
from ecatd.shm.statistics import read

from .findings import Area, Finding

_AREA = Area("service")
_PACKAGES = ("pysoem", "eclipse-zenoh", "msgpack", "jinja2")
_ROOM_MIB = 64
_OWNER = "start ecatd as root, or its service: it puts the directory right, or says what hinders it"


def look_at_service(bus: str) -> Iterator[Finding]:
    """Checks whether a bus of this machine and its gateway run, and have what they need."""
    yield from _bus_and_gateway(bus)
    yield from _accounts()


def _bus_and_gateway(bus: str) -> Iterator[Finding]:
    name = f"bus {bus}"
    try:
        running = read(bus).version
    except UnreachableError as error:
        if advice := why_not_running(bus):
            yield _AREA.problem(name, advice.text, advice.remedy)
        else:  # nothing says that it should run on this machine
            yield _AREA.hint(name, str(error), how_to_start(bus))
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


def look_at_shared_memory() -> Iterator[Finding]:
    """Checks free room and leftovers in /dev/shm."""
    area = Area("shared memory")
    state = os.statvfs(MEMORY)
    free = state.f_bavail * state.f_frsize >> 20
    text = f"{free} MiB free in {MEMORY}"
    if free < _ROOM_MIB:
        remedy = f"remove what fills it: `du -a {MEMORY}`"
        yield area.problem("room", text, remedy)
    else:
        yield area.ok("room", text)
    for text in filter(None, map(problem, folders())):
        yield area.problem("owner", text, _OWNER)
    for file in sorted(file for folder in folders() for file in folder.glob("*.out")):
        bus = file.stem
        if not any(os.path.exists(control_socket(folder, bus)) for folder in search_dirs()):  # noqa: PTH110
            text = f"{file} is left over from bus '{bus}', whose ecatd was killed"
            remedy = "the next start of the bus replaces it; or remove it"
            yield area.hint("left over", text, remedy)


def look_at_versions(bus: str) -> Iterator[Finding]:
    """Checks the versions of ecatd, of the packages that it needs, and of the running daemon."""
    area = Area("versions")
    found = [f"ecatd {VERSION}"]
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            remedy = "install ecatd again with pip"
            yield area.problem(name, "it is not installed", remedy)
    yield area.ok("installed", ", ".join(found))
    with suppress(EcatError):
        if advice := other_version(bus, read(bus).version):
            yield area.hint("running", advice.text, advice.remedy)
