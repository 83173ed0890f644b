"""What is known of an object without asking its slave."""

from __future__ import annotations

import pytest

from ecatd.description.bus import Slave
from ecatd.description.object_types import ObjectType, ObjectTypes
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

SPEED = Entry(0x606C, 0, "Speed", DataType.INTEGER32, 32, unit="rad/s", scale=0.5, offset=1.0)
NAMED_ONLY = Entry(0x6064, 0, "Where it is", 0, 32)
STATUSWORD = Entry(0x6041, 0, "Statusword", DataType.UNSIGNED16, 16)


def slave(*entries: Entry) -> ObjectTypes:
    inputs = [Pdo(0x1A00, "Inputs", 3, list(entries))]
    return ObjectTypes(Slave(0, "Drive", 1, 2, 3, coe=True, inputs=inputs))


def test_process_data_come_before_standards() -> None:
    drive = slave(STATUSWORD, SPEED, NAMED_ONLY)
    assert drive.find(0x606C, 0) == ("Speed", DataType.INTEGER32, "rad/s", 0.5, 1.0)
    assert drive.find(0x6064, 0)[:2] == ("Where it is", DataType.INTEGER32)
    assert drive.find(0x1018, 1)[:2] == ("Vendor ID", DataType.UNSIGNED32)
    assert drive.find(0x6060, 0)[:2] == ("Modes of operation", DataType.INTEGER8)
    assert drive.find(0x2000, 7) == ObjectType()


def test_objects_of_drives_mean_something_else_in_other_slaves() -> None:
    assert slave(SPEED).find(0x6060, 0) == ObjectType()


@pytest.mark.parametrize(
    ("known", "size", "wanted"),
    [
        (0, 1, DataType.UNSIGNED8),
        (0, 4, DataType.UNSIGNED32),
        (0, 3, DataType.OCTET_STRING),
        (DataType.INTEGER16, 2, DataType.INTEGER16),
        (DataType.INTEGER16, 4, DataType.UNSIGNED32),
        (DataType.BOOLEAN, 1, DataType.BOOLEAN),
        (DataType.VISIBLE_STRING, 3, DataType.VISIBLE_STRING),
    ],
)
def test_a_type_fits_its_data(known: int, size: int, wanted: DataType) -> None:
    assert ObjectType("x", known).of(bytes(size)) == ObjectType("x", wanted)


def test_replies_say_what_is_known() -> None:
    assert ObjectType("x", 7).to_map() == {"name": "x", "data_type": 7}
    assert ObjectType("x", 7, "V", 0.1).to_map() == {
        "name": "x",
        "data_type": 7,
        "unit": "V",
        "scale": 0.1,
        "offset": 0.0,
    }
