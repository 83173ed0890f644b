"""Values of CoE types, to and from SDO data."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import naming
from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import (
    DataType,
    bit_length,
    decode,
    encode,
    encode_int,
    is_real,
    parse_type,
    type_name,
    value_range,
)

INTEGERS = [t for t in DataType if bit_length(t) and not is_real(t)]


@given(st.sampled_from(INTEGERS), st.data())
def test_integers_survive(data_type: DataType, data: st.DataObject) -> None:
    low, high = value_range(data_type, bit_length(data_type))
    value = data.draw(st.integers(low, high))
    assert decode(data_type, encode(data_type, str(value))) == value


@given(st.sampled_from(INTEGERS))
def test_one_beyond_the_range_is_refused(data_type: DataType) -> None:
    low, high = value_range(data_type, bit_length(data_type))
    for value in (low - 1, high + 1):
        with pytest.raises(UsageError, match=naming(low, high, value)):
            encode_int(data_type, value)


def test_spellings_of_values() -> None:
    assert encode(DataType.UNSIGNED16, "0x10") == b"\x10\x00"
    assert encode(DataType.INTEGER8, "-1") == b"\xff"
    assert encode(DataType.BOOLEAN, "true") == b"\x01"
    assert encode(DataType.REAL32, "1.5") == b"\x00\x00\xc0\x3f"
    assert encode(DataType.OCTET_STRING, "01 ff") == b"\x01\xff"
    assert encode(DataType.VISIBLE_STRING, "x") == b"x"
    assert decode(DataType.VISIBLE_STRING, b"abc\0\0") == "abc"
    assert decode(0x0800, b"\x01\x02") == "01 02"


@pytest.mark.parametrize(
    ("data_type", "text"),
    [
        (DataType.INTEGER8, "x"),
        (DataType.REAL32, "x"),
        (DataType.REAL32, "1e99"),
        (DataType.OCTET_STRING, "0g"),
        (DataType.INTEGER16, "1.5"),
        (DataType.BOOLEAN, "yes"),
    ],
)
def test_nonsense_is_refused(data_type: DataType, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        encode(data_type, text)


def test_data_of_the_wrong_size_is_refused() -> None:
    with pytest.raises(UsageError, match=naming("1 bytes", "UNSIGNED16", 2)):
        decode(DataType.UNSIGNED16, b"\x01")


def test_spellings_of_types() -> None:
    assert parse_type("int16") == parse_type("INT") == parse_type("Integer16") == 0x0003
    assert type_name(0x0003) == "INTEGER16"
    assert type_name(0x0800) == "0x0800"
    with pytest.raises(UsageError, match=naming("'word3'", "data type")):
        parse_type("word3")
