"""The diagnosis history of a slave: messages in words."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecatd.base.errors import StateError
from ecatd.etg.datatypes import DataType
from ecatd.etg.diagnosis import FIRST, Kind, order, parse_message
from ecatd.etg.error_codes import emergency_text, error_class


def message(
    code: int, flags: int, text_id: int = 0, time_ns: int = 0, parameters: bytes = b""
) -> bytes:
    return struct.pack("<IHHQ", code, flags, text_id, time_ns) + parameters


def test_a_message_has_its_text_from_the_esi_file() -> None:
    parameters = struct.pack("<HI", DataType.UNSIGNED32, 240) + struct.pack("<H3s", 0x2003, b"abc")
    found = parse_message(message(0x0001E000, 0x0202, 7, 5, parameters))
    assert found is not None
    assert (found.kind_name, found.time_ns, found.local_time) == ("error", 5, False)
    assert found.parameters == [240, "abc"]
    texts = {7: "%x V at 100 %% on %s"}
    assert found.text(texts) == "F0 V at 100 % on abc"
    assert found.text({7: "no places"}) == "no places (240, abc)"
    assert found.text({7: "%d %s %d"}) == "240 abc %d"
    assert "0x0007" in found.text({})


def test_codes_without_text() -> None:
    for code, flags, kind, word in (
        (0x7305E800, 0x0012, "error", "error code 0x7305 (additional modules)"),
        (0x1234E001, 0x0001, "warning", "0x1234 of the manufacturer"),
        (0x0000F000, 0x0000, "info", "0x0000F000"),
        (0x0000F000, 0x000F, "kind 15", "0x0000F000"),
    ):
        found = parse_message(message(code, flags))
        assert found is not None
        assert found.kind_name == kind
        assert word in found.text({})
    assert Kind.ERROR == 2


def test_error_codes_have_their_class() -> None:
    for code, words in (
        (0x0000, "error reset"),
        (0x0123, "unknown class"),
        (0x1000, "generic error"),
        (0x2310, "current, output side"),
        (0x3210, "voltage inside the device"),
        (0x3401, "voltage"),  # a subclass of its own
        (0x8130, "communication"),
        (0x8611, "monitoring"),
        (0xB000, "unknown class"),
        (0xFF01, "device specific"),
    ):
        assert error_class(code) == words
    assert emergency_text(0x3210, 4) == (
        "error code 0x3210 (voltage inside the device), error register 0x04"
    )


def test_empty_places_and_damage() -> None:
    assert parse_message(b"") is None
    assert parse_message(bytes(28)) is None
    for data in (
        b"\1\2\3",
        message(1, 0x0100),
        message(1, 0x0100, parameters=b"\7"),
        message(1, 0x0100, parameters=struct.pack("<HB", DataType.UNSIGNED32, 1)),
    ):
        with pytest.raises(StateError):
            parse_message(data)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_message_or_an_error(data: bytes) -> None:
    try:
        found = parse_message(data)
    except StateError:
        return
    if found is not None:
        assert found.text({found.text_id: "%s %d"})


def test_the_oldest_message_comes_first() -> None:
    assert order(0, 4) == [6, 7, 8, 9]
    assert order(9, 4) == [6, 7, 8, 9]
    assert order(7, 4) == [8, 9, 6, 7]
    assert order(FIRST, 1) == [6]
