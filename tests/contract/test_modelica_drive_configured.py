"""The drive block with drives whose parameters the daemon keeps, so that models repeat none."""

import ctypes
from collections.abc import Callable
from pathlib import Path

import pytest
from drive_calls import Mode, Player, State, build, generic, settings

from conftest import Daemon, wait_for
from ecatsim.control import Simulator

ROOT = Path(__file__).parents[2]
TROLL = (ROOT / "examples" / "troll" / "troll.toml").read_text()
WHEEL, FORGETFUL = 0, 1
RIG = """
name = "forgetful"
[[slave]]
device = "ElmoGold"
[[slave]]
device = "CiA402"
parameters = { forgetful = true }
"""
LIST = """
[[slave]]
position = 1
name = "axis"
[[slave.startup]]
object = "0x6072:00"
type = "uint16"
value = 1500
"""

Calls = Callable[[Daemon], ctypes.CDLL]


@pytest.fixture
def calls(tmp_path: Path, compiler: str) -> Calls:
    """The calls of the drive block, for the library that is generated for a daemon."""

    def calls(daemon: Daemon) -> ctypes.CDLL:
        daemon.ctl("generate", "Plant", str(tmp_path))
        return build(tmp_path, compiler, tmp_path)

    return calls


def without_power(daemon: Daemon, slave: int) -> None:
    """Takes the power from a slave until everybody has noticed, and gives it back."""
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_off(slave)
        with daemon.client() as client:
            wait_for(lambda: client.slaves()[slave].al_state == 0, daemon)
        rig.faults.power_on(slave)


def test_the_example_for_the_test_stand(start_daemon: Callable[..., Daemon], calls: Calls) -> None:
    daemon = start_daemon("troll", config=TROLL)
    with Player(calls(daemon), daemon.bus, WHEEL, settings(Mode.CYCLIC_VELOCITY)) as player:
        player.reference = lambda time: 3.0
        player.enable()
        player.until(lambda: abs(player.a.w - 3.0) < 0.05)
        without_power(daemon, WHEEL)
        player.disable()
        player.enable()
        player.until(lambda: abs(player.a.w - 3.0) < 0.05)
        player.disable()
    rows = daemon.ctl_json("startup", "verify")["parameters"]
    assert len(rows) == 5
    assert {row["result"] for row in rows} == {"as configured"}
    assert daemon.ctl_json("sdo-read", "wheel", "0x6083", "0")["value"] == 2_000_000


@pytest.mark.long
def test_a_drive_that_forgets_its_parameters(
    start_daemon: Callable[..., Daemon], calls: Calls, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    daemon = start_daemon(str(rig))
    library = calls(daemon)
    with Player(library, daemon.bus, FORGETFUL, generic(Mode.CYCLIC_VELOCITY)) as player:
        player.set(enable=True)
        player.until(lambda: player.a.state == State.FAULT)
        assert daemon.ctl_json("sdo-read", "1", "0x603F", "0")["value"] == 0x6320
    assert daemon.stop() == 0
    daemon = start_daemon(str(rig), config=LIST)
    with Player(library, daemon.bus, FORGETFUL, generic(Mode.CYCLIC_VELOCITY)) as player:
        player.reference = lambda time: 3.0
        for _ in range(2):
            player.enable()
            player.until(lambda: abs(player.a.w - 3.0) < 0.05)
            player.disable()
            without_power(daemon, FORGETFUL)
