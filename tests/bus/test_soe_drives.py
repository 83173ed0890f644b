"""Drives with SoE: telegrams become process data, IDNs are written at the start, axes move."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatd.client import Client
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 4000
CONTROL, VELOCITY, TORQUE = 134, 36, 80
STATUS, POSITION, SPEED = 135, 51, 40
RUN, IN_TORQUE = 0xE000, 0xC000
RIG = """
name = "servos"
[[slave]]
device = "EK1100"
[[slave]]
device = "SoeDrive"
parameters = { axes = 2 }
"""
CONFIG = """
[gateway]
listen = []
[[slave]]
position = 1
[[slave.idn]]
idn = "S-0-0016"
value = "S-0-0051, S-0-0040"
[[slave.idn]]
idn = "S-0-0091"
drive = 1
value = 200
[[slave.idn]]
idn = "S-0-0024"
drive = 1
hex = "04 00 04 00 24 00 50 00"
[[slave.idn]]
idn = "P-0-4000"
value = 1
optional = true
"""


@pytest.fixture
def rig(tmp_path: Path) -> str:
    file = tmp_path / "servos.toml"
    file.write_text(RIG)
    return str(file)


def telegrams(daemon: Daemon) -> list[tuple[int, list[tuple[int, int]]]]:
    slave = daemon.ctl_json("pdos", "1")["slaves"][0]
    return [
        (pdo["index"], [(entry["index"], entry["subindex"]) for entry in pdo["entries"]])
        for pdo in (*slave["outputs"], *slave["inputs"])
    ]


def turn(client: Client, axis: int, rpm: float) -> None:
    """Turns an axis at a speed until its drive says so."""
    client.signal(1, CONTROL, axis).raw = RUN
    client.signal(1, VELOCITY, axis).value = rpm
    at = client.signal(1, POSITION, axis).raw
    for _ in range(2000):
        client.commit()
        client.wait()
        client.sample()
        moved = client.signal(1, POSITION, axis).raw - at
        if client.signal(1, STATUS, axis).raw & IN_TORQUE == IN_TORQUE and moved > 100_000:
            return
    pytest.fail(f"axis {axis} does not turn")


def test_telegrams_are_process_data_and_the_axes_turn(
    start_daemon: Callable[..., Daemon], rig: str
) -> None:
    daemon = start_daemon(rig, config=CONFIG)
    wanted = [
        (0x0018, [(CONTROL, 0), (VELOCITY, 0)]),
        (0x1018, [(CONTROL, 1), (VELOCITY, 1), (TORQUE, 1)]),
        (0x0010, [(STATUS, 0), (POSITION, 0), (SPEED, 0)]),
        (0x1010, [(STATUS, 1), (POSITION, 1)]),
    ]
    assert telegrams(daemon) == wanted
    names(daemon.log, "slave 1 (SoeDrive)", "P-0-4000 = 1", "no such IDN", "optional")
    with (
        daemon.client() as client,
        Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
        client.claim(1, lease=30),
    ):
        assert client.signal(1, SPEED, 0).unit == "rpm"
        assert client.signal(1, VELOCITY, 1).name == "Velocity command value"
        turn(client, 0, 300)
        turn(client, 1, 500)  # S-0-0091 limits it to 200
        for _ in range(100):
            client.commit()
            client.wait()
            client.sample()
        assert client.signal(1, SPEED, 0).value == pytest.approx(300, rel=0.1)
        (limited,) = daemon.ctl_json("soe-read", "1", "S-0-0040", "--drive", "1")["idns"]
        assert limited["value"] == pytest.approx(200, rel=0.1)
        (speed,) = daemon.ctl_json("soe-read", "1", "S-0-0040")["idns"]
        assert speed["value"] == pytest.approx(300, rel=0.1)
        (elsewhere,) = daemon.ctl_json("soe-read", "1", "S-0-0047")["idns"]  # in no telegram
        assert elsewhere["value"] == 0
        assert elsewhere["data"] == "00000000"
        # The drive alone says where it is; the MDT has the velocity, and not the position.
        for idn, code in (("S-0-0051", "0x7004"), ("S-0-0036", "0x700A")):
            told = daemon.ctl("soe-write", "1", idn, "0", check=False)
            assert told.returncode == 7
            names(told.stderr, "slave 1", idn, code)
        daemon.ctl("soe-write", "1", "S-0-0047", "1234")
        assert daemon.ctl("soe-read", "1", "S-0-0047").stdout.startswith("1234 inc ")
        # It forgets its telegrams without power, and gets them again.
        simulator.faults.power_off(1)
        wait_for(lambda: "no answer" in str(daemon.slave_rows()), daemon)
        simulator.faults.power_on(1)
        wait_for(lambda: daemon.ctl("check", check=False).returncode == 0, daemon)
    assert telegrams(daemon) == wanted
    assert daemon.stop() == 0


ODD = """
from ecatsim import Rig
from ecatsim.devices.beckhoff import EK1100
from ecatsim.devices.soe_drive import SoeDrive

class Odd(SoeDrive):
    "It says of its position that it has 16 bits, and exchanges 32, as its EEPROM says."

    product, order = 0x5001, "Odd"

    def __init__(self):
        super().__init__()
        self.idns[0][51].attribute = 0x00110000

def rig():
    return Rig("odd", [EK1100(), Odd(), Odd()])
"""


def test_a_drive_and_its_eeprom_that_contradict_each_other(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "odd.py"
    rig.write_text(ODD)
    chosen = '[[slave]]\nposition = 2\npdo_source = "sii"\n'
    daemon = start_daemon(str(rig), config=f"[gateway]\nlisten = []\n{chosen}")
    what = "SoE places 0x0033:00 in 16 bits at bit 16, the EEPROM in 32 bits at bit 16"
    names(daemon.log, "slave 1 (Odd)", f"PDO 0x0010: {what}", "pdo_source")
    names(daemon.log, "slave 2 (Odd)", f"{what}; as configured, the EEPROM is believed")
    assert [row["state"] for row in daemon.slave_rows()] == ["OP", "PREOP", "OP"]
    with daemon.client() as client:
        assert client.signal(2, POSITION, 0).name == "Position feedback value 1"
    refused = tmp_path / "soe.toml"
    refused.write_text('[[slave]]\nposition = 0\npdo_source = "soe"\n')
    told = daemon.ctl("config", "check", str(refused), check=False)
    names(told.stdout + told.stderr, "slave 0 (EK1100)", "process data over SoE")
    assert daemon.stop() == 0


@pytest.mark.parametrize(
    ("table", "tokens"),
    [
        ('idn = "S-0-0091"\nvalue = 7000', "S-0-0091 = 7000 | larger than the maximum"),
        ('idn = "S-0-0091"\nhex = "00 00"', "S-0-0091 | takes 4 bytes, not 2"),
        ('idn = "S-0-0016"\nvalue = "S-0-0099"', "AT 1 | S-0-0099 | how long it is"),
    ],
)
def test_what_the_drive_cannot_do_is_told(
    start_daemon: Callable[..., Daemon], rig: str, table: str, tokens: str
) -> None:
    config = f"[gateway]\nlisten = []\n[[slave]]\nposition = 1\n[[slave.idn]]\n{table}\n"
    daemon = start_daemon(rig, config=config, ready=False)
    if "AT 1" in tokens:  # one slave without process data must not stop the bus
        daemon.wait_ready()
        log = daemon.log
        assert re.search(r"slave 1 \(SoeDrive\).* takes no part", log), log
        assert daemon.stop() == 0
    else:
        status, log = daemon.wait_end()
        assert status == 7, log
        log = one_line_error(log, "ecatd")
    names(log, "slave 1 (SoeDrive)", *tokens.split(" | "))
