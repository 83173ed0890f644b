"""Checks what this user may do."""

from __future__ import annotations

import grp
import os
import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import JOIN, EcatError
from ecatd.base.namespaces import is_root
from ecatd.base.paths import control_socket, search_dirs
from ecatd.base.process import CAP_NET_ADMIN
from ecatd.shm.real_time import SETTINGS
from ecatd.shm.statistics import read as read_statistics

from .findings import Area, Finding
from .settings import read

_AREA = Area("this user")

_FOR_FRAMES = {"CAP_NET_RAW": 13, "CAP_NET_ADMIN": CAP_NET_ADMIN}
"""What a daemon on an interface needs, with the numbers of capabilities(7)."""


def service_group() -> int | None:
    """The group of the service; None if it is not installed."""
    try:
        return grp.getgrnam("ecat").gr_gid
    except KeyError:
        return None


def look_at_rights(bus: str) -> Iterator[Finding]:
    """What this user may do."""
    yield _membership(bus)
    yield _raw_frames()
    yield from _real_time_of(bus)
    for name, number, least, line, cost in (
        ("real time", resource.RLIMIT_RTPRIO, 98, "@ecat - rtprio 98", "priority"),
        ("locked memory", resource.RLIMIT_MEMLOCK, 1 << 28, "@ecat - memlock unlimited", ""),
    ):
        soft = resource.getrlimit(number)[0]
        if is_root() or soft == resource.RLIM_INFINITY or soft >= least:
            yield _AREA.ok(name, "granted")
        else:
            text = (
                f"limit {soft}: an ecatd that this user starts does not get it, but the service "
                "does"
            )
            remedy = f"a line '{line}' in /etc/security/limits.conf, then log in again"
            yield _AREA.hint(name, text, remedy, cost=cost)


def _real_time_of(bus: str) -> Iterator[Finding]:
    """What the daemon that runs now has asked for and did not get."""
    with suppress(EcatError):  # it does not run
        for grant in read_statistics(bus).grants:
            if grant.wanted and grant.error:
                words = SETTINGS[grant.setting]
                why = os.strerror(grant.error)
                text = f"refused to the ecatd that runs ({why}): {words.without}"
                yield Area("real time").hint(words.title, text, words.how)


def _raw_frames() -> Finding:
    """Whether an ecatd that this user starts by hand may use an interface."""
    lines = read(Path("/proc/self/status")).splitlines()
    effective = next(int(line.split()[1], 16) for line in lines if line.startswith("CapEff:"))
    missing = [cap for cap, bit in _FOR_FRAMES.items() if not effective >> bit & 1]
    if not missing:
        return _AREA.ok("raw frames", "granted")
    text = (
        f"no {' and no '.join(missing)}: an ecatd that this user starts cannot use an interface, "
        "but the service can"
    )
    return _AREA.hint("raw frames", text, "start the service, or start ecatd with sudo")


def _membership(bus: str) -> Finding:
    name = "use of the bus"
    if is_root():
        return _AREA.ok(name, "root may do everything")
    reachable = any(os.access(control_socket(folder, bus), os.W_OK) for folder in search_dirs())
    if reachable:
        return _AREA.ok(name, "may write outputs and send requests")
    group = service_group()
    if group is None:
        return _AREA.hint(
            name,
            "the group 'ecat' does not exist",
            "install the service: `ecatctl service install`",
        )
    if group in os.getgroups():
        return _AREA.ok(name, "member of the group 'ecat'")
    return _AREA.problem(name, "not a member of the group 'ecat'", JOIN)
