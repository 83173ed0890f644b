"""`ecatctl errors`, `graph`, `reg-read`, `reg-write`, `sii-read`, on a bus with branches."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from conftest import Daemon, names, naming, one_line_error, wait_for
from ecatd.base.errors import NoAnswerError
from ecatd.client.remote import Remote
from ecatd.operations.eeproms import ReadSii, WriteSii
from ecatsim.control import Simulator
from ecatsim.devices.beckhoff import EL3102

pytestmark = pytest.mark.bus


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("branches")


@pytest.fixture
def simulator(bus: Daemon) -> Iterator[Simulator]:
    with Simulator(str(bus.child_pid("ecatsim"))) as simulator:
        yield simulator
        bus.ctl("errors", "--reset")


def test_damaged_frames_are_located(bus: Daemon, simulator: Simulator) -> None:
    names(bus.ctl("errors").stdout, "no errors", len(bus.slave_rows()))
    rows = bus.ctl_json("errors", "--all")["slaves"]
    leads = {
        (row["position"], port["port"]): tuple(port["to"])
        for row in rows
        for port in row["ports"]
        if port["to"] is not None
    }
    assert leads[0, 0] == (-1, 0)
    # What a port leads to, leads back to it.
    assert all(leads[there] == here for here, there in leads.items() if there[0] >= 0)
    place = max(position for position, _ in leads)  # in the last branch
    before = leads[place, 0]
    simulator.faults.noise(place, count=3)
    wait_for(lambda: bool(bus.ctl_json("errors")["counted"]), bus)
    wait_for(lambda: bus.ctl_json("errors")["counted"][0]["invalid"] == 3, bus)
    (link,) = bus.ctl_json("errors")["counted"]
    assert [tuple(end) for end in link["ends"]] == [before, (place, 0)]
    labels = (f"slave {before[0]}", f"port {before[1]}", f"slave {place}", "3 damaged frames")
    names(bus.ctl("errors").stdout, *labels, "cable")
    assert bus.ctl("errors", "0").stdout.startswith("no errors")
    for end in (before[0], place):
        names(bus.ctl("errors", str(end)).stdout, "3 damaged frames")
    names(bus.ctl("errors", "--reset").stdout, *labels, "cleared")
    assert bus.ctl_json("errors")["counted"] == []
    names(bus.log, "error counters of all slaves", "pid")


def test_each_cable_has_a_verdict(bus: Daemon, simulator: Simulator, tmp_path: Path) -> None:
    """A loose cable: bursts of errors, and the link is lost; then it is mended."""

    def cable(slave: int) -> dict[str, Any]:
        links = json.loads(bus.ctl("errors", "--json", check=False).stdout)["links"]
        (found,) = [row for row in links if row["slave"] == slave]
        return dict(found)

    def told() -> list[dict[str, Any]]:
        return list(bus.ctl_json("events", "--kind", "cable")["events"])

    rows = bus.ctl_json("errors")["links"]
    assert [(row["slave"], row["port"]) for row in rows] == [(n, 0) for n in range(11)]
    assert (rows[0]["before"], rows[7]["before"], rows[7]["before_port"]) == (-1, 3, 1)
    simulator.faults.noise(7, count=5)
    wait_for(lambda: cable(7)["errors"] == 5, bus)
    assert {cable(n)["verdict"] for n in range(11) if n != 7} <= {"good", "unknown"}
    row = cable(7)
    assert (row["verdict"], row["lost_links"], row["worse"]) == ("strained", 0, 0)
    names(row["text"], "between slave 3 (EK1122) port 1 and slave 7", "5 errors", "reseat")
    simulator.faults.noise(7, count=60)
    wait_for(lambda: cable(7)["verdict"] == "bad", bus)
    svg = tmp_path / "bus.svg"
    bus.ctl("graph", "-o", str(svg))
    assert svg.read_text().count('class="broken"') == 1
    names(bus.ctl("graph").stdout.splitlines()[8], "bad", "errors")
    names(bus.ctl("errors").stdout, "bad: between slave 3 (EK1122) port 1 and slave 7", "replace")
    wait_for(lambda: any(row["verdict"] == "bad" for row in told()), bus, 20)
    assert {row["slave"] for row in told()} == {7}
    names(bus.log, "bad cable between slave 3 (EK1122) port 1")
    simulator.faults.break_link(7)
    wait_for(lambda: "there is no link" in cable(7)["text"], bus)
    assert cable(8)["verdict"] == "unknown"
    simulator.faults.heal_link(7)
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)
    assert cable(7)["lost_links"] == 1
    bus.ctl("errors", "--reset")
    assert (cable(7)["verdict"], cable(7)["errors"]) == ("unknown", 0)  # watched anew


def test_slaves_that_do_not_answer_are_named(bus: Daemon, simulator: Simulator) -> None:
    simulator.faults.break_link(10)
    wait_for(lambda: bus.ctl("errors", check=False).returncode == 4, bus)
    silent = bus.ctl("errors", "--reset", check=False)
    assert silent.returncode == 4
    names(silent.stderr, "slave 10 (EL2008)")
    assert "cleared" not in silent.stdout
    for command in (("reg-read", "10", "al_status"), ("errors", "10")):
        assert bus.ctl(*command, check=False).returncode == 4
    rows = {row["position"]: row for row in bus.ctl_json("graph")["slaves"]}
    assert not rows[10]["known"]
    assert 10 not in rows[3]["behind"]
    simulator.faults.heal_link(10)
    wait_for(lambda: bus.ctl("errors", check=False).returncode == 0, bus)
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


def test_the_tree_is_drawn(bus: Daemon, simulator: Simulator, tmp_path: Path) -> None:
    simulator.faults.noise(5, count=3)
    wait_for(lambda: bool(bus.ctl_json("errors")["counted"]), bus)
    slaves = bus.ctl_json("graph")["slaves"]
    behind = {row["position"]: row["behind"] for row in slaves}
    assert behind[3] == [4, 7, 10]  # a junction: ports 3, 1 and 2
    assert [row["port"] for row in slaves if row["position"] in behind[3]] == [3, 1, 2]
    lines = bus.ctl("graph").stdout.splitlines()
    assert lines[0] == "master"
    assert [line.lstrip("│ ").split()[0] for line in lines[1:]] == [*map(str, range(11))]
    assert [line.startswith("│") for line in lines[1:]] == [False] * 4 + [True] * 6 + [False]
    names(lines[6], "EL2004", "OP", "port 1", "errors")
    svg, dot = tmp_path / "bus.svg", tmp_path / "bus.dot"
    bus.ctl("graph", "-o", str(svg))
    texts = [item.text for item in ElementTree.parse(svg).iter("{http://www.w3.org/2000/svg}text")]
    assert "3 EK1122" in texts
    bus.ctl("graph", "-o", str(dot))
    names(dot.read_text(), "s3 -> s7", "s0 [label=", "errors")
    wrong = bus.ctl("graph", "-o", "bus.png", check=False)
    assert wrong.returncode == 2
    names(one_line_error(wrong.stderr, "ecatctl"), "bus.png", ".svg")


def test_new_errors_are_told_as_they_come(bus: Daemon, simulator: Simulator) -> None:
    simulator.faults.noise(1, count=0, every=50)
    result = bus.ctl("errors", "--watch", "0.3", "--count", "4", "--json")
    simulator.faults.clear()
    first, *later = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(later) == 3
    assert any(link["ends"][1] == [1, 0] for row in later for link in row["counted"])
    assert first["schema"] == 1


def test_registers_are_read_and_written(bus: Daemon) -> None:
    assert bus.ctl("reg-read", "0", "al_status").stdout == "0x0008 8\n"
    assert bus.ctl("reg-read", "0", "0x0130").stdout == "0x0008 8\n"
    (row,) = bus.ctl_json("reg-read", "0", "rx-errors")["registers"]
    assert row == {
        "address": 0x0300,
        "name": "rx_errors",
        "data": "00 " * 7 + "00",
        "value": 0,
    }
    names(bus.ctl("reg-read", "1").stdout, "0x0130", "al_status", "AL state")
    refused = bus.ctl("reg-write", "0", "al_control", "4", check=False)
    assert refused.returncode == 2
    names(one_line_error(refused.stderr, "ecatctl"), "al_control", "the AL state", "--yes")
    written = bus.ctl("reg-write", "0", "0x0410", "hex:34 12", "--yes")
    assert written.stdout == "0x1234 4660\n"
    names(bus.log, "0x0410", "watchdog_pdi", "34 12", "pid")


@pytest.mark.parametrize(
    ("arguments", "status", "tokens"),
    [
        ("reg-read 0 nonsense", 2, ("'nonsense'", "reg-read SLAVE")),
        ("reg-read 0 0x0FFF 2", 2, ("0x0FFF", "0x1000")),
        ("reg-read 99 al_status", 7, ("slave 99",)),
        ("reg-write 0 0x0012 0x12345 --yes", 2, ("0x12345", "2 bytes")),
        ("reg-write 0 0x0012 hex:0 --yes", 2, ("'hex:0'",)),
        ("reg-write 0 0x0012 5 --yes", 7, ("slave 0 (EK1100)", "0x0012", "write")),
        ("errors 99", 7, ("slave 99",)),
        ("alias 99 5 --yes", 7, ("slave 99",)),
        ("errors --count 2", 2, ("--watch",)),
    ],
)
def test_wrong_arguments(bus: Daemon, arguments: str, status: int, tokens: tuple[str, ...]) -> None:
    wrong = bus.ctl(*arguments.split(), check=False)
    assert wrong.returncode == status, wrong.stderr
    names(one_line_error(wrong.stderr, "ecatctl"), *tokens)


def test_an_eeprom_is_read(bus: Daemon, simulator: Simulator, tmp_path: Path) -> None:
    file = tmp_path / "eeprom.bin"
    bus.ctl("sii-read", "9", "-o", str(file))
    image = file.read_bytes()
    assert image == EL3102().sii_image()
    text = bus.ctl("sii-read", "9").stdout
    names(text, "EL3102", "0x00000002", f"{len(image)} bytes", "CoE", "0x1A00", "sync manager 3")
    assert "problem" not in text
    simulator.faults.eeprom(9, "checksum")
    names(bus.ctl("sii-read", "9").stdout, "problem", "byte 0x000E")
    simulator.faults.eeprom(9, "restore")
    found = bus.ctl_json("sii-read", "9")["sii"]
    assert (found["order"], found["problems"]) == ("EL3102", [])
    wrong = bus.ctl("sii-read", "9", "-o", str(tmp_path / "no" / "file"), check=False)
    assert wrong.returncode == 7
    one_line_error(wrong.stderr, "ecatctl")


def test_how_far_a_long_command_is_stands_on_the_terminal(bus: Daemon) -> None:
    assert bus.ctl("sii-read", "9").stderr == ""
    for command, said in (("sii-read", "128 bytes"), ("rescan", "devices on the wire")):
        ours, theirs = os.openpty()
        arguments = [sys.executable, "-m", "ecatd.cli", command, *["9"] * (command != "rescan")]
        subprocess.run(arguments, env=bus.env, stdout=subprocess.DEVNULL, stderr=theirs, check=True)
        shown = os.read(ours, 1 << 16).decode()
        os.close(theirs)
        os.close(ours)
        assert said in shown
        assert shown.endswith("\r\033[K")  # nothing of it is left


def test_an_eeprom_is_written(bus: Daemon, tmp_path: Path) -> None:
    file, backup = tmp_path / "eeprom.bin", tmp_path / "before.bin"
    bus.ctl("sii-read", "9", "-o", str(file))
    image = bytearray(file.read_bytes())
    name = image.index(b"EL3102")
    image[name : name + 6] = b"EL3199"
    file.write_bytes(image)
    asked = bus.ctl("sii-write", "9", str(file), "--backup", str(backup), check=False)
    assert asked.returncode == 2
    names(one_line_error(asked.stderr, "ecatctl"), "slave 9 (EL3102)", "1 word", "--yes")
    assert not backup.exists()
    shown = bus.ctl("sii-write", "9", str(file), "--dry-run").stdout
    names(shown, "- order code", "EL3199", "1 word would be written")
    document = bus.ctl_json("sii-write", "9", str(file), "--backup", str(backup), "--yes")
    assert (document["differ"], document["written"]) == (1, 1)
    names(bus.log, "EEPROM words", "slave 9 (EL3102)", "pid")
    assert bus.ctl_json("sii-read", "9")["sii"]["order"] == "EL3199"
    again = bus.ctl("sii-write", "9", str(file), "--yes")
    names(again.stdout, "slave 9 (EL3102)", "nothing was written")
    bus.ctl("sii-write", "9", str(backup), "--backup", str(tmp_path / "x"), "--yes")
    assert bus.ctl_json("sii-read", "9")["sii"]["order"] == "EL3102"
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


def test_an_eeprom_that_does_not_answer_delays_no_other(
    bus: Daemon, simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", bus.env["ECATD_RUNTIME_DIR"])
    simulator.faults.break_link(10)
    wait_for(lambda: bus.ctl("errors", check=False).returncode == 4, bus)

    def read_of_silent_slave() -> tuple[float, float]:
        begun = time.monotonic()
        with Remote(bus.bus) as other, pytest.raises(NoAnswerError, match=naming("slave 10")):
            other.request(ReadSii(10, 0, 8))
        return begun, time.monotonic()

    def one_of_another_slave_has_overtaken() -> bool:
        """Whether a read that began 0.2 s after that of the silent slave has ended before it."""
        done = []
        reading = pool.submit(read_of_silent_slave)
        while not reading.done():
            begun = time.monotonic()
            assert len(remote.request(ReadSii(9, 0, 8))["data"]) == 16
            done.append((begun, time.monotonic()))
        first, last = reading.result()
        return any(first + 0.2 < begun and end < last for begun, end in done)

    with ThreadPoolExecutor(1) as pool, Remote(bus.bus) as remote:
        wait_for(one_of_another_slave_has_overtaken, bus)
    simulator.faults.heal_link(10)
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


def test_one_client_at_a_time_writes_an_eeprom(
    bus: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", bus.env["ECATD_RUNTIME_DIR"])
    with Remote(bus.bus) as remote:
        image = remote.sii(9)
        file, backup = tmp_path / "eeprom.bin", tmp_path / "before.bin"
        file.write_bytes(image.replace(b"EL3102", b"EL3199"))
        remote.request(WriteSii(9, 0x3F0, bytes(4), more=True))
        for command in (["alias", "9", "7"], ["sii-write", "9", str(file), "--backup", backup]):
            refused = bus.ctl(*map(str, command), "--yes", "--json", check=False)
            assert refused.returncode == 7
            error = json.loads(refused.stdout)["error"]
            assert error["name"] == "busy"
            names(error["message"], "slave 9 (EL3102)", f"pid {os.getpid()}")
        assert not backup.exists()
        assert bus.ctl_json("alias", "8", "0", "--yes")["alias"] == 0  # another slave
        remote.request(WriteSii(9, 0x3F0, image[0x7E0:0x7E4]))
        assert bus.ctl_json("alias", "9", "7", "--yes")["before"] == 0
        remote.request(WriteSii(9, 0, image[:16]))
        assert remote.sii(9) == image


def test_commands_that_write_an_eeprom_together_do_not_mix_their_words(
    bus: Daemon, tmp_path: Path
) -> None:
    before = tmp_path / "before.bin"
    bus.ctl("sii-read", "9", "-o", str(before))
    files = [tmp_path / f"{number}.bin" for number in range(2)]
    for number, file in enumerate(files):
        image = bytearray(before.read_bytes())
        for at in range(0x400, len(image), 0x80):
            image[at] ^= 1 + number
        file.write_bytes(image)
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "ecatd.cli", "sii-write", "9", str(file), "--yes"],
            env=bus.env,
            cwd=tmp_path / str(number),
            stderr=subprocess.PIPE,
            text=True,
        )
        for number, file in enumerate(files)
        if not (tmp_path / str(number)).mkdir()
    ]
    while any(process.poll() is None for process in started):
        bus.ctl("sii-read", "9")  # a reader disturbs no writer
    said = [process.communicate()[1] for process in started]
    assert {process.returncode for process in started} <= {0, 7}, said
    after = tmp_path / "after.bin"
    bus.ctl("sii-read", "9", "-o", str(after))
    done = [file for file, process in zip(files, started, strict=True) if process.returncode == 0]
    assert after.read_bytes() in [file.read_bytes() for file in done], said
    bus.ctl("sii-write", "9", str(before), "--backup", str(tmp_path / "x"), "--yes")


def test_wrong_eeproms_are_not_written(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "eeprom.bin"
    bus.ctl("sii-read", "9", "-o", str(file))
    image = file.read_bytes()
    for data, tokens in (
        (b"", ("0 bytes",)),
        (image[:-1], (f"{len(image) - 1} bytes",)),
        (image + bytes(len(image)), (f"{2 * len(image)} bytes", "slave 9 (EL3102)")),
        (bytes([image[0] ^ 1]) + image[1:], ("checksum", "--force")),
    ):
        file.write_bytes(data)
        wrong = bus.ctl("sii-write", "9", str(file), "--yes", check=False)
        assert wrong.returncode == 2, wrong
        names(one_line_error(wrong.stderr, "ecatctl"), str(file), *tokens)
    file.write_bytes(image)
    (tmp_path / "here").write_bytes(b"")
    file.write_bytes(image.replace(b"EL3102", b"EL3199"))
    wrong = bus.ctl(
        "sii-write", "9", str(file), "--backup", str(tmp_path / "here"), "--yes", check=False
    )
    assert wrong.returncode == 2
    names(one_line_error(wrong.stderr, "ecatctl"), str(tmp_path / "here"))
    assert bus.ctl_json("sii-read", "9")["sii"]["order"] == "EL3102"


def test_an_alias_is_written_with_its_checksum(bus: Daemon, simulator: Simulator) -> None:
    before = bus.ctl_json("sii-read", "1")["sii"]["alias"]
    asked = bus.ctl("alias", "1", "1234", check=False)
    assert asked.returncode == 2
    names(one_line_error(asked.stderr, "ecatctl"), "slave 1", before, "1234", "--yes")
    assert bus.ctl_json("alias", "1", "1234", "--yes")["before"] == before
    found = bus.ctl_json("sii-read", "1")["sii"]
    assert (found["alias"], found["problems"]) == (1234, [])
    names(bus.ctl("alias", "1", "1234").stdout, "nothing was written")
    # The other one has it only in its EEPROM so far.
    again = bus.ctl("alias", "2", "1234", check=False)
    names(again.stderr, "warning", bus.ctl_json("slaves")["slaves"][1]["name"], "has this alias")
    simulator.faults.eeprom(1, "checksum")
    wrong = bus.ctl("alias", "1", "5", "--yes", check=False)
    assert wrong.returncode == 7
    names(one_line_error(wrong.stderr, "ecatctl"), "slave 1", "checksum", "sii-write")
    simulator.faults.eeprom(1, "restore")
    bus.ctl("alias", "1", str(before), "--yes")


@pytest.mark.parametrize("command", ["alias", "sii-write"])
def test_an_eeprom_that_changes_during_the_question(
    bus: Daemon, tmp_path: Path, command: str
) -> None:
    before = bus.ctl_json("sii-read", "1")["sii"]["alias"]
    file = tmp_path / "sii.bin"
    bus.ctl("alias", "1", "100", "--yes")
    bus.ctl("sii-read", "1", "-o", str(file))
    bus.ctl("alias", "1", "101", "--yes")
    what = "100" if command == "alias" else str(file)
    ours, theirs = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", command, "1", what],
        **(dict.fromkeys(("stdin", "stderr"), theirs) | {"stdout": subprocess.DEVNULL}),
        env=bus.env,
        cwd=tmp_path,
    ) as process:
        os.close(theirs)
        said = b""
        while b"[y/N]" not in said:
            said += os.read(ours, 4096)
        bus.ctl("alias", "1", "102", "--yes")
        os.write(ours, b"y\n")
        said = b""
        with contextlib.suppress(OSError):  # it has closed its end
            while more := os.read(ours, 4096):
                said += more
        assert process.wait() == 7
    os.close(ours)
    names(said.decode(), "slave 1", "somebody else", "nothing was written")
    assert bus.ctl_json("sii-read", "1")["sii"]["alias"] == 102
    assert [path.name for path in tmp_path.glob("sii*")] == ["sii.bin"]  # no backup of nothing
    bus.ctl("alias", "1", str(before), "--yes")


def test_a_slave_is_reset_and_comes_back(bus: Daemon) -> None:
    asked = bus.ctl("reboot", "5", check=False)
    assert asked.returncode == 2
    names(one_line_error(asked.stderr, "ecatctl"), "slave 5", "--yes")
    document = bus.ctl_json("--timeout", "60", "reboot", "5", "--yes")
    assert document["slave"] == 5
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)
    assert any(
        row["event"] == "al_state" and row["slave"] == 5 for row in bus.ctl_json("events")["events"]
    )


def test_the_wire_is_compared_with_the_start(bus: Daemon, simulator: Simulator) -> None:
    same = bus.ctl("rescan")
    names(same.stdout, "11 devices", "10 EL2008", "as at the start")
    simulator.faults.power_off(10)
    wait_for(lambda: bus.ctl("rescan", check=False).returncode == 7, bus)
    names(bus.ctl("rescan", check=False).stdout, "10 devices", "slave 10 (EL2008)", "not there")
    simulator.faults.swap(10, "EL1018")
    simulator.faults.power_on(10)
    wait_for(lambda: len(rows(bus)) == 11, bus)
    wait_for(lambda: rows(bus)[10]["vendor"] is not None, bus)
    assert rows(bus)[10]["product"] != bus.slave_rows()[10]["product"]
    assert rows(bus)[10]["difference"]
    simulator.faults.swap(10, "original")
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)
    assert bus.ctl("rescan").returncode == 0


def rows(bus: Daemon) -> list[dict[str, Any]]:
    found = json.loads(bus.ctl("rescan", "--json", check=False).stdout)
    devices: list[dict[str, Any]] = found["devices"]
    return devices


def test_a_sensor_drifts_while_the_bus_runs(bus: Daemon, simulator: Simulator) -> None:
    def raw() -> int:
        (row,) = bus.ctl_json("read", "9/0x6000:11")["values"]
        return int(row["raw"])

    true = raw()
    simulator.faults.drift(9, "0x6000:11", per_second=-5000, limit=700)
    wait_for(lambda: raw() == true - 700, bus)
    simulator.faults.drift(9, "0x6000:11", per_second=0)
    wait_for(lambda: raw() == true, bus)
