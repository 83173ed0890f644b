"""Buses of all kinds give Modelica that tools take."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymoca.parser import parse

import ecatgen
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatdev.checks import check_structure
from ecatdev.drawing.checks import check_diagram, check_icon
from ecatdev.drawing.pictures import found_with, models
from ecatdev.drawing.scene import diagram, icon
from ecatdev.files import write_files
from ecatgen import generate
from ecatgen.build import build_library
from ecatgen.render import render

pytestmark = pytest.mark.long

TOOLS = Path(sample_buses.__file__).parents[1]

LIBRARY = "Plant"
PROFILES = load_profiles()
I16, I32, REAL = DataType.INTEGER16, DataType.INTEGER32, DataType.REAL32
U8, U16 = DataType.UNSIGNED8, DataType.UNSIGNED16


def outputs(*entries: Entry, mapping: int = 0x1600) -> list[Pdo]:
    return [Pdo(mapping, "", 2, list(entries))]


def inputs(*entries: Entry) -> list[Pdo]:
    return [Pdo(0x1A00, "", 3, list(entries))]


def unnamed(position: int) -> Slave:
    made = [Entry(0x6000, n, "", U8, 8) for n in range(1, 5)]
    return Slave(position, "", 1, 2 + position // 2, 3, inputs=inputs(*made))


def hundreds() -> Slave:
    def channels(index: int, kind: int, bits: int) -> list[Entry]:
        return [Entry(index + n // 8, n % 8 + 1, f"Channel {n}", kind, bits) for n in range(240)]

    return Slave(
        0,
        "IO 240",
        1,
        2,
        3,
        outputs=outputs(*channels(0x7000, I16, 16)),
        inputs=inputs(*channels(0x6000, DataType.BOOLEAN, 1)),
    )


def wide() -> Slave:
    types = (DataType.UNSIGNED64, DataType.INTEGER64, DataType.REAL64)
    made = [Entry(0x7000, n, f"value {n}", kind, 64) for n, kind in enumerate(types, 1)]
    more = [replace(entry, index=0x6000) for entry in made]
    more += [Entry(0x6000, 9, "48 bits", DataType.UNSIGNED48, 48)]
    more += [Entry(0x6000, 10, "text", DataType.VISIBLE_STRING, 128)]
    return Slave(0, "Wide", 1, 2, 3, outputs=outputs(*made), inputs=inputs(*more))


def units() -> Slave:
    """Units that Modelica knows, others, and none that it could write."""
    made = [
        Entry(0x7000, 1, "pressure", I16, 16, "bar", 0.01, -1.0, 0.0, 10.0),
        Entry(0x7000, 2, "temperature", REAL, 32, "°C"),
        Entry(0x7000, 3, "switch", DataType.BOOLEAN, 1, "V", 24.0),
        Entry(0x7000, 4, "angle", I16, 16, "°", -1e-7, 1e22),
        Entry(0x7000, 5, "speed", I32, 32, "rpm", 1 / 60),
        Entry(0x7000, 6, "position", I32, 32, "increments"),
        Entry(0x7000, 7, "torque", I16, 16, "Nm", 0.1),
        Entry(0x7000, 8, "load", I16, 16, "%", 0.1),
        Entry(0x7000, 9, "quoted", I16, 16, 'a"b\\c', 0.1),
    ]
    more = [replace(entry, index=0x6000, minimum=None, maximum=None) for entry in made]
    return Slave(0, "Units", 1, 2, 3, outputs=outputs(*made), inputs=inputs(*more))


def mapped_twice() -> Slave:
    entry = Entry(0x7000, 1, "x", U8, 8)
    return Slave(
        0,
        "D",
        1,
        2,
        3,
        outputs=outputs(entry) + outputs(entry, mapping=0x1601),
        inputs=inputs(entry, entry),
    )


def drives() -> Iterator[Slave]:
    """Drives with what one of the modes needs, or less, or more, or not raw."""
    control, status = Entry(0x6040, 0, "Control", U16, 16), Entry(0x6041, 0, "Status", U16, 16)
    velocity, speed = Entry(0x60FF, 0, "Target", I32, 32), Entry(0x606C, 0, "Speed", I32, 32)
    position, place = Entry(0x607A, 0, "Target", I32, 32), Entry(0x6064, 0, "Place", I32, 32)
    current = Entry(0x6078, 0, "Value", I16, 16)
    physical = replace(velocity, unit="rad/s", scale=1e-4)
    more = Entry(0x2000, 1, "mode", I16, 16), Entry(0x2000, 2, "limit", I16, 16, "V", 0.1)
    kinds: list[tuple[list[Entry], list[Entry]]] = [
        ([control], [status]),
        ([control, velocity], [status, speed]),
        ([control, position, velocity], [status, place]),
        ([control, Entry(0x6071, 0, "", I16, 16)], [status, current]),
        ([control, physical], [status, speed]),
        ([control, velocity, *more, replace(control, index=0x6840)], [status, speed]),
        ([velocity, *more], [status, replace(speed, bit_length=64, data_type=DataType.INTEGER64)]),
    ]
    for n, (written, read) in enumerate(kinds):
        mapped = {"outputs": outputs(*written), "inputs": inputs(*read)}
        yield Slave(n, "Axis", 1, 2, 3, coe=True, **mapped)


NAMES = (
    *("Привод", "日本語", "Ångström", "é" * 60, "🚀 rocket", "a\u0300", "ﬁ", "²³", "CON", "COM1"),
    *("Package", "Resources", "Drives", "Examples", "EtherCATMaster", "valid", "end", "der"),
    *("EL1018", "EL1018_2", "el1018", "El_1018", "EL1018 2", "Zero Real", "Zero Real"),
)

BUSES = {
    "unnamed": [unnamed(n) for n in range(4)],
    "hundreds": [hundreds()],
    "wide": [wide()],
    "units": [units()],
    "twice": [mapped_twice()],
    "empty": [Slave(n, f"EK1{n}00", 2, 2 + n, 3) for n in range(3)],
    "outputs only": [
        Slave(n, "EL2008", 2, 3, 4, outputs=outputs(Entry(0x7000, 1, "Output", 1, 1)))
        for n in range(3)
    ],
    "names": [
        Slave(
            n,
            name,
            1,
            2,
            3,
            inputs=inputs(Entry(0x6000, 1, name, U8, 8), Entry(0x6000, 2, f"{name} 2", U8, 8)),
        )
        for n, name in enumerate(NAMES)
    ],
    "drives": list(drives()),
    "no slaves": [],
    "troll": sample_buses.troll().slaves,
}


def files(bus: Bus) -> dict[str, bytes]:
    return render(build_library(give_meanings(bus, PROFILES), LIBRARY))


def problems(made: dict[str, bytes]) -> list[str]:
    """What the check of files says; links to the library EtherCAT are not followed."""
    with tempfile.TemporaryDirectory() as folder:
        write_files(Path(folder) / LIBRARY, made)
        found = list(check_structure(Path(folder) / LIBRARY))
    return [problem for problem in found if "modelica://EtherCAT" not in problem]


@pytest.mark.parametrize("name", BUSES)
def test_files_names_and_texts(name: str) -> None:
    assert problems(files(Bus("ecat0", 1000, BUSES[name]))) == []


@pytest.mark.parametrize("name", [name for name in BUSES if name != "hundreds"])
def test_nothing_overlaps(name: str, tmp_path: Path) -> None:
    write_files(tmp_path / LIBRARY, files(Bus("ecat0", 1000, BUSES[name])))
    found = found_with(tmp_path)
    drawn = list(models(found, LIBRARY))
    assert drawn
    for model in drawn:
        assert list(check_diagram(diagram(found, model))) == []
        assert list(check_icon(icon(found, model))) == []


WITH_OUTPUTS = [
    name for name, slaves in BUSES.items() if any(pdo.entries for s in slaves for pdo in s.outputs)
]


@pytest.mark.parametrize("name", WITH_OUTPUTS)
def test_a_constant_of_an_example_has_one_unit(name: str) -> None:
    library = build_library(give_meanings(Bus("ecat0", 1000, BUSES[name]), PROFILES), LIBRARY)
    unit = {f"{b.instance}.{c.name}": c.unit for b in library.blocks for c in b.writes}
    all_fed = [
        {(c.source, unit[c.target]) for c in example.connections if c.target in unit}
        for example in library.examples
    ]
    assert any(all_fed)
    for fed in all_fed:
        assert len(fed) == len({source for source, _ in fed})


def test_no_connector_is_called_like_something_of_the_base_class() -> None:
    made: set[str] = set()
    for base in ("PartialSampled", "PartialSlave"):
        file = Path(ecatgen.__file__).parent / f"modelica/EtherCAT/Interfaces/{base}.mo"
        library = parse(file.read_text()).classes["EtherCAT"]
        made |= library.classes["Interfaces"].classes[base].symbols.keys()
    assert {"domainID", "sampled", "valid", "etherCATMaster"} <= made
    entries = [Entry(0x6000 + n, 1, name, U8, 8) for n, name in enumerate(sorted(made))]
    slave = Slave(0, "S", 1, 2, 3, inputs=inputs(*entries))
    (block,) = build_library(give_meanings(Bus("b", 1000, [slave]), PROFILES), LIBRARY).blocks
    assert len(block.reads) == len(made)
    assert not {connector.name for connector in block.reads} & made


TEXTS = st.text(max_size=70) | st.sampled_from([*NAMES, "", "Input", "Value"])
ENTRIES = st.builds(
    Entry,
    index=st.integers(1, 0xFFFF) | st.sampled_from([0x6000, 0x6040, 0x6041, 0x606C, 0x60FF]),
    subindex=st.integers(0, 3),
    name=TEXTS,
    data_type=st.sampled_from([*DataType]),
    bit_length=st.sampled_from([1, 2, 8, 16, 31, 32, 33, 64, 65, 255]),
    unit=st.sampled_from(["", "V", "A", "°C", "1/min", "nonsense"]) | st.text(max_size=5),
    scale=st.sampled_from([1.0, 0.1, -3e-9]),
    offset=st.floats(allow_nan=False, allow_infinity=False, width=32),
)
PDOS = st.lists(
    st.builds(Pdo, st.integers(0, 0xFFFF), TEXTS, st.just(2), st.lists(ENTRIES, max_size=5)),
    max_size=2,
)
CODES = st.integers(0, 0xFFFFFFFF)
SLAVES = st.builds(
    Slave, st.just(0), TEXTS, CODES, CODES, CODES, outputs=PDOS, inputs=PDOS, coe=st.booleans()
)


@settings(max_examples=60, deadline=None)
@given(st.lists(SLAVES, max_size=4), TEXTS, st.integers(1, 1_000_000))
def test_any_bus_gives_sound_files_and_always_the_same(
    slaves: list[Slave], name: str, cycle: int
) -> None:
    for position, slave in enumerate(slaves):
        slave.position = position
    bus = Bus(name, cycle, slaves)
    made = files(bus)
    assert problems(made) == []
    assert files(deepcopy(bus)) == made
    assert len({path.casefold() for path in made}) == len(made)


def test_the_bytes_do_not_depend_on_the_process() -> None:
    program = (
        "import hashlib\n"
        "from ecatgen.build import build_library\n"
        "from ecatdev import sample_buses\n"
        "from ecatgen.render import render\n"
        "files = render(build_library(sample_buses.awkward(), 'Plant'))\n"
        "print(hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest())\n"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(TOOLS)},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(digests) == 1


def classes(library: Path) -> Iterator[str]:
    for file in sorted(library.rglob("*.mo")):
        head = re.match(r"within ?([\w.]*);\n(?:block|model) (\w+)", file.read_text("utf-8"))
        if head:
            yield ".".join(head.groups())


# What a class with an outer component is told when it is checked alone, as in the standard library.
_ALONE = re.compile(r"top-level outer element|An inner declaration for outer|Notification: ")


@pytest.mark.skipif(shutil.which("omc") is None, reason="omc (OpenModelica) is not on PATH")
@pytest.mark.parametrize("name", BUSES)
def test_openmodelica_checks_every_class_without_a_warning(name: str, tmp_path: Path) -> None:
    generate(Bus("ecat0", 1000, BUSES[name]), LIBRARY, tmp_path)
    names = list(classes(tmp_path / LIBRARY))
    assert f"{LIBRARY}.Examples.AllSlaves" in names
    script = tmp_path / "check.mos"
    load = [f'loadFile("{tmp_path}/{package}/package.mo");' for package in ("EtherCAT", LIBRARY)]
    checks = [
        f'print(checkModel({path}) + "\\n"); print(getErrorString() + "\\n");' for path in names
    ]
    script.write_text("\n".join(['loadModel(Modelica, {"4.0.0"});', *load, *checks]))
    done = subprocess.run(
        ["omc", str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    said = done.stdout + done.stderr
    for path in names:
        assert f"Check of {path} completed successfully" in said, said
    ours = [
        line
        for line in said.splitlines()
        if re.search(r"Warning|Error", line) and not _ALONE.search(line)
    ]
    assert ours == []
