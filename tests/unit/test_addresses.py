"""One notation of addresses: with a colon hexadecimal, alone with 0x or decimal, never guessed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.base.addresses import address_text, parse_address, parse_number
from ecatd.base.errors import UsageError
from ecatd.cli.addresses import find_object, object_
from ecatd.operations.query import from_query


@pytest.mark.parametrize("text", ["6000:11", "0x6000:11", "0X6000:0x11"])
def test_with_a_colon_both_parts_are_hexadecimal(text: str) -> None:
    assert parse_address(text) == (0x6000, 17) == object_(text)


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF))
def test_what_is_printed_is_read(index: int, subindex: int) -> None:
    shown = address_text(index, subindex)
    assert parse_address(shown) == (index, subindex) == parse_address(shown.removeprefix("0x"))


@pytest.mark.parametrize(
    "text", ["", "6000", "6000:", ":11", "6000:111", "60000:1", "6000:1g", "-1:0"]
)
def test_other_texts_are_no_address(text: str) -> None:
    assert parse_address(text) is None


@pytest.mark.parametrize(
    ("text", "what", "most", "value"),
    [
        ("0x6060", "index", 0xFFFF, 0x6060),
        ("24672", "index", 0xFFFF, 0x6060),  # 0x24672 would be none
        ("9", "subindex", 0xFF, 9),
        ("255", "subindex", 0xFF, 255),
        ("0x12", "subindex", 0xFF, 18),
    ],
)
def test_a_number_with_one_reading_is_taken(text: str, what: str, most: int, value: int) -> None:
    assert parse_number(text, what, most) == value


@pytest.mark.parametrize(
    ("text", "what", "most", "facts"),
    [
        ("6060", "index", 0xFFFF, ("index 6060", "0x6060", "0x17AC")),
        ("130", "register", 0xFFFF, ("register 130", "0x0130", "0x0082")),
        ("11", "subindex", 0xFF, ("subindex 11", "0x11", "0x0B")),
        ("0130", "register", 0xFFFF, ("0x0130", "0x0082")),
        ("1C12", "index", 0xFFFF, ("'1C12'", "0x1C12")),
        ("0x10000", "index", 0xFFFF, ("0x10000", "0xFFFF")),
        ("65536", "index", 0xFFFF, ("65536", "65535")),
        ("256", "subindex", 0xFF, ("256", "255")),
        ("-1", "index", 0xFFFF, ("'-1'", "index")),
        ("1_0", "index", 0xFFFF, ("'1_0'", "index")),
        ("0b1", "index", 0xFFFF, ("'0b1'", "index")),
    ],
)
def test_other_numbers_are_refused(text: str, what: str, most: int, facts: tuple[str, ...]) -> None:
    with pytest.raises(UsageError) as refused:
        parse_number(text, what, most)
    names(str(refused.value), *facts)


@given(st.integers(0, 0xFFFF))
def test_no_number_is_guessed(number: int) -> None:
    text = str(number)
    try:
        assert parse_number(text, "index", 0xFFFF) == number
    except UsageError:
        assert int(text, 16) != number
    else:
        assert int(text, 16) in range(number, number + 1) or int(text, 16) > 0xFFFF


def test_a_key_over_zenoh_has_the_same_notation() -> None:
    assert from_query(["ro", "sdo", "0", "0x6060", "0"], "", {}).index == 0x6060  # type: ignore[attr-defined]
    with pytest.raises(UsageError) as refused:
        from_query(["ro", "sdo", "0", "6060", "0"], "", {})
    names(str(refused.value), "0x6060", "0x17AC")


def test_one_subindex_is_enough() -> None:
    with pytest.raises(UsageError) as refused:
        find_object(None, 0, (0x6000, 17), 3)  # type: ignore[arg-type]  # nobody is asked
    names(str(refused.value), "0x6000:11")
