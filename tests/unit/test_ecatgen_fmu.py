"""From the bus description to the variables of an FMU: types, limits, units, the table."""

import math
import struct
from dataclasses import replace

import pytest

from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen.build import build_library
from ecatgen.fmu.build import build_fmu
from ecatgen.fmu.ir import Fmu, Variable
from ecatgen.fmu.render import render
from ecatgen.fmu.units import units


def make(bus: Bus, fmi: int) -> Fmu:
    return build_fmu(
        bus, build_library(give_meanings(bus, load_profiles()), "Plant"), fmi, ["plant.c"]
    )


def variable(entry: Entry, fmi: int, *, output: bool = True) -> Variable:
    """The variable for the only entry of a bus; `output`: of the bus, so an input of the FMU."""
    pdo = Pdo(0x1600, "", 2, [entry])
    slave = Slave(0, "Thing", 1, 2, 3, outputs=[pdo] * output, inputs=[pdo] * (not output))
    (found,) = (v for v in make(Bus("b", 1000, [slave]), fmi).variables if v.name == "thing.x")
    return found


def entry(data_type: int, bits: int, **more: float | str | None) -> Entry:
    return replace(Entry(0x7000, 1, "X", data_type, bits), **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("data_type", "bits", "fmi2", "fmi3"),
    [
        (DataType.BOOLEAN, 1, "Boolean", "Boolean"),
        (DataType.BOOLEAN, 8, "Boolean", "Boolean"),
        (DataType.UNSIGNED8, 1, "Boolean", "Boolean"),
        (DataType.UNSIGNED8, 8, "Integer", "UInt8"),
        (DataType.INTEGER8, 8, "Integer", "Int8"),
        (DataType.UNSIGNED16, 12, "Integer", "UInt16"),
        (DataType.INTEGER16, 16, "Integer", "Int16"),
        (DataType.UNSIGNED24, 24, "Integer", "UInt32"),
        (DataType.INTEGER32, 32, "Integer", "Int32"),
        (DataType.UNSIGNED32, 31, "Integer", "UInt32"),
        (DataType.UNSIGNED32, 32, "Real", "UInt32"),
        (DataType.INTEGER40, 40, "Real", "Int64"),
        (DataType.UNSIGNED64, 64, "Real", "UInt64"),
        (DataType.REAL32, 32, "Real", "Float64"),
        (DataType.REAL64, 64, "Real", "Float64"),
    ],
)
def test_types(data_type: int, bits: int, fmi2: str, fmi3: str) -> None:
    for output in (False, True):
        assert variable(entry(data_type, bits), 2, output=output).element == fmi2
        assert variable(entry(data_type, bits), 3, output=output).element == fmi3


def limits(found: Variable) -> tuple[str | None, str | None]:
    attributes = dict(found.type_attributes)
    return attributes.get("min"), attributes.get("max")


def test_limits_are_what_the_entry_can_hold() -> None:
    assert limits(variable(entry(DataType.INTEGER16, 16), 2)) == ("-32768", "32767")
    assert limits(variable(entry(DataType.INTEGER16, 16), 3)) == (None, None)  # as the type
    assert limits(variable(entry(DataType.UNSIGNED16, 12), 3)) == ("0", "4095")
    assert limits(variable(entry(DataType.REAL64, 64), 2)) == (None, None)


def test_limits_of_the_configuration() -> None:
    limited = entry(DataType.INTEGER16, 16, scale=0.1, unit="V", minimum=-5.0, maximum=7.5)
    for fmi in (2, 3):
        found = variable(limited, fmi)
        assert found.unit == "V"
        assert list(map(float, filter(None, limits(found)))) == pytest.approx([-5, 7.5])


def test_the_start_value_is_within_the_limits() -> None:
    limited = entry(DataType.REAL32, 32, minimum=2.5, maximum=4.0)
    attributes = dict(variable(limited, 2).type_attributes)
    assert float(attributes["start"]) == 2.5
    assert "start" not in dict(variable(limited, 2, output=False).type_attributes)


def test_the_largest_integers_are_not_rounded_up() -> None:
    """2^63 - 1 is no floating-point number; the next one above would be out of range."""
    found = variable(entry(DataType.INTEGER64, 64), 2)
    assert float(str(limits(found)[1])) < 2**63


def test_a_row_of_the_table_says_what_a_value_means() -> None:
    limited = entry(DataType.INTEGER16, 16, scale=0.1, offset=-1.0, unit="m/s", maximum=7.5)
    *_, scale, offset, minimum, maximum, unit = variable(limited, 2).row.split()
    numbers = [
        struct.unpack(">d", bytes.fromhex(word))[0] for word in (scale, offset, minimum, maximum)
    ]
    assert (numbers, unit) == ([0.1, -1.0, -math.inf, 85], "m/s")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_limit_that_no_number_can_be_is_left_out(fmi: int) -> None:
    """XML has no infinity."""
    found = variable(entry(DataType.INTEGER32, 32, scale=1e300, unit="Pa"), fmi)
    assert limits(found) == (None, None)


@pytest.mark.parametrize("fmi", [2, 3])
def test_names_are_unique_and_references_are_places(fmi: int) -> None:
    slaves = [
        Slave(0, "Cycle", 1, 2, 3),
        Slave(1, "bus", 1, 2, 3),
        Slave(2, "valid", 1, 2, 3, inputs=[Pdo(0x1A00, "", 3, [entry(6, 16)])]),
    ]
    slaves[2].inputs[0].entries += [replace(entry(6, 16), index=0x7001, name="Al State")]
    variables = make(Bus("b", 1000, slaves), fmi).variables
    names = [item.name for item in variables]
    assert len({name.casefold() for name in names}) == len(names)
    assert {"cycleSlave.valid", "busSlave.alState", "bus", "cycle"} <= set(names)
    assert [item.reference for item in variables] == list(range(len(names)))


def test_the_table_has_a_line_for_each() -> None:
    fmu = make(sample_buses.awkward(), 3)
    lines = render(fmu)["resources/plant.txt"].decode().split("\n")
    assert lines.pop() == ""
    rows = (fmu.slaves, fmu.messages, fmu.drives, fmu.variables)
    assert len(lines) == 9 + sum(map(len, rows))
    assert f"slaves {len(fmu.slaves)}" in lines
    assert all(len(line.split(" ", 1)) == 2 for line in lines)


@pytest.mark.parametrize(
    ("name", "base"),
    [
        ("V", {"kg": "1", "m": "2", "s": "-3", "A": "-1"}),
        ("mA", {"A": "1", "factor": "0.001"}),
        ("rad/s2", {"s": "-2", "rad": "1"}),
        ("N.m", {"kg": "1", "m": "2", "s": "-2"}),
        ("degC", {"K": "1", "offset": "273.15"}),
        ("1", {}),
        ("furlong", {}),
        ("inc/s", {}),
        ("m/(s.kg)", {"kg": "-1", "m": "1", "s": "-1"}),
        ("1/s", {"s": "-1"}),
    ],
)
def test_units(name: str, base: dict[str, str]) -> None:
    (found,) = units([name, "", name])
    assert (found.name, dict(found.base)) == (name, base)
