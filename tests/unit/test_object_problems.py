"""Start-up parameters and mapped entries against the objects of a slave."""

import tomllib

import pytest

from conftest import names
from ecatd.config import SlaveConfig, read_config
from ecatd.config.resolve.objects import object_indices, object_problems
from ecatd.etg.datatypes import DataType
from ecatd.etg.dictionary import Access, DictionaryEntry, DictionaryObject, ObjectCode

LIMIT = DictionaryEntry(
    "Limit", DataType.INTEGER16, 16, Access.RW | Access.RX_PDO, 0, None, b"\xf6\xff", b"\x64\0"
)
UNLIMITED = DictionaryEntry(
    "Ramp", DataType.UNSIGNED32, 32, Access.READ | Access.WRITE_PREOP, 0, None, bytes(4), bytes(4)
)
NAME = DictionaryEntry("Name", DataType.VISIBLE_STRING, 64, Access.RW)
LEAST = DictionaryEntry("Least", DataType.UNSIGNED16, 16, Access.RW, 0, None, b"\1\0")
SWITCH = DictionaryEntry("Switch", DataType.BOOLEAN, 1, Access.RW)
STATUS = DictionaryEntry("Status", DataType.UNSIGNED16, 16, Access.RO | Access.TX_PDO)
OBJECTS = {
    0x2000: DictionaryObject(
        0x2000,
        "Settings",
        ObjectCode.RECORD,
        0,
        {3: LIMIT, 4: UNLIMITED, 5: NAME, 7: LEAST, 8: SWITCH},
    ),
    0x6041: DictionaryObject(0x6041, "Statusword", ObjectCode.VAR, 6, {0: STATUS}),
    0x2005: None,
}


def table(text: str) -> SlaveConfig:
    return read_config(tomllib.loads(f"[[slave]]\nposition = 0\n{text}")).slave[0]


def startup(object_: str, kind: str, value: object, more: str = "") -> str:
    text = f'[[slave.startup]]\nobject = "{object_}"\ntype = "{kind}"\nvalue = {value}\n'
    return text + more + "\n"


def pdo(index: int, object_: str, bits: int) -> str:
    entry = f'{{ object = "{object_}", bits = {bits} }}'
    return f"[[slave.pdo]]\nindex = {index}\nentries = [{entry}, {{ bits = 8 }}]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (startup("0x2000:03", "int16", 100), None),
        (startup("0x2000:03", "int16", 101), "-10 | 100 | 101 | 0x2000:03 | value"),
        (startup("0x2000:03", "int16", -11), "-10 | 100 | -11 | 0x2000:03 | value"),
        (startup("0x2000:03", "int32", 7), "INTEGER16 | 0x2000:03 | 2 | 4 | type"),
        (startup("0x2000:03", "int16", 9, 'unit = "V"'), None),
        (startup("0x2000:03", "int32", 9, 'unit = "V"'), "INTEGER16 | 2 | 4"),
        (startup("0x2000:04", "uint32", 7), None),
        (startup("0x2000:04", "uint32", 7, 'transition = "SO"'), "0x2000:04 | SO | PREOP"),
        (startup("0x2000:05", "string", '"any"'), None),
        (startup("0x2000:05", "string", '"a long text"'), "8 bytes | 0x2000:05 | 11"),
        (startup("0x2000:07", "uint16", 0), "1 to any | 0x2000:07 | 0"),
        (startup("0x2000:07", "uint16", 1), None),
        (startup("0x2000:07", "int16", -5), "-5 | 65531 | UNSIGNED16 | type"),
        (startup("0x2000:08", "uint8", 1), None),
        (startup("0x2000:08", "uint8", 2), "BOOLEAN | 0x2000:08 | 2"),
        ('[[slave.startup]]\nobject = "0x2000:03"\nhex = "01"\n', "INTEGER16 | 2 | 1 | hex"),
        (startup("0x2000:06", "int16", 7), "no entry | 0x2000:06 | object"),
        (startup("0x2005:00", "int16", 7), "no object | 0x2005:00 | object"),
        (startup("0x2005:00", "int16", 7, "optional = true"), "no object | 0x2005:00 | object"),
        (startup("0x7000:00", "int16", 7), None),
        (startup("0x6041:00", "uint16", 7), "only to read | 0x6041:00"),
        (pdo(0x1600, "0x2000:03", 16), None),
        (pdo(0x1600, "0x2000:03", 8), "16 bits | 0x2000:03 | 0x1600 | 8"),
        (pdo(0x1A00, "0x2000:03", 16), "0x2000:03 | inputs | 0x1A00"),
        (pdo(0x1600, "0x6041:00", 16), "0x6041:00 | outputs | 0x1600"),
        (pdo(0x1A00, "0x6041:00", 16), None),
        (pdo(0x1A00, "0x2005:00", 16), "no object | 0x2005:00 | 0x1A00 | entries"),
    ],
)
def test_objects(text: str, message: str | None) -> None:
    found = list(object_problems(table(text), OBJECTS))
    if message is None:
        assert not found
    else:
        ((place, problem),) = found
        assert place in table(text).startup + table(text).pdo
        names(problem, *message.split(" | "))


def test_complete_access_is_compared_by_object_only() -> None:
    text = '[[slave.startup]]\nobject = "0x2000:01"\nhex = "01 02 03"\ncomplete = true\n'
    assert not [*object_problems(table(text), OBJECTS)]
    ((_, problem),) = object_problems(table(text.replace("0x2000", "0x2005")), OBJECTS)
    names(problem, "no object", "0x2005:01")
    ((_, problem),) = object_problems(table(text.replace("0x2000:01", "0x6041:00")), OBJECTS)
    names(problem, "single value", "0x6041:00")


def test_the_objects_that_a_table_names() -> None:
    text = startup("0x2000:03", "int16", 7) + startup("0x2005:00", "int16", 7, "optional = true")
    settings = table(text + pdo(0x1600, "0x6040:00", 16))
    assert object_indices(settings) == [0x2000, 0x2005, 0x6040]
    assert object_indices(settings, optional=False) == [0x2000, 0x6040]
