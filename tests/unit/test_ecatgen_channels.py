"""Channels that are alike become vectors, and nothing else does."""

from pathlib import Path

import pytest

from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatdev.drawing.checks import check_diagram, check_icon
from ecatdev.drawing.pictures import found_with
from ecatdev.drawing.scene import diagram, icon
from ecatdev.files import write_files
from ecatgen.build import build_library
from ecatgen.ir import Channels, Library
from ecatgen.render import render

NAMES = ("level", "speed", "odd", "late", "alone", "valve")
I16, U16 = DataType.INTEGER16, DataType.UNSIGNED16


def channel(number: int, name: str, data_type: DataType = I16, **more: object) -> Entry:
    index = 0x6000 + 16 * (number - 1)
    subindex = 1 + NAMES.index(name)  # an address of its own
    return Entry(index, subindex, f"{name} {number}", data_type, 16, **more)  # type: ignore[arg-type]


def library(inputs: list[Entry], outputs: list[Entry] | None = None) -> Library:
    slave = Slave(0, "Box", 1, 2, 3)
    slave.inputs = [Pdo(0x1A00, "", 3, inputs)]
    slave.outputs = [Pdo(0x1600, "", 2, outputs)] if outputs else []
    return build_library(Bus("b", 1000, [slave]), "Plant")


def vectors(inputs: list[Entry]) -> dict[str, tuple[str, ...]]:
    """Members of each connector, by its name and dimension."""
    (made,) = library(inputs).channels
    return {vector.name + vector.dimension: vector.members for vector in made.vectors}


def check_drawing(made: Library, tmp_path: Path) -> None:
    write_files(tmp_path / "Plant", render(made))
    found = found_with(tmp_path)
    assert made.channels
    for item in made.channels:
        path = f"Plant.Channels.{item.name}"
        assert list(check_diagram(diagram(found, path))) == []
        assert list(check_icon(icon(found, path))) == []


def test_the_reference_plant(tmp_path: Path) -> None:
    made = build_library(sample_buses.troll(), "Plant")
    by_name: dict[str, Channels] = {item.name: item for item in made.channels}
    assert list(by_name) == ["EL1018", "EL2008", "EL3008", "EL3008_2"]
    (outputs,) = by_name["EL2008"].left
    assert (outputs.name, outputs.dimension) == ("channelOutput", "[8]")
    assert outputs.members == tuple(f"channel{n}Output" for n in range(1, 9))
    (volts,) = by_name["EL3008"].right
    assert 'each unit = "V"' in volts.modifiers
    assert not any("start" in modifier for modifier in volts.modifiers)  # of what is connected
    files = render(made)
    assert files["Channels/package.order"].decode().split() == list(by_name)
    text = files["Channels/EL2008.mo"].decode()
    assert "Modelica.Blocks.Interfaces.BooleanInput channelOutput[8]" in text
    assert "connect(channelOutput[8], slave.channel8Output)" in text
    assert "connect(slave.valid, valid)" in text
    check_drawing(made, tmp_path)


def test_only_what_is_alike_and_numbered_from_one_becomes_a_vector(tmp_path: Path) -> None:
    inputs = [
        *(channel(n, "level") for n in (1, 2, 3)),
        *(channel(n, "speed", scale=2.0) for n in (1, 2)),
        channel(1, "odd", I16),
        channel(2, "odd", U16),
        *(channel(n, "late") for n in (2, 3)),
        channel(1, "alone"),
        Entry(0x7000, 0, "plain", U16, 16),
    ]
    assert vectors(inputs) == {
        "level[3]": ("level1", "level2", "level3"),
        "speed[2]": ("speed1", "speed2"),
        **{name: (name,) for name in ("odd1", "odd2", "late2", "late3", "alone1", "plain")},
    }
    check_drawing(library(inputs, [channel(n, "valve") for n in (1, 2)]), tmp_path)


def test_a_vector_that_would_have_the_name_of_another_connector() -> None:
    found = vectors([*(channel(n, "level") for n in (1, 2)), Entry(0x7000, 0, "level", U16, 16)])
    assert len(found) == 2
    assert ("level1", "level2") in found.values()


@pytest.mark.parametrize("names", [[], [1], [1, 3], [2, 3]])
def test_a_slave_without_such_channels_has_no_such_block(names: list[int]) -> None:
    made = library([channel(n, "level") for n in names])
    assert made.channels == ()
    assert not any(path.startswith("Channels/") for path in render(made))
