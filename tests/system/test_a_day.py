"""A day of administration of a whole machine. The tests depend on each other, in this order."""

import importlib.util
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from system_machine import MACS, PATIENCE_S, Machine, segment, wires

from ecatsim.control import Simulator

pytestmark = pytest.mark.system
whole_day = pytest.mark.long
"""Not in the short form of the day, `make test-system-short`."""

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "build/machine"
PACKAGES = ROOT / "build/deb"

BRIDGE = "/etc/systemd/system/ecatd-can-bridge.service"
VELOCITY = 0x606C
SPEED = 200_000  # of spin.py
PROCESSES = ("main", "ecatd.server", "ecatd.gateway")
PRUNED = ("/files", "/tmp", "/var/log", "/run/systemd", "/run/udev")
"""Folders in which others may keep names of ecatd: the tests, the journal, systemd, udev."""
START_LIMIT_S = 15
LATE = ("disturbance", "al_state", "recovery", "exchange", "can_overflow")
"""Events that a slow processor causes: the emulated one stands still at times."""
FIGURES: list[tuple[str, str]] = []
"""What was measured, printed at the end."""

TALKING = (0, 4, 5, 6, 7)
"""Slaves of the rig that have a mailbox. If the processor is slow, so are their answers."""
CONFIGURATION = """\
interface = "{interface}"
cycle_time_us = 10000
state_timeout_s = 60.0

[gateway]
listen = []

[eoe]
interface = "eoe0"
address = "192.168.7.1/24"

[health]
wrong_counters = 1.0
lost = 1.0
late = 1.0

[[outputs.safe]]
slave = 0
value = "quick_stop"
stop_timeout_s = 10.0
""" + "".join(f"[[slave]]\nposition = {slave}\nmailbox_timeout_ms = 9000\n" for slave in TALKING)
# Slaves 6 and 7 are CAN terminals; the bus behind the second one is used.
CONFIGURATION = CONFIGURATION.replace("position = 6\n", "position = 6\nwatchdog_ms = 0\n")
CONFIGURATION += "watchdog_ms = 0\n[slave.can]\nbit_rate = 500\nframes_per_second = 500\n"
CAN, NODE = 7, 2
"""This terminal, and the CANopen node behind it."""


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """The machine, with the Debian packages in `/files`."""
    assert IMAGE.exists(), "use make test-system"
    packages = sorted(PACKAGES.glob("*.deb"))
    assert packages, "use make test-system"
    helpers = sorted((Path(__file__).parent / "guest").glob("*.py"))
    folder = tmp_path_factory.mktemp("machine")
    with wires(), Machine(IMAGE, folder, [*packages, *helpers, *python_packages()]) as running:
        yield running


def python_packages() -> list[Path]:
    """What the package `canopen` needs; the Python of the machine is that of Debian 12, as ours."""
    found = [importlib.util.find_spec(name) for name in ("can", "canopen", "wrapt", "packaging")]
    files = [Path(spec.origin).parent for spec in found if spec and spec.origin]
    spec = importlib.util.find_spec("typing_extensions")
    return [*files, Path(spec.origin)] if spec and spec.origin else files


@pytest.fixture(scope="session")
def drive(machine: Machine) -> Iterator[str]:
    """The simulated segment at the first card: its name for `Simulator`."""
    with segment("troll-can", 0) as name:
        yield name


def interface(machine: Machine, number: int) -> str:
    """The name that the machine gives to a card, or an empty text."""
    found = machine.text(f"grep -l {MACS[number]} /sys/class/net/*/address; true")
    return Path(found).parent.name if found else ""


def wait_until_well(machine: Machine, bus: str = "ecat0") -> None:
    """A bus is well when `ecatctl check` says so."""
    machine.until(f"ecatctl --bus {bus} check", 240)


def process(machine: Machine, module: str) -> str:
    """The number of a process of ecatd: `main`, `ecatd.server` or `ecatd.gateway`."""
    service = "ecatd-gateway" if module == "ecatd.gateway" else "ecatd"
    main = machine.text(f"systemctl show --property MainPID --value {service}")
    return (
        main
        if module in ("main", "ecatd.gateway")
        else machine.text(f"pgrep -P {main} -f '^{module}'")
    )


def turn(machine: Machine, simulator: Simulator) -> None:
    """Has a client in the machine turn the drive."""
    wait_until_well(machine)
    machine("systemctl reset-failed spin; true")
    machine(
        "systemd-run --quiet --unit=spin --uid=mechanic --collect "
        "/usr/lib/ecatd/bin/python /files/spin.py"
    )
    end = time.monotonic() + PATIENCE_S
    while abs(simulator.get(0, VELOCITY)) < 0.9 * SPEED:
        assert time.monotonic() < end, machine("journalctl -u spin -n 20 --no-pager").text
        time.sleep(0.1)


def watch_the_end(simulator: Simulator) -> tuple[int, float]:
    """Waits until the drive leaves OP or stands still; its speed then, and the seconds."""
    began = time.monotonic()
    while True:
        speed = abs(simulator.get(0, VELOCITY))
        seconds = time.monotonic() - began
        if simulator.status().slaves[0].state != "OP" or speed == 0:
            return speed, seconds
        assert seconds < PATIENCE_S, "the drive goes on turning"
        time.sleep(0.01)


def note(what: str, figure: str) -> None:
    FIGURES.append((what, figure))
    print(f"figure: {what}: {figure}", flush=True)


# --- Installation ------------------------------------------------------------------------------


def test_the_package_is_installed_without_a_network(machine: Machine) -> None:
    machine("apt-get install -y /files/ecatd_*.deb 2>&1 | tail -5", timeout=300)
    assert machine.text("ecatctl --version").startswith("ecatctl ")
    assert machine.text("systemctl is-enabled ecatd") == "enabled"
    machine("systemctl start ecatd")
    told = machine("systemctl status ecatd --no-pager", status=3).text
    assert re.search("ConditionPathExists=/etc/ecatd/ecat0.toml", told)


def test_others_leave_the_interface_alone(machine: Machine) -> None:
    """systemd-networkd and NetworkManager would configure every card of this machine."""
    name, other = interface(machine, 0), interface(machine, 1)
    managed = "nmcli --terse --get-values GENERAL.STATE device show"
    machine("systemctl start NetworkManager")
    machine.until(f"! {managed} {name} | grep unmanaged")
    told = machine(f"ecatctl service install --interface {name}").text
    assert "/etc/ecatd/ecat0.toml" in told
    machine("udevadm settle")
    properties = machine.text(f"udevadm info -q property /sys/class/net/{name}").splitlines()
    assert {"ID_ECATD=1", "NM_UNMANAGED=1"} <= set(properties)
    assert "ID_ECATD" not in machine.text(f"udevadm info -q property /sys/class/net/{other}")
    machine.until(f"{managed} {name} | grep unmanaged")
    machine.until(f"! {managed} {other} | grep unmanaged")
    machine("systemctl stop NetworkManager")  # the two would work on the other card together
    machine.write(
        "/etc/systemd/network/80-all.network",
        "[Match]\nName=e*\n[Network]\nAddress=10.9.8.7/24\n",
    )
    machine("systemctl enable --now systemd-networkd")
    machine.until(f"ip -4 -brief addr show {other} | grep 10.9.8.7")
    machine.until(f"networkctl --no-pager list {name} | grep unmanaged")
    machine(f"ip addr flush dev {name}; ip addr flush dev {other}")
    assert machine.text("stat -c %G:%a /dev/cpu_dma_latency") == "ecat:660"


def test_r42_the_bus_starts(machine: Machine, drive: str) -> None:
    name = interface(machine, 0)
    assert machine.text(f"basename $(readlink /sys/class/net/{name}/device/driver)") == "e1000e"
    machine.write("/etc/ecatd/ecat0.toml", CONFIGURATION.format(interface=name))
    began = machine("systemctl start ecatd", timeout=200)
    note("start of the service", f"{began.seconds:.1f} s")
    wait_until_well(machine)
    assert "is in OP: 8 slaves" in machine.text("systemctl show --property StatusText ecatd")
    users = {
        name: machine.text(f"ps -o user:32= -p {process(machine, name)}") for name in PROCESSES
    }
    assert users == {"main": "ecatd", "ecatd.server": "ecatd", "ecatd.gateway": "ecatd-gateway"}
    assert "192.168.7.1/24" in machine.text("ip -4 -brief address show eoe0")
    with Simulator(drive) as simulator:
        assert {slave.state for slave in simulator.status().slaves} == {"OP"}


def test_the_service_misses_nothing(machine: Machine) -> None:
    """With the rights of its unit, the service has all that it wants, and warns of nothing else."""
    settings = json.loads(machine.text("ecatctl info --json"))["settings"]
    assert settings
    assert not [row for row in settings if row["wanted"] and not row["granted"]]
    text = machine.text("journalctl -q -u ecatd -p warning -o json --no-pager")
    told = [json.loads(line) for line in text.splitlines()]
    lines = [x["MESSAGE"] for x in told if x.get("ECAT_EVENT") not in LATE]
    assert any("[eoe]" in line for line in lines), "the rig has no slave with EoE"
    fast = "works at 1000 Mbit/s"  # as the cards of QEMU do, and no slave
    assert not [line for line in lines if "[eoe]" not in line and fast not in line]


def test_r31_who_may_use_the_bus(machine: Machine) -> None:
    machine("useradd -m -G ecat mechanic && useradd -m stranger")
    assert "OP" in machine.text("runuser -u mechanic -- ecatctl sdo-read 0 0x6060 && echo OP")
    told = machine("runuser -u stranger -- ecatctl sdo-read 0 0x6060", status=6).text
    assert "usermod -aG ecat" in told
    machine("runuser -u stranger -- ecatctl check", status=3)


def test_the_live_view_has_an_address_for_the_group(machine: Machine) -> None:
    page = "/usr/lib/ecatd/lib/python3*/site-packages/ecatd/web/_page/index.html"
    if machine(f"ls {page}", status=None).status:
        pytest.skip("the page was not built: there is no Node.js")
    assert machine.text("systemctl is-enabled ecatd-web; true") == "disabled"
    machine("systemctl start ecatd-web")
    machine.until("test -s /run/ecatd-web/address")
    assert machine.text("stat -c %U:%G:%a /run/ecatd-web/address") == "ecatd-web:ecat:640"
    address = machine.text("runuser -u mechanic -- cat /run/ecatd-web/address")
    machine("runuser -u stranger -- cat /run/ecatd-web/address", status=1)
    read = f"import urllib.request as r; print(r.urlopen('{address}').read())"
    assert "page.js" in machine.text(f'/usr/lib/ecatd/bin/python -c "{read}"')
    number = machine.text("systemctl show --property MainPID --value ecatd-web")
    machine(f"nsenter -t {number} -m -- ls /run/ecatd/ecat0", status=2)
    machine("systemctl stop ecatd-web")
    machine("test -e /run/ecatd-web/address", status=1)


def test_a_gateway_that_somebody_stopped(machine: Machine) -> None:
    machine("systemctl stop ecatd-gateway")
    told = machine("ecatctl --timeout 1 slaves", status=3).text
    assert "'systemctl start ecatd-gateway'" in told
    machine("systemctl start ecatd-gateway")
    wait_until_well(machine)


def test_the_journal_has_fields_and_explanations(machine: Machine) -> None:
    text = machine.text("journalctl -u ecatd -o json --no-pager | tail -50")
    entries = [json.loads(line) for line in text.splitlines()]
    assert any(entry.get("ECAT_BUS") == "ecat0" for entry in entries)
    assert any("MESSAGE_ID" in entry and "ECAT_EVENT" in entry for entry in entries)
    told = machine.text("journalctl -x -u ecatd --no-pager")
    assert re.search("in OP.*?Subject: ", told, re.DOTALL)


# --- CAN behind a terminal, and CAN of Linux -----------------------------------------------------


def expect(machine: Machine, frame: str, answer: str) -> None:
    """Sends a frame on `vcan0` until another one comes."""
    identifier = answer.partition("#")[0]
    machine(f"candump -L vcan0,{identifier}:7FF >/tmp/answers 2>&1 & echo $! >/tmp/candump")
    machine.until(f"cansend vcan0 {frame}; sleep 0.5; grep -w '{answer}$' /tmp/answers")
    machine("kill $(cat /tmp/candump)")


ASK, ANSWER = f"{0x600 + NODE:X}#4000100000000000", f"{0x580 + NODE:X}#4300100091010F00"
"""The node is asked for its type."""


def test_a_can_terminal_on_socketcan(machine: Machine, drive: str) -> None:
    """By the unit in the documentation."""
    text = (ROOT / "docs/can.md").read_text()
    (unit,) = re.findall(r"^```ini\n(\[Unit\]\n.*?)^```", text, re.DOTALL | re.MULTILINE)
    machine.write(BRIDGE, unit.replace(" 6 ", f" {CAN} "))
    machine("systemctl daemon-reload && systemctl start ecatd-can-bridge")
    machine(f"timeout 60 candump -n 1 vcan0,{0x700 + NODE:X}:7FF")  # a heartbeat
    expect(machine, ASK, ANSWER)
    machine(f"cansend vcan0 000#01{NODE:02X}")  # operational: its outputs are wired to its inputs
    expect(machine, f"{0x200 + NODE:X}#5A", f"{0x180 + NODE:X}#5A")
    machine("systemctl stop ecatd-can-bridge")
    assert machine.text("systemctl show -P Result ecatd-can-bridge") == "success"


@whole_day
def test_a_can_terminal_stays_on_socketcan(machine: Machine, drive: str) -> None:
    machine("systemctl start ecatd-can-bridge")
    master = "PYTHONPATH=/files /usr/bin/python3 /files/canopen_master.py"
    assert machine.text(master).splitlines()[-2:] == [str([NODE]), "CANopen I/O"]
    machine("candump -L vcan0,0:0,#FFFFFFFF >/tmp/errors 2>&1 & echo $! >/tmp/candump")
    machine.until(f"grep {0x700 + NODE:X}# /tmp/errors")
    with Simulator(drive) as simulator:
        simulator.faults.can_bus_off(CAN)
    machine.until("grep 20000240 /tmp/errors")  # bus-off, with counters
    machine("kill $(cat /tmp/candump)")
    wait_until_well(machine)
    machine("systemctl restart ecatd", timeout=300)
    wait_until_well(machine)
    machine("ip link set vcan0 down; sleep 2; ip link set vcan0 up")
    expect(machine, ASK, ANSWER)
    assert machine.text("systemctl show -P NRestarts ecatd-can-bridge") == "0"
    machine("ip link delete vcan0")
    machine.until("systemctl show -P NRestarts ecatd-can-bridge | grep -v ^0")
    machine.until("ip link show vcan0 up | grep vcan0")
    expect(machine, ASK, ANSWER)
    machine("systemctl stop ecatd-can-bridge")


@whole_day
def test_a_start_that_goes_on_gets_its_time(machine: Machine, drive: str) -> None:
    """It takes longer than systemd would wait, and the bus server says that it works on it."""
    limits = "/run/systemd/system/ecatd@.service.d/limits.conf"
    machine.write(limits, f"[Service]\nTimeoutStartSec={START_LIMIT_S}\n")
    with Simulator(drive) as simulator:
        names = [slave.name for slave in simulator.status().slaves]
        # Its PDOs are described by a hundred objects.
        simulator.faults.mailbox(names.index("EL3008"), "slow", delay_s=0.5)
        machine("systemctl daemon-reload && systemctl stop ecatd", timeout=200)
        began = machine("systemctl start ecatd", timeout=400)
        note(f"start with a limit of {START_LIMIT_S} s", f"{began.seconds:.1f} s")
        assert began.seconds > START_LIMIT_S
        simulator.faults.mailbox(names.index("EL3008"), "none")
    machine(f"rm {limits} && systemctl daemon-reload")
    wait_until_well(machine)


# --- Processes that die or hang while a drive turns ----------------------------------------------


@pytest.mark.parametrize(
    "module",
    ["main", *(pytest.param(name, marks=whole_day) for name in (*PROCESSES[1:], "client"))],
)
def test_r17_a_process_is_killed(machine: Machine, drive: str, module: str) -> None:
    with Simulator(drive) as simulator:
        turn(machine, simulator)
        before = {name: process(machine, name) for name in ("main", "ecatd.server")}
        if module == "client":
            machine("systemctl kill --signal=KILL spin")
        else:
            machine(f"kill -KILL {process(machine, module)}")
        if module == "ecatd.gateway":
            wait_until_well(machine)
            assert abs(simulator.get(0, VELOCITY)) > 0.9 * SPEED
            machine("systemctl stop spin")
            watch_the_end(simulator)
        else:
            speed, seconds = watch_the_end(simulator)
            note(
                f"{module} killed: the drive leaves OP or stands", f"{speed} inc/s, {seconds:.1f} s"
            )
            if module in ("main", "client"):
                assert speed < SPEED / 50
        wait_until_well(machine)
        machine("systemctl stop spin; true")
        same = {name: process(machine, name) == pid for name, pid in before.items()}
        assert set(same.values()) == {module in ("client", "ecatd.gateway")}


@whole_day
@pytest.mark.parametrize("module", PROCESSES)
def test_r18_a_process_hangs(machine: Machine, drive: str, module: str) -> None:
    with Simulator(drive) as simulator:
        turn(machine, simulator)
        stopped = process(machine, module)
        began = time.monotonic()
        machine(f"kill -STOP {stopped}")
        if module == "ecatd.gateway":
            machine.until(f"! kill -0 {stopped}", 240)
            wait_until_well(machine)
            assert abs(simulator.get(0, VELOCITY)) > 0.9 * SPEED
            machine("systemctl stop spin")
        else:
            machine.until(f"! kill -0 {stopped}", 240)
            wait_until_well(machine)
        note(f"{module} stopped: well again", f"{time.monotonic() - began:.1f} s")
        machine("systemctl stop spin; true")


@whole_day
def test_no_memory_is_left(machine: Machine, drive: str) -> None:
    """The kernel ends what takes the memory, not ecatd."""
    before = process(machine, "ecatd.server")
    with Simulator(drive) as simulator:
        turn(machine, simulator)
        machine(
            "systemd-run --quiet --wait --pipe python3 -c "
            "'x = []\nwhile True: x.append(bytearray(b\"x\" * 2**24))' 2>&1 | tail -1",
            status=None,
            timeout=300,
        )
        assert "Out of memory" in machine.text("dmesg | grep -i 'out of memory'")
        assert process(machine, "ecatd.server") == before
        machine("systemctl stop spin; true")
    wait_until_well(machine)


@whole_day
def test_the_doctor_sees_and_mends_the_card(machine: Machine) -> None:
    name = interface(machine, 0)
    machine(f"ethtool -C {name} rx-usecs 100; ethtool -K {name} gro on")

    def hints() -> set[str]:
        found = json.loads(machine("ecatctl doctor --json", status=None).text)["findings"]
        assert not [item for item in found if item["level"] == "problem"], found
        return {item["name"] for item in found if item["fixable"]}

    assert {"interrupt coalescing", "offloads"} <= hints()
    told = machine("ecatctl doctor --fix", status=None).text
    for line in re.findall(r"^.* -> .*$", told, re.MULTILINE):
        note("doctor", line)
    assert re.search(f"{name} coalescing: rx 100 .*-> rx 0 tx .*the exchange took", told)
    assert machine.text(f"ethtool -c {name} | grep ^rx-usecs:").split()[1] == "0"
    assert "interrupt coalescing" not in hints()
    machine("ecatctl doctor --undo", status=None)
    assert machine.text(f"ethtool -c {name} | grep ^rx-usecs:").split()[1] == "100"
    told = machine("ecatctl doctor --latency 10", status=None, timeout=200).text
    assert "with PREEMPT_RT" in told
    assert re.search(r"^ +busy +yes ", told, re.MULTILINE)
    wait_until_well(machine)


@whole_day
def test_r21_the_time_of_day_jumps(machine: Machine) -> None:
    before = process(machine, "ecatd.server")
    machine("date -s '+1 hour' && sleep 2 && date -s '-2 hours' && sleep 2 && date -s '+1 hour'")
    wait_until_well(machine)
    assert process(machine, "ecatd.server") == before
    assert machine("ecatctl check").seconds < 60  # a wait that went by that clock would hang


# --- Wires and cards -----------------------------------------------------------------------------


def test_r10_the_cable_is_pulled(machine: Machine) -> None:
    machine.monitor("set_link", name="card0", up=False)
    machine.until("ecatctl check | grep -E 'no carrier|link|cable|down'; test $? = 0", 120)
    assert machine("ecatctl check", status=None).status in (1, 2)
    machine.monitor("set_link", name="card0", up=True)
    wait_until_well(machine)


@whole_day
def test_r10_the_card_is_pulled_and_put_back(machine: Machine) -> None:
    name = interface(machine, 0)
    machine.monitor("device_del", id="card0")
    machine.until(f"! test -e /sys/class/net/{name}")
    machine.until("! ecatctl check", 120)
    machine.monitor(
        "device_add", driver="e1000e", netdev="wire0", id="card0", bus="slot0", mac=MACS[0]
    )
    machine.until(f"test -e /sys/class/net/{name}")
    wait_until_well(machine)


@whole_day
def test_r42_two_buses(machine: Machine) -> None:
    name = interface(machine, 1)
    with segment("line:3", 1):
        machine(f"ecatctl --bus press service install --interface {name}")
        machine(
            "sed -i 's/^listen = .*/listen = []/; s/^cycle_time_us.*/cycle_time_us = 10000/' "
            "/etc/ecatd/press.toml"
        )
        machine("systemctl start ecatd@press", timeout=200)
        wait_until_well(machine, "press")
        wait_until_well(machine)
        machine("systemctl stop ecatd@press", timeout=200)
        wait_until_well(machine)
        assert machine.text("ls /run/ecatd") == "ecat0"
        machine("systemctl disable ecatd@press")  # its segment ends, and the machine starts again


@whole_day
def test_r10_the_machine_starts_again_with_a_late_interface(machine: Machine) -> None:
    machine.monitor("device_del", id="card0")
    machine.until("! ecatctl check", 120)
    machine.reboot()
    assert machine("systemctl is-active ecatd", status=None).text.strip() != "active"
    machine.monitor(
        "device_add", driver="e1000e", netdev="wire0", id="card0", bus="slot0", mac=MACS[0]
    )
    began = time.monotonic()
    wait_until_well(machine)
    note("the interface is there: the bus is well", f"{time.monotonic() - began:.1f} s")


# --- Upgrade and end -----------------------------------------------------------------------------


@whole_day
def test_an_upgrade_leaves_the_bus_alone(machine: Machine) -> None:
    before = process(machine, "ecatd.server")
    machine("cp -r /etc/ecatd /tmp/before")
    machine("mkdir -p /tmp/new && dpkg-deb -R /files/ecatd_*.deb /tmp/new")
    machine("sed -i 's/^Version: .*/Version: 99.0/' /tmp/new/DEBIAN/control")
    version = "/tmp/new/usr/lib/ecatd/lib/python3.11/site-packages/ecatd/base/version.py"
    machine(f"sed -i 's/^VERSION = .*/VERSION = \"99.0\"/' {version}")
    machine("dpkg-deb -Znone -b /tmp/new /tmp/ecatd_99.deb >/dev/null")
    told = machine("apt-get install -y /tmp/ecatd_99.deb 2>&1 | tail -5", timeout=300).text
    assert "systemctl restart ecatd" in told
    assert process(machine, "ecatd.server") == before
    machine("diff -r /etc/ecatd /tmp/before")
    wait_until_well(machine)
    assert "is run by version 0." in machine("ecatctl doctor", status=None).text
    machine("systemctl restart ecatd", timeout=300)
    wait_until_well(machine)
    assert "is run by version" not in machine("ecatctl doctor", status=None).text
    assert process(machine, "ecatd.server") != before


def test_nothing_stays(machine: Machine, drive: str) -> None:
    machine(f"systemctl enable ecatd@press; rm {BRIDGE} && systemctl daemon-reload")
    machine(f"ethtool -C {interface(machine, 0)} rx-usecs 100; ecatctl doctor --fix", status=None)
    machine("test -e /run/ecatd-doctor.json")
    machine("apt-get purge -y ecatd 2>&1 | tail -5", timeout=300)
    with Simulator(drive) as simulator:
        assert {slave.state for slave in simulator.status().slaves} == {"INIT"}
    names = " -o ".join(f"-name '{name}*'" for name in ("*ecatd", "ecatctl", "ecatsim", "ecat0"))
    pruned = " ".join(f"-path {path} -prune -o" for path in PRUNED)
    left = machine.text(f"find / /run -xdev {pruned} \\( {names} \\) -print; ls /dev/shm")
    assert not left
    assert machine("id ecatd", status=1)
    assert machine("id ecatd-gateway", status=1)
    assert machine("id ecatd-web", status=1)
    assert machine("getent group ecat", status=2)
    assert "ecatd" not in machine.text("systemctl list-units --all --no-pager | grep ecat; true")
    print("\n".join(f"| {what} | {figure} |" for what, figure in FIGURES))
