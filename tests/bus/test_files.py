"""`ecatctl foe-read`, `foe-write`, `diagnosis` and `identify`, on drives that have files."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, stop_process, wait_for
from ecatd.base.errors import BusyError, StateError
from ecatd.client.remote import Remote
from ecatsim.control import Simulator
from rigs.files import FIRMWARE, PARAMETERS

pytestmark = pytest.mark.bus

RIG = Path(__file__).parents[1] / "rigs" / "files.py"


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared(str(RIG))


def remote(bus: Daemon, monkeypatch: pytest.MonkeyPatch) -> Remote:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", bus.env["ECATD_RUNTIME_DIR"])
    return Remote(bus.bus, timeout=60)


def test_a_file_is_read(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "p.bin"
    names(bus.ctl("foe-read", "0", "parameters.bin", "-o", str(file)).stdout, len(PARAMETERS))
    assert file.read_bytes() == PARAMETERS
    assert bus.ctl("foe-read", "0", "empty.txt", "-o", "-").stdout == ""
    secret = bus.ctl("foe-read", "1", "secret.txt", "-o", "-", "--password", "0xC0FFEE")
    assert secret.stdout == "something"
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


def test_a_file_is_written_and_read_back(bus: Daemon, tmp_path: Path) -> None:
    file, again = tmp_path / "new.bin", tmp_path / "again.bin"
    file.write_bytes(PARAMETERS[::-1])
    document = bus.ctl_json("foe-write", "0", str(file), "--as", "other.bin", "--yes")
    assert (document["bytes"], document["file"]) == (len(PARAMETERS), "other.bin")
    bus.ctl("foe-read", "0", "other.bin", "-o", str(again))
    assert again.read_bytes() == PARAMETERS[::-1]
    names(bus.log, "writing file 'other.bin'", f"{len(PARAMETERS)} bytes", "pid")
    told = [row["text"] for row in bus.ctl_json("events", "--kind", "change")["events"]]
    for what in ("writing file 'other.bin' begins", "writing file 'other.bin' is done"):
        assert any(what in text and text in bus.log for text in told), told


def test_firmware_is_written_in_boot_while_the_others_stay_in_op(
    bus: Daemon, tmp_path: Path
) -> None:
    file = tmp_path / FIRMWARE
    file.write_bytes(bytes(3000))
    refused = bus.ctl("foe-write", "0", str(file), "--yes", check=False)
    assert refused.returncode == 7
    names(one_line_error(refused.stderr, "ecatctl"), "slave 0", "0x8008", "--boot")
    asked = bus.ctl("foe-write", "0", str(file), "--boot", check=False)
    assert asked.returncode == 2
    names(one_line_error(asked.stderr, "ecatctl"), "3000 bytes", "BOOT", "--yes")
    bus.ctl("foe-write", "0", str(file), "--boot", "--yes")
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)
    states = [
        (row["slave"], row["text"].rpartition(": ")[2])
        for row in bus.ctl_json("events")["events"]
        if row["event"] == "al_state"
    ]
    assert (0, "BOOT") in states
    assert {slave for slave, text in states if text in ("BOOT", "INIT", "PREOP")} == {0}


def test_a_slave_without_boot_and_one_without_files(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "x.bin"
    file.write_bytes(b"x")
    without = bus.ctl("foe-write", "2", str(file), "--boot", "--yes", check=False)
    assert without.returncode == 7
    names(one_line_error(without.stderr, "ecatctl"), "slave 2", "BOOT")
    none = bus.ctl("foe-read", "2", "x", "-o", "-", check=False)
    assert none.returncode == 7
    names(one_line_error(none.stderr, "ecatctl"), "slave 2", "'x'")
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


@pytest.mark.parametrize(
    ("arguments", "status", "tokens"),
    [
        ("foe-read 0 nothing -o -", 7, ("0x8001", "'nothing'")),
        ("foe-read 1 secret.txt -o -", 7, ("0x8002", "--password")),
        ("foe-read 9 a -o -", 7, ("slave 9",)),
        ("foe-read 0 a", 2, ("-o",)),
        ("foe-read 0 a -o - --json", 2, ("--json", "-o")),
        ("foe-write 0 missing.bin --yes", 2, ("missing.bin",)),
        ("diagnosis 2", 7, ("slave 2", "0x10F3")),
    ],
)
def test_wrong_requests(bus: Daemon, arguments: str, status: int, tokens: tuple[str, ...]) -> None:
    wrong = bus.ctl(*arguments.split(), check=False)
    assert wrong.returncode == status, wrong.stderr
    text = wrong.stderr if status == 2 else one_line_error(wrong.stderr, "ecatctl")
    names(text, *tokens)


@pytest.mark.long
def test_a_slave_that_takes_no_message_keeps_nobody_else_waiting(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """It has the worker to itself for no longer than any other slave."""
    bus = start_daemon(str(RIG))
    server = bus.child_pid("ecatd.server")
    file = tmp_path / "x.bin"
    file.write_bytes(bytes(5000))
    with Simulator(str(bus.child_pid("ecatsim"))) as simulator:
        simulator.faults.mailbox(0, "full")
        assert bus.ctl("sdo-read", "0", "0x1018", "1", check=False).returncode == 4
        failed = bus.ctl("foe-write", "0", str(file), "--as", "other.bin", "--yes", check=False)
        assert failed.returncode == 4, failed.stderr
        names(one_line_error(failed.stderr, "ecatctl"), "slave 0", "does not take messages")
        assert bus.ctl("sdo-read", "2", "0x1018", "1").returncode == 0
        simulator.faults.mailbox(0, "none")
    assert bus.child_pid("ecatd.server") == server
    bus.ctl("foe-write", "0", str(file), "--as", "other.bin", "--yes")


def test_a_full_disk_of_the_slave(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "big.bin"
    file.write_bytes(bytes(9000))
    full = bus.ctl("foe-write", "1", str(file), "--password", "0xC0FFEE", "--yes", check=False)
    assert full.returncode == 7
    names(one_line_error(full.stderr, "ecatctl"), "0x8003", "4000 bytes")


def test_a_transfer_goes_on_without_its_client(
    bus: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = bytes(range(256)) * 800
    with remote(bus, monkeypatch) as first, remote(bus, monkeypatch) as second:
        begun = first.start_file_write(0, "long.bin", data)
        begun.send()
        # The same file finds the same transfer, and sends only what the daemon has not got.
        same = second.start_file_write(0, "long.bin", data)
        assert same.number == begun.number
        with pytest.raises(BusyError):
            second.start_file_write(0, "another.bin", b"x")
        assert second.sdo_read(0, 0x1018, 1).data  # other requests are answered meanwhile
        while same.step == "receiving":
            same.send()
        first.close()
        wait_for(same.look, bus)
        assert same.moved == len(data)
        file = tmp_path / "long.bin"
        bus.ctl("foe-read", "0", "long.bin", "-o", str(file))
        assert file.read_bytes() == data


def test_a_transfer_is_cancelled(bus: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    with remote(bus, monkeypatch) as client:
        transfer = client.start_file_write(0, "long.bin", bytes(300_000))
        while transfer.step == "receiving":
            transfer.send()
        transfer.cancel()
        assert transfer.step == "failed"
        with pytest.raises(StateError, match="cancelled"):
            transfer.look()
        assert client.start_file_read(0, "empty.txt").number != transfer.number


def test_a_read_ends_with_its_command(bus: Daemon, tmp_path: Path) -> None:
    big = tmp_path / "big.bin"
    big.write_bytes(bytes(400_000))
    bus.ctl("foe-write", "0", str(big), "--yes")
    command = [
        sys.executable,
        "-m",
        "ecatd.cli",
        "foe-read",
        "0",
        "big.bin",
        "-o",
        str(tmp_path / "read.bin"),
    ]
    with subprocess.Popen(command, env=bus.env) as process:
        wait_for(lambda: "reading file 'big.bin' begins" in bus.log, bus)
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
    names(bus.log, "reading file 'big.bin' was cancelled")


def test_the_diagnosis_history_has_the_emergencies(bus: Daemon, tmp_path: Path) -> None:
    assert bus.ctl_json("diagnosis", "0")["messages"] == []
    names(bus.ctl("diagnosis", "0").stdout, "slave 0", "empty")
    codes = [0x3210, 0x4310, 0x7305, 0x8400, 0x2310, 0x6320, 0x3220]
    with Simulator(str(bus.child_pid("ecatsim"))) as simulator:
        for code in codes:
            simulator.faults.emergency(0, code, 1)
    wait_for(lambda: len(bus.ctl_json("diagnosis", "0")["messages"]) == 5, bus)
    rows = bus.ctl_json("diagnosis", "0")["messages"]
    assert [row["code"] >> 16 for row in rows] == codes[-5:]  # the oldest are overwritten
    names(
        bus.ctl("diagnosis", "0").stdout,
        "error code 0x3220 (voltage inside the device)",
        "0x3220E800",
        "KIND",
    )
    asked = bus.ctl("diagnosis", "0", "--clear", check=False)
    assert asked.returncode == 2
    bus.ctl("diagnosis", "0", "--clear", "--yes")
    assert bus.ctl_json("diagnosis", "0")["messages"] == []


def test_a_slave_blinks_and_stops(bus: Daemon) -> None:
    led = ("reg-read", "1", "run_led", "--json")
    before = json.loads(bus.ctl(*led).stdout)["registers"][0]["value"]
    command = [sys.executable, "-m", "ecatd.cli", "identify", "1", "--seconds", "600"]
    with subprocess.Popen(command, env=bus.env, stderr=subprocess.DEVNULL) as process:
        wait_for(lambda: bus.ctl_json(*led[:-1])["registers"][0]["value"] == 0x1E, bus)
        process.send_signal(signal.SIGINT)
        process.wait()
    assert bus.ctl_json(*led[:-1])["registers"][0]["value"] == before
    names(bus.ctl("identify", "1", "--seconds", "0.1").stderr, "slave 1", "0.1 s")


def test_idns_are_read_and_written(bus: Daemon) -> None:
    assert bus.ctl("soe-read", "1", "S-0-0001").stdout == "2000 us  Control unit cycle time\n"
    listed = bus.ctl("soe-read", "1").stdout
    names(listed, "S-0-0017", "P-0-0200", "Boost", "-0.1 mm", "OP")
    before = bus.ctl_json("soe-read", "1", "S-0-0017")["idns"][0]["data"]
    bus.ctl("soe-write", "1", "S-0-0017", f"hex:{before[:8]}6300")
    names(bus.ctl("soe-read", "1").stdout, "S-0-0099: ", "0x1001", "S-0-0001")
    refused = {item["idn"]: item for item in bus.ctl_json("soe-read", "1")["idns"]}["S-0-0099"]
    assert refused["error"]["name"] == "state"
    names(refused["error"]["message"], "slave 1", "0x1001")
    bus.ctl("soe-write", "1", "S-0-0017", f"hex:{before}")
    bus.ctl("soe-write", "1", "S-0-0047", "12.5 mm")
    (row,) = bus.ctl_json("soe-read", "1", "S-0-0047")["idns"]
    assert (row["value"], row["unit"], row["data"]) == (12.5, "mm", "48e80100")
    names(bus.log, "S-0-0047", "18 fc ff ff", "48 e8 01 00", "pid")
    for text, value in (("-12.5", -12.5), ("-1e1", -10.0)):
        (row,) = bus.ctl_json("soe-write", "1", "S-0-0047", text)["idns"]
        assert row["value"] == value
    for arguments, status, tokens in (
        ("soe-write 1 S-0-0047 -0x10", 2, ("'-0x10'",)),  # it has decimals
        ("soe-read 1 S-0-0099", 7, ("slave 1", "S-0-0099", "0x1001")),
        ("soe-write 1 S-0-0001 9000", 7, ("slave 1", "0x7007")),
        ("soe-write 1 P-0-0100 1", 7, ("slave 1", "0x7005")),
        ("soe-write 1 S-0-0001 x", 2, ("'x'",)),
        ("soe-read 2 S-0-0001", 7, ("slave 2", "SoE")),
        ("foe-read 2 a -o -", 7, ("slave 2", "FoE")),
    ):
        wrong = bus.ctl(*arguments.split(), check=False)
        assert wrong.returncode == status, wrong
        names(one_line_error(wrong.stderr, "ecatctl"), *tokens)
    assert bus.ctl("soe-read", "1", "47", check=False).returncode == 2


def test_a_transfer_is_protected_and_ends_with_cancel(bus: Daemon, tmp_path: Path) -> None:
    big = tmp_path / "big.bin"
    big.write_bytes(bytes(3_000_000))
    command = [sys.executable, "-m", "ecatd.cli", "foe-write", "0", str(big), "--yes"]
    with subprocess.Popen(command, env=bus.env, stderr=subprocess.PIPE, text=True) as process:
        wait_for(lambda: "writing file 'big.bin' begins (3000000" in bus.log, bus)
        for arguments in (
            ("state", "0", "PREOP", "--yes"),
            ("state", "PREOP", "--yes"),
            ("reboot", "0", "--yes"),
            ("alias", "0", "7", "--yes"),
        ):
            refused = bus.ctl(*arguments, check=False)
            assert refused.returncode == 7, (arguments, refused)
            names(one_line_error(refused.stderr, "ecatctl"), "slave 0", "'big.bin'", "--cancel")
        document = bus.ctl_json("foe-write", "0", str(big), "--cancel")
        assert (document["file"], document["cancelled"]) == ("big.bin", True)
        assert process.wait() == 7
        assert process.stderr is not None
        names(process.stderr.read(), "'big.bin'", "cancelled", "pid")
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


@pytest.mark.parametrize("data", [b"", b"x"])
def test_a_cancel_starts_nothing(bus: Daemon, tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "unasked.bin"
    file.write_bytes(data)
    none = bus.ctl("foe-write", "0", str(file), "--cancel", check=False)
    assert none.returncode == 7, none
    names(one_line_error(none.stderr, "ecatctl"), "slave 0", "'unasked.bin'", "nothing was done")
    bus.ctl("foe-write", "0", str(file), "--as", "other.bin", "--yes")  # it is not busy either
    assert "writing file 'unasked.bin'" not in bus.log


def test_a_file_that_is_done_when_the_gateway_is_back_is_not_written_again(
    bus: Daemon, tmp_path: Path
) -> None:
    file = tmp_path / "once.bin"
    file.write_bytes(bytes(300_000))
    command = [sys.executable, "-m", "ecatd.cli", "foe-write", "0", str(file), "--yes"]
    with subprocess.Popen(command, env=bus.env, stdout=subprocess.PIPE, text=True) as process:
        wait_for(lambda: "writing file 'once.bin' begins" in bus.log, bus)
        stop_process(process.pid)
        try:
            os.kill(bus.child_pid("ecatd.gateway"), signal.SIGKILL)
            wait_for(lambda: "writing file 'once.bin' is done" in bus.log, bus)
        finally:
            process.send_signal(signal.SIGCONT)
        text, _ = process.communicate()
    assert process.returncode == 0
    names(text, "300000 bytes")
    assert bus.log.count("writing file 'once.bin' begins") == 1


@pytest.mark.long
def test_a_restart_of_the_gateway_does_not_end_the_command(bus: Daemon, tmp_path: Path) -> None:
    big = tmp_path / "long.bin"
    big.write_bytes(bytes(2_000_000))
    command = [sys.executable, "-m", "ecatd.cli", "foe-write", "0", str(big), "--yes"]
    with subprocess.Popen(command, env=bus.env, stdout=subprocess.PIPE, text=True) as process:
        wait_for(lambda: "writing file 'long.bin' begins (2000000" in bus.log, bus)
        os.kill(bus.child_pid("ecatd.gateway"), signal.SIGKILL)
        text, _ = process.communicate()
    assert process.returncode == 0
    names(text, "2000000 bytes")
