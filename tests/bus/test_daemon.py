"""The daemon on the simulated rig: what comes up, what clients see, and how it ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conftest import CYCLE_TIME_US, SHM, Daemon, names, naming, one_line_error, wait_for
from ecatd.base.errors import LOOPBACK, SdoAbortError, StateError, UnreachableError, UsageError
from ecatd.base.paths import zenoh_socket
from ecatd.client import Request
from ecatd.etg.al import AlState
from ecatd.shm import contract as shm
from handle import EBUS, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

DRIVE, EL1018, EL2008, EL3008 = 0, 2, 3, 5
VOLT = 32767 / 10


def test_the_bus_is_described_and_in_op(troll: Daemon) -> None:
    with troll.client() as client:
        slaves = client.slaves()
        assert [slave.product for slave in slaves] == [
            0x00030924,
            0x044C2C52,
            0x03FA3052,
            0x07D83052,
            0x0BC03052,
            0x0BC03052,
            0x1A5F3052,
            0x1A5F3052,
        ]
        wait_for(lambda: all(slave.al_state == 8 for slave in client.slaves()), troll)
        assert client.cycle_time == CYCLE_TIME_US / 1e6
        with Handle(troll.bus) as handle:
            assert [handle.find(2, 0x0BC03052, nth) for nth in (0, 1, 2)] == [4, 5, EBUS]
            names(handle.error, "2 slaves", "0x00000002", "0x0BC03052")
        with pytest.raises(
            StateError, match=naming("slave 2", f"'{troll.bus}'", "EL1018", "0x07D83052")
        ):
            client.expect(2, 2, 0x07D83052)
        with pytest.raises(StateError, match=naming("slave 2", "revision", "0x00000005")):
            client.expect(2, 2, 0x03FA3052, 5)
        with pytest.raises(StateError, match=naming("slave 2 (EL1018)", "input", "0x6060:00")):
            client.signal(2, 0x6060, 0, 0)


def test_samples_are_fresh_and_complete(troll: Daemon) -> None:
    with troll.client() as client:
        complete = 0
        last = 0
        for _ in range(200):
            client.wait()
            client.sample()
            domain = client.domain()
            assert domain.cycle > last
            last = domain.cycle
            complete += domain.wkc_state == shm.WkcState.COMPLETE
        assert complete > 100  # frames may be late on a busy machine, not most of them
        # Constants at the second analog terminal: -8, -4, -1, 0, 1, 4, 8 and 10 V.
        values = [client.signal(EL3008, 0x6000 + 16 * channel, 0x11).raw for channel in range(8)]
        assert [round(value / VOLT) for value in values] == [-8, -4, -1, 0, 1, 4, 8, 10]


def test_outputs_reach_the_slaves_and_come_back_over_wires(troll: Daemon) -> None:
    with troll.client() as client:
        outputs = [client.signal(EL2008, 0x7000 + 16 * n, 1) for n in range(8)]
        inputs = [client.signal(EL1018, 0x6000 + 16 * n, 1) for n in range(4)]
        client.claim(EL2008, lease=30)
        for pattern in (0b0101, 0b1010, 0b1111, 0b0000):
            for bit, output in enumerate(outputs):
                output.raw = pattern >> bit & 1
            client.commit()
            for _ in range(2000):
                client.wait()
                client.sample()
                if [i.raw for i in inputs] == [pattern >> n & 1 for n in range(4)]:
                    break
            else:
                pytest.fail(f"pattern {pattern:04b} does not arrive")


def test_outputs_belong_to_one_client(troll: Daemon) -> None:
    with troll.client() as first, troll.client() as second:
        claim = first.claim(EL2008, lease=30)
        with pytest.raises(
            StateError, match=naming("slave 3 (EL2008)", "belongs to", f"pid {os.getpid()}")
        ):
            second.claim(EL2008)
        output = second.signal(EL2008, 0x7000, 1)
        with pytest.raises(StateError, match=naming("0x7000:01", "claimed")):
            output.raw = 1
        claim.release()
        second.claim(EL2008, lease=30)
        assert second.slaves()[EL2008].owned
        assert second.slaves()[EL2008].outputs == shm.Outputs.CLAIMED
        output.raw = 1
        second.commit()
        for _ in range(100):
            second.wait()
            if second.slaves()[EL2008].outputs == shm.Outputs.ACTIVE:
                break
        else:
            pytest.fail("the commit is not taken over")


def test_values_out_of_range_are_refused(troll: Daemon) -> None:
    with troll.client() as client:
        client.claim(DRIVE, lease=30)
        torque = client.signal(DRIVE, 0x6071)
        for wrong in (32768, -32769, 32767.5, float("nan"), float("inf"), 1e300):
            with pytest.raises(UsageError, match=naming("0x6071:00", -32768, 32767)):
                torque.raw = wrong
        for right in (32767, -32768, 0):
            torque.raw = right
        bit = client.signal(EL2008, 0x7000, 1)
        with pytest.raises(StateError, match="claimed"):
            bit.raw = 1
        with pytest.raises(UsageError, match=naming("0x6000:01", "input")):
            client.signal(EL1018, 0x6000, 1).raw = 1
        with pytest.raises(UsageError, match=naming(99999, "signal")):
            client.signal(99999)


def test_slaves_without_outputs_cannot_be_claimed(troll: Daemon) -> None:
    with troll.client() as client:
        with pytest.raises(UsageError, match=naming("slave 2 (EL1018)", "no outputs")):
            client.claim(EL1018)
        with pytest.raises(StateError, match=naming("slave 77")):
            client.claim(77)


def test_sdo_requests_through_shared_memory(troll: Daemon) -> None:
    with troll.client() as client:

        def finish(request: Request) -> bytes:
            while (data := request.poll()) is None:
                client.wait()
            return data

        assert finish(client.sdo_upload(DRIVE, 0x1018, 1)) == b"\x9a\0\0\0"
        assert finish(client.sdo_download(DRIVE, 0x6060, 0, b"\x03")) == b""
        assert finish(client.sdo_upload(DRIVE, 0x6060)) == b"\x03"
        # Several at once, answered in any order to the right one.
        requests = [client.sdo_upload(DRIVE, 0x1018, sub) for sub in (1, 2, 3)]
        assert [finish(r) for r in reversed(requests)][::-1][1] == (0x30924).to_bytes(4, "little")
        with pytest.raises(SdoAbortError, match=naming("0x7777:00")) as caught:
            finish(client.sdo_upload(DRIVE, 0x7777))
        assert caught.value.code == 0x06020000
        with pytest.raises(StateError, match=naming(4, "requests")):
            requests = [client.sdo_upload(DRIVE, 0x1018, 1) for _ in range(5)]


def test_a_client_of_a_bus_that_is_not_there() -> None:
    from ecatd.client import Client

    with pytest.raises(UnreachableError, match=naming("'nobody'", "systemctl start ecatd@nobody'")):
        Client("nobody")
    with pytest.raises(UsageError, match=naming("'a/b'", "bus name")):
        Client("a/b")


OWNER = """
import sys, time
from ecatd.client import Client
from ecatd.base.errors import UnreachableError
client = Client(sys.argv[1])
client.claim(3, lease=float(sys.argv[2]))
for n in range(8):
    client.signal(3, 0x7000 + 16 * n, 1).raw = 1
client.commit()
print("owns", flush=True)
while True:
    try:
        client.wait()
        client.sample()
    except UnreachableError:  # a busy machine exchanges nothing for a while
        pass
"""


@contextmanager
def own_outputs(daemon: Daemon, lease: float = 2.0) -> Iterator[subprocess.Popen[str]]:
    """A process that owns the digital outputs, has set all of them and keeps its lease."""
    with subprocess.Popen(
        [sys.executable, "-c", OWNER, daemon.bus, str(lease)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == "owns\n"
        yield process
        process.kill()


def outputs_now(daemon: Daemon) -> tuple[list[float], shm.Outputs]:
    with daemon.client() as client:
        client.wait(2)
        client.sample()
        values = [client.signal(3, 0x7000 + 16 * n, 1).raw for n in range(8)]
        return values, client.slaves()[3].outputs


@pytest.mark.parametrize("end", ["kill", "stop", "terminate"])
def test_r15_outputs_of_a_client_that_ends_or_hangs_are_safe(troll: Daemon, end: str) -> None:
    number = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "terminate": signal.SIGTERM}[end]
    with own_outputs(troll) as owner:
        for _ in range(1000):
            if outputs_now(troll) == ([1.0] * 8, shm.Outputs.ACTIVE):
                break
        else:
            pytest.fail("the outputs are not set")
        owner.send_signal(number)
        for _ in range(1000):
            if outputs_now(troll) == ([0.0] * 8, shm.Outputs.SAFE):
                break
        else:
            pytest.fail("the outputs stay")
        # The slot and the slave can be used again.
        with troll.client() as client:
            client.claim(3)


def test_a_client_that_lost_its_lease_is_told(troll: Daemon) -> None:
    with troll.client() as client:
        client.claim(EL2008, lease=2)
        output = client.signal(EL2008, 0x7000, 1)
        output.raw = 1
        client.commit()
        while client.slaves()[EL2008].owned:
            client.wait()  # waiting alone is no sign of life
        output.raw = 1
        with pytest.raises(StateError, match=naming("sample", "in time")):
            client.commit()
        client.claim(EL2008, lease=30)
        output.raw = 1
        client.commit()


def test_safe_values_come_from_the_configuration(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon(
        "troll",
        config="[gateway]\nlisten = []\n"
        "[[outputs.safe]]\nslave = 3\nentry = '0x7010:01'\nvalue = 1\n"
        "[[outputs.safe]]\nslave = 3\nentry = '0x7020:01'\nvalue = 'hold'\n",
    )
    assert outputs_now(daemon) == ([0, 1, 0, 0, 0, 0, 0, 0], shm.Outputs.SAFE)
    with own_outputs(daemon):
        while outputs_now(daemon)[1] != shm.Outputs.ACTIVE:
            pass
    for _ in range(1000):
        if outputs_now(daemon) == ([0, 1, 1, 0, 0, 0, 0, 0], shm.Outputs.SAFE):
            return
    pytest.fail(f"{outputs_now(daemon)}")


def test_a_reader_notices_that_the_daemon_was_killed(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as client:
        client.wait()
        client.sample()
        daemon.kill_all()
        # Not one of the two that say "in vain": the error names the cause.
        with pytest.raises(UnreachableError, match=naming(f"'{daemon.bus}'", "has ended")):
            for _ in range(100000):
                client.wait(1, timeout=30)
                client.sample()
        with pytest.raises(UnreachableError):
            client.sample()
    # What was left over does not deceive a new client, and does not stop a new daemon.
    assert (SHM / daemon.bus).exists()
    with pytest.raises(UnreachableError, match=naming(f"'{daemon.bus}'", "systemctl start ecatd")):
        daemon.client()
    again = start_daemon("troll", "--bus", daemon.bus)
    again.bus = daemon.bus
    with again.client() as client:
        client.wait()
    assert again.stop() == 0
    assert not list(SHM.glob(f"{daemon.bus}*"))


def test_a_reader_notices_that_the_daemon_was_stopped(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as client:
        client.wait()
        assert daemon.stop() == 0
        with pytest.raises(UnreachableError, match=naming(f"'{daemon.bus}'", "stopped")):
            for _ in range(2):  # the first may find cycles that ended before the stop
                client.wait(1, timeout=30)
    assert not list(SHM.glob(f"{daemon.bus}*"))


def stall(daemon: Daemon) -> None:
    """Stops the exchange for longer than the watchdog of the slaves."""
    server = daemon.child_pid("ecatd.server")
    os.kill(server, signal.SIGSTOP)
    time.sleep(0.4)  # four times as long
    os.kill(server, signal.SIGCONT)


def al_states(daemon: Daemon) -> list[int]:
    with daemon.client() as client:
        return [slave.al_state for slave in client.slaves()]


def test_r02_slaves_come_back_from_a_watchdog(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    stall(daemon)
    wait_for(lambda: "back in OP after" in daemon.log, daemon)
    assert re.search(r"slave 0 .*: SAFEOP\+ERROR \(AL status 0x001B: Sync manager", daemon.log)
    assert re.search(r"slave 3 \(EL2008\): SAFEOP\+ERROR", daemon.log)
    wait_for(lambda: al_states(daemon) == [AlState.OP] * 8, daemon)


def test_the_watchdog_brings_no_slave_back_that_somebody_took_out_of_op(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll")
    daemon.ctl("state", "3", "SAFEOP", "--yes")
    stall(daemon)
    wait_for(lambda: "back in OP after" in daemon.log, daemon)
    wait_for(lambda: al_states(daemon)[0] == AlState.OP, daemon)
    assert al_states(daemon)[3] & 0x0F == AlState.SAFEOP


def test_the_gateway_may_die_and_comes_back(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    first = daemon.child_pid("ecatd.gateway")
    os.kill(first, signal.SIGKILL)
    with daemon.client() as client:
        for _ in range(3000):
            client.wait()
            client.sample()
            if daemon.ctl("info", check=False).returncode == 0:
                break
    assert daemon.child_pid("ecatd.gateway") != first
    (told,) = (line for line in daemon.log.splitlines() if "gateway has ended" in line)
    names(told, "signal 9")
    assert daemon.ctl_json("stats")["state"] == "running"


def test_r17_the_daemon_ends_when_its_bus_server_dies(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    os.kill(daemon.child_pid("ecatd.server"), signal.SIGKILL)
    status, log = daemon.wait_end()
    assert status == 70
    names(one_line_error(log, "ecatd"), "bus server", "signal 9", "ecatd again")
    assert "the gateway" not in log  # which ends with the bus server


def test_r31_both_files_have_the_documented_modes(troll: Daemon) -> None:
    modes = {path.name: oct(path.stat().st_mode & 0o777) for path in SHM.glob(f"{troll.bus}*")}
    assert modes == {troll.bus: "0o640", f"{troll.bus}.out": "0o660"}


def test_r31_others_are_told_how_to_get_in() -> None:
    code = (
        "import os; from ecatd.client.session import _local_endpoint\n"
        "if os.geteuid() == 0: os.setuid(65534)\n"
        "_local_endpoint('tclosed')\n"
    )
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as closed:
        Path(folder).chmod(0o755)
        path = zenoh_socket(Path(folder), "tclosed")
        path.parent.mkdir(parents=True)
        closed.bind(str(path))
        path.chmod(0)
        told = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "ECATD_RUNTIME_DIR": folder},
            capture_output=True,
            text=True,
        ).stderr
    names(told, "NotPermittedError", "'tclosed'", "usermod -aG ecat", f"--connect {LOOPBACK}")


@pytest.mark.parametrize("answers", ["come", "get lost"])
def test_r23_stopping_takes_the_slaves_to_init(tmp_path: Path, answers: str) -> None:
    """Seen by another master, on the interface that the daemon has left."""
    code = (
        "import os, socket, subprocess, sys\n"
        "def faults(*fault): subprocess.run([sys.executable, '-m', 'ecatsim', 'ctl', *fault,"
        " '--name', str(os.getppid())], check=True, stdout=subprocess.DEVNULL)\n"
        "ready = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); ready.bind('notify')\n"
        "daemon = subprocess.Popen([sys.executable, '-m', 'ecatd.service', '--interface',"
        " 'ecat-master', '--bus', 'tinit'])\n"
        "while b'READY=1' not in ready.recv(4096): pass\n"
        "if sys.argv[1] == 'get lost': faults('drop', '--way-back', '--all-frames', '--count=0')\n"
        "daemon.terminate(); assert daemon.wait() == 0\n"
        "faults('clear')\n"
        "raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4))\n"
        "raw.bind(('ecat-master', 0x88A4)); raw.settimeout(60)\n"
        # One BRD of AL status: the states of all slaves, ORed, and how many have answered.
        "raw.send(bytes.fromhex('ffffffffffff030101010101 88a4 0e10 07 77 00003001 0200 0000')"
        " + bytes(32))\n"
        "while (answer := raw.recv(1600))[17] != 0x77 or not answer[6] & 2: pass\n"
        "print(answer[26], answer[28])\n"
    )
    env = {
        **os.environ,
        "ECATD_RUNTIME_DIR": str(tmp_path / "run"),
        "NOTIFY_SOCKET": str(tmp_path / "notify"),
    }
    result = subprocess.run(
        [
            *(sys.executable, "-m", "ecatsim", "run", "troll"),
            *("--", sys.executable, "-c", code, answers),
        ],
        env=env,
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.stdout == "1 8\n", result.stdout + result.stderr
