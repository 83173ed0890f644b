"""Checks what this user may do."""

from __future__ import annotations

import grp
import os
import resource
from collections.abc import Iterator

from ecatd.model.errors import JOIN
from ecatd.paths import control_socket, search_dirs

from .costs import COSTS
from .findings import Finding, Level


def look_at_rights(bus: str) -> Iterator[Finding]:
    """What this user may do."""
    yield _membership(bus)
    area = "this user"
    for name, number, least, line, cost in (
        ("real time", resource.RLIMIT_RTPRIO, 98, "@ecat - rtprio 98", str(COSTS["priority"])),
        ("locked memory", resource.RLIMIT_MEMLOCK, 1 << 28, "@ecat - memlock unlimited", ""),
    ):
        soft = resource.getrlimit(number)[0]
        if os.geteuid() == 0 or soft == resource.RLIM_INFINITY or soft >= least:
            yield Finding(area, name, Level.OK, "granted")
        else:
            text = (
                f"limit {soft}: an ecatd that this user starts does not get it, but the service "
                "does"
            )
            remedy = f"a line '{line}' in /etc/security/limits.conf, then log in again"
            yield Finding(area, name, Level.HINT, text, remedy, cost=cost)


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
        return Finding(
            area, name, Level.HINT, "the group 'ecat' does not exist", "install the service"
        )
    if member:
        return Finding(area, name, Level.OK, "member of the group 'ecat'")
    return Finding(area, name, Level.PROBLEM, "not a member of the group 'ecat'", JOIN)
