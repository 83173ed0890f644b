"""What is different between two buses is told by slave and connector."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from bus_strategies import buses
from hypothesis import given, settings
from hypothesis import strategies as st

import ecatgen.build
from conftest import names
from ecatd.config import Config
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Domain, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen import generate
from ecatgen.build import build_library
from ecatgen.differences import Difference, compare, lines
from ecatgen.fmu import generate_fmu
from ecatgen.origin import essence
from ecatgen.render import render


def compared(old: Bus, new: Bus) -> tuple[Difference, ...]:
    first, second = ((bus, build_library(bus, "Plant")) for bus in (old, new))
    return compare(first, second)


def in_order(slaves: Sequence[Slave]) -> Bus:
    return Bus("ecat0", 1000, [replace(slave, position=n) for n, slave in enumerate(slaves)])


def told(change: Callable[[Bus], None]) -> list[str]:
    """The lines for a change of `troll`."""
    new = sample_buses.troll()
    change(new)
    return lines(compared(sample_buses.troll(), new))


def entry_of(bus: Bus, slave: int, index: int) -> Entry:
    both = [*bus.slaves[slave].entries(outputs=True), *bus.slaves[slave].entries(outputs=False)]
    return next(entry for _, entry, _ in both if entry.index == index)


def say(found: Sequence[str], *wanted: str) -> None:
    """Asserts that each line names what is wanted of it; "1 -> 2": the first before the second."""
    assert len(found) == len(wanted), found
    for line, tokens in zip(found, wanted, strict=True):
        for token in tokens.split(" | "):
            first, arrow, second = token.partition(" -> ")
            names(line, *filter(None, (first, second)))
            if arrow:
                names(line.rpartition(second)[0], first)


def test_nothing_is_different() -> None:
    assert told(lambda bus: None) == []


def test_connectors_come_and_go() -> None:
    def shorten(bus: Bus) -> None:
        bus.slaves[3].outputs.pop()

    say(told(shorten), "slave 3 | EL2008 | channel8Output | gone | output | 0x7070:01")
    new = sample_buses.troll()
    shorten(new)
    found = lines(compared(new, sample_buses.troll()))
    say(found, "slave 3 | EL2008 | channel8Output | new | output | 0x7070:01 | BOOLEAN")


def test_connectors_change() -> None:
    def change(bus: Bus) -> None:
        entry = entry_of(bus, 0, 0x6071)
        entry.data_type, entry.bit_length = DataType.INTEGER32, 32
        entry_of(bus, 0, 0x607A).name = "Goal"
        entry_of(bus, 2, 0x6000).bit_length = 2
        entry_of(bus, 4, 0x6000).name = "Under range"

    say(
        told(change),
        "slave 0 | GoldGCONDrive | targetPosition -> goal | output | 0x607A:00",
        "slave 0 | GoldGCONDrive | goal | name | Target Position -> Goal",
        "slave 0 | GoldGCONDrive | targetTorque | INTEGER16 -> INTEGER32",
        "slave 2 | EL1018 | channel1Input | bits | 1 -> 2",
        "slave 4 | EL3008 | aiStandardChannel1StatusUnderrange -> underRange | input | 0x6000:01",
        "slave 4 | EL3008 | underRange | name | Status__Underrange -> Under range",
    )


def test_units_and_scales() -> None:
    def scale(bus: Bus) -> None:
        entry = entry_of(bus, 0, 0x6071)
        entry.unit, entry.scale = "N.m", 0.5

    found = told(scale)
    for line in found:
        names(line, "slave 0", "GoldGCONDrive", "targetTorque")
    say([line for line in found if "targetTorque: unit" in line], "nothing -> N.m")
    say([line for line in found if "targetTorque: scale" in line], "1.0 -> 0.5")


def test_slaves_come_go_and_move() -> None:
    slaves = sample_buses.troll().slaves
    old = in_order(slaves)
    say(
        lines(compared(old, in_order([slaves[0], *slaves]))),
        "slave 1 | GoldGCONDrive_2 | new | Gold EtherCAT GCON Drive | 0x00010420",
        "moved | slaves 2 to 8 -> slaves 1 to 7",
    )
    say(
        lines(compared(old, in_order(slaves[:-1]))),
        "slave 7 | EL6751_2 | gone | EL6751 | 0x00140000",
    )
    swapped = [*slaves[:2], slaves[3], slaves[2], *slaves[4:]]
    say(
        lines(compared(old, in_order(swapped))),
        "EL2008 | moved | slave 2 -> slave 3",
        "EL1018 | moved | slave 3 -> slave 2",
    )
    other = replace(slaves[2], name="EL1008", product=0x03F03052)
    say(
        lines(compared(old, in_order([*slaves[:2], other, *slaves[3:]]))),
        "slave 2 | EL1018 | gone | 0x00100000",
        "slave 2 | EL1008 | new | 0x00100000",
    )


def test_a_slave_with_a_name_is_the_same_wherever_it_is() -> None:
    slaves = sample_buses.troll().slaves
    left, right = (
        replace(sample_buses.troll().slaves[4], given_name=name) for name in ("left", "right")
    )
    left.inputs[0].entries[-1].unit = "V"
    old = in_order([*slaves[:4], left, right])
    say(
        lines(compared(old, in_order([*slaves[:4], right, left]))),
        "slave 4 | Right | moved | slave 5",
        "slave 5 | Left | moved | slave 4",
    )
    say(
        lines(compared(old, in_order([*slaves[:4], right]))),
        "slave 4 | Left | gone",
        "slave 4 | Right | moved | slave 5",
    )
    port = replace(left, given_name="port")
    say(
        lines(compared(old, in_order([*slaves[:4], port, right]))),
        "slave 4 | class | Left -> Port | models",
    )


def test_classes_that_other_slaves_have_now_are_told() -> None:
    slaves = sample_buses.troll().slaves
    say(
        lines(compared(in_order(slaves), in_order([slaves[0], slaves[4], *slaves[1:]]))),
        "slave 1 | EL3008 | new | 0x00140000",
        "slave 5 | class | EL3008 -> EL3008_2 | models",
        "slave 6 | class | EL3008_2 -> EL3008_3 | models",
        "moved | slaves 2 to 8 -> slaves 1 to 7",
    )


def test_what_no_connector_shows_is_told_all_the_same() -> None:
    def pad(bus: Bus) -> None:
        bus.slaves[2].inputs.append(Pdo(0x1A10, "", 0, [Entry(0, 0, "", DataType.PADDING, 8)]))

    say(told(pad), "slave 2 | EL1018 | PDOs | padding")

    def configure(bus: Bus) -> None:
        bus.name, bus.cycle_time_us = "other", 500
        bus.domains = [Domain(), Domain("slow", 4, 1)]
        bus.slaves[1].revision = 1

    say(
        told(configure),
        "bus | name | ecat0 -> other",
        "bus | cycle | 1000 µs -> 500 µs",
        "bus | domains | slow | every 4 | phase 1",
        "slave 1 | EK1100 | revision | 0x00120000 -> 0x00000001",
    )


KINDS = [Slave(0, name, 2, product, 1) for name, product in (("A1", 1), ("B1", 2), ("C1", 3))]
rows = st.lists(st.sampled_from(KINDS), max_size=8)


@given(rows, rows)
def test_every_slave_is_accounted_for(before: list[Slave], after: list[Slave]) -> None:
    found = compared(in_order(before), in_order(after))
    count = {kind: sum(item.kind == kind for item in found) for kind in ("gone", "new", "moved")}
    assert len(after) - len(before) == count["new"] - count["gone"]
    assert (found == ()) == (before == after)
    for slave in KINDS:
        assert sum(item.kind in ("gone", "new") for item in found) >= abs(
            before.count(slave) - after.count(slave)
        )


@settings(max_examples=25)
@given(buses, buses)
def test_whatever_is_different_is_told(before: Bus, after: Bus) -> None:
    """And every bus makes a library."""
    old, new = essence(before), essence(after)
    for bus in (old, new):
        assert render(build_library(bus, "Plant"))
    found = compared(old, new)
    assert (found == ()) == (old == new)
    assert all("\n" not in line for line in lines(found))


def test_a_large_bus_is_compared_quickly() -> None:
    slaves = 150 * KINDS
    *_, moved = lines(compared(in_order(slaves), in_order(slaves[1:])))
    say([moved], "moved | slaves 0 to 448 -> slaves 1 to 449")


def test_a_report_has_the_differences(tmp_path: Path) -> None:
    assert generate(sample_buses.troll(), "Plant", tmp_path).differences == ()
    new = sample_buses.troll()
    new.slaves[3].outputs.pop()
    for check in (True, False):
        report = generate(new, "Plant", tmp_path, check=check)
        (difference,) = report.differences
        document = difference.to_dict()
        assert report.details() == [document.pop("text")]
        say(report.details(), "slave 3 | EL2008 | channel8Output | gone | output | 0x7070:01")
        assert document == {
            "slave": 3,
            "block": "EL2008",
            "connector": "channel8Output",
            "kind": "gone",
            "before": "channel8Output",
            "after": "",
        }
        assert not report.otherwise
    assert not generate(new, "Plant", tmp_path, check=True).is_change


def test_another_generator_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    templates = tmp_path / "templates"
    templates.mkdir()
    own = Path(ecatgen.build.__file__).parent / "templates" / "users_guide.mo.j2"
    (templates / own.name).write_text(own.read_text() + "// mine\n")
    out = tmp_path / "out"
    generate(sample_buses.troll(), "Plant", out)
    (out / "Plant" / "Mine.mo").write_text("mine")  # changes package.order: not the generator
    (out / "Plant" / "EL1018.mo").unlink()
    report = generate(sample_buses.troll(), "Plant", out, templates=[templates], check=True)
    assert report.written == ("Plant/EL1018.mo", "Plant/UsersGuide.mo", "Plant/package.order")
    assert report.otherwise == ("Plant/UsersGuide.mo",)
    (line,) = report.details()
    names(line, "1 file", "same bus", "Plant/UsersGuide.mo", "ecatd")
    new = sample_buses.troll()
    new.slaves[3].outputs.pop()
    report = generate(new, "Plant", out, templates=[templates])
    assert "Plant/EL2008.mo" in report.written
    assert report.otherwise == ("Plant/UsersGuide.mo",)
    assert len(report.differences) == 1


@pytest.mark.parametrize("text", ["", "{}", '{"schema": 1, "slaves": 5}'])
def test_a_scan_that_cannot_be_read_is_no_hindrance(tmp_path: Path, text: str) -> None:
    generate(sample_buses.troll(), "Plant", tmp_path)
    scan = tmp_path / "Plant" / "Resources" / "bus.json"
    scan.write_text(text)
    report = generate(sample_buses.troll(), "Plant", tmp_path, force=True)
    assert report.differences == ()
    assert (tmp_path / "Plant" / "Resources" / "bus.json.orig").read_text() == text


LEVEL = """
[[device]]
description = "Inputs \\"8 bits\\" \\u007f"
source = "manual"
vendor = 2
product = [0x03FA3052]

[[device.entry]]
index = 0x6000
subindex = 1
step = 0x10
count = 2
unit = "m"
raw = [0, 27648]
physical = [0, 4.5]

[[device.entry]]
index = 0x6020
subindex = [1, 3]
note = "line\\nbreak"
quantity = "Level"
values = { -1 = "a \\"b\\"", 0x10 = "ü" }
connector = false
"""


def troll_with(folder: Path, profile: str) -> Bus:
    """The reference plant, with one more device profile."""
    folder.mkdir(exist_ok=True)
    (folder / "level.toml").write_text(profile)
    return give_meanings(sample_buses.troll(), load_profiles(Config(profiles=[str(folder)])))


@pytest.mark.parametrize("fmu", [False, True])
def test_a_profile_that_has_changed_is_told_by_slave_and_connector(
    tmp_path: Path, fmu: bool
) -> None:
    def run(text: str, *, check: bool = False) -> list[str]:
        bus = troll_with(tmp_path / "profiles", text)
        if fmu:
            return generate_fmu(bus, "Plant", tmp_path, 2, check=check).details()
        return generate(bus, "Plant", tmp_path, check=check).details()

    assert run(LEVEL) == []
    assert run(LEVEL) == []
    changed = LEVEL.replace("4.5", "9").replace("connector = false", "").replace("ü", "u")
    (first, *_, values, drawn) = run(changed, check=True)
    before, after = 4.5 / 27648, 9 / 27648
    say(
        [first, values, drawn],
        f"slave 2 | EL1018 | channel1Input | scale | {before} -> {after}",
        'slave 2 | EL1018 | channel3Input | -1 a "b" | 16 ü -> 16 u',
        "slave 2 | EL1018 | channel3Input | variable -> connector",
    )
    assert run(changed)
    assert run(changed) == []
    (unit,) = (line for line in run("") if "channel1Input: unit" in line)
    say([unit], "slave 2 | EL1018 | m -> nothing")


def test_a_library_carries_what_its_values_mean(tmp_path: Path) -> None:
    bus = troll_with(tmp_path / "profiles", LEVEL)
    generate(bus, "Plant", tmp_path)
    carried = bus_file.load(tmp_path / "Plant" / "Resources" / "bus.json")
    assert carried == essence(bus)
    assert not generate(carried, "Plant", tmp_path, check=True).is_change


@pytest.mark.parametrize("lost", ["Plant/.ecatgen.json", "EtherCAT"])
def test_nothing_is_said_of_runs_that_are_not_known(tmp_path: Path, lost: str) -> None:
    generate(sample_buses.troll(), "Plant", tmp_path)
    path = tmp_path / lost
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
    report = generate(sample_buses.troll(), "Plant", tmp_path, check=True)
    assert report.is_change
    assert report.details() == []
