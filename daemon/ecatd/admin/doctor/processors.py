"""Checks kernel and processors for what makes a cycle late."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from .findings import Area, Finding
from .settings import Change, read

_CPUS = "sys/devices/system/cpu"
_AREA = Area("processors")
_DEEP_US = 50
"""A sleep from which a processor takes longer to wake up costs as much as a short cycle."""


def look_at_processors(
    cpu: int | None, group: int | None = None, root: Path = Path("/")
) -> Iterator[Finding]:
    """Findings about kernel and processors.

    Args:
        cpu: `realtime.cpu` of the configuration.
        group: The group of the service; None if there is no service.
        root: The folder with `sys`, `proc` and `dev`.
    """
    yield _kernel(root)
    yield from _engine_cpu(cpu, root / _CPUS)
    yield from _governor(root / _CPUS)
    yield _sleep(group, root)
    yield _clock(root)
    yield from _others(cpu, root / "proc")


def _kernel(root: Path) -> Finding:
    version = os.uname()
    if read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version.version:
        return _AREA.ok("kernel", f"{version.release}, with PREEMPT_RT")
    text = f"{version.release}, without PREEMPT_RT: drivers may delay a cycle by milliseconds"
    remedy = "Debian: `apt install linux-image-rt-amd64`; `ecatctl doctor --latency 60` measures it"
    return _AREA.hint("kernel", text, remedy)


def _engine_cpu(cpu: int | None, cpus: Path) -> Iterator[Finding]:
    online = _cpu_list(read(cpus / "online"))
    isolated = _cpu_list(read(cpus / "isolated"))
    if cpu is None:
        text = f"the engine has no CPU for itself (realtime.cpu); this machine has {len(online)}"
        best = max(isolated or online, default=0)
        remedy = f"set realtime.cpu = {best}" + ("" if isolated else f", and {_isolate(best)}")
        yield _AREA.hint("CPU of the engine", text, remedy, cost="cpu")
        return
    if cpu not in online:
        text = f"realtime.cpu is {cpu}, but there are only {read(cpus / 'online')}"
        yield _AREA.problem("CPU of the engine", text, "correct realtime.cpu")
        return
    if cpu in isolated:
        yield _AREA.ok("CPU of the engine", f"CPU {cpu}, isolated from the others")
    else:
        text = f"CPU {cpu}, which other programs use, too"
        remedy = f"{_isolate(cpu)}, or remove realtime.cpu"
        yield _AREA.hint("CPU of the engine", text, remedy, cost="cpu")
    twins = _cpu_list(read(cpus / f"cpu{cpu}/topology/thread_siblings_list")) - {cpu}
    if twins:
        text = f"CPU {cpu} shares its core with CPU {min(twins)}: they slow each other down"
        remedy = f"switch hyper-threading off, or isolate CPU {min(twins)}, too"
        yield _AREA.hint("shared core", text, remedy)


def _cpu_list(text: str) -> set[int]:
    """The numbers of a list such as `0-2,5`."""
    found: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        found.update(range(int(first), int(last or first) + 1))
    return found


def _isolate(cpu: int) -> str:
    return f"boot with isolcpus={cpu} nohz_full={cpu} rcu_nocbs={cpu}"


def _governor(cpus: Path) -> Iterator[Finding]:
    files = sorted(cpus.glob("cpu[0-9]*/cpufreq/scaling_governor"))
    slow = [file for file in files if read(file) != "performance"]
    if not slow:
        without = "the processors have a fixed frequency, or the host controls it"
        yield _AREA.ok("frequency", "performance" if files else without)
    for file in slow:
        cpu = file.parents[1].name
        text = f"{cpu} has the governor '{read(file)}': the processor is slow after a pause"
        change = Change(f"{cpu} governor", "performance")
        yield _AREA.hint("frequency", text, f"`echo performance >{file}`", change)


def _sleep(group: int | None, root: Path) -> Finding:
    latencies = [0]
    for state in (root / _CPUS).glob("cpu[0-9]*/cpuidle/state[0-9]*"):
        if read(state / "disable") != "1":
            latencies.append(int(read(state / "latency") or 0))
    deepest = max(latencies)
    if deepest <= _DEEP_US:
        return _AREA.ok("sleep", f"they wake up within {deepest} µs")
    device = root / "dev/cpu_dma_latency"
    text = f"they sleep so deeply that they take {deepest} µs to wake up"
    if not device.exists():
        remedy = "boot with intel_idle.max_cstate=1, or switch C-states off in the BIOS"
    elif _may_write(device, group):
        return _AREA.ok("sleep", f"{text}; ecatd prevents this while it runs")
    else:
        text += f"; ecatd cannot prevent this, because it may not write {device}"
        remedy = (
            "run ecatd as a service (`ecatctl service install`), or with sudo"
            if group is None
            else "`udevadm control --reload`, then `udevadm trigger --name-match=cpu_dma_latency`: "
            "a rule of the service gives the device to its group"
        )
    return _AREA.hint("sleep", text, remedy, cost="dma_latency_us")


def _may_write(device: Path, group: int | None) -> bool:
    """Whether the service may write a device, or this user if there is no service."""
    if group is None:
        return os.access(device, os.W_OK)
    status = device.stat()
    return bool(status.st_mode & (0o020 if status.st_gid == group else 0o002))


def _clock(root: Path) -> Finding:
    source = read(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source in ("hpet", "acpi_pm", "jiffies", "refined-jiffies"):
        text = f"{source}: reading the time takes a microsecond or more, instead of 20 ns"
        remedy = (
            "`dmesg` says why the kernel does not use the TSC; boot with tsc=reliable if the TSC "
            "is good"
        )
        return _AREA.hint("clock", text, remedy)
    return _AREA.ok("clock", source or "unknown")


def _others(cpu: int | None, proc: Path) -> Iterator[Finding]:
    runtime = read(proc / "sys/kernel/sched_rt_runtime_us")
    if runtime not in ("", "-1"):
        period = int(read(proc / "sys/kernel/sched_rt_period_us") or 1_000_000)
        share = 100 * int(runtime) // period
        text = f"real-time programs get {share} % of each second; enough unless busy_receive is set"
        yield _AREA.ok("share of real time", text)
    names = (read(path / "comm") for path in proc.glob("[0-9]*"))
    if cpu is not None and "irqbalance" in names:
        text = "irqbalance runs: it may move interrupts to the CPU of the engine"
        remedy = f"IRQBALANCE_BANNED_CPULIST={cpu} in /etc/default/irqbalance, or stop it"
        yield _AREA.hint("irqbalance", text, remedy)
    if "hypervisor" in read(proc / "cpuinfo").partition("\n\n")[0].split():
        text = "this is a virtual machine: its host decides when it runs"
        yield _AREA.hint("machine", text, "measure: `ecatctl doctor --latency 60`")
