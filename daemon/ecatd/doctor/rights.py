"""Looks at what this user may do."""

from __future__ import annotations

import grp
import os
import pwd
import resource
from collections.abc import Iterator

from ecatd.model.errors import JOIN
from ecatd.paths import control_socket, search_dirs

from .findings import Finding, Level


def look_at_rights(bus: str) -> Iterator[Finding]:
    """What this user may do."""
    yield _membership(bus)
    yield from _accounts()
    area = "this user"
    for name, number, least, line in (
        ("real time", resource.RLIMIT_RTPRIO, 98, "@ecat - rtprio 98"),
        ("locked memory", resource.RLIMIT_MEMLOCK, 1 << 28, "@ecat - memlock unlimited"),
    ):
        soft = resource.getrlimit(number)[0]
        if os.geteuid() == 0 or soft == resource.RLIM_INFINITY or soft >= least:
            yield Finding(area, name, Level.OK, "granted")
        else:
            text = f"limit {soft}: an ecatd that this user starts has none; the service has it"
            remedy = f"a line '{line}' in /etc/security/limits.conf, then log in again"
            yield Finding(area, name, Level.HINT, text, remedy)


def _accounts() -> Iterator[Finding]:
    """The users and groups of the service, of which one may have been deleted."""
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
        yield Finding(
            "service",
            "users and groups",
            Level.PROBLEM,
            text,
            "`systemd-sysusers` as root makes them",
        )
    elif there:
        yield Finding("service", "users and groups", Level.OK, "they exist")


def _membership(bus: str) -> Finding:
    area, name = "this user", "use of the bus"
    if os.geteuid() == 0:
        return Finding(area, name, Level.OK, "root may do everything")
    reachable = any(os.access(control_socket(folder, bus), os.W_OK) for folder in search_dirs())
    if reachable:
        return Finding(area, name, Level.OK, "may write outputs and send requests")
    try:
        member = grp.getgrnam("ecat").gr_gid in os.getgroups()
    except KeyError:
        return Finding(area, name, Level.HINT, "there is no group 'ecat'", "install the service")
    if member:
        return Finding(area, name, Level.OK, "member of the group 'ecat'")
    return Finding(area, name, Level.PROBLEM, "no member of the group 'ecat'", JOIN)
