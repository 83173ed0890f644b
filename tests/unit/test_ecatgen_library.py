"""From the bus description to the intermediate representation: types, names, examples."""

import pytest

from conftest import names as all_named
from ecatd.base.errors import UsageError
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen.blocks import EXAMPLE_COMPONENTS
from ecatgen.build import build_library
from ecatgen.connectors import kind_of
from ecatgen.ir import Block, Example, Library

PROFILES = load_profiles()


@pytest.fixture(scope="module")
def troll() -> Library:
    return build_library(sample_buses.troll(), "TrollPlant")


def block(library: Library, name: str) -> Block:
    return next(block for block in library.blocks if block.name == name)


def example(library: Library, name: str) -> Example:
    return next(example for example in library.examples if example.name == name)


def bus(*slaves: Slave) -> Bus:
    return Bus("ecat0", 1000, list(slaves))


@pytest.mark.parametrize(
    ("data_type", "bits", "kind"),
    [
        (DataType.BOOLEAN, 1, "Boolean"),
        (DataType.BOOLEAN, 8, "Boolean"),
        (DataType.BIT1, 1, "Boolean"),
        (DataType.UNSIGNED8, 1, "Boolean"),
        (DataType.BIT2, 2, "Integer"),
        (DataType.INTEGER8, 8, "Integer"),
        (DataType.UNSIGNED16, 16, "Integer"),
        (DataType.UNSIGNED24, 24, "Integer"),
        (DataType.INTEGER32, 32, "Integer"),
        (DataType.DWORD, 31, "Integer"),
        (DataType.UNSIGNED32, 32, "Real"),
        (DataType.DWORD, 32, "Real"),
        (DataType.INTEGER64, 64, "Real"),
        (DataType.UNSIGNED64, 64, "Real"),
        (DataType.REAL32, 32, "Real"),
        (DataType.REAL64, 64, "Real"),
        (0x0800, 16, "Integer"),
    ],
)
def test_an_integer_of_modelica_has_32_bits_and_a_sign(
    data_type: int, bits: int, kind: str
) -> None:
    assert kind_of(Entry(0x6000, 1, "x", data_type, bits)) == kind


def test_a_block_for_each_slave_in_the_order_of_the_bus(troll: Library) -> None:
    assert [(block.position, block.name, block.instance) for block in troll.blocks] == [
        (0, "GoldGCONDrive", "goldGCONDrive"),
        (1, "EK1100", "ek1100"),
        (2, "EL1018", "el1018"),
        (3, "EL2008", "el2008"),
        (4, "EL3008", "el3008"),
        (5, "EL3008_2", "el3008_2"),
        (6, "EL6751", "el6751"),
        (7, "EL6751_2", "el6751_2"),
    ]
    assert troll.fingerprint == f"{sample_buses.troll().fingerprint:016x}"
    assert troll.command == "ecatctl generate TrollPlant DIR"


def test_connectors_of_the_drive(troll: Library) -> None:
    drive = block(troll, "GoldGCONDrive")
    assert [c.name for c in drive.writes] == [
        *("targetPosition", "targetVelocity", "targetTorque", "maxTorque", "controlWord"),
        "modeOfOperation",
    ]
    assert {c.class_name for c in drive.writes} == {"Modelica.Blocks.Interfaces.IntegerInput"}
    status = next(c for c in drive.reads if c.index == 0x6041)
    assert status.name == "statusWord"
    assert status.class_name == "Modelica.Blocks.Interfaces.IntegerOutput"
    assert status.description == "TPDO3 Mapping: Status word (0x6041:00)"
    speed = next(c for c in drive.reads if c.index == 0x606C)
    assert speed.description == "Velocity actual value (0x606C:00)"
    assert not drive.skipped


def test_connectors_of_terminals(troll: Library) -> None:
    assert [c.name for c in block(troll, "EL1018").reads] == [
        f"channel{n}Input" for n in range(1, 9)
    ]
    assert [c.name for c in block(troll, "EL2008").writes] == [
        f"channel{n}Output" for n in range(1, 9)
    ]
    analog = block(troll, "EL3008").reads
    assert len(analog) == 8 * 8
    assert analog[7].name == "aiStandardChannel1Value"
    assert (analog[7].kind, analog[7].unit, analog[7].scale) == ("Real", "V", 10 / 32767)
    assert [c.name for c in block(troll, "EL3008").right] == [
        f"aiStandardChannel{n}Value" for n in range(1, 9)
    ]
    assert (analog[2].name, analog[2].kind) == ("aiStandardChannel1StatusLimit1", "Integer")


def test_a_slave_without_process_data_has_a_block_without_connectors(troll: Library) -> None:
    coupler = block(troll, "EK1100")
    assert coupler.reads == coupler.writes == ()


def test_entries_that_cannot_be_reached_are_told() -> None:
    text = Entry(0x6000, 1, "text", DataType.VISIBLE_STRING, 128)
    once = Entry(0x6000, 2, "once", DataType.UNSIGNED8, 8)
    again = Entry(0x6000, 2, "again", DataType.UNSIGNED8, 8)
    slave = Slave(0, "S1", 1, 2, 3, inputs=[Pdo(0x1A00, "", 3, [text, once, again])])
    (made,) = build_library(bus(slave), "P").blocks
    assert [c.name for c in made.reads] == ["once"]
    reasons = {skipped.entry_name: skipped.reason for skipped in made.skipped}
    assert list(reasons) == ["text", "again"]
    all_named(reasons["text"], "64 bits")
    all_named(reasons["again"], "mapped twice")


def test_the_same_object_may_be_input_and_output() -> None:
    entry = Entry(0x6040, 0, "Control word", DataType.UNSIGNED16, 16)
    slave = Slave(
        0,
        "S1",
        1,
        2,
        3,
        inputs=[Pdo(0x1A00, "in", 3, [entry])],
        outputs=[Pdo(1, "out", 2, [entry])],
    )
    (made,) = build_library(bus(slave), "P").blocks
    assert [c.name for c in made.writes + made.reads] == ["outControlWord", "inControlWord"]
    assert len({c.handle for c in made.writes + made.reads}) == 2


def test_names_stay_when_other_slaves_are_added(troll: Library) -> None:
    slaves = sample_buses.troll().slaves
    more = [Slave(0, "EL9999", 2, 1, 1), *slaves[:3], Slave(0, "EK1122", 2, 9, 1), *slaves[3:]]
    for position, slave in enumerate(more):
        slave.position = position
    names = {
        block.name: [c.name for c in block.reads + block.writes]
        for block in build_library(bus(*more), "TrollPlant").blocks
    }
    for before in troll.blocks:
        assert names[before.name] == [c.name for c in before.reads + before.writes]


def test_a_name_in_the_configuration_is_that_of_the_block() -> None:
    slaves = [Slave(n, "EL1018", 2, 1, 1) for n in range(3)]
    slaves[1].given_name = "safety-door"
    blocks = build_library(bus(*slaves), "P").blocks
    assert [block.name for block in blocks] == ["EL1018", "SafetyDoor", "EL1018_2"]
    assert blocks[1].description == "safety-door (EL1018), slave 1"


def test_a_name_that_no_class_can_have_is_told() -> None:
    classes = {"Förderer": "Forderer", "αβγ": "Slave00000002", "model": "ModelSlave"}
    given = [*classes, "left-arm", "EL2_2"]
    slaves = [Slave(n, "T", 1, 2, 3, given_name=name) for n, name in enumerate(given)]
    notes = build_library(bus(*slaves), "P").notes
    assert len(notes) == len(classes)
    for position, (note, (name, class_)) in enumerate(zip(notes, classes.items(), strict=True)):
        all_named(note, f"slave {position}", name, class_)


def test_a_name_that_another_class_has_is_told() -> None:
    slaves = [Slave(n, "T", 1, 2, 3, given_name=name) for n, name in enumerate(["left", "Left"])]
    (note,) = build_library(bus(*slaves), "P").notes
    all_named(note, "slave 1", "Left_2", "slave 0", "left")


def test_names_of_equal_slaves_follow_from_those_before_them() -> None:
    def names(*kinds: str) -> list[str]:
        slaves = [Slave(n, name, 2, 1, 1) for n, name in enumerate(kinds)]
        return [block.name for block in build_library(bus(*slaves), "P").blocks]

    assert names("EL1018", "EL3008", "EL3008") == ["EL1018", "EL3008", "EL3008_2"]
    # One more behind them changes nothing, nor does any other before them.
    assert names("EL1018", "EL3008", "EL3008", "EL3008")[:3] == ["EL1018", "EL3008", "EL3008_2"]
    assert names("EK1100", "EL3008", "EL2008", "EL3008")[1::2] == ["EL3008", "EL3008_2"]
    # One less before them does: on the bus nothing tells which of them is gone.
    assert names("EL1018", "EL3008") == ["EL1018", "EL3008"]


def test_all_slaves_is_an_example_of_every_bus(troll: Library) -> None:
    made = example(troll, "AllSlaves")
    assert {c.class_name for c in made.components if c.class_name.startswith("TrollPlant.")} == {
        f"TrollPlant.{block.name}" for block in troll.blocks
    }
    writes = [f"{b.instance}.{c.name}" for b in troll.blocks for c in b.writes]
    assert [c.target for c in made.connections] == writes
    (empty,) = build_library(bus(), "P").examples
    assert [c.name for c in empty.components] == ["etherCATMaster"]


@pytest.mark.parametrize(
    ("name", "connections", "results"),
    [
        (
            "PointToPointMovement",
            {"goldGCONDrive.enable": "enable.y", "goldGCONDrive.w_ref": "reference.y"},
            ["w_ref", "w_m", "i_m"],
        ),
        (
            "RelativePosition",
            {
                "goldGCONDrive.enable": "enable.y",
                "goldGCONDrive.phi_ref": "angle.y",
                "angle.u": "reference.y",
            },
            ["phi_ref", "phi_m"],
        ),
    ],
)
def test_examples_of_a_drive(
    troll: Library, name: str, connections: dict[str, str], results: list[str]
) -> None:
    made = example(troll, name)
    assert {c.target: c.source for c in made.connections} == connections
    assert [v.name for v in made.variables] == results
    names = {c.name for c in made.components} | {v.name for v in made.variables}
    blocks = {block.instance for block in troll.blocks}
    assert names - blocks <= set(EXAMPLE_COMPONENTS)


def test_a_bus_without_a_drive_has_no_drive_example() -> None:
    slaves = [slave for slave in sample_buses.troll().slaves if slave.position != 0]
    assert [e.name for e in build_library(bus(*slaves), "P").examples] == ["AllSlaves"]


def test_a_slave_called_like_something_of_an_example_gets_another_component_name() -> None:
    (made,) = build_library(bus(Slave(0, "reference", 1, 2, 3)), "P").blocks
    assert (made.name, made.instance) == ("Reference", "referenceSlave")


def test_a_slave_called_like_the_library_gets_another_class_name() -> None:
    (made,) = build_library(bus(Slave(0, "EL1018", 1, 2, 3)), "EL1018").blocks
    assert made.name == "EL1018Slave"


def test_the_sample_time_of_examples_is_the_cycle_of_the_bus() -> None:
    library = build_library(give_meanings(Bus("x", 250, []), PROFILES), "P")
    assert "sampleTime = {0.00025}" in library.examples[0].components[0].modifiers


def test_the_name_of_the_library_is_checked() -> None:
    with pytest.raises(UsageError):
        build_library(bus(), "EtherCAT")
