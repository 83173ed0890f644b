"""A slave loses its power while it is told its start-up parameters: as if it had been absent."""

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

Start = Callable[[str], Daemon]


@pytest.fixture
def start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Start:
    """Starts a daemon, and switches slave 2 off once it is told a parameter."""

    def start(more: str) -> Daemon:
        file, description = tmp_path / "rig.toml", tmp_path / "full.json"
        file.write_text(RIG)
        run_module("ecatd.cli", "scan", "--from", str(file), "-o", str(description))
        file.write_text(RIG + SLOW)
        text = CONFIG.replace("DESCRIPTION", str(description)).replace("MORE", more)
        daemon = start_daemon(str(file), config=text + 400 * PARAMETER, ready=False)
        wait_for(lambda: "start-up parameter 0x6065:00" in daemon.log, daemon)
        with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
            rig.faults.power_off(2)
            rig.faults.mailbox(2, "none")
        return daemon

    return start


def states(daemon: Daemon) -> list[str]:
    return [row["text"] for row in daemon.ctl_json("state")["slaves"]]


def test_an_optional_slave_comes_later(start: Start) -> None:
    daemon = start("optional = true").wait_ready()
    names(daemon.log, "slave 2 (axis, CiA402) answered at first", "power")
    assert "restart ecatd" not in daemon.log
    assert states(daemon) == ["OP", "OP", "no answer"]
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_on(2)
    wait_for(lambda: states(daemon) == ["OP"] * 3, daemon)


def test_a_tolerated_slave_keeps_nobody_from_op(start: Start) -> None:
    daemon = start('policy = "tolerant"').wait_ready()
    names(daemon.log, "not as expected", "axis is missing")
    assert states(daemon) == ["OP", "OP"]


def test_a_slave_that_must_be_there_is_named(start: Start) -> None:
    status, log = start("").wait_end()
    assert status == 7
    names(one_line_error(log, "ecatd"), "axis is missing", "slave 2", "check its power")
