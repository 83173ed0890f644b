"""A slave loses its power during the start: as if it had been absent, or were lost later."""

from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, run_module, wait_for
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = 'name = "machine"\n' + "".join(
    f'[[slave]]\ndevice = "{kind}"\n' for kind in ("EK1100", "EL1008", "CiA402")
)
SLOW = '[[fault]]\nkind = "mailbox"\nslave = 2\nmode = "slow"\ndelay_s = 0.05\n'
PARAMETER = '[[slave.startup]]\nobject = "0x6065:00"\ntype = "uint32"\nvalue = 4321\n'
CONFIG = """
state_timeout_s = 5.0
[gateway]
listen = []
[log]
start = "debug"
[recovery]
retry_s = 0.5
[expected]
description = "DESCRIPTION"
unlisted = false
[[slave]]
position = 0
vendor = 2
product = 0x044C2C52
[[slave]]
position = 1
vendor = 2
product = 0x03F03052
[[slave]]
position = 2
name = "axis"
vendor = 0xFFFF
product = 0x402
MORE
"""

AT_ONCE = '[[fault]]\nkind = "power-off"\nslave = 2\nat_cycle = 1\n'
"""With the first process data: the slaves are in PREOP, and on their way to SAFEOP."""

Start = Callable[..., Daemon]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    """Starts a daemon, and switches slave 2 off once it is told a parameter."""

    def start(more: str, parameter: str = 400 * PARAMETER, fault: str = SLOW) -> Daemon:
        file, description = tmp_path / "rig.toml", tmp_path / "full.json"
        file.write_text(RIG)
        run_module("ecatd.cli", "scan", "--from", str(file), "-o", str(description))
        file.write_text(RIG + fault)
        text = CONFIG.replace("DESCRIPTION", str(description)).replace("MORE", more)
        daemon = start_daemon(str(file), config=text + parameter, ready=False)
        if fault == AT_ONCE:
            return daemon
        wait_for(lambda: "start-up parameter 0x6065:00" in daemon.log, daemon)
        with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
            rig.faults.power_off(2)
            rig.faults.mailbox(2, "none")
        return daemon

    return start


def states(daemon: Daemon) -> list[str]:
    return [row["text"] for row in daemon.ctl_json("state")["slaves"]]


@pytest.mark.long
def test_an_optional_slave_comes_later(start: Start) -> None:
    daemon = start("optional = true").wait_ready()
    names(daemon.log, "slave 2 (axis, CiA402) answered at first", "power")
    assert "restart ecatd" not in daemon.log
    assert states(daemon) == ["OP", "OP", "no answer"]
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_on(2)
    wait_for(lambda: states(daemon) == ["OP"] * 3, daemon)


@pytest.mark.long
def test_a_tolerated_slave_keeps_nobody_from_op(start: Start) -> None:
    daemon = start('policy = "tolerant"').wait_ready()
    names(daemon.log, "not as expected", "axis is missing")
    assert states(daemon) == ["OP", "OP", "no answer"]


@pytest.mark.long
def test_a_slave_that_must_be_there_is_named(start: Start) -> None:
    status, log = start("").wait_end()
    assert status == 7
    names(one_line_error(log, "ecatd"), "axis is missing", "slave 2", "check its power")


BEFORE_OP = 400 * f'{PARAMETER}transition = "SO"\n'
"""Told in SAFEOP, before OP."""


@pytest.mark.long
def test_an_optional_slave_that_is_lost_on_the_way_to_op_comes_later(start: Start) -> None:
    daemon = start("optional = true", BEFORE_OP).wait_ready()
    names(daemon.log, "slave 2 (axis, CiA402) answered at first", "goes on without it")
    names(daemon.log, "2 slaves (and 1 optional, absent)")
    assert "slave count changed" not in daemon.log
    row = daemon.slave_rows("state")[2]
    assert (row["text"], row["recovery"]) == ("no answer", "absent")
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.mailbox(2, "none")
        rig.faults.power_on(2)
    wait_for(lambda: states(daemon) == ["OP"] * 3, daemon)
    assert daemon.ctl_json("sdo-read", "axis", "0x6065")["value"] == 4321


@pytest.mark.long
def test_a_tolerated_slave_that_is_lost_on_the_way_to_op_is_recovered(start: Start) -> None:
    daemon = start('policy = "tolerant"', "", AT_ONCE).wait_ready()
    names(daemon.log, "slave 2 (axis, CiA402) answered at first", "2 slaves (and 1 missing)")
    wait_for(lambda: "slave count changed from 3 to 2" in daemon.log, daemon)
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_on(2)
    wait_for(lambda: states(daemon) == ["OP"] * 3, daemon)


@pytest.mark.long
def test_a_strict_slave_that_is_lost_on_the_way_to_op_is_named(start: Start) -> None:
    status, log = start("", "", AT_ONCE).wait_end()
    assert status == 7
    said = one_line_error(log, "ecatd")
    names(said, "slave 2 (axis, CiA402)", "no longer", "power", 'policy = "tolerant"')
