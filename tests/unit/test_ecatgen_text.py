"""Texts of others inside Modelica, HTML and C: they come out as they were, and break nothing."""

import re
from html import unescape

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecatgen.text import c_comment, c_string, modelica_html, modelica_integer, modelica_string


def plain(text: str) -> bool:
    return text.isprintable() and text == text.strip()


@given(st.text())
def test_r39_modelica_strings_end_where_they_should(text: str) -> None:
    literal = modelica_string(text)
    assert re.fullmatch(r'"(?:[^"\\]|\\["\\])*"', literal)
    assert not re.search(r"[\x00-\x1f]", literal)
    literal.encode()
    if plain(text):
        assert re.sub(r"\\(.)", r"\1", literal[1:-1]).rstrip() == text


@given(st.text())
def test_r39_html_has_no_elements_and_no_quotes(text: str) -> None:
    body = modelica_html(text)
    assert not re.search(r'[<>"]', body)
    if plain(text):
        assert unescape(re.sub(r"\\(.)", r"\1", body)) == text


@given(st.text())
def test_c_strings_are_ascii(text: str) -> None:
    literal = c_string(text)
    assert re.fullmatch(r'"(?:[ -~]|\\[0-7]{3})*"', literal)
    assert "??" not in literal
    assert not re.search(r'(?<!\\)["]', literal[1:-1].replace("\\042", ""))


@given(st.text())
def test_r39_c_comments_stay_open(text: str) -> None:
    comment = c_comment(text)
    assert comment.isprintable(), "no letters that change the direction of the text"
    assert "*/" not in comment
    assert "/*" not in comment
    assert "\n" not in comment


@pytest.mark.parametrize(
    ("number", "literal"),
    [
        (0, "0"),
        (0x7FFFFFFF, "2147483647"),
        (0x80000000, "-2147483647 - 1"),
        (0x80000001, "-2147483647"),
        (0xFFFFFFFF, "-1"),
    ],
)
def test_unsigned_numbers_as_modelica_integers(number: int, literal: str) -> None:
    assert modelica_integer(number) == literal
