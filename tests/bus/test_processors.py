"""Which processors the threads of the daemon use."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from conftest import Daemon

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

MODULES = ("ecatd.server", "ecatd.gateway", "ecatsim")


def threads(pid: int) -> dict[int, tuple[str, set[int]]]:
    """Name and processors of each thread of a process, by its number."""
    found = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # it ends meanwhile
            number = int(task.name)
            found[number] = (task / "comm").read_text().strip(), os.sched_getaffinity(number)
    return found


def of(daemon: Daemon) -> tuple[dict[str, set[int]], list[set[int]]]:
    """Processors of the threads of the bus server that have names, and of all others."""
    named: dict[str, set[int]] = {}
    others = []
    for pid in (daemon.process.pid, *(daemon.child_pid(module) for module in MODULES)):
        for name, processors in threads(pid).values():
            if name.startswith("ecat-"):
                named[name] = processors
            else:
                others.append(processors)
    return named, others


def config(cpu: int) -> str:
    return f"[gateway]\nlisten = []\n[realtime]\ncpu = {cpu}\n"


def test_the_processor_of_the_engine_is_left_to_it(start_daemon: Callable[..., Daemon]) -> None:
    every = os.sched_getaffinity(0)
    if len(every) < 2:
        pytest.skip("there is one processor only")
    cpu = max(every)
    named, others = of(start_daemon("line:2", config=config(cpu)))
    assert named == {
        "ecat-cyclic": {cpu},
        "ecat-relay": every - {cpu},
        "ecat-wake": every - {cpu},
        "ecat-worker": every - {cpu},
    }
    assert others
    assert all(processors == every - {cpu} for processors in others)


def test_without_one_all_are_used(start_daemon: Callable[..., Daemon]) -> None:
    every = os.sched_getaffinity(0)
    named, others = of(start_daemon("line:2", config=config(-1)))
    assert set(named) == {"ecat-cyclic", "ecat-relay", "ecat-wake", "ecat-worker"}
    assert all(processors == every for processors in (*named.values(), *others))


def test_the_only_processor_is_shared(start_daemon: Callable[..., Daemon]) -> None:
    cpu = min(os.sched_getaffinity(0))
    daemon = start_daemon(
        "line:2", config=config(cpu), preexec=lambda: os.sched_setaffinity(0, {cpu})
    )
    named, others = of(daemon)
    assert all(processors == {cpu} for processors in (*named.values(), *others))
    assert "CPU (" not in daemon.log, "nothing was refused"
