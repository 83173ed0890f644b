"""Copies: an input of one slave decides an output of another, in every cycle."""

import math
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_reload import reload

from conftest import Daemon, names, one_line_error, wait_for
from ecatd import Client
from ecatd.base.errors import StateError
from ecatd.client import Direction
from ecatd.shm import contract as shm
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

# What is written to the first outputs comes in at the inputs, is copied, and comes in again. The
# lamps are in a slower domain than the switches.
RIG = """
name = "copies"
[[slave]]
device = "EL2008"
[[slave]]
device = "EL1008"
[[slave]]
device = "EL2004"
[[slave]]
device = "EL1018"
[[slave]]
device = "AnalogIO"
[[slave]]
device = "AnalogIO"
[[wire]]
from = { slave = 0, entry = "0x7000:01" }
to = { slave = 1, entry = "0x6000:01" }
[[wire]]
from = { slave = 2, entry = "0x7010:01" }
to = { slave = 3, entry = "0x6010:01" }
[[wire]]
from = { slave = 4, entry = "0x7000:01" }
to = { slave = 4, entry = "0x6000:01" }
[[wire]]
from = { slave = 5, entry = "0x7000:01" }
to = { slave = 5, entry = "0x6000:01" }
"""
CONFIG = """
[gateway]
listen = []
[[domain]]
slaves = [0, 1, 4, 5]
[[domain]]
divider = 3
slaves = [2, 3]
[[slave]]
position = 1
name = "switches"
[[slave]]
position = 2
name = "lamps"
[[signal]]
slave = 4
entry = "0x6000:01"
unit = "V"
scale = 0.01
[[signal]]
slave = 5
entry = "0x7000:01"
unit = "V"
scale = 0.001
offset = 1
[[outputs.safe]]
slave = "lamps"
entry = "0x7010:01"
value = 1
[[copy]]
slave = "lamps"
entry = "0x7010:01"
from_slave = "switches"
from_entry = "0x6000:01"
[[copy]]
slave = 5
entry = "0x7000:01"
from_slave = 4
from_entry = "0x6000:01"
"""

DRIVE = """
[gateway]
listen = []
[[outputs.safe]]
slave = 0
value = "quick_stop"
stop_timeout_s = 20
[[copy]]
slave = 0
entry = "0x60FF:00"
from_slave = 0
from_entry = "0x6041:00"
"""


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory) -> Daemon:
    rig = tmp_path_factory.mktemp("copies") / "rig.toml"
    rig.write_text(RIG)
    return start_shared(str(rig), config=CONFIG)


@pytest.fixture
def client(daemon: Daemon) -> Iterator[Client]:
    with daemon.client() as client:
        for slave in (0, 2, 4):
            client.claim(slave, lease=30)
        yield client


def arrives(daemon: Daemon, client: Client, output: str, value: int, entry: str, raw: int) -> None:
    """Writes an output, and waits until an input has a value because of that."""
    client.signal(output, direction=Direction.OUTPUT).raw = value
    client.commit()
    there = client.signal(entry, direction=Direction.INPUT)

    def has_come() -> bool:
        client.wait()
        client.sample()
        return bool(there.raw == raw)

    wait_for(has_come, daemon)


def test_an_input_decides_an_output(daemon: Daemon, client: Client) -> None:
    for value in (1, 0, 1, 0):
        arrives(daemon, client, "0/0x7000:01", value, "3/0x6010:01", value)
    # 100 · 0.01 V is 1 V, which is 0 beyond the offset; 3 V are 2000 · 0.001 V beyond it.
    for value, raw in ((100, 0), (300, 2000), (0, -1000), (-200, -3000)):
        arrives(daemon, client, "4/0x7000:01", value, "5/0x6000:01", raw)
    # Held at the limits of 16 bits: 327.67 V would be 326670.
    for value, raw in ((32767, 32767), (-32768, -32768)):
        arrives(daemon, client, "4/0x7000:01", value, "5/0x6000:01", raw)


def test_the_limits_of_a_copy_change_while_the_bus_runs(daemon: Daemon, client: Client) -> None:
    arrives(daemon, client, "4/0x7000:01", 300, "5/0x6000:01", 2000)
    limited = CONFIG.replace("offset = 1\n", "offset = 1\nmaximum = 2.5\n", 1)
    reload(daemon, limited, "configuration read again; changed")
    arrives(daemon, client, "4/0x7000:01", 300, "5/0x6000:01", 1500)
    arrives(daemon, client, "4/0x7000:01", 200, "5/0x6000:01", 1000)
    # A table that gives nothing but limits, to an output that had none.
    more = limited + "[[signal]]\nslave = 2\nentry = '0x7010:01'\nminimum = 1\n"
    names(reload(daemon, more, "read again; changed"), "signal[lamps 0x7010:01]")
    arrives(daemon, client, "0/0x7000:01", 0, "3/0x6010:01", 1)
    reload(daemon, limited, "read again; changed")
    arrives(daemon, client, "0/0x7000:01", 0, "3/0x6010:01", 0)
    reload(daemon, CONFIG, "read again; changed")


def test_the_output_is_safe_without_its_source(daemon: Daemon, client: Client) -> None:
    arrives(daemon, client, "0/0x7000:01", 1, "3/0x6010:01", 1)
    arrives(daemon, client, "0/0x7000:01", 0, "3/0x6010:01", 0)
    lamp = client.signal("lamps/0x7010:01", direction=Direction.OUTPUT)
    with Simulator(str(daemon.child_pid("ecatsim"))) as rig:
        rig.faults.power_off(5)  # the last of the domain, so no working counter is complete
        wait_for(lambda: client.output(lamp).reason == shm.Reason.SOURCE, daemon)
        wait_for(lambda: rig.get(2, 0x7010, 1) == 1, daemon)  # the next frame has it
        rig.faults.power_on(5)
        wait_for(lambda: client.output(lamp).reason == shm.Reason.START, daemon)
    arrives(daemon, client, "0/0x7000:01", 1, "3/0x6010:01", 1)


def test_the_output_is_safe_while_its_source_is_not_in_op(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """EL1008 has no outputs, so the working counter is complete in SAFEOP, too."""
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    config = CONFIG.replace("[gateway]", '[recovery]\nslaves = "watchdog"\n[gateway]')
    daemon = start_daemon(str(rig), config=config)
    with daemon.client() as client, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        client.claim(0, lease=30)
        arrives(daemon, client, "0/0x7000:01", 0, "3/0x6010:01", 0)
        lamp = client.signal("lamps/0x7010:01", direction=Direction.OUTPUT)
        simulator.faults.al_error(1, code=0x001D)

        def is_safe_though_all_is_exchanged() -> bool:
            client.wait()
            client.sample()
            complete = client.domain().wkc_state == shm.WkcState.COMPLETE
            return complete and (lamp.raw, client.output(lamp).reason) == (1, shm.Reason.SOURCE)

        wait_for(is_safe_though_all_is_exchanged, daemon)
        since = client.output(lamp).since_cycle
        for _ in range(5):
            client.wait()
        client.sample()
        assert (lamp.raw, client.output(lamp).since_cycle) == (1, since)
        daemon.ctl("state", "1", "OP")
        wait_for(lambda: client.output(lamp).reason == shm.Reason.START, daemon)
        arrives(daemon, client, "0/0x7000:01", 1, "3/0x6010:01", 1)
        arrives(daemon, client, "0/0x7000:01", 0, "3/0x6010:01", 0)


def test_the_stop_of_a_drive_wins(start_daemon: Callable[..., Daemon]) -> None:
    """The statusword, which is never 0, is the target velocity, but not while the drive stops."""
    daemon = start_daemon("troll", config=DRIVE)
    with daemon.client() as client:

        def until(condition: Callable[[], bool]) -> None:
            def holds() -> bool:
                client.wait()
                client.sample()
                client.commit()
                return condition()

            wait_for(holds, daemon)

        status, target = client.signal(0, 0x6041), client.signal(0, 0x60FF)
        word, speed = client.signal(0, 0x6040), client.signal(0, 0x606C)
        client.sdo_download(0, 0x6085, 0, struct.pack("<I", 1)).result()  # brakes for minutes
        claim = client.claim(0, lease=30)
        client.signal(0, 0x6060).raw = 9
        client.signal(0, 0x6072).raw = 1000
        for command, state in ((6, 0x21), (7, 0x23), (15, 0x27)):
            word.raw = command
            until(lambda wanted=state: int(status.raw) & 0x6F == wanted)  # type: ignore[misc]
        until(lambda: abs(int(speed.raw)) > 300)
        assert target.raw == status.raw
        claim.release()
        until(lambda: int(status.raw) & 0x6F == 0x07)  # quick stop active
        assert client.output(word).state == shm.Outputs.STOPPING
        assert target.raw == 0
        assert client.output(target).reason == shm.Reason.RELEASED
        client.sdo_download(0, 0x6085, 0, struct.pack("<I", 10_000_000)).result()


NUMBERS_RIG = """
[[slave]]
vendor = 0xFFFF
product = 0x31
name = "Numbers"
[slave.mailbox]
[[slave.pdo]]
index = 0x1600
entry = [
  { index = 0x7000, subindex = 1, type = "real32" },
  { index = 0x7000, subindex = 2, type = "uint64" },
  { index = 0x7000, subindex = 3, type = "int64" },
  { index = 0x7000, subindex = 4, type = "uint64" },
  { index = 0x7000, subindex = 5, type = "real64" },
]
[[slave.pdo]]
index = 0x1A00
entry = [
  { index = 0x6000, subindex = 1, type = "real32" },
  { index = 0x6000, subindex = 2, type = "uint64" },
  { index = 0x6000, subindex = 3, type = "int64" },
  { index = 0x6000, subindex = 4, type = "real64" },
]
[[slave.object]]
index = 0x6000
entry = [
  { subindex = 1, type = "real32", access = "txpdo", data = "00 00 c0 7f" },
  { subindex = 2, type = "uint64", access = "txpdo" },
  { subindex = 3, type = "int64", access = "txpdo" },
  { subindex = 4, type = "real64", access = "txpdo" },
]
[[slave]]
vendor = 0xFFFF
product = 0x30
name = "Real"
[slave.mailbox]
[[slave.pdo]]
index = 0x1600
entry = [{ index = 0x7000, subindex = 1, type = "int16" }]
[[slave.pdo]]
index = 0x1A00
entry = [{ index = 0x6000, subindex = 1, type = "real32" }]
[[slave.object]]
index = 0x6000
entry = [{ subindex = 1, type = "real32", access = "txpdo", data = "00 00 c0 7f" }]
"""
NUMBERS = """
[gateway]
listen = []
[[outputs.safe]]
slave = 0
entry = "0x7000:01"
value = 7
[[signal]]
slave = 1
entry = "0x7000:01"
maximum = 1000
[[outputs.safe]]
slave = 1
entry = "0x7000:01"
value = 7
[[copy]]
slave = 1
entry = "0x7000:01"
from_slave = 1
from_entry = "0x6000:01"
factor = -2
offset = 1
""" + "".join(
    f'[[copy]]\nslave = 0\nentry = "0x7000:0{to}"\n'
    f'from_slave = 0\nfrom_entry = "0x6000:0{source}"\n' + ("factor = 10\n" if to == 5 else "")
    for to, source in ((1, 1), (2, 2), (3, 2), (4, 3), (5, 4))
)


def test_numbers_keep_their_digits_or_are_held_at_the_limits(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "numbers.toml"
    rig.write_text(NUMBERS_RIG)
    daemon = start_daemon(str(rig), config=NUMBERS)
    with daemon.client() as client, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:

        def becomes(slave: int, subindex: int, value: float) -> None:
            wait_for(lambda: simulator.get(slave, 0x7000, subindex) == value, daemon)

        outputs = [client.signal(f"{n}/0x7000:01", direction=Direction.OUTPUT) for n in (0, 1)]
        for slave, output in enumerate(outputs):
            becomes(slave, 1, 7)  # the safe value: the input is not a number
            assert client.output(output).reason == shm.Reason.SOURCE
        # The same type: digit by digit.
        simulator.set(0, 0x6000, 1, 0.5)
        becomes(0, 1, 0.5)
        # A double has 53 bits. An output of another sign is held at the limits of its type.
        for value in (2**53 + 1, 2**64 - 1):
            simulator.set(0, 0x6000, 2, value)
            becomes(0, 2, value)
            becomes(0, 3, min(value, 2**63 - 1))
        for value in (2**62 + 1, -1):
            simulator.set(0, 0x6000, 3, value)
            becomes(0, 4, max(value, 0))
        for real in (1e308, -1e308):
            simulator.set(0, 0x6000, 4, real)
            becomes(0, 5, math.copysign(sys.float_info.max, real))
        # An integer of a real: rounded to the nearest number; held at the declared maximum, and at
        # the limit of the type.
        for real, raw in ((-2.7, 6), (-2.8, 7), (2.0, -3), (-1e9, 1000), (1e9, -32768)):
            simulator.set(1, 0x6000, 1, real)
            becomes(1, 1, raw)
        wait_for(lambda: client.output(outputs[1]).reason == shm.Reason.START, daemon)


def test_nobody_owns_a_copied_output(daemon: Daemon, client: Client) -> None:
    lamp = client.signal("lamps/0x7010:01", direction=Direction.OUTPUT)
    assert client.output(lamp).state == shm.Outputs.COPIED
    with pytest.raises(StateError, match=r"copy") as refused:
        client.claim(lamp)
    names(refused.value, "0x7010:01", "slave 2 (lamps)", "0x6000:01 of slave 1", "[[copy]]")
    # The other outputs of the slave belong to the client, and the copy does not lose by that.
    client.signal("lamps/0x7000:01", direction=Direction.OUTPUT).raw = 1
    client.commit()
    arrives(daemon, client, "0/0x7000:01", 1, "3/0x6010:01", 1)
    shown = daemon.ctl("claims").stdout
    names(shown, "copied", "from 1/0x6000:01")
    init = daemon.ctl("config", "init").stdout
    assert init.count("[[copy]]") == 2
    names(init, 'from_slave = "switches"')


WITHOUT_SOURCE = """
[gateway]
listen = []
[expected]
policy = "tolerant"
[[slave]]
position = 0
name = "switches"
vendor = 0x2
product = 0x03F03052
OPTIONAL
[[slave]]
position = 1
name = "lamps"
vendor = 0x2
product = 0x07D83052
[[outputs.safe]]
slave = "lamps"
entry = "0x7000:01"
value = 1
[[copy]]
slave = "lamps"
entry = "0x7000:01"
from_slave = "switches"
from_entry = "0x6000:01"
"""


@pytest.mark.parametrize("optional", ["", "optional = true"], ids=["missing", "optional"])
def test_the_output_stays_its_own_without_the_slave_of_its_input(
    start_daemon: Callable[..., Daemon], tmp_path: Path, optional: str
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('name = "m"\n[[slave]]\ndevice = "EL2008"\n')
    daemon = start_daemon(str(rig), config=WITHOUT_SOURCE.replace("OPTIONAL", optional))
    (told,) = (line for line in daemon.log.splitlines() if "copy[0]" in line)
    names(
        told, "warning", f"{daemon.config_file}:", "copy[0].from_slave", "slave 0 (lamps, EL2008)"
    )
    names(told, "0x7000:01", "safe value")
    names(daemon.ctl("claims").stdout, "copied", "not valid")
    with daemon.client() as client, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        lamp = client.signal("lamps/0x7000:01", direction=Direction.OUTPUT)
        assert client.output(lamp).state == shm.Outputs.COPIED
        assert client.output(lamp).reason == shm.Reason.SOURCE
        with pytest.raises(StateError, match=r"copies") as refused:
            client.claim(lamp)
        names(refused.value, "0x7000:01", "slave 0 (lamps)", "[[copy]]")
        client.claim(0, lease=30)
        client.signal("lamps/0x7010:01", direction=Direction.OUTPUT).raw = 1
        client.commit()
        wait_for(lambda: simulator.get(0, 0x7010, 1) == 1, daemon)
        assert simulator.get(0, 0x7000, 1) == 1
    assert "[[copy]]" not in daemon.ctl("config", "init").stdout.partition("# [[copy]]")[0]


def test_an_output_that_is_copied_twice_is_refused(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG)
    again = '[[copy]]\nslave = 2\nentry = "0x7010:1"\nfrom_slave = 1\nfrom_entry = "0x6010:01"\n'
    status, log = start_daemon(str(rig), config=CONFIG + again, ready=False).wait_end()
    assert status == 2
    names(one_line_error(log, "ecatd"), "copy[2].entry", "slave 2")
