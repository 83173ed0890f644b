"""The drives of manufacturers on a bus: each reaches OP, and turns when it is told to."""

import json
from collections.abc import Callable

import pytest

from conftest import Daemon, wait_for
from ecatsim.devices import drives

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

RIG = "".join(f'[[slave]]\ndevice = "{name}"\n' for name in drives.NAMES)
STARTUP = """
[[slave]]
position = 2

[[slave.startup]]
object = "0x6060:00"
type = "int8"
value = 7
"""
CONTROL, STATUS, MODE = 0x6040, 0x6041, 0x6060


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], tmp_path) -> Daemon:  # type: ignore[no-untyped-def]
    rig = tmp_path / "drives.toml"
    rig.write_text(RIG)
    return start_daemon(str(rig), config=STARTUP)


def test_each_drive_is_in_op_and_turns(daemon: Daemon) -> None:
    wait_for(lambda: [row["text"] for row in daemon.slave_rows("state")] == ["OP"] * 4, daemon)
    with daemon.client() as client:
        claims = [client.claim(slave, lease=30) for slave in range(len(drives.NAMES))]
        assert claims

        def step() -> None:
            client.wait(1, timeout=30)
            client.sample()
            client.commit()

        def until(condition: Callable[[], bool]) -> None:
            for _ in range(10_000):
                step()
                if condition():
                    return
            pytest.fail("it does not come about")

        def status(slave: int) -> int:
            return int(client.signal(slave, STATUS).raw) & 0x6F

        step()
        speeds = {0: 200_000, 1: 60, 3: 60}  # counts/s, and rpm
        for slave in range(4):
            if slave in speeds:
                client.signal(slave, MODE).raw = 9
                client.signal(slave, 0x60FF).raw = speeds[slave]
        client.signal(0, 0x6072).raw = 1000
        client.signal(2, 0x60C1, 1).raw = client.signal(2, 0x6063).raw
        for word, state in ((6, 0x21), (7, 0x23), (15, 0x27)):
            for slave in range(4):
                client.signal(slave, CONTROL).raw = word
            until(lambda wanted=state: all(status(s) == wanted for s in range(4)))  # type: ignore[misc]
        for slave, speed in speeds.items():
            until(lambda s=slave, v=speed: client.signal(s, 0x606C).raw > 0.9 * v)  # type: ignore[misc]
        begin = int(client.signal(2, 0x6063).raw)
        client.signal(2, 0x60C1, 1).raw = begin + 20_000
        until(lambda: abs(int(client.signal(2, 0x6063).raw) - begin - 20_000) < 500)
    document = json.loads(daemon.ctl("slaves", "--json").stdout)
    assert [row["name"] for row in document["slaves"]] == [
        *("Gold EtherCAT GCON Drive", "EPOS4", "AKD", "SOMANET Circulo"),
    ]
