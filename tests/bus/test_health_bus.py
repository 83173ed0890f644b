"""Health follows what the exchange does: `check`, the status, metrics and events, on a real bus.

What goes wrong is done by the simulator, to registers of slaves, or to the interface.
"""

import contextlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from test_bad_conditions import INSIDE, MASTER, Bench

from conftest import Daemon, names, wait_for
from ecatd.base import network_namespace
from ecatd.shm.statistics import read
from ecatsim.control import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

CYCLE_TIME_US = 4000
CONFIG = """
[gateway]
listen = []
[health]
window_s = 3
lost = 0.2
late = 0.2
[[slave]]
position = 0
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 20000
"""
WELL, DEGRADED, DOWN = range(3)


@pytest.fixture(scope="module")
def bench(start_shared: Callable[..., Daemon]) -> Iterator[Bench]:
    made = Bench(start_shared("troll", config=CONFIG))
    yield made
    made.close()


@pytest.fixture
def simulator(bench: Bench) -> Iterator[Simulator]:
    with Simulator(str(bench.simulator)) as made:
        yield made
        made.faults.clear()
        bench.wait_for(lambda: check(bench)[0] == WELL)


def check(bench: Bench) -> tuple[int, list[str]]:
    """Exit status of `ecatctl check`, and the problems."""
    done = bench.daemon.ctl("check", "--json", check=False)
    return done.returncode, json.loads(done.stdout)["problems"]


def problem(bench: Bench, *tokens: object) -> str:
    """Waits for a problem that names all of these, and returns it."""
    found: list[str] = []

    def told() -> bool:
        found[:] = [text for text in check(bench)[1] if all(str(token) in text for token in tokens)]
        return bool(found)

    bench.wait_for(told)
    return found[0]


def metrics(bench: Bench) -> str:
    return bench.daemon.ctl("metrics").stdout


def test_working_counters_are_wrong_and_no_slave_explains_it(
    bench: Bench, simulator: Simulator
) -> None:
    assert check(bench) == (WELL, [])
    assert 'ecat_domain_well{bus="' + bench.daemon.bus + '",domain="0",name=""} 1' in metrics(bench)
    simulator.faults.wkc(-1, count=0)
    text = problem(bench, "wrong working counter")
    # Of the slaves in OP, only the two EL3008 and the EL1018 add just one.
    names(text, "domain 0", "7 instead of 8", "slaves 2, 4-5", "`ecatctl capture -o FILE`")
    bench.wait_for(lambda: check(bench)[0] == DOWN)
    bench.wait_for(lambda: "wrong working counter" in bench.daemon.status)
    assert "8 of 8 slaves in OP" in bench.daemon.status
    found = metrics(bench)
    assert re.search(r'ecat_domain_well\{[^}]*domain="0"[^}]*\} 0', found)
    share = re.search(r'ecat_fault\{[^}]*kind="working_counter",domain="0"[^}]*\} (\S+)', found)
    assert share
    assert float(share[1]) > 0.5  # frames of a busy machine may be late as well
    bench.wait_for_event("exchange", fault="working_counter", domain=0, over=False)
    simulator.faults.clear()
    bench.wait_for_event("exchange", fault="working_counter", domain=0, over=True)
    bench.wait_for(lambda: check(bench) == (WELL, []))
    bench.wait_for(lambda: "is in OP" in bench.daemon.status)


def test_a_slave_whose_registers_are_others_is_found_by_asking(bench: Bench) -> None:
    before = len(bench.events)
    for register, difference in (("0x060C", "switched off"), ("0x060B", "other values")):
        bench.daemon.ctl("reg-write", "5", register, "0", "--size", "1", "--yes")
        text = problem(bench, "wrong working counter", "FMMU")
        names(text, "slave 5 (EL3008)", "FMMU 0", "0x0600", difference)
        # What the message advises mends it.
        for command in re.findall(r"`ecatctl (state 5 \w+)`", text):
            bench.daemon.ctl(*command.split(), "--yes")
        bench.wait_for(lambda: check(bench) == (WELL, []))
    told = [event for event in bench.events[before:] if event["event"] == "exchange"]
    begun = [event["slaves"] for event in told if not event["over"]]
    assert begun
    assert all(slaves == [5] for slaves in begun), "what is over does not begin again"


def test_a_drive_in_fault_is_not_well_although_it_is_in_op(
    bench: Bench, simulator: Simulator
) -> None:
    def drive(*steps: tuple[int, int]) -> None:
        """Gives each controlword until the statusword has its bits, in CiA 402's mask."""
        values = {0x6060: 8, 0x6072: 1000, 0x607A: 100_000}
        with bench.daemon.client() as client, client.claim(0, lease=0.5):
            statusword = client.signal(0, 0x6041)
            for word, wanted in steps:
                while int(statusword.raw) & 0x4F != wanted:
                    for index, value in {**values, 0x6040: word}.items():
                        client.signal(0, index).raw = value
                    client.commit()
                    client.wait()
                    client.sample()

    window = simulator.get(0, 0x6065, 0)
    simulator.set(0, 0x6065, 0, 1)
    drive((0x06, 0x01), (0x07, 0x03), (0x0F, 0x08))
    text = problem(bench, "reports a fault")
    names(text, "slave 0 (Gold EtherCAT GCON Drive)", "0x8611", "following error", "0x6065")
    names(
        text,
        "0x6065:00 (Following error window) is 1, and 20000 in the start-up list",
        "0x6066:00 (Following error time out) is",
    )
    assert re.search(r'ecat_fault\{[^}]*kind="drive"', metrics(bench))
    bench.wait_for(lambda: "8 of 8 slaves in OP" in bench.daemon.status)
    bench.wait_for_event("drive", slave=0, code=0x8611, over=False, severity="error")
    simulator.set(0, 0x6065, 0, window)
    drive((0x80, 0x40))
    bench.wait_for_event("drive", slave=0, over=True, severity="info")
    bench.wait_for(lambda: check(bench) == (WELL, []))


def test_half_of_all_frames_are_lost_or_late(bench: Bench, simulator: Simulator) -> None:
    simulator.faults.drop(count=0, every=2)
    text = problem(bench, "did not come back")
    names(text, "domain 0", "`ecatctl errors`")
    assert check(bench)[0] == DEGRADED
    simulator.faults.clear()
    bench.wait_for(lambda: check(bench) == (WELL, []))
    simulator.faults.delay(5000, count=0, every=2)
    names(problem(bench, "came back too late"), "domain 0", "`ecatctl doctor`", "cycle_time_us")


def test_damaged_counters_are_no_new_slaves(bench: Bench, simulator: Simulator) -> None:
    before = simulator.status().frames
    simulator.faults.corrupt(seed=1, count=0)
    bench.wait_for(lambda: simulator.status().frames > before + 3000)
    names(problem(bench, "damaged frames"), "domain 0", "`ecatctl errors`", "cable")
    simulator.faults.clear()
    told = [line for line in bench.daemon.log.splitlines() if "slave count changed" in line]
    assert not told


def test_slaves_that_were_away_for_a_moment_explain_the_counter(
    bench: Bench, simulator: Simulator
) -> None:
    before = len(bench.events)

    def told(kind: str) -> list[dict[str, Any]]:
        return [event for event in bench.events[before:] if event["event"] == kind]

    def begun() -> list[dict[str, Any]]:
        wrong = [item for item in told("exchange") if item["fault"] == "working_counter"]
        return [item for item in wrong if not item["over"]]

    def failed() -> int:
        return int(read(bench.daemon.bus).counters["wkc_bad"])

    many = failed() + 20
    simulator.faults.break_link(4)
    bench.wait_for(lambda: told("slaves") and failed() > many)
    simulator.faults.heal_link(4)
    bench.wait_for(begun)
    bench.wait_for(lambda: check(bench) == (WELL, []))
    assert all(item["slaves"] == [4, 5] for item in begun()), begun()


def test_an_mtu_that_is_too_small_is_a_fault_of_the_interface(bench: Bench) -> None:
    bench.inside("mtu", MASTER, "100")
    text = problem(bench, "MTU")
    names(text, MASTER, "100", "1500", f"`ip link set {MASTER} mtu 1500`")
    # It explains all that follows, and whatever the slaves do meanwhile is no fault of theirs.
    bench.wait_for(lambda: check(bench) == (DOWN, [text]))
    bench.wait_for_event("exchange", fault="unsent", domain=0, over=False)
    bench.wait_for_event("interface", interface=MASTER, topic="mtu", over=False)
    bench.inside("mtu", MASTER, "1500")
    bench.wait_for_event("interface", interface=MASTER, topic="mtu", over=True)
    bench.wait_for_op()
    bench.wait_for(lambda: check(bench) == (WELL, []))


class Segment:
    """A simulated segment that is no part of a daemon.

    Attributes:
        pid: Process of the simulator, whose namespace has the interfaces.
    """

    def __init__(self, rig: str, *options: str) -> None:
        read, write = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ecatsim", "run", rig, "--ready-fd", str(write), *options],
            pass_fds=(write,),
            stdout=subprocess.DEVNULL,
        )
        os.close(write)
        with os.fdopen(read) as ready:
            self.pid = int(json.loads(ready.readline())["pid"])

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()

    def join(self) -> None:
        """Has this process, which begins a daemon, enter the namespace."""
        network_namespace.join(self.pid)


@pytest.fixture
def segment() -> Iterator[Callable[..., Segment]]:
    with contextlib.ExitStack() as stack:

        def start(rig: str, *options: str) -> Segment:
            made = Segment(rig, *options)
            stack.callback(made.close)
            return made

        yield start


def test_a_start_without_a_good_exchange_says_so(
    segment: Callable[..., Segment], start_daemon: Callable[..., Daemon]
) -> None:
    """It serves requests: READY=1 is told, and `check` says what is wrong."""
    wire = segment("troll")
    with Simulator(str(wire.pid)) as simulator:
        simulator.faults.wkc(-1, count=0)
    daemon = start_daemon("", "--interface", MASTER, preexec=wire.join)
    names(daemon.log, "no exchange of domain 0", "`ecatctl check`")
    assert "is in OP" not in daemon.log
    wait_for(lambda: daemon.ctl("check", check=False).stdout.startswith("down: "), daemon)
    names(daemon.ctl("check", check=False).stdout, "8 of 8 slaves in OP", "domain 0")


SECOND = "ecat-master2"


@pytest.mark.parametrize(
    ("first", "second", "tokens"),
    [
        (MASTER, "", ("ring", "pass 8 slaves", f'second_interface = "{SECOND}"')),
        (SECOND, "", (f'interface = "{MASTER}"', f'second_interface = "{SECOND}"', "far end")),
        (SECOND, MASTER, ("exchanged", f'interface = "{MASTER}"')),
    ],
)
def test_a_ring_with_one_interface_or_exchanged_ones(
    segment: Callable[..., Segment],
    start_daemon: Callable[..., Daemon],
    first: str,
    second: str,
    tokens: tuple[str, ...],
) -> None:
    wire = segment("troll", "--ring")
    config = f'second_interface = "{second}"\n' * bool(second) + "[gateway]\nlisten = []\n"
    daemon = start_daemon("", "--interface", first, ready=False, config=config, preexec=wire.join)
    status, log = daemon.wait_end()
    assert status != 0
    names(log, *tokens)
    assert "cable" not in log


@pytest.mark.parametrize(
    ("more", "port", "tokens"),
    [
        ((), MASTER, (f"{MASTER} is a part of br0", f"`ip link set {MASTER} nomaster`")),
        (("--ring",), SECOND, ("arrive at br0", "this bridge", "`ip link set PORT nomaster`")),
    ],
)
def test_a_bridge_is_no_end_of_a_ring(
    segment: Callable[..., Segment],
    start_daemon: Callable[..., Daemon],
    more: tuple[str, ...],
    port: str,
    tokens: tuple[str, ...],
) -> None:
    wire = segment("troll", *more)
    command = [sys.executable, str(INSIDE), str(wire.pid), "bridge", port, "br0"]
    if subprocess.run(command, check=False).returncode:
        pytest.skip("this kernel makes no bridge")
    config = "[gateway]\nlisten = []\n"
    daemon = start_daemon("", "--interface", MASTER, ready=False, config=config, preexec=wire.join)
    status, log = daemon.wait_end()
    assert status != 0
    names(log, *tokens)
    assert 'second_interface = "br0"' not in log
    assert "cable" not in log


def test_an_mtu_that_is_too_small_at_the_start_is_raised_until_the_end(
    segment: Callable[..., Segment], start_daemon: Callable[..., Daemon]
) -> None:
    wire = segment("troll")

    def inside(*arguments: str) -> str:
        command = [sys.executable, str(INSIDE), str(wire.pid), *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    inside("mtu", MASTER, "1400")
    daemon = start_daemon("", "--interface", MASTER, preexec=wire.join)
    names(daemon.log, MASTER, "MTU of 1400", "1500")
    assert inside("mtu", MASTER) == "1500\n"
    assert daemon.stop() == 0
    assert inside("mtu", MASTER) == "1400\n"
