"""A start without rights says in one line what is missing, and the command that mends it."""

import errno
import os

import pytest

from conftest import names
from ecatd.master.engine.engine import Grant
from ecatd.shm.contract import Setting
from ecatd.shm.real_time import warnings

REFUSED = [
    Grant(Setting.SCHEDULING, True, 80, errno.EPERM),
    Grant(Setting.MEMORY, True, 0, errno.ENOMEM),
    Grant(Setting.DMA_LATENCY, True, 0, errno.EACCES),
]


@pytest.mark.parametrize("manager", [True, False])
def test_all_that_rights_are_missing_for_is_one_line(
    manager: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    if manager:
        monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere")
    (line,) = warnings(REFUSED, "press")
    names(line, "SCHED_FIFO", "locked memory", "DMA latency", "'ecatctl doctor'")
    if manager:
        names(line, "'systemctl cat ecatd@press'")
    elif os.geteuid() == 0:
        names(line, "--cap-add=SYS_NICE")
    else:
        names(line, "sudo prlimit --pid $$ --rtprio=98 --memlock=unlimited")


def test_other_mistakes_are_told_for_themselves() -> None:
    wrong = Grant(Setting.AFFINITY, True, 1023, errno.EINVAL)
    first, second = warnings([wrong, *REFUSED], "ecat0")
    names(first, "CPU (1023)", "set realtime.cpu")
    names(second, "SCHED_FIFO")
    (alone,) = warnings(REFUSED[2:], "ecat0")
    assert "prlimit" not in alone
    assert not list(warnings([], "ecat0"))
