"""AL states that a user asks for, and what becomes of a slave that refuses."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

RIG = Path(__file__).parents[1] / "rigs" / "boot.py"
WITHOUT_MAILBOX, WITHOUT_BOOT, BOOTABLE, PRETENDER, TIRED = range(5)


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared(str(RIG))


def states(daemon: Daemon) -> list[str]:
    return [row["text"] for row in daemon.slave_rows("state")]


def refused(daemon: Daemon, *arguments: str) -> str:
    result = daemon.ctl("state", *arguments, "--yes", check=False)
    assert result.returncode == 7
    return one_line_error(result.stderr, "ecatctl")


@pytest.mark.parametrize("position", [WITHOUT_MAILBOX, WITHOUT_BOOT])
def test_boot_is_not_asked_for_where_there_is_none(daemon: Daemon, position: int) -> None:
    name, before = ("EL2008", "EL3008")[position], len(daemon.log)
    said = refused(daemon, str(position), "BOOT")
    names(said, f"slave {position} ({name})", "BOOT", "EEPROM", "mailbox", "0x14", "0x17")
    wait_for(lambda: states(daemon) == 5 * ["OP"], daemon)
    after = daemon.log[before:].splitlines()
    assert not [line for line in after if f"slave {position} " in line and "ERROR" in line]


def test_boot_of_all_slaves_is_not_asked_for_where_one_has_none(daemon: Daemon) -> None:
    names(refused(daemon, "BOOT"), "slaves 0-1, 4", "BOOT", "EEPROMs")
    wait_for(lambda: states(daemon) == 5 * ["OP"], daemon)


def test_boot_is_reached_and_left_from_and_to_op(daemon: Daemon) -> None:
    daemon.ctl("state", str(BOOTABLE), "BOOT", "--yes")
    wait_for(lambda: states(daemon) == ["OP", "OP", "BOOT", "OP", "OP"], daemon)
    text = daemon.ctl("sdo-read", str(BOOTABLE), "0x1018", "1", check=False).stderr
    names(text, f"slave {BOOTABLE}", "BOOT", "PREOP")
    daemon.ctl("state", str(BOOTABLE), "PREOP", "--yes")
    assert daemon.ctl("sdo-read", str(BOOTABLE), "0x1018", "1").stdout.startswith("0x00000002")
    daemon.ctl("state", str(BOOTABLE), "BOOT", "--yes")
    daemon.ctl("state", str(BOOTABLE), "OP")
    wait_for(lambda: states(daemon) == 5 * ["OP"], daemon)


@pytest.mark.long
def test_a_slave_that_refuses_boot_is_in_op_again(daemon: Daemon) -> None:
    text = refused(daemon, str(PRETENDER), "BOOT")
    names(text, "slave 3 (EL3008)", "BOOT", "INIT+ERROR", "AL status 0x0013")
    wait_for(lambda: states(daemon) == 5 * ["OP"], daemon)


def test_a_slave_that_refuses_stays_where_it_was_without_an_error(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon(str(RIG))
    daemon.ctl("state", str(TIRED), "PREOP", "--yes")
    text = refused(daemon, str(TIRED), "SAFEOP")
    assert "slave 4 (EL2008)" in text
    assert "AL status 0x001D" in text
    wait_for(lambda: states(daemon) == ["OP", "OP", "OP", "OP", "PREOP"], daemon)


def test_a_slave_that_refuses_op_keeps_its_reason(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIG))
    daemon.ctl("state", str(TIRED), "PREOP", "--yes")
    refused(daemon, str(TIRED), "OP")
    wait_for(lambda: bool(re.search(r"slave 4 \(EL2008\) .*0x001D", daemon.log)), daemon)
    assert states(daemon)[TIRED].startswith("PREOP+ERROR (AL status 0x001D")


def test_nobody_waits_for_a_slave_without_power(start_daemon: Callable[..., Daemon]) -> None:
    """It is named at once, and a request for all slaves brings the others there."""
    daemon = start_daemon(str(RIG), config="state_timeout_s = 60.0\n[gateway]\nlisten = []\n")
    daemon.ctl("state", str(BOOTABLE), "PREOP", "--yes")
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_off(TIRED)
    wait_for(lambda: states(daemon)[TIRED] == "no answer", daemon)
    for arguments in ((str(TIRED), "OP"), ("OP",)):
        text = refused(daemon, *arguments)
        names(text, "slave 4 (EL2008)", "no answer", "switched off", "`ecatctl check`")
        assert "within" not in text, "it has waited"
    assert states(daemon) == [*(4 * ["OP"]), "no answer"]
