"""`ecatctl shm` and `ecatctl claims` beside a live daemon, and beside one that was killed."""

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from conftest import SHM, Daemon, names, one_line_error, run_module, wait_for
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

EL2008 = 3
OWNER = """
import sys, time
from ecatd.client import Client
with Client() as bus:
    bus.claim({slave}, lease={lease})
    bus.signal({slave}, 0x7000, 1).raw = 1
    bus.commit()
    print("ready", flush=True)
    while True:
        bus.sample()
        bus.commit()
        time.sleep(0.005)
"""


@contextlib.contextmanager
def owner(daemon: Daemon, lease: float = 30.0) -> Iterator[subprocess.Popen[str]]:
    """Another process that owns the outputs of the EL2008, the first of which is on."""
    program = OWNER.format(slave=EL2008, lease=lease).replace("Client()", f"Client({daemon.bus!r})")
    process = subprocess.Popen(
        [sys.executable, "-c", program], text=True, stdout=subprocess.PIPE, env=daemon.env
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def outputs_of(daemon: Daemon) -> list[dict[str, Any]]:
    outputs: list[dict[str, Any]] = daemon.ctl_json("claims", str(EL2008))["outputs"]
    return outputs


def test_claims_name_who_owns_what(troll: Daemon) -> None:
    with owner(troll) as process:
        wait_for(lambda: outputs_of(troll)[0]["value"] == 1, troll)
        document = troll.ctl_json("claims")
        (slot,) = document["owners"]
        assert (slot["pid"], slot["held"], slot["state"]) == (process.pid, True, "active")
        assert slot["name"].startswith("python")
        assert (slot["lease_ms"], slot["outputs"]) == (30_000, 8)
        assert abs(slot["since"] - time.time()) < 60
        assert slot["silent_ms"] < slot["lease_ms"]
        assert (slot["by_hand"], slot["user"]) == (False, "")
        drive, *_rest = document["outputs"]
        assert (drive["owner"], drive["state"], drive["cause"]) == (-1, "safe", "start")
        assert (drive["since"], drive["reason"]) == (None, "no client has owned it since the start")
        first, second = outputs_of(troll)[:2]
        assert (first["address"], first["value"], first["state"]) == ("0x7000:01", 1, "active")
        assert (second["value"], second["state"], second["reason"]) == (0, "claimed", "")
        assert abs(first["since"] - time.time()) < 60
        assert first["owner"] == second["owner"] == 0
        socket = f"{troll.env['ECATD_RUNTIME_DIR']}/{troll.bus}/gateway/zenoh"
        over_zenoh = "--connect", f"unixsock-stream/{socket}"
        far = troll.ctl_json("claims", str(EL2008), *over_zenoh)
        assert far["outputs"][0] == {**first, "since": far["outputs"][0]["since"]}
        assert abs(far["outputs"][0]["since"] - first["since"]) < 0.1
        text = troll.ctl("claims").stdout
        row = rf"^ +{slot['slot']} +{process.pid}  python.* 30.0 s +8  active$"
        assert re.search(row, text, re.M)
        assert re.search(r"^  0x7000:01 Output +1  active +slot \d+ python", text, re.M)
        assert re.search(r"^0 Gold .*: 6 outputs, each +0  safe +never claimed$", text, re.M)
        drive_text = troll.ctl("claims", "0").stdout
        assert re.search(r"^  0x6040:00 Control word +0  safe +never claimed$", drive_text, re.M)
        assert max(map(len, text.splitlines())) <= 80


@pytest.mark.long
def test_clients_that_hang_or_die_are_told(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with owner(daemon, lease=2.0) as process:
        process.send_signal(signal.SIGSTOP)
        wait_for(lambda: outputs_of(daemon)[0]["state"] == "safe", daemon)
        text = daemon.ctl("claims", str(EL2008)).stdout
        row = rf"{process.pid}  python.* 0  lapsed\n +has lost its outputs: lease lost\n"
        row += r" +the process lives, but is stopped$"
        assert re.search(row, text, re.M)
        assert re.search(r"^  0x7000:01 Output +\d  safe +lease lost ", text, re.M)
        (slot,) = daemon.ctl_json("claims")["owners"]
        assert (slot["held"], slot["process"]) == (True, "stopped")
        lapse = f"; process {process.pid} (python"
        wait_for(lambda: lapse in daemon.log, daemon)
        said = (
            r"'python.*' \(pid \d+\) gave no sign of life for \d+ ms, and its lease was 2000 ms; "
        )
        assert re.search(
            rf"{said}process \d+ \(python.*\) lives, but is stopped$", daemon.log, re.M
        )
        events = daemon.ctl_json("events")["events"]
        event = [item for item in events if item["event"] == "safe"][-1]
        assert (event["reason"], event["process"], event["lease_ms"]) == ("lapsed", "stopped", 2000)
        assert event["silent_ms"] >= event["lease_ms"]
        process.kill()
        process.wait()
        text = daemon.ctl("claims").stdout
        assert "      has lost its outputs: lease lost\n      the process is gone\n" in text
        assert max(map(len, text.splitlines())) <= 80
        (slot,) = daemon.ctl_json("claims")["owners"]
        assert (slot["held"], slot["process"]) == (False, "ended")
        assert (slot["lapses"], slot["reason"]) == (1, "lapsed")


def test_a_client_that_says_the_number_of_another_process_is_not_believed(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll")
    with (
        subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other,
        daemon.client() as client,
    ):
        client.claim(client.signal(EL2008, 0x7000, 1), lease=0.5)
        (slot,) = daemon.ctl_json("claims")["owners"]
        path = SHM / f"{daemon.bus}.out"
        header = shm.struct("ecat_out_header").from_buffer_copy(path.read_bytes())
        at = header.slots_offset + slot["slot"] * header.slot_stride
        with path.open("r+b") as file:
            file.seek(at + shm.struct("ecat_out_slot").pid.offset)
            file.write(other.pid.to_bytes(4, "little"))
        client.claim(client.signal(EL2008, 0x7010, 1), lease=0.5)  # and then it hangs
        wait_for(lambda: "gave no sign of life" in daemon.log, daemon)
        accused = re.search(rf"; its process lives, but it is not {other.pid} \(python", daemon.log)
        # Without rights, the daemon may not see which files others have open.
        assert accused or os.geteuid() != 0
        other.kill()


def test_shm_shows_all_there_is(troll: Daemon) -> None:
    document = troll.ctl_json("shm")
    assert (document["alive"], document["state"], document["problems"]) == (True, "running", [])
    assert document["counts"] == {"slave": 8, "signal": 156, "domain": 1, "slot": 32}
    assert len(document["signals"]) == 156
    assert {slave["state"] for slave in document["slaves"]} == {"OP"}
    with troll.client() as client:
        client.sample()
        assert f"{client.fingerprint:016x}" == document["fingerprint"]
        for signal_, seen in zip(client.signals(), document["signals"], strict=True):
            assert (signal_.address, signal_.output) == (seen["address"], seen["output"])
            if signal_.slave == 5:  # constants
                assert signal_.raw == seen["raw"] or "Toggle" in signal_.name
    text = troll.ctl("shm").stdout
    assert text.startswith(f"bus {troll.bus}: running, cycle ")
    for head in ("DOMAIN ", "POS  STATE", "SIGNAL ", "REAL TIME", "EXCHANGE"):
        assert f"\n{head}" in text
    # On a busy machine the last exchange may just have been too long ago.
    valid = re.compile(r"^  in  0x6070:11 Value +32767 .* 10 V +valid$", re.M)
    wait_for(lambda: valid.search(troll.ctl("shm").stdout) is not None, troll)
    assert "\033" not in text
    assert max(map(len, text.splitlines())) <= 80
    one = troll.ctl("shm", "2").stdout
    assert "EL1018" in one
    assert "EL2008" not in one


def test_raw_tables_come_with_their_meaning(troll: Daemon) -> None:
    text = troll.ctl("shm", "--raw", "header").stdout
    assert "header[0]  (ecat_shm_header)" in text
    assert re.search(r"^  magic +0x314D485354414345 +ECAT_SHM_MAGIC$", text, re.M)
    assert re.search(r"^  state +2 RUNNING +ecat_bus_state; control$", text, re.M)
    document = troll.ctl_json("shm", "--raw", "slaves")
    assert (document["table"], document["struct"]) == ("slaves", "ecat_shm_slave")
    assert [row["product"] for row in document["rows"]][:2] == [0x00030924, 0x044C2C52]
    wrong = troll.ctl("shm", "--raw", "nothing", check=False)
    assert wrong.returncode == 2
    assert "'nothing'" in wrong.stderr


def test_watch_comes_again_and_outlives_the_daemon(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    lines = daemon.ctl("claims", "--json", "--watch", "0.5", "--count", "3").stdout.splitlines()
    cycles = [json.loads(line)["cycle"] for line in lines]
    assert cycles == sorted(set(cycles))
    assert len(cycles) == 3
    command = [sys.executable, "-m", "ecatd.cli", "claims", "--json", "--watch", "0.1"]
    with subprocess.Popen(command, env=daemon.env, text=True, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            assert json.loads(process.stdout.readline())["state"] == "running"
            daemon.kill_all()
            while "error" not in (gone := json.loads(process.stdout.readline())):
                pass
            assert gone["error"]["name"] == "unreachable"
        finally:
            process.kill()


def test_shared_memory_that_was_left_behind(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    daemon.kill_all()
    left = daemon.ctl("shm", check=False)
    assert (left.returncode, left.stderr) == (3, "")
    assert left.stdout.startswith(f"bus {daemon.bus}: NO DAEMON, only its leftovers; cycle ")
    assert f"rm -f {SHM}/{daemon.bus} {SHM}/{daemon.bus}.out" in left.stdout
    assert json.loads(daemon.ctl("shm", "--json", check=False).stdout)["alive"] is False
    claims = daemon.ctl("claims", check=False)
    assert claims.returncode == 3
    names(one_line_error(claims.stderr, "ecatctl"), "not running", f"'{daemon.bus}'")
    file = SHM / daemon.bus
    data = bytearray(file.read_bytes())
    data[0] ^= 0xFF
    file.write_bytes(data)
    broken = daemon.ctl("shm", check=False)
    assert broken.returncode == 7
    names(one_line_error(broken.stderr, "ecatctl"), "damaged", "magic number", "byte 0")


@pytest.mark.parametrize("command", ["shm", "claims"])
def test_wrong_usage_and_nobody_there(troll: Daemon, command: str) -> None:
    far = troll.ctl(command, "--connect", "tcp/127.0.0.1:1", check=False)
    assert far.returncode == (2 if command == "shm" else 3)
    names(far.stderr, "machine of the daemon" if command == "shm" else "no ecatd answers")
    count = troll.ctl(command, "--count", "2", check=False)
    names(count.stderr, "--count", "--watch")
    slave = troll.ctl(command, "77", check=False)
    assert slave.returncode == 7
    names(one_line_error(slave.stderr, "ecatctl"), "slave 77")
    nobody = run_module("ecatd.cli", command, "--bus", "nobody", env=troll.env)
    assert nobody.returncode == 3
    said = one_line_error(nobody.stderr, "ecatctl")
    names(said, "not running", "'nobody'", "systemctl start ecatd")


@pytest.mark.parametrize(("variables", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_colours_are_for_terminals(
    troll: Daemon, variables: dict[str, str], coloured: bool
) -> None:
    main, child = pty.openpty()
    env = {key: value for key, value in troll.env.items() if key != "NO_COLOR"} | variables
    process = subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", "claims"], env=env, stdin=child, stdout=child
    )
    os.close(child)
    output = b""
    with contextlib.suppress(OSError):  # the other side is closed
        while data := os.read(main, 65536):
            output += data
    os.close(main)
    assert process.wait() == 0
    assert (b"\033[1mbus " in output) is coloured
    assert (b"\033" in output) is coloured
