"""Texts about the real-time settings: what each one does, and how to have it granted."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from ecatd.base.namespaces import is_root
from ecatd.base.notify import is_managed
from ecatd.linux.systemd_services import service

from .contract import Setting


@dataclass(frozen=True, slots=True)
class Words:
    """Texts about one real-time setting.

    Attributes:
        title: Its name.
        value: Its value in words; `{}` stands for the number.
        with_it: What it does or costs when it is granted.
        without: What may happen without it.
        how: How to have it granted.
    """

    title: str
    value: str
    with_it: str
    without: str
    how: str


SETTINGS = {
    Setting.SCHEDULING: Words(
        "SCHED_FIFO",
        "priority {}",
        "runs before all ordinary programs",
        "cycles are late when others are busy",
        "needs CAP_SYS_NICE, or RLIMIT_RTPRIO of at least the priority: the service has it; when "
        "you start ecatd yourself, use sudo, or add the line '@ecat - rtprio 98' to "
        "/etc/security/limits.conf",
    ),
    Setting.AFFINITY: Words(
        "CPU",
        "{}",
        "stays on its CPU; best an isolated one",
        "may move between CPUs, at some µs each",
        "set realtime.cpu to a CPU that exists and that the service may use (CPUAffinity=, "
        "AllowedCPUs= in the unit)",
    ),
    Setting.MEMORY: Words(
        "locked memory",
        "yes",
        "the bus server is never swapped out",
        "a page fault may cost a cycle",
        "needs CAP_IPC_LOCK, or RLIMIT_MEMLOCK without limit: the service has it; when you start "
        "ecatd yourself, use sudo, or 'ulimit -l unlimited'",
    ),
    Setting.TIMER_SLACK: Words(
        "timer slack",
        "{} ns",
        "timers end on time",
        "up to 50 µs late without SCHED_FIFO",
        "prctl(PR_SET_TIMERSLACK) was refused: see the system calls that the unit allows "
        "(SystemCallFilter=)",
    ),
    Setting.DMA_LATENCY: Words(
        "DMA latency",
        "{} µs",
        "CPUs sleep lightly, and need more power",
        "CPUs sleep deeply, wake 1 to 200 µs late",
        "needs the right to write /dev/cpu_dma_latency: run as root, or give the file to the "
        "group of the service (udev rule); in the unit DeviceAllow=/dev/cpu_dma_latency rw",
    ),
    Setting.BUSY_RECEIVE: Words(
        "busy receive",
        "yes",
        "one core is always busy",
        "each exchange takes some µs more",
        "set realtime.busy_receive, and give the engine a CPU of its own (realtime.cpu)",
    ),
}

_OF_LIMITS = {Setting.SCHEDULING: "--rtprio=98", Setting.MEMORY: "--memlock=unlimited"}
"""Settings that a process gets by a limit, with the option of prlimit(1)."""
_NO_RIGHT = (errno.EPERM, errno.EACCES, errno.ENOMEM, errno.ENOENT)
"""Errors for lack of rights: ENOMEM if more memory would be locked than the limit allows, ENOENT
if a container does not have the device."""


class Refused(Protocol):
    """A setting that the system has refused."""

    @property
    def setting(self) -> Setting:
        """Which one."""

    @property
    def value(self) -> int:
        """The value asked for."""

    @property
    def error(self) -> int:
        """The errno."""


def warnings(refused: Iterable[Refused], bus: str) -> Iterator[str]:
    """Warnings of a start: one for all that rights are missing for, one for each other mistake.

    Args:
        refused: The settings that were refused.
        bus: Name of the bus.
    """
    lacking = []
    for grant in refused:
        words = SETTINGS[grant.setting]
        if grant.error in _NO_RIGHT:
            lacking.append(grant.setting)
        else:
            yield (
                f"no real time: {words.title} ({words.value.format(grant.value)}) was refused "
                f"({os.strerror(grant.error)}): {words.how}"
            )
    if lacking:
        *first, last = (SETTINGS[setting].title for setting in lacking)
        those = f"{', '.join(first)} and {last}" if first else last
        yield (
            f"no real time: the system refuses {those}: cycles may be late; {_remedy(lacking, bus)}"
            f"'ecatctl doctor' says more"
        )


def _remedy(lacking: list[Setting], bus: str) -> str:
    """The command that mends it."""
    if is_managed():
        return f"a change of the unit takes it away: 'systemctl cat {service(bus)}'; "
    options = [option for setting, option in _OF_LIMITS.items() if setting in lacking]
    if not options:
        return ""
    if is_root():
        return "in a container: start it with '--cap-add=SYS_NICE --cap-add=IPC_LOCK'; "
    return f"'sudo prlimit --pid $$ {' '.join(options)}' in this shell, then start again; "
