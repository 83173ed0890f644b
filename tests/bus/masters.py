"""What the tests with real masters share: how masters are run, and what they do with pysoem.

Masters run as commands inside `ecatsim run`. Functions named `master_…` in the test files are such
commands: they return what is to be judged, as JSON.
"""

import contextlib
import inspect
import json
import multiprocessing
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

SO_RCVBUFFORCE, SOL_PACKET, PACKET_STATISTICS = 33, 263, 6
ECATSIM = [sys.executable, "-m", "ecatsim"]
INTERFACE = "ecat-master"
INIT, PREOP, SAFEOP, OP, ERROR, ACK = 1, 2, 4, 8, 0x10, 0x10
LOST = -1
PATIENCE = 120.0  # as in `conftest`, which rig files cannot import


def run(rig_name, master, *arguments):
    """Runs a master of a test file beside a rig and returns what it found."""
    file = Path(inspect.getfile(master))
    folders = [str(file.parent), str(file.parent.parent)]  # the latter for `conftest`
    code = (
        f"import sys, json; sys.path[:0] = {folders!r}; import {file.stem} as t; "
        f"print('found', json.dumps(t.{master.__name__}(*{arguments!r})))"
    )
    result = subprocess.run(
        [*ECATSIM, "run", str(rig_name), "--", sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=go_first,
    )
    assert result.returncode == 0, result.stderr + result.stdout
    # Masters print lines of their own, before and after.
    (found,) = [line for line in result.stdout.splitlines() if line.startswith("found ")]
    return json.loads(found.removeprefix("found "))


def go_first():
    """Lets this process run before others: foreign masters have time-outs of 2 ms built in."""
    with contextlib.suppress(PermissionError):
        os.nice(-10)


def pattern(slave, number, size):
    """Outputs that no other slave has in this round, and this one in no other."""
    return bytes((17 * slave + 31 * number + i) & 0xFF for i in range(size - 1)) + bytes([number])


def new_master():
    """A master by pysoem for a busy machine.

    By itself SOEM sends a frame again after 2 ms, and goes on with what the first copy brings: what
    the second one brings is then in its way.
    """
    import pysoem

    pysoem.settings.timeouts.ret = 100_000
    pysoem.settings.timeouts.rx_mailbox = 5_000_000
    return pysoem.Master()


def open_pysoem(configure=None, *, watchdog=False):
    """A bus in SAFEOP; without watchdogs, which a busy machine could let expire."""

    master = new_master()
    master.open(INTERFACE)
    assert master.config_init() > 0
    for slave in () if watchdog else master.slaves:
        slave._fpwr(0x0420, b"\x00\x00")
    if configure:
        configure(master)
    master.config_map()
    assert master.state_check(SAFEOP, 2_000_000) == SAFEOP
    return master


def cycle(master, count=1):
    """Exchanges process data; the last working counter."""
    for _ in range(count):
        master.send_processdata()
        counter = master.receive_processdata(10_000)
        time.sleep(0.001)
    return counter


def to_op(master):
    """Brings all slaves to OP, as a master does: with process data under way."""
    cycle(master)
    master.state = OP
    master.write_state()
    for _ in range(2000):
        cycle(master)
        if master.read_state() == OP:
            return
    raise AssertionError([hex(slave.state) for slave in master.slaves])


def wait_state(slave, *states):
    """Waits until a slave is in one of the states; the state and the AL status code."""
    import pysoem

    for _ in range(3000):
        try:
            status = struct.unpack("<HxxH", slave._fprd(0x0130, 6))
        except pysoem.WkcError:  # the frame was lost
            status = None
        if status and status[0] in states:
            return list(status)
        time.sleep(0.001)
    raise AssertionError(f"state is {status}")


def request(slave, state, *expected):
    slave._fpwr(0x0120, struct.pack("<H", state))
    return wait_state(slave, *(expected or (state,)))


def record(file, ready, stop):
    """Writes every frame to a pcap file until `stop` is set."""
    wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0003))
    # Room for a whole start-up: on a busy machine this process gets its turn late.
    wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
    with contextlib.suppress(PermissionError):
        wire.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 1 << 24)
    wire.bind((INTERFACE, 0x0003))
    wire.settimeout(0.2)
    ready.set()
    with Path(file).open("wb") as output:
        output.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
        while True:
            try:
                frame = wire.recv(2048)
            except TimeoutError:
                if not stop.is_set():
                    continue
                _, lost = struct.unpack("II", wire.getsockopt(SOL_PACKET, PACKET_STATISTICS, 8))
                assert lost == 0, "the recorder was too slow for the frames"
                return
            seconds, rest = divmod(time.time_ns(), 10**9)
            output.write(struct.pack("<IIII", seconds, rest // 1000, len(frame), len(frame)))
            output.write(frame)


@contextlib.contextmanager
def recording(file):
    """Another process records what is on the wire meanwhile."""
    context = multiprocessing.get_context("fork")
    ready, stop = context.Event(), context.Event()
    recorder = context.Process(target=record, args=(file, ready, stop))
    recorder.start()
    ready.wait()
    yield
    stop.set()
    recorder.join()
    assert recorder.exitcode == 0, "the recording is not complete"
