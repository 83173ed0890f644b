"""Rigs with CAN buses: rig files, faults, and what `ecatsim ctl can` shows."""

import re
import time
from pathlib import Path

import pytest

from conftest import names_at, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatsim import Rig, Simulation
from ecatsim.can import CanBus, CanFrame, CanNode, NodeState, Traffic
from ecatsim.can.nodes.drive import CanopenDrive
from ecatsim.cli.ctl import _print_can
from ecatsim.control.can import can_bus
from ecatsim.devices.can_terminals import EL6751CAN
from ecatsim.devices.library import make
from ecatsim.files import rig_file
from ecatsim.rigs.library import make as make_rig

DOCUMENT = Path(__file__).parents[2] / "docs" / "simulator-can.md"


def examples(language):
    return re.findall(rf"^```{language}\n(.*?)^```", DOCUMENT.read_text(), re.M | re.S)


class Keeper(CanNode):
    """Keeps what it receives."""

    def __init__(self):
        super().__init__("keeper")
        self.ids = []

    def on_frame(self, frame):
        self.ids.append(frame.id)


@pytest.fixture
def simulation():
    bus = CanBus(1_000_000)
    bus.add(Keeper())
    bus.add(CanNode("load", traffic=[Traffic(0x700, rate=100)]))
    simulation = Simulation(Rig("bench", [make("EL2008"), EL6751CAN(bus)], can=[bus]))
    yield simulation
    simulation.close()


def run_until(simulation, condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        simulation.step()
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.001)


# --- faults --------------------------------------------------------------------------------------


def test_a_node_loses_its_power_and_gets_it_back(simulation):
    (bus,) = simulation.rig.can
    load = bus.nodes[1]
    simulation.faults.can_node(1, "LOAD", "off")
    assert load.status.state == NodeState.NO_POWER
    assert not load.on
    simulation.faults.can_node(1, str(load.place), "on")
    run_until(simulation, lambda: bus.nodes[0].ids)


def test_a_node_with_another_bit_rate(simulation):
    (bus,) = simulation.rig.can
    simulation.faults.can_bit_rate(1, "load", kbit=250)
    before = bus.nodes[0].status.received
    run_until(simulation, lambda: bus.nodes[1].status.failed > 10)
    assert bus.nodes[0].status.received == before
    simulation.faults.can_bit_rate(1, "load", kbit=1000)
    run_until(simulation, lambda: bus.nodes[0].status.received > before)


def test_noise_and_its_end(simulation):
    (bus,) = simulation.rig.can
    simulation.faults.can_noise(1, 0.9)
    run_until(simulation, lambda: bus.status().error_frames > 5)
    simulation.faults.can_noise(1, 0.0)
    failed = bus.status().error_frames
    run_until(simulation, lambda: len(bus.nodes[0].ids) > 10)
    assert bus.status().error_frames <= failed + 1  # one may have been on the wire


@pytest.mark.parametrize("level", ["recessive", "dominant"])
def test_a_short_circuit_and_its_repair(simulation, level):
    (bus,) = simulation.rig.can
    load = bus.nodes[1]
    simulation.faults.can_short(1, level)
    wanted = {"recessive": NodeState.BUS_OFF, "dominant": NodeState.PASSIVE}[level]
    seen = set()
    run_until(simulation, lambda: seen.add(load.status.state) or wanted in seen)
    sent = load.status.sent
    assert bus.nodes[0].status.received == sent
    simulation.faults.can_short(1, "none")
    run_until(simulation, lambda: load.status.sent > sent)


def test_a_babbling_node_leaves_no_room(simulation):
    (bus,) = simulation.rig.can
    keeper = bus.nodes[0]
    simulation.faults.can_babble(1, id=0x10)
    run_until(simulation, lambda: keeper.ids.count(0x10) > 200)
    before = keeper.ids.count(0x700)
    run_until(simulation, lambda: keeper.ids.count(0x10) > 600)
    assert keeper.ids.count(0x700) == before
    simulation.faults.can_babble(1, end=True)
    run_until(simulation, lambda: keeper.ids.count(0x700) > before + 3)
    babbler = bus.places.index("babbling node")
    assert bus.node_status(babbler).state == NodeState.NO_POWER, "it would acknowledge frames"
    simulation.faults.can_babble(1, id=0x11)
    run_until(simulation, lambda: 0x11 in keeper.ids)


def test_a_name_of_two_nodes_is_none(simulation):
    (bus,) = simulation.rig.can
    place = bus.add_place("Keeper")
    with pytest.raises(UsageError, match=naming("can-node", "0 and 3", "keeper", "number")):
        simulation.faults.can_node(1, "keeper", "off")
    bus.power(place, True)
    simulation.faults.can_node(1, str(place), "off")
    assert bus.node_status(place).state == NodeState.NO_POWER


def test_the_terminal_goes_bus_off(simulation):
    terminal = simulation.rig.devices[1]
    terminal.can.go_online(1_000_000, 100)
    simulation.faults.can_bus_off(1)
    assert terminal.can.status.state == NodeState.BUS_OFF


def test_faults_that_cannot_be(simulation):
    with pytest.raises(UsageError, match=naming("can-noise", "slave 0", "EL2008", "CAN")):
        simulation.faults.can_noise(0, 0.5)
    with pytest.raises(UsageError, match=naming("can-node", "'lod'", "load")):
        simulation.faults.can_node(1, "lod", "off")


def test_a_terminal_without_power_is_off_the_bus(simulation):
    terminal = simulation.rig.devices[1]
    terminal.can.go_online(1_000_000, 100)
    simulation.faults.power_off(1)
    assert terminal.can.status.state == NodeState.NO_POWER


# --- what is shown -------------------------------------------------------------------------------


def test_what_a_bus_shows(simulation, capsys):
    (bus,) = simulation.rig.can
    run_until(simulation, lambda: len(bus.nodes[0].ids) > 2)
    shown = can_bus(simulation, bus)
    assert [node["name"] for node in shown["nodes"]] == ["keeper", "load", "EL6751"]
    assert [(item["slave"], item["node"]) for item in shown["terminals"]] == [(1, 2)]
    assert shown["nodes"][1]["sent"] == shown["nodes"][0]["received"] > 2
    assert shown["nodes"][2]["state"] == "no power"
    _print_can({"buses": [shown, shown]})
    assert "load" in capsys.readouterr().out
    _print_can({"buses": []})
    assert capsys.readouterr().out


# --- rig files -----------------------------------------------------------------------------------

FILE = """\
[[slave]]
device = "EK1100"

[[slave]]
device = "EL6751CAN"

[[slave]]
device = "KendrionCAN"

[[can]]
name = "one"
bit_rate = 250
terminals = [1, 2]

[[can.node]]
device = "CanopenDrive"
parameters = { node_id = 9 }

[[can.node]]
device = "mine.py:Mine"
bit_rate = 500

[[can.node]]
name = "load"
traffic = [{ id = 5, extended = true, rate = 10, count = 3 }]
checks = [{ id = 6 }]
"""
MINE = """\
from ecatsim.can import CanNode
class Mine(CanNode):
    pass
def Wrong():
    return 5
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    path = tmp_path / "rig.toml"
    path.write_text(FILE)
    return path


def test_a_rig_file_has_buses(file):
    rig = rig_file.load(file)
    (bus,) = rig.can
    assert (bus.name, bus.bit_rate) == ("one", 250_000)
    assert bus.places == ["EL6751", "FIO CAN", "CANopen drive 9", "Mine", "load"]
    assert type(bus.nodes[0]) is CanopenDrive
    assert [node.bit_rate for node in bus.nodes] == [0, 500_000, 0]
    assert all(device.can.bus is bus for device in rig.devices[1:])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("terminals = [1, 2]", "terminals = [0]", "can[0].terminals: slave 0"),
        ("terminals = [1, 2]", "terminals = [7]", "can[0].terminals: slave 7"),
        ("terminals = [1, 2]", "terminals = [1, 1]", "can[0].terminals: slave 1 | already"),
        ("bit_rate = 250", "bit_rate = 2000", "can[0].bit_rate: 2000 | 1000"),
        ('"CanopenDrive"', '"CanopenDriver"', "can[0].node[0].device: CanopenDriver"),
        ("node_id = 9", "node_id = 300", "can[0].node[0].device: node_id | 127 | 300"),
        ("mine.py:Mine", "mine.py:Wrong", "can[0].node[1].device: mine.py:Wrong"),
        ("mine.py:Mine", "mine.py", "can[0].node[1].device: mine.py:ClassName"),
        ("id = 6", "id = 0x800", "can[0].node[2].checks[0]: 0x7FF"),
        ('name = "load"', 'nam = "load"', "can[0].node[2].nam: name"),
    ],
)
def test_mistakes_in_rig_files(file, old, new, message):
    assert old in FILE
    file.write_text(FILE.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        rig_file.load(file)
    place = str(caught.value).partition(": ")[0]
    names_at(caught.value, f"{place}: {message}")
    assert place.startswith(str(file))


def test_the_example_of_the_documentation(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(examples("toml")[0])
    (bus,) = rig_file.load(path).can
    assert bus.places == ["EL6751", "CANopen drive 5", "load"]


def test_the_python_example_of_the_documentation(tmp_path):
    path = tmp_path / "counter.py"
    path.write_text(examples("python")[0])
    rig = make_rig(str(path))
    (bus,) = rig.can
    keeper = bus.add(Keeper())
    bus.run(time.monotonic())
    keeper.send(CanFrame(0x100, b"\1"))
    end = time.monotonic() + 20
    while keeper.ids != [0x101]:
        bus.run(time.monotonic())
        assert time.monotonic() < end
        time.sleep(0.001)
