"""`ecatctl errors`, `graph`, `reg-read`, `reg-write`, `sii-read`, on a bus with branches."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from conftest import Daemon, names, one_line_error, wait_for
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
    wait_for(lambda: bool(bus.ctl_json("errors")["links"]), bus)
    wait_for(lambda: bus.ctl_json("errors")["links"][0]["invalid"] == 3, bus)
    (link,) = bus.ctl_json("errors")["links"]
    assert [tuple(end) for end in link["ends"]] == [before, (place, 0)]
    labels = (f"slave {before[0]}", f"port {before[1]}", f"slave {place}", "3 damaged frames")
    names(bus.ctl("errors").stdout, *labels, "cable")
    assert bus.ctl("errors", "-p", "0").stdout.startswith("no errors")
    for end in (before[0], place):
        names(bus.ctl("errors", "-p", str(end)).stdout, "3 damaged frames")
    names(bus.ctl("errors", "--reset").stdout, *labels, "cleared")
    assert bus.ctl_json("errors")["links"] == []
    names(bus.log, "error counters of all slaves", "pid")


def test_slaves_that_do_not_answer_are_named(bus: Daemon, simulator: Simulator) -> None:
    simulator.faults.break_link(10)
    wait_for(lambda: bus.ctl("errors", check=False).returncode == 4, bus)
    silent = bus.ctl("errors", "--reset", check=False)
    assert silent.returncode == 4
    names(silent.stderr, "slave 10 (EL2008)")
    assert "cleared" not in silent.stdout
    for command in (("reg-read", "10", "al_status"), ("errors", "-p", "10")):
        assert bus.ctl(*command, check=False).returncode == 4
    rows = {row["position"]: row for row in bus.ctl_json("graph")["slaves"]}
    assert not rows[10]["known"]
    assert 10 not in rows[3]["behind"]
    simulator.faults.heal_link(10)
    wait_for(lambda: bus.ctl("errors", check=False).returncode == 0, bus)
    wait_for(lambda: all(row["text"] == "OP" for row in bus.slave_rows("state")), bus)


def test_the_tree_is_drawn(bus: Daemon, simulator: Simulator, tmp_path: Path) -> None:
    simulator.faults.noise(5, count=3)
    wait_for(lambda: bool(bus.ctl_json("errors")["links"]), bus)
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
    assert any(link["ends"][1] == [1, 0] for row in later for link in row["links"])
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
        ("reg-read 0 nonsense", 2, ("'nonsense'", "al_status")),
        ("reg-read 0 0x0FFF 2", 2, ("0x0FFF", "0x1000")),
        ("reg-read 99 al_status", 7, ("slave 99",)),
        ("reg-write 0 0x0012 0x12345 --yes", 2, ("0x12345", "2 bytes")),
        ("reg-write 0 0x0012 hex:0 --yes", 2, ("'hex:0'",)),
        ("reg-write 0 0x0012 5 --yes", 7, ("slave 0 (EK1100)", "0x0012", "write")),
        ("errors -p 99", 7, ("slave 99",)),
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
