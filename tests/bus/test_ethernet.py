"""Ethernet over EtherCAT: frames reach slaves, and slaves get their IP parameters."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from ecatsim.control import Simulator

pytestmark = [
    pytest.mark.bus,
    pytest.mark.skipif(
        not os.access("/dev/net/tun", os.R_OK | os.W_OK), reason="/dev/net/tun is not accessible"
    ),
]

INSIDE = Path(__file__).with_name("inside.py")
RIG = """
name = "web"
[[slave]]
device = "EK1100"
[[slave]]
vendor = 2
product = 7
order = "Small"
mailbox = { receive_size = 64, send = 0x1080, send_size = 64, protocols = ["eoe", "coe"] }
[[slave]]
vendor = 2
product = 8
order = "Large"
mailbox = { receive_size = 512, send = 0x1200, send_size = 512, protocols = ["eoe"] }
"""
CONFIG = """
[gateway]
listen = []
[recovery]
retry_s = 0.5
[eoe]
interface = "eoe0"
address = "192.168.7.1/24"
[[slave]]
position = 1
name = "web"
[slave.eoe]
address = "192.168.7.2/24"
gateway = "192.168.7.1"
[[slave]]
position = 2
[slave.eoe]
mac = "02-00-00-00-00-0A"
address = "192.168.7.3/24"
name = "web-1"
"""


class Machine:
    """A bus with two slaves that have EoE, and a computer with an interface to them."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.simulator = Simulator(str(daemon.child_pid("ecatsim")))

    def inside(self, *arguments: str) -> None:
        pid = self.daemon.child_pid("ecatd.server")
        command = [sys.executable, str(INSIDE), str(pid), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr

    def port(self, position: int) -> dict[str, object]:
        rows = self.daemon.ctl_json("eoe")["slaves"]
        found: dict[str, object] = next(row for row in rows if row["slave"] == position)
        return found

    def ip(self, slave: str) -> dict[str, object]:
        found: dict[str, object] = self.daemon.ctl_json("eoe-read", slave)["ip"]
        return found


@pytest.fixture
def machine(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> Iterator[Callable[..., Machine]]:
    with contextlib.ExitStack() as stack:

        def start(rig: str = RIG, config: str = CONFIG) -> Machine:
            file = tmp_path / "rig.toml"
            file.write_text(rig)
            bench = Machine(start_daemon(str(file), config=config))
            stack.enter_context(bench.simulator)
            return bench

        yield start


def _state(bench: Machine, position: int) -> str:
    return str(bench.daemon.slave_rows("state")[position]["text"])


def test_frames_of_all_sizes_reach_the_slaves(machine: Callable[..., Machine]) -> None:
    bench = machine()
    sizes = ("0", "1", "500", "1472")
    bench.inside("echo", "192.168.7.2", *sizes)  # over 48 fragments
    bench.inside("echo", "192.168.7.3", *sizes)
    small, large = bench.port(1), bench.port(2)
    assert large["macs"] == ["02:00:00:00:00:0a"]
    assert small["macs"] == [bench.ip("web")["mac"]]
    for port in (small, large):
        assert (port["lost"], port["dropped"]) == (0, 0)
        assert int(str(port["received"])) >= len(sizes)
    names(bench.daemon.ctl("eoe").stdout, "eoe0", "192.168.7.1/24", "web (Small)", "Large")
    # Objects of the slave can be read beside it.
    assert bench.daemon.ctl_json("sdo-read", "web", "0x1018", "1")["value"] == 2


@pytest.mark.skipif(not shutil.which("tshark"), reason="tshark is not installed")
def test_tshark_understands_the_messages(machine: Callable[..., Machine], tmp_path: Path) -> None:
    # It takes a first fragment for a whole frame, so these frames have only one each.
    bench = machine(RIG.replace("64", "512").replace("0x1080", "0x1200"))
    bench.inside("echo", "192.168.7.2", "0", "40")
    bench.daemon.ctl("eoe-write", "2", "--gateway", "192.168.7.77")
    file = tmp_path / "frames.pcapng"
    bench.daemon.ctl("capture", "-o", str(file))

    def tshark(*arguments: str) -> list[str]:
        command = ["tshark", "-r", str(file), *arguments]
        shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        return shown.splitlines()

    assert tshark("-Y", "_ws.malformed || _ws.short") == []
    wanted = ("ipaddr", "subnetmask", "defaultgateway", "dnsname")
    fields = [part for name in wanted for part in ("-e", f"ecat_mailbox.eoe.init.{name}")]
    answers = tshark("-Y", "ecat_mailbox.eoe.init.ipaddr", "-T", "fields", *fields)
    parameters = {line.replace("\t", " ") for line in answers}
    assert "192.168.7.3 255.255.255.0 192.168.7.77 web-1" in parameters


@pytest.mark.long
def test_a_web_server_behind_a_slave(machine: Callable[..., Machine]) -> None:
    bench = machine(RIG.replace('order = "Large"', 'order = "Large"\neoe_interface = "web0"'))
    bench.inside("fetch", "web0", "192.168.7.3", "200000")


@pytest.mark.long
def test_a_slave_that_sends_all_the_time_is_asked_nevertheless(
    machine: Callable[..., Machine], tmp_path: Path
) -> None:
    """It takes no message before its own one has been read."""
    rig = RIG.replace('["eoe"]', '["eoe", "coe", "foe"]')
    bench = machine(rig.replace('order = "Large"', 'order = "Large"\neoe_interface = "web0"'))
    server = bench.daemon.child_pid("ecatd.server")
    to_all = f"{6 * 'ff'}020000000002{1400 * '55'}"
    file = tmp_path / "f.bin"
    file.write_bytes(bytes(range(256)) * 40)
    command = [sys.executable, str(INSIDE), str(server), "send", "web0", to_all, "1000000", "0"]
    with subprocess.Popen(command) as flood:
        try:
            wait_for(lambda: int(str(bench.port(2)["received"])) > 100, bench.daemon)
            bench.daemon.ctl("foe-write", "--yes", "2", str(file))
            assert bench.daemon.ctl_json("sdo-read", "2", "0x1018", "1")["value"] == 2
            assert bench.ip("2")["address"] == "192.168.7.3"
        finally:
            flood.kill()
    assert bench.daemon.child_pid("ecatd.server") == server
    bench.daemon.ctl("foe-read", "2", "f.bin", "-o", str(tmp_path / "back.bin"))
    assert (tmp_path / "back.bin").read_bytes() == file.read_bytes()


def test_ip_parameters_are_read_and_written(machine: Callable[..., Machine]) -> None:
    bench = machine()
    found = bench.ip("web")
    assert found.pop("mac")
    assert found == {
        "address": "192.168.7.2",
        "mask": "255.255.255.0",
        "gateway": "192.168.7.1",
        "dns": None,
        "name": None,
    }
    ctl = bench.daemon.ctl
    ctl("eoe-write", "2", "--address", "10.0.0.5/8", "--dns", "10.0.0.1")
    text = ctl("eoe-read", "2").stdout
    names(text, "10.0.0.5", "255.0.0.0", "10.0.0.1", "02:00:00:00:00:0a")
    ctl("eoe-write", "2", "--dns", "none", "--name", "none")
    assert (bench.ip("2")["dns"], bench.ip("2")["name"]) == (None, None)
    names(ctl("config", "init").stdout, "[eoe]", "eoe0", "[slave.eoe]", "192.168.7.2/24")
    names(bench.daemon.log, "slave 2 (Large)", "10.0.0.5/8", "192.168.7.3/24")
    for arguments, said in (
        (("eoe-write", "2"), "--address"),
        (("eoe-write", "2", "--address", "10.0.0.5"), "10.0.0.5"),
        (("eoe-write", "2", "--mac", "01:00:00:00:00:00"), "01:00:00:00:00:00"),
        (("eoe-write", "2", "--gateway", "0.0.0.0"), "0.0.0.0"),
    ):
        failed = ctl(*arguments, check=False)
        assert failed.returncode == 2
        names(failed.stderr, said)
    failed = ctl("eoe-write", "web", "--name", 30 * "x", check=False)  # 64 bytes are too few
    assert failed.returncode == 7
    names(one_line_error(failed.stderr, "ecatctl"), "slave 1 (web, Small)", "64")
    failed = ctl("eoe-read", "EK1100", check=False)
    assert failed.returncode == 7
    names(one_line_error(failed.stderr, "ecatctl"), "slave 0 (EK1100)")


def test_a_slave_gets_its_parameters_again_after_a_loss_of_power(
    machine: Callable[..., Machine],
) -> None:
    bench = machine()
    bench.simulator.faults.power_off(2)
    wait_for(lambda: _state(bench, 2) == "no answer", bench.daemon)
    bench.simulator.faults.power_on(2)
    wait_for(lambda: _state(bench, 2) == "OP", bench.daemon)
    assert bench.ip("2")["address"] == "192.168.7.3"
    bench.inside("echo", "192.168.7.3", "100")


@pytest.mark.long
def test_a_slave_that_takes_no_frames_is_named_and_holds_up_nobody(
    machine: Callable[..., Machine],
) -> None:
    bench = machine()
    bench.simulator.faults.mailbox(2, "full")
    to_all = f"{6 * 'ff'}020000000002{60 * '00'}"
    bench.inside("send", "eoe0", to_all, "5", "0.01")
    wait_for(lambda: "Ethernet frames" in bench.daemon.log, bench.daemon)
    names(bench.daemon.log, "slave 2 (Large)")
    bench.inside("echo", "192.168.7.2", "1000")
    bench.simulator.faults.mailbox(2, "none")
    bench.inside("echo", "192.168.7.3", "100")


def test_what_the_configuration_cannot_mean(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(RIG)
    for tables, said in (
        ('[[slave]]\nposition = 0\n[slave.eoe]\naddress = "192.168.7.2/24"\n', "slave 0 (EK1100)"),
        ('[[slave]]\nposition = 1\n[slave.eoe]\naddress = "192.168.7.2"\n', "slave[0].eoe.address"),
        ('[[slave]]\nposition = 1\n[slave.eoe]\ngateway = "192.168.7.2"\n', "slave[0].eoe.gateway"),
        ('[[slave]]\nposition = 1\n[slave.eoe]\nmac = "no"\n', "slave[0].eoe.mac"),
        ('[eoe]\naddress = "192.168.7.1/24"\n', "eoe.interface"),
        ('[eoe]\ninterface = "eoe 0"\n', "eoe.interface"),
        ('[eoe]\ninterface = "lo"\n', "eoe.interface"),
        ('[eoe]\ninterface = "eoe0"\naddress = "192.168.7.255/24"\n', "eoe.address"),
        (CONFIG.replace("7.3", "7.2"), "slave[1].eoe.address"),
        (CONFIG.replace("7.3/24", "8.3/24"), "slave[1].eoe.address"),
        (CONFIG.replace('gateway = "192.168.7.1"', 'gateway = "10.0.0.1"'), "slave[0].eoe.gateway"),
        (CONFIG.replace("position = 2", "position = 2\nmailbox_poll_ms = 0"), "slave 2 (Large)"),
    ):
        daemon = start_daemon(str(file), config=tables, ready=False)
        status, log = daemon.wait_end()
        assert status == 2, log
        names(log, said)


def test_an_interface_that_cannot_be_made(machine: Callable[..., Machine]) -> None:
    bench = machine(config=CONFIG.replace('"eoe0"', '"ecat-master"'))
    names(bench.daemon.log, "warning", "ecat-master")
    assert bench.daemon.ctl_json("eoe")["problem"]
    names(bench.daemon.ctl("eoe").stdout, "ecat-master")
    assert [_state(bench, position) for position in range(3)] == 3 * ["OP"]
