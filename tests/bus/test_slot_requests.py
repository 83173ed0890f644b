"""Requests of clients to slaves through shared memory, and clients that do what none should."""

import re
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from raw_slot import RawSlot

from conftest import Daemon, names, naming, one_line_error, run_module, wait_for
from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.client import Client
from ecatd.etg.al import AlState

pytestmark = [pytest.mark.bus, pytest.mark.long]

DRIVE, EL2008, LAST = 0, 3, 7
ACCELERATION = 0x6083


def al_state(client: Client, position: int) -> int:
    return client.slaves()[position].al_state & 0x0F


def test_a_client_brings_a_slave_to_a_state(troll: Daemon) -> None:
    with troll.client() as client:
        for state in (AlState.PREOP, AlState.SAFEOP, AlState.OP):
            assert client.request_state(EL2008, state).result() == b""
            assert al_state(client, EL2008) == state
        # Down in one go, and up in steps.
        client.request_state(DRIVE, AlState.INIT).result()
        assert al_state(client, DRIVE) == AlState.INIT
        client.request_state(DRIVE, AlState.OP).result()
        assert al_state(client, DRIVE) == AlState.OP


def test_what_cannot_be_done_is_told_with_the_reason(troll: Daemon) -> None:
    with troll.client() as client:
        with pytest.raises(StateError, match=naming("slave 3 (EL2008)", "no object dictionary")):
            client.sdo_upload(EL2008, 0x1018).result()
        with pytest.raises(SdoAbortError, match=naming("0x7777:00")) as caught:
            client.sdo_upload(DRIVE, 0x7777).result()
        assert caught.value.code == 0x06020000
        with pytest.raises(SdoAbortError) as caught:
            client.sdo_download(DRIVE, 0x1018, 1, bytes(4)).result()
        assert caught.value.code == 0x06010002  # read only
        assert client.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"  # and it goes on


def test_the_state_machine_of_a_slave_may_refuse(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config="state_timeout_s = 5.0\n[gateway]\nlisten = []\n")
    with daemon.client() as client:
        simulator(daemon, "power-off", str(LAST))
        with pytest.raises(StateError, match=naming("slave 7 (EL6751)", "no answer")):
            client.request_state(LAST, AlState.PREOP).result(60)
        with pytest.raises(NoAnswerError, match=naming("slave 7 (EL6751)", "answer")):
            client.sdo_upload(LAST, 0x1018, 1).result(60)


def simulator(daemon: Daemon, *command: str) -> None:
    result = run_module("ecatsim", "ctl", "--name", str(daemon.child_pid("ecatsim")), *command)
    assert result.returncode == 0, result.stderr


ASKER = """
import struct, sys, time
from ecatd.client import Client
client = Client(sys.argv[1])
asked = [client.sdo_upload(7, 0x1018, 1)]  # waited for, for a while: it does not answer
for n in range(3):
    asked.append(client.sdo_download(0, 0x6083, 0, struct.pack("<I", 4711 + n)))
client.wait(50)  # they are queued in the daemon by now
print("asked", flush=True)
if sys.argv[2] == "leave":
    client.close()
time.sleep(60)
"""


@pytest.mark.parametrize("end", ["kill", "leave"])
def test_r37_what_a_dead_client_asked_for_is_dropped(
    start_daemon: Callable[..., Daemon], end: str
) -> None:
    daemon = start_daemon("troll")
    simulator(daemon, "mailbox", str(LAST), "stuck")
    with daemon.client() as client:
        client.sdo_download(DRIVE, ACCELERATION, 0, struct.pack("<I", 1000)).result()
        with subprocess.Popen(
            [sys.executable, "-c", ASKER, daemon.bus, end], stdout=subprocess.PIPE, text=True
        ) as asker:
            assert asker.stdout
            assert asker.stdout.readline() == "asked\n"
            if end == "kill":
                asker.send_signal(signal.SIGKILL)
            # These wait for the mailbox behind what has begun; then nothing of it is left.
            values = [client.sdo_upload(DRIVE, ACCELERATION).result(60) for _ in range(10)]
            asker.kill()
    assert {struct.unpack("<I", value)[0] for value in values} == {1000}


def test_what_was_taken_back_is_dropped(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    simulator(daemon, "mailbox", str(LAST), "stuck")
    with daemon.client() as client:
        client.sdo_download(DRIVE, ACCELERATION, 0, struct.pack("<I", 1000)).result()
        blocked = client.sdo_upload(LAST, 0x1018, 1)
        unwanted = client.sdo_download(DRIVE, ACCELERATION, 0, struct.pack("<I", 4711))
        other = client.sdo_upload(DRIVE, ACCELERATION)
        client.wait(50)  # they are queued in the daemon by now
        unwanted.cancel()
        with pytest.raises(StateError, match="was cancelled"):
            unwanted.poll()
        assert other.result(60) == struct.pack("<I", 1000)
        # Its place is free, and answers of others do not come into it.
        assert client.sdo_upload(DRIVE, ACCELERATION).result() == struct.pack("<I", 1000)
        with pytest.raises(NoAnswerError):
            blocked.result(60)


def test_a_slave_without_mailbox_now_is_told_at_once(troll: Daemon) -> None:
    troll.ctl("state", "0", "INIT", "--yes")
    result = troll.ctl("sdo-read", "0", "0x6060", check=False)
    assert result.stderr.count("\n") == 1
    said = one_line_error(result.stderr, "ecatctl")
    names(said, "slave 0 (Gold EtherCAT GCON Drive)", "INIT", "`ecatctl state 0 PREOP`")
    troll.ctl("state", "0", "OP")


def test_r13_emergencies_between_answers_are_told(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    simulator(daemon, "emergency", str(DRIVE), "0x3220", "--register", "0x04")
    with daemon.client() as client:
        assert client.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"
    told = naming("slave 0 (Gold EtherCAT GCON Drive)", "emergency", "0x3220", "0x04")
    wait_for(lambda: any(re.search(told, line) for line in daemon.log.splitlines()), daemon)


def test_r24_a_slave_that_does_not_answer_holds_up_nobody_else(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll")
    simulator(daemon, "mailbox", str(LAST), "stuck")
    with daemon.client() as first, daemon.client() as second, daemon.client() as client:
        blocked = [one.sdo_upload(LAST, 0x1018, 1) for one in (first, second)]
        for _ in range(5):
            assert client.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"
        assert [request.poll() for request in blocked] == [None, None]
        for request in blocked:
            with pytest.raises(NoAnswerError, match=naming("slave 7", "0x1018:01")):
                request.result(60)
        simulator(daemon, "mailbox", str(LAST), "none")
        assert client.sdo_upload(LAST, 0x1018, 1).result() == b"\2\0\0\0"


@contextmanager
def hostile(daemon: Daemon, *command: str) -> Iterator[tuple[int, str]]:
    """A process that runs beside the test; its pid and what it says first."""
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        try:
            yield process.pid, process.stdout.readline().strip()
            assert process.poll() is None
        finally:  # also where the test fails: it would not end by itself
            process.kill()


def test_random_requests_are_told_and_starve_nobody(troll: Daemon) -> None:
    raw = str(Path(__file__).with_name("raw_slot.py"))
    before = len(troll.log)
    with hostile(troll, raw, troll.bus) as (pid, program), troll.client() as client:
        for _ in range(50):
            assert client.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"
        who = rf"slot \d+.* contains data that no client library writes.*'{program}' \(pid {pid}\)"
        wait_for(lambda: re.search(who, troll.log[before:]) is not None, troll)
        for _ in range(50):
            assert client.sdo_upload(DRIVE, 0x1018, 2).result() == struct.pack("<I", 0x00030924)
        assert troll.ctl("sdo-read", "0", "0x1018", "1").stdout.startswith("0x0000009A")
        assert [slave.al_state for slave in client.slaves()] == [AlState.OP] * 8
    lines = [line for line in troll.log[before:].splitlines() if "no client library" in line]
    assert 1 <= len(lines) < 30


FLOOD = """
import sys
from ecatd.client import Client
client = Client(sys.argv[1])
running = [client.sdo_upload(0, 0x1018, 1) for _ in range(4)]
print("floods", flush=True)
while True:
    running = [r if r.poll() is None else client.sdo_upload(0, 0x1018, 1) for r in running]
"""


def test_clients_take_turns(troll: Daemon) -> None:
    """Two that always have four requests waiting leave a third of the mailbox to another one."""
    flood = ("-c", FLOOD, troll.bus)
    with hostile(troll, *flood), hostile(troll, *flood), troll.client() as client:
        for _ in range(100):
            assert client.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"


def test_r35_values_out_of_their_range_are_told_and_not_sent(
    start_daemon: Callable[..., Daemon],
) -> None:
    declared = (
        "[[signal]]\nslave = 0\nentry = '0x6071:00'\nname = 'torque'\nunit = '%'\nscale = 0.1\n"
        "minimum = -20\nmaximum = 20\n"
    )
    daemon = start_daemon("troll", config=f"[gateway]\nlisten = []\n{declared}")
    with daemon.client() as client, daemon.client() as reader:
        torque = client.signal(DRIVE, 0x6071)
        client.claim(DRIVE, lease=30.0)
        torque.raw = 150
        client.commit()
        raw = RawSlot(daemon.bus)
        byte = torque.bit_offset // 8  # there is one domain
        for value in (201, -201, 32767, 200):
            raw.commit_again(byte, struct.pack("<h", value))
            for _ in range(5):
                client.wait()
                client.sample()  # keeps the lease
                reader.sample()
                assert -200 <= torque.raw <= 200
        assert torque.raw == 200
        wait_for(lambda: "out of its declared range" in daemon.log, daemon)
    assert re.search(
        r"'\S+' \(pid \d+\) wrote 0x6071:00 \(torque\) of slave 0 \(.*\) out of its declared "
        r"range, -20 to 20 %; the output keeps the value before",
        daemon.log,
    )
