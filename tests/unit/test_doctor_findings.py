"""What `ecatctl doctor` finds in the files of the kernel: each finding, well and not."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from conftest import names
from ecatd.admin.doctor.findings import Finding, Level
from ecatd.admin.doctor.interface import look_at, look_at_state
from ecatd.admin.doctor.processors import look_at_processors
from ecatd.linux.interface_state import InterfaceState

CPUS = "sys/devices/system/cpu"
CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"
DEEP = {
    f"{CPUS}/cpu0/cpuidle/state1/latency": "2",
    f"{CPUS}/cpu1/cpuidle/state1/latency": "2",
    f"{CPUS}/cpu1/cpuidle/state2/latency": "890",
}
"""Only the second processor sleeps deeply."""
STATE = InterfaceState("eth7", speed=100, duplex="full")
CARD = {
    "sys/class/net/eth7/device/msi_irqs/41": "msi",
    "sys/class/net/eth7/device/driver/name": "igb",
}

OK, HINT, PROBLEM = Level.OK, Level.HINT, Level.PROBLEM


def write(root: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{text}\n")
    return root


def only(found: list[Finding], name: str) -> Finding:
    (finding,) = [item for item in found if item.name == name]
    return finding


def check(finding: Finding, level: Level, *tokens: str) -> None:
    """Checks a finding; what is not well has a remedy."""
    assert (finding.level, bool(finding.remedy)) == (level, level != OK), finding
    names(f"{finding.text}; {finding.remedy}", *tokens)


@pytest.mark.parametrize(
    ("name", "files", "level", "tokens"),
    [
        ("kernel", {"sys/kernel/realtime": "1"}, OK, ["with PREEMPT_RT"]),
        ("CPU of the engine", {f"{CPUS}/isolated": "1"}, OK, ["CPU 1", "isolated"]),
        ("CPU of the engine", {}, HINT, ["CPU 1", "isolcpus=1"]),
        ("CPU of the engine", {f"{CPUS}/online": "0"}, PROBLEM, ["realtime.cpu is 1", "only 0"]),
        (
            "shared core",
            {f"{CPUS}/cpu1/topology/thread_siblings_list": "0-1"},
            HINT,
            ["CPU 1", "CPU 0"],
        ),
        ("frequency", {}, OK, ["fixed"]),
        ("frequency", {f"{CPUS}/cpu1/cpufreq/scaling_governor": "performance"}, OK, []),
        (
            "frequency",
            {f"{CPUS}/cpu1/cpufreq/scaling_governor": "powersave"},
            HINT,
            ["cpu1", "powersave", "scaling_governor"],
        ),
        ("sleep", {f"{CPUS}/cpu0/cpuidle/state1/latency": "2"}, OK, ["2 µs"]),
        ("sleep", DEEP, HINT, ["890 µs", "C-states"]),
        ("sleep", {**DEEP, f"{CPUS}/cpu1/cpuidle/state2/disable": "1"}, OK, ["2 µs"]),
        ("sleep", {**DEEP, "dev/cpu_dma_latency": ""}, OK, ["890 µs", "ecatd prevents"]),
        ("clock", {CLOCK: "tsc"}, OK, ["tsc"]),
        ("clock", {CLOCK: "hpet"}, HINT, ["hpet", "dmesg"]),
        ("share of real time", {"proc/sys/kernel/sched_rt_runtime_us": "950000"}, OK, ["95 %"]),
        ("irqbalance", {"proc/71/comm": "irqbalance"}, HINT, ["IRQBALANCE_BANNED_CPULIST=1"]),
        ("machine", {"proc/cpuinfo": "flags : sse hypervisor"}, HINT, ["virtual"]),
    ],
)
def test_processors(
    tmp_path: Path, name: str, files: dict[str, str], level: Level, tokens: list[str]
) -> None:
    root = write(tmp_path, {f"{CPUS}/online": "0-1", **files})
    check(only([*look_at_processors(1, None, root)], name), level, *tokens)


def test_what_is_not_there_is_not_found(tmp_path: Path) -> None:
    found = [*look_at_processors(1, None, write(tmp_path, {f"{CPUS}/online": "0-1"}))]
    assert not {item.name for item in found} & {"shared core", "irqbalance", "machine"}


def test_an_engine_without_a_processor_of_its_own(tmp_path: Path) -> None:
    root = write(tmp_path, {f"{CPUS}/online": "0-3", f"{CPUS}/isolated": "2"})
    check(
        only([*look_at_processors(None, None, root)], "CPU of the engine"),
        HINT,
        "4",
        "realtime.cpu = 2",
    )


@pytest.mark.parametrize(
    ("mode", "of_the_service", "level", "tokens"),
    [
        (0o660, True, OK, ["ecatd prevents"]),
        (0o600, True, HINT, ["may not write", "udevadm trigger"]),
        (0o660, False, HINT, ["may not write", "udevadm trigger"]),
        (0o666, False, OK, ["ecatd prevents"]),
    ],
)
def test_the_service_keeps_processors_awake_only_if_its_group_may(
    tmp_path: Path, mode: int, of_the_service: bool, level: Level, tokens: list[str]
) -> None:
    root = write(tmp_path, {**DEEP, "dev/cpu_dma_latency": ""})
    device = root / "dev/cpu_dma_latency"
    device.chmod(mode)
    group = device.stat().st_gid + (not of_the_service)
    check(only([*look_at_processors(1, group, root)], "sleep"), level, *tokens)


@pytest.mark.unprivileged
@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everything")
def test_a_user_who_may_not_keep_processors_awake(tmp_path: Path) -> None:
    root = write(tmp_path, {**DEEP, "dev/cpu_dma_latency": ""})
    (root / "dev/cpu_dma_latency").chmod(0o400)
    found = only([*look_at_processors(1, None, root)], "sleep")
    check(found, HINT, "may not write", "sudo")


@pytest.mark.parametrize(
    ("cpu", "where", "level", "tokens"),
    [
        (None, "0-3", OK, ["IRQ 41", "CPU 0-3"]),
        (2, "2", OK, ["IRQ 41", "CPU 2"]),
        (2, "0", HINT, ["IRQ 41", "CPU 0", "engine runs on CPU 2", "irq/41/smp_affinity_list"]),
    ],
)
def test_interrupts(
    tmp_path: Path, cpu: int | None, where: str, level: Level, tokens: list[str]
) -> None:
    root = write(tmp_path, {**CARD, "proc/irq/41/smp_affinity_list": where})
    found = only([*look_at_state(STATE, cpu, root)], "interrupts")
    check(found, level, *tokens)
    assert (found.change is not None) == (level == HINT)


@pytest.mark.parametrize(
    ("name", "state", "files", "level", "tokens"),
    [
        ("link", {}, {}, OK, ["100 Mbit/s"]),
        ("link", {"up": False, "carrier": False}, {}, OK, ["switched off"]),
        ("link", {"carrier": False, "speed": 0}, {}, PROBLEM, ["no carrier", "cable"]),
        ("link", {"speed": 1000}, {}, HINT, ["not an EtherCAT slave", "IN port"]),
        ("link", {"duplex": "half"}, {}, PROBLEM, ["half", "autoneg"]),
        ("bridge", {"master": "br0"}, {}, PROBLEM, ["nomaster"]),
        ("driver", {}, {}, OK, []),
        ("driver", {}, {"sys/class/net/eth7/wireless/x": ""}, PROBLEM, ["radio", "Ethernet port"]),
    ],
)
def test_cards(
    tmp_path: Path,
    name: str,
    state: dict[str, Any],
    files: dict[str, str],
    level: Level,
    tokens: list[str],
) -> None:
    root = write(tmp_path, CARD | files)
    found = [*look_at_state(replace(STATE, **state), None, root)]
    check(only(found, name), level, *tokens)


def test_a_virtual_interface() -> None:
    check(only([*look_at("lo", None)], "driver"), HINT, "virtual", "Ethernet port")
