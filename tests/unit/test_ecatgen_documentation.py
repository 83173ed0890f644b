"""The documentation of generated blocks and packages, as the browser of a tool shows it."""

import re

import pytest

from conftest import names
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen.build import build_library
from ecatgen.render import render

Table = list[list[str]]


def pages(bus: Bus) -> dict[str, str]:
    files = render(build_library(give_meanings(bus, load_profiles()), "Plant"))
    return {path: data.decode() for path, data in files.items() if path.endswith(".mo")}


@pytest.fixture(scope="module")
def troll() -> dict[str, str]:
    return pages(sample_buses.troll())


OUTPUTS, INPUTS = "Outputs: what the model writes", "Inputs: what the model reads"
VARIABLES = "Inputs without connector: variables of the block"
HEAD = ["name", "type", "unit", "access", "object", "PDO", "entry", "data type", "bits"]


def rows(source: str, heading: str) -> Table:
    """The rows of the table below a heading."""
    part = source.partition(f"<h4>{heading}</h4>")[2].partition("</table>")[0]
    cells = [re.findall(r"<t[dh]>(.*?)</t[dh]>", row) for row in re.findall(r"<tr>.*", part)]
    return [[re.sub(r"<.*?>", "", cell) for cell in row] for row in cells]


def test_every_entry_is_in_a_table(troll: dict[str, str]) -> None:
    values, variables = rows(troll["EL3008.mo"], INPUTS), rows(troll["EL3008.mo"], VARIABLES)
    assert values[0] == variables[0] == [*HEAD, "conversion"]
    assert values[1] == [
        *("aiStandardChannel1Value", "Real", "V", "read", "0x6000:11", "AI Standard Channel 1"),
        *("Value", "INTEGER16", "16", "raw * 0.000305185"),
    ]
    assert (len(values), len(variables)) == (1 + 8, 1 + 56)
    assert variables[1][:5] == [
        *("aiStandardChannel1StatusUnderrange", "Boolean", "", "read", "0x6000:01")
    ]
    assert rows(troll["EL3008.mo"], OUTPUTS) == []
    written = rows(troll["GoldGCONDrive.mo"], OUTPUTS)
    assert {row[3] for row in written[1:]} == {"write"}


def test_numbers_with_names_have_a_table(troll: dict[str, str]) -> None:
    table = rows(troll["GoldGCONDrive.mo"], "<code>modeOfOperation</code>")
    assert table[0] == ["value", "meaning"]
    assert ["9", "cyclic synchronous velocity"] in table


def test_the_sources_of_units_are_named(troll: dict[str, str]) -> None:
    assert "IEC 61800-7-201" in troll["GoldGCONDrive.mo"]
    assert "EL30xx documentation" in troll["EL3008.mo"]
    assert "device profiles" not in troll["EL1018.mo"]


def test_what_the_block_leaves_out_is_said() -> None:
    entry = Entry(0x6000, 1, "a < b", DataType.OCTET_STRING, 128)
    slave = Slave(0, "S1", 1, 2, 3, inputs=[Pdo(0x1A00, "", 3, [entry])])
    source = pages(Bus("b", 1000, [slave]))["S1.mo"]
    assert "<li>0x6000:01 a &lt; b (OCTET_STRING, 128 bits): more than 64 bits</li>" in source
    names(source, "no process data")


def test_the_package_lists_all_blocks(troll: dict[str, str]) -> None:
    source = troll["package.mo"]
    listed = re.findall(r'modelica://Plant\.(\w+)\\">\1<', source)
    names = [path.removesuffix(".mo") for path in troll if "/" not in path]
    assert {*listed, "package", "UsersGuide"} == set(names)
    assert re.search(r'revisionId = "bus [0-9a-f]{16}"', source)
    assert 'uses(Modelica(version = "4.0.0"), EtherCAT(version = ' in source
