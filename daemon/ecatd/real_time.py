"""Texts about the real-time settings: what each one does, and how to have it granted."""

from __future__ import annotations

from dataclasses import dataclass

from ecatd.shm import Setting


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
        "comes before all ordinary programs",
        "cycles are late when others are busy",
        "needs CAP_SYS_NICE, or RLIMIT_RTPRIO of at least the priority: the service has it; by "
        "hand use sudo, or a line '@ecat - rtprio 98' in /etc/security/limits.conf",
    ),
    Setting.AFFINITY: Words(
        "CPU",
        "{}",
        "stays on its CPU; best an isolated one",
        "may move between CPUs: some µs each time",
        "set realtime.cpu to a CPU that exists and that the service may use (CPUAffinity=, "
        "AllowedCPUs= in the unit)",
    ),
    Setting.MEMORY: Words(
        "locked memory",
        "yes",
        "the bus server is never swapped out",
        "a page fault may cost a cycle",
        "needs CAP_IPC_LOCK, or RLIMIT_MEMLOCK without limit: the service has it; by hand use "
        "sudo, or 'ulimit -l unlimited'",
    ),
    Setting.TIMER_SLACK: Words(
        "timer slack",
        "{} ns",
        "the timer rings when it should",
        "up to 50 µs later without SCHED_FIFO",
        "prctl(PR_SET_TIMERSLACK) was refused: see the system calls that the unit allows "
        "(SystemCallFilter=)",
    ),
    Setting.DMA_LATENCY: Words(
        "DMA latency",
        "{} µs",
        "no deep sleep of CPUs: power, heat",
        "CPUs sleep deeply: late by 1 to 200 µs",
        "needs the right to write /dev/cpu_dma_latency: run as root, or give the file to the "
        "group of the service (udev rule); in the unit DeviceAllow=/dev/cpu_dma_latency rw",
    ),
    Setting.BUSY_RECEIVE: Words(
        "busy receive",
        "yes",
        "one core is always busy",
        "some µs more for each exchange",
        "set realtime.busy_receive, and give the engine a CPU of its own (realtime.cpu)",
    ),
}
