"""What goes wrong on a wire, on the real daemon: named, counted, told, survived.

The daemon runs on a simulated segment; what goes wrong is done to its interfaces, from inside their
namespace, or by the simulator.
"""

import contextlib
import ctypes
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from conftest import PATIENCE, SHM, Daemon, names, one_line_error, run_module, wait_for
from ecatd.base.errors import UnreachableError
from ecatd.base.paths import zenoh_socket
from ecatd.base.process import OF_ROOT
from ecatd.etg.al import AlState
from ecatd.operations.bus import Event
from ecatd.operations.encoding import unpack
from ecatd.operations.zenoh_keys import bus_key, session_config
from ecatd.shm import contract as shm
from ecatdev.zenoh_keys.types import problems
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]

CYCLE_TIME_US = 1000
"""These tests count cycles."""

INSIDE = Path(__file__).with_name("inside.py")
PR_CAPBSET_DROP, CAP_NET_ADMIN, CAP_IPC_LOCK, CAP_SYS_NICE = 24, 12, 14, 23
MASTER, SIMULATOR = "ecat-master", "ecat-sim"


class Bench:
    """A daemon, its simulator, and what it publishes."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.simulator = daemon.child_pid("ecatsim")
        self.server = daemon.child_pid("ecatd.server")
        self.events: list[dict[str, Any]] = []
        socket = zenoh_socket(Path(daemon.env["ECATD_RUNTIME_DIR"]), daemon.bus)
        settings = {"connect/endpoints": [f"unixsock-stream/{socket}"]}
        self._session = zenoh.open(session_config("client", settings))
        self._subscriber = self._session.declare_subscriber(
            bus_key(daemon.bus, "ro", "event"),
            lambda sample: self.events.append(unpack(bytes(sample.payload))),
        )
        # An answer to a question that was asked later says that the gateway knows the subscriber.
        assert list(self._session.get(bus_key(daemon.bus, "ro", "info"), timeout=PATIENCE))

    def close(self) -> None:
        """Ends; all events must have been as docs/zenoh-keys.md says."""
        self._subscriber.undeclare()
        self._session.close()
        assert [text for event in self.events for text in problems(event, Event)] == []

    def inside(self, *arguments: str) -> None:
        """Does something in the namespace of the interfaces."""
        subprocess.run(self._command(arguments), check=True)

    def start_inside(self, *arguments: str) -> subprocess.Popen[bytes]:
        """The same, beside the test."""
        return subprocess.Popen(self._command(arguments))

    def _command(self, arguments: tuple[str, ...]) -> list[str]:
        return [sys.executable, str(INSIDE), str(self.simulator), *arguments]

    def ctl(self, *arguments: str) -> None:
        """Runs `ecatsim ctl`."""
        result = run_module("ecatsim", "ctl", "--name", str(self.simulator), *arguments)
        assert result.returncode == 0, result.stderr

    def power(self, *positions: int, on: bool) -> None:
        """Switches the power of slaves in this order, one right after the other."""
        with Simulator(str(self.simulator)) as simulator:
            for position in positions:
                (simulator.faults.power_on if on else simulator.faults.power_off)(position)

    def wait_for(self, condition: Callable[[], bool]) -> None:
        try:
            wait_for(condition, self.daemon)
        except AssertionError as error:
            error.add_note(f"events: {self.events}")
            raise

    def wait_for_log(self, text: str, count: int = 1) -> None:
        self.wait_for(lambda: self.daemon.log.count(text) >= count)

    def wait_for_event(self, kind: str, **facts: Any) -> None:
        """Waits until an event with these facts has been published."""
        wanted = {"event": kind, **facts}.items()
        self.wait_for(lambda: any(wanted <= event.items() for event in map(simple, self.events)))

    def wait_for_data(self) -> None:
        """Waits until process data of all slaves have been exchanged ten times in a row."""
        with self.daemon.client() as client:

            def ten() -> bool:
                for _ in range(10):
                    client.wait()
                    client.sample()
                    if client.domain().wkc_state != shm.WkcState.COMPLETE:
                        return False
                return True

            self.wait_for(ten)

    def wait_for_op(self) -> None:
        """Waits until the slaves that were in OP are there again."""
        with self.daemon.client() as client:
            self.wait_for(lambda: all(slave.al_state == AlState.OP for slave in client.slaves()))

    def health(self) -> Any:
        """A copy of the counters in shared memory."""
        data = (SHM / self.daemon.bus).read_bytes()
        header = shm.struct("ecat_shm_header").from_buffer_copy(data)
        return shm.struct("ecat_shm_health").from_buffer_copy(data, header.health_offset)

    def check_rights(self) -> None:
        """Checks that no thread has CAP_NET_ADMIN in effect, though it can have it.

        It has given up for good what the bus does not need.
        """
        for thread in Path(f"/proc/{self.server}/task").iterdir():
            lines = (thread / "status").read_text().splitlines()
            status = dict(line.split(":\t", 1) for line in lines)
            found = [int(status[key], 16) >> CAP_NET_ADMIN & 1 for key in ("CapEff", "CapPrm")]
            assert found == [0, 1], status["Name"]
            kept = sum(1 << capability for capability in OF_ROOT)
            assert not int(status["CapPrm"], 16) & ~kept, status["Name"]
            assert not int(status["CapBnd"], 16) & ~kept, status["Name"]
            assert status["NoNewPrivs"] == "1", status["Name"]

    def busy(self, seconds: float = 1.0) -> float:
        """Share of a CPU that the bus server takes for a while."""

        def used() -> int:
            fields = Path(f"/proc/{self.server}/stat").read_text().rsplit(")", 1)[1].split()
            return int(fields[11]) + int(fields[12])

        before = used()
        time.sleep(seconds)
        return (used() - before) / os.sysconf("SC_CLK_TCK") / seconds


def simple(event: dict[str, Any]) -> dict[str, Any]:
    """An event without what cannot be compared by `<=`."""
    return {key: value for key, value in event.items() if not isinstance(value, (list, dict))}


@pytest.fixture
def bench(start_daemon: Callable[..., Daemon]) -> Iterator[Bench]:
    made = Bench(start_daemon("troll"))
    made.wait_for_data()
    yield made
    made.close()


def test_r10_interface_switched_off_and_on(bench: Bench) -> None:
    bench.inside("switch", MASTER, "down")
    bench.wait_for_log(f"{MASTER}: was switched off")
    bench.wait_for_log(f"frames cannot be sent on {MASTER}: ")
    bench.wait_for_event("link", interface=MASTER, state="down")
    bench.wait_for(lambda: bench.health().link_first == shm.Link.DOWN)
    assert bench.busy() < 0.5
    # What an administrator has switched off stays off.
    assert bench.health().link_first == shm.Link.DOWN
    assert bench.health().unsent > 0
    bench.inside("switch", MASTER, "up")
    bench.wait_for_log(f"{MASTER}: the link is up")
    bench.wait_for_event("link", interface=MASTER, state="up")
    assert bench.health().link_first == shm.Link.UP
    bench.wait_for_data()
    bench.wait_for_op()
    bench.wait_for_log("back in OP after")


def test_r10_carrier_lost_and_back(bench: Bench) -> None:
    bench.inside("switch", SIMULATOR, "down")
    bench.wait_for_log(f"{MASTER}: no carrier: check the cable")
    bench.wait_for_log("no slave answers")
    bench.wait_for_event("link", interface=MASTER, state="no_carrier")
    bench.wait_for_event("slaves", found=0)
    bench.wait_for(lambda: bench.health().link_first == shm.Link.NO_CARRIER)
    assert bench.health().slaves_found == 0
    assert bench.health().wkc_bad > 0
    assert bench.busy() < 0.5
    bench.inside("switch", SIMULATOR, "up")
    bench.wait_for_log(f"{MASTER}: the link is up")
    bench.wait_for_log("all 8 slaves answer, and no others")
    bench.wait_for_event("slaves", found=8)
    bench.wait_for_data()
    bench.wait_for_op()


def test_r10_interface_gone_and_back(bench: Bench) -> None:
    bench.inside("delete", MASTER)
    bench.wait_for_log(f"{MASTER}: is gone")
    bench.wait_for_event("link", interface=MASTER, state="gone")
    bench.wait_for(lambda: bench.health().link_first == shm.Link.GONE)
    assert bench.busy() < 0.5
    bench.inside("make", MASTER, SIMULATOR)
    bench.wait_for_log(f"{MASTER} is back as another interface")
    bench.wait_for_event("link", interface=MASTER, state="up")
    bench.wait_for_data()
    bench.wait_for_op()
    assert bench.daemon.ctl("sdo-read", "0", "0x1018", "1").stdout.startswith("0x0000009A")
    bench.check_rights()


def test_r05_slaves_missing_and_back(bench: Bench) -> None:
    bench.ctl("break-link", "5")
    bench.wait_for_log(
        "slave count changed from 8 to 5: no answer from slave 5 (EL3008) and all slaves behind it"
    )
    bench.wait_for_event("slaves", found=5, expected=8)
    bench.wait_for_event("al_state", slave=6, text="slave 6 (EL6751): no answer")
    bench.wait_for(lambda: bench.health().slaves_found == 5)
    with bench.daemon.client() as client:
        states = [slave.al_state for slave in client.slaves()]
    assert states == [AlState.OP] * 5 + [0] * 3
    assert bench.health().wkc_bad > 0
    bench.ctl("heal-link", "5")
    bench.wait_for_log("all 8 slaves answer, and no others")
    bench.wait_for_event("slaves", found=8, expected=8)
    bench.wait_for_data()
    bench.wait_for_op()


def test_slaves_that_do_not_answer_are_named_together(
    start_daemon: Callable[..., Daemon],
) -> None:
    bench = Bench(start_daemon("troll", config="state_timeout_s = 5.0\n[gateway]\nlisten = []\n"))
    bench.wait_for_data()
    bench.ctl("power-off", "2")
    bench.wait_for_log("slave count changed from 8 to 2")
    result = bench.daemon.ctl("state", "OP", check=False)
    assert result.returncode == 7
    assert result.stderr.count("\n") == 1
    names(one_line_error(result.stderr, "ecatctl"), "slaves 2-7", "no answer")
    bench.close()


def test_slave_that_leaves_op_is_named(bench: Bench) -> None:
    bench.ctl("al-error", "4", "0x1234")
    bench.wait_for_log("slave 4 (EL3008): SAFEOP+ERROR (AL status 0x1234")
    bench.wait_for_event("al_state", slave=4, al_code=0x1234)
    with bench.daemon.client() as client:
        assert client.slaves()[4].al_state == AlState.SAFEOP | 0x10
    # It did not fall by its watchdog: somebody should look why, so it stays.
    time.sleep(1)
    bench.wait_for_data()
    with bench.daemon.client() as client:
        assert client.slaves()[4].al_state == AlState.SAFEOP | 0x10


def test_emergencies_of_a_running_slave_are_events(bench: Bench) -> None:
    """Nobody asks the slave for anything; what it says otherwise is not lost either."""
    with Simulator(str(bench.simulator)) as simulator:
        simulator.faults.emergency(0, 0x3220, register=0x04)
        bench.wait_for_event("emergency", slave=0, code=0x3220, register=0x04, times=1)
        said = "error code 0x3220 (voltage inside the device), error register 0x04"
        bench.wait_for_log(f"slave 0 (Gold EtherCAT GCON Drive) sent an emergency: {said}")
        shown = bench.daemon.ctl("events", "0").stdout.splitlines()
        (line,) = (line for line in shown if "emergency" in line)
        assert line.endswith(f"slave 0 (Gold EtherCAT GCON Drive) sent an emergency: {said}")
        for code in range(0x8000, 0x8020):
            simulator.faults.emergency(0, code, register=0x11)
    for code in (0x8000, 0x801F):
        bench.wait_for_event("emergency", slave=0, code=code)
    assert bench.daemon.ctl_json("sdo-read", "0", "0x1000")["value"]


def test_r14_another_master_on_the_wire(bench: Bench) -> None:
    """One that does nothing but to send, with indices of the engine and addresses of its own."""
    lrd = "0a85000000702000 0000" + "00" * 34
    frame = "ffffffffffff 041122334455 88a4 2c10" + lrd
    other = bench.start_inside("send", MASTER, frame, "3000", "0.001")
    # A slave sets a bit of the source address.
    bench.wait_for_log(
        f"frames of another EtherCAT master on {MASTER} (source 06:11:22:33:44:55): "
    )
    bench.wait_for_event("foreign_master", interface=MASTER, source="06:11:22:33:44:55")
    assert bench.health().foreign > 0
    bench.wait_for_data()
    other.wait()
    bench.wait_for_log(f"no more frames of another EtherCAT master on {MASTER}")
    bench.wait_for_event("foreign_master", interface=MASTER, over=True)
    assert bench.daemon.log.count("frames of another EtherCAT master") < 8
    bench.wait_for_op()


def test_frames_of_an_earlier_run_are_not_taken(bench: Bench) -> None:
    """Answers as ours, but for the number of the run; their inputs are all ones."""
    before = bench.health().foreign
    other = bench.start_inside("replay", MASTER, SIMULATOR, "3")
    bench.wait_for_log("another ecatd or an earlier run of this one")
    with bench.daemon.client() as client:
        constant = client.signal(5, 0x6010, 0x11)
        while other.poll() is None:
            client.wait()
            client.sample()
            assert constant.raw == pytest.approx(-4 / 10 * 32767, abs=1)
    assert bench.health().foreign > before
    bench.wait_for_data()
    bench.wait_for_op()


def test_r14_a_second_master_that_uses_the_slaves(bench: Bench) -> None:
    """It takes the slaves out of OP and maps them its own way; nothing of that may end us."""
    bench.start_inside("soem", MASTER, "2").wait()
    bench.wait_for_log("a master with SOEM")
    bench.wait_for_event("foreign_master", interface=MASTER, over=False)
    bench.wait_for_event("al_state")
    bench.wait_for_log("no more frames of another EtherCAT master")
    assert bench.busy() < 0.5
    assert bench.daemon.slave_rows("state")


def other_master(bench: Bench, source: str) -> str:
    """What is told of another master, once it is told."""
    begin = f"frames of another EtherCAT master on {MASTER} (source {source}): "
    bench.wait_for_log(begin)
    return next(line for line in bench.daemon.log.splitlines() if begin in line)


def test_r14_a_second_master_that_only_scans(bench: Bench) -> None:
    """To scan is to reset all slaves; what was done is named, and undone."""
    bench.start_inside("soem_scan", MASTER).wait()
    other_master(bench, "03:01:01:01:01:01, a master with SOEM")
    # What it did may be told in parts: the first report may come before it has done everything.
    for what, whose in (
        (r"AL control \(0x0120: INIT", "all slaves"),
        (r"FMMUs \(0x0600\)", "all slaves"),
        (r"station addresses \(0x0010\)", "single slaves"),
    ):
        said = re.compile(rf"It wrote [^\n]*{what}[^\n]* of {whose}")
        bench.wait_for(lambda said=said: said.search(bench.daemon.log) is not None)
    fact = "FMMUs (0x0600) of all slaves"
    bench.wait_for(lambda: any(fact in event.get("wrote", []) for event in bench.events))
    assert bench.health().foreign > 0
    bench.wait_for_log("back in OP after")
    bench.wait_for_op()
    bench.wait_for_data()
    assert bench.daemon.ctl_json("stats")["foreign"] == bench.health().foreign


def test_a_second_master_of_another_kind(bench: Bench) -> None:
    """KickCAT gives up when the first answer that it gets is one of ours; else it goes on."""
    bench.start_inside("kickcat_scan", MASTER).wait()
    other_master(bench, "ca:de:ca:de:de:ff, a master with KickCAT")
    assert bench.health().foreign >= 1
    bench.wait_for_data()


def test_a_second_master_that_only_reads(bench: Bench) -> None:
    read = "0700000030010200000000000000"  # BRD of the AL status
    frame = ("ff" * 6 + "062233445566" + "88a4" + "0e10" + read).ljust(120, "0")
    bench.start_inside("send", MASTER, frame, "1", "0").wait()
    told = other_master(bench, "06:22:33:44:55:66")
    names(told, "1 within 1 s", "only read")
    bench.wait_for_event("foreign_master", interface=MASTER, count=1)
    assert bench.health().foreign == 1


RIG = """
name = "growing"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL2008"
[[slave]]
device = "EL1018"
[[slave]]
device = "EL1008"
[[fault]]
kind = "break-link"
slave = 3
"""


def test_more_slaves_than_at_the_start(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    rig = tmp_path / "growing.toml"
    rig.write_text(RIG)
    bench = Bench(start_daemon(str(rig)))
    assert "3 slaves found" in bench.daemon.log
    bench.ctl("heal-link", "3")
    bench.wait_for_log("slave count changed from 3 to 4: a slave was added behind slave 2 (EL1018)")
    bench.wait_for_event("slaves", found=4, expected=3)
    bench.wait_for(lambda: bench.health().slaves_found == 4)
    bench.wait_for_data()
    bench.ctl("break-link", "3")
    bench.wait_for_log("all 3 slaves answer, and no others")
    bench.close()


def test_slaves_that_lost_their_power_are_told_from_missing_ones(bench: Bench) -> None:
    bench.ctl("power-off", "7")
    bench.wait_for_log("to 7: no answer from slave 7 (EL6751), 1 slave missing")
    bench.ctl("power-on", "7")
    bench.wait_for_log("slave 7 (EL6751): back in OP after")
    bench.wait_for_event("slaves", found=8)
    bench.wait_for_op()
    bench.wait_for_data()


def take_real_time_away() -> None:
    """In a process that becomes the daemon: as a user who may not have real time."""
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
    libc = ctypes.CDLL(None)
    for capability in (CAP_IPC_LOCK, CAP_SYS_NICE):
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)


def test_r43_no_permission_for_real_time(start_daemon: Callable[..., Daemon]) -> None:
    config = "[gateway]\nlisten = []\n[realtime]\ncpu = 1023\n"
    daemon = start_daemon("troll", config=config, preexec=take_real_time_away)
    told = [line for line in daemon.log.splitlines() if "no real time: " in line]
    wrong, rights = sorted(told)
    names(wrong, "CPU (1023) was refused", "realtime.cpu")
    names(rights, "refuses SCHED_FIFO", "locked memory", "ecatctl doctor")
    names(rights, f"systemctl cat ecatd@{daemon.bus}")  # it is started as systemd does
    found = daemon.ctl("doctor", "--json", check=False).stdout
    names(found, "SCHED_FIFO", "refused", "CAP_SYS_NICE", "CAP_IPC_LOCK")
    bench = Bench(daemon)
    bench.wait_for_data()
    bench.close()


def test_r42_the_right_to_set_interfaces_up_is_not_in_effect(bench: Bench) -> None:
    bench.check_rights()


def test_r20_a_cycle_that_is_held_up_is_counted(bench: Bench) -> None:
    before = bench.health().missed
    os.kill(bench.server, signal.SIGSTOP)
    time.sleep(0.05)  # less than the watchdog of the slaves
    os.kill(bench.server, signal.SIGCONT)
    bench.wait_for(lambda: bench.health().missed >= before + 40)
    bench.wait_for_log(" missed cycles")
    bench.wait_for_event("disturbance")
    bench.wait_for_data()


SLAVES = 5
RING = "name = 'ring'\nring = true\n" + "[[slave]]\ndevice = 'Loopback32'\n" * SLAVES
SECOND = "ecat-master2"


@pytest.fixture
def ring(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Iterator[Bench]:
    rig = tmp_path / "ring.toml"
    rig.write_text(RING)
    made = Bench(start_daemon(str(rig)))
    made.wait_for_data()
    made.wait_for_log("the ring is closed")  # the watch has seen it before anything is broken
    yield made
    made.close()


def exchange_everything(bench: Bench, value: int) -> None:
    """Writes outputs of every slave and waits until they have come back as inputs."""
    with bench.daemon.client() as client:
        outputs = [client.signal(slave, 0x7000, 1) for slave in range(SLAVES)]
        inputs = [client.signal(slave, 0x6000, 1) for slave in range(SLAVES)]

        def claimed() -> bool:
            """Whether all are owned; a machine that stands still is not what is tested here."""
            with contextlib.suppress(UnreachableError):
                client.claim(outputs, lease=30)
                return True
            return False

        bench.wait_for(claimed)
        wanted = [value + slave for slave in range(SLAVES)]

        def arrived() -> bool:
            for output, number in zip(outputs, wanted, strict=True):
                output.raw = number
            client.commit()
            client.wait()
            client.sample()
            return [item.raw for item in inputs] == wanted

        bench.wait_for(arrived)


def ring_of(bench: Bench) -> str:
    """What `ecatctl info` says about the ring."""
    lines = bench.daemon.ctl("info", check=False).stdout.splitlines()
    return next(line for line in lines if line.startswith("ring "))


@pytest.mark.parametrize("place", range(SLAVES + 1))
def test_a_ring_that_is_cut_anywhere(ring: Bench, place: int) -> None:
    """Every slave goes on being exchanged, and the place is told."""
    ring.wait_for_log("the ring is closed")
    assert ring.health().ring == shm.Ring.CLOSED
    assert "closed" in ring_of(ring)
    exchange_everything(ring, 10)
    names = [MASTER, *(f"slave {i} (Loopback32)" for i in range(SLAVES)), SECOND]
    cable = [str(place)] if place < SLAVES else [str(SLAVES - 1), "--port", "1"]
    ring.ctl("break-link", *cable)
    text = f"the ring is broken between {names[place]} and {names[place + 1]}"
    ring.wait_for_log(text)
    ring.wait_for_event("ring", state="open", slaves_before=place)
    assert ring.health().ring == shm.Ring.OPEN
    assert ring.health().ring_break == place
    ends = {0: "in front of slave 0", SLAVES: f"behind slave {SLAVES - 1}"}
    where = ends.get(place, f"between slaves {place - 1} and {place}")
    assert f"OPEN {where}, second interface up" in ring_of(ring)
    exchange_everything(ring, 20)
    ring.wait_for_data()
    ring.wait_for(lambda: ring.health().slaves_found == SLAVES)
    # Mailbox and registers reach all of them, too.
    ring.wait_for(lambda: {row["text"] for row in ring.daemon.slave_rows("state")} == {"OP"})
    ring.ctl("heal-link", *cable)
    ring.wait_for_log("the ring is closed", 2)
    ring.wait_for_event("ring", state="closed")
    assert ring.health().ring == shm.Ring.CLOSED
    exchange_everything(ring, 30)
    assert "slaves missing" not in ring.daemon.log


def test_a_ring_from_which_nothing_comes_back(ring: Bench) -> None:
    """What was last known of it says nothing then."""
    ring.wait_for_log("the ring is closed")
    for interface, end in ((SIMULATOR, 0), ("ecat-sim2", SLAVES - 1)):
        ring.inside("switch", interface, "down")
        near = MASTER if interface == SIMULATOR else SECOND
        ring.wait_for_log(
            f"{near}: no carrier: check the cable, and the power of slave {end} (Loopback32)"
        )
    ring.wait_for(lambda: ring.health().slaves_found == 0)
    assert ring_of(ring).split(maxsplit=1)[1] == (
        "unknown while no frame comes back, second interface no carrier"
    )


@pytest.mark.parametrize(
    ("cable", "text"),
    [
        ("slave = 0", f"between {MASTER} and slave 0 (Loopback32)"),
        ("slave = 2", "between slave 1 (Loopback32) and slave 2 (Loopback32)"),
        ("slave = 4\nport = 1", f"between slave 4 (Loopback32) and {SECOND}"),
    ],
)
def test_a_ring_that_was_cut_before_the_start(
    start_daemon: Callable[..., Daemon], tmp_path: Path, cable: str, text: str
) -> None:
    rig = tmp_path / "ring.toml"
    rig.write_text(RING + f"[[fault]]\nkind = 'break-link'\n{cable}\n")
    bench = Bench(start_daemon(str(rig)))
    bench.wait_for_log(f"the ring is broken {text}")
    exchange_everything(bench, 5)
    assert len(bench.daemon.slave_rows("state")) == SLAVES
    bench.close()


@pytest.mark.parametrize("interface", [MASTER, SECOND])
def test_a_ring_survives_the_loss_of_an_interface(ring: Bench, interface: str) -> None:
    exchange_everything(ring, 10)
    ring.inside("switch", interface, "down")
    ring.wait_for_event("link", interface=interface, state="down")
    exchange_everything(ring, 20)
    assert ring.busy() < 0.5
    ring.inside("switch", interface, "up")
    ring.wait_for_event("link", interface=interface, state="up")
    ring.wait_for_log("the ring is closed", 2)
    exchange_everything(ring, 30)
    assert {row["text"] for row in ring.daemon.slave_rows("state")} == {"OP"}


def test_a_contact_that_fails_for_a_moment(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    fault = "[[fault]]\nkind = '{}-link'\nslave = 2\nat_cycle = {}\n"
    rig = tmp_path / "ring.toml"
    rig.write_text(RING + fault.format("break", 2000) + fault.format("heal", 2020))
    bench = Bench(start_daemon(str(rig)))
    bench.wait_for_log("the ring was broken between slave 1 (Loopback32) and slave 2 ")
    bench.wait_for_event("ring", state="closed", slaves_before=2)
    exchange_everything(bench, 5)
    bench.close()


@pytest.mark.parametrize(("interface", "peer"), [(MASTER, SIMULATOR), (SECOND, f"{SIMULATOR}2")])
def test_a_ring_survives_that_an_interface_is_another_one(
    ring: Bench, interface: str, peer: str
) -> None:
    exchange_everything(ring, 10)
    ring.inside("delete", interface)
    ring.wait_for_event("link", interface=interface, state="gone")
    exchange_everything(ring, 20)
    assert {row["text"] for row in ring.daemon.slave_rows("state")} == {"OP"}
    ring.inside("make", interface, peer)
    ring.wait_for_log(f"{interface} is back as another interface")
    ring.wait_for_log("the ring is closed", 2)
    exchange_everything(ring, 30)
    assert {row["text"] for row in ring.daemon.slave_rows("state")} == {"OP"}


def test_a_second_break_loses_the_slaves_between(ring: Bench) -> None:
    ring.ctl("break-link", "1")
    ring.wait_for_log("the ring is broken between slave 0 ")
    ring.ctl("break-link", "3")
    ring.wait_for_log("no answer from slaves 1-2, 2 slaves missing")
    ring.wait_for_event("slaves", found=3, expected=SLAVES)
    ring.ctl("heal-link", "1")
    ring.wait_for_log("all 5 slaves answer, and no others")
    ring.ctl("heal-link", "3")
    ring.wait_for_log("the ring is closed", 2)
    ring.wait_for_data()
    ring.wait_for_op()
