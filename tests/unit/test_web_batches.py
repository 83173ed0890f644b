"""Batches of a trace for pages: what a browser reads is what was put in; no peak is lost."""

import json
import math
import struct
from array import array
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from ecatd.operations.traces import TYPES
from ecatd.web.batch import Cycles, Extremes, pack_cycles


def read(message: bytes) -> tuple[dict[str, Any], dict[str, list[list[float]]]]:
    """The header, and the arrays of each column, as `readBatch` of the page finds them."""
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    assert (4 + length) % 8 == 0

    def values(letter: str, at: int) -> list[float]:
        assert at % 8 == 0
        return [*struct.unpack_from(f"<{header['count']}{letter}", message, at)]

    found = {"": [values("d", header[name]) for name in ("cycles", "times")]}
    for column in header["columns"]:
        if "at" in column:
            found[column["name"]] = [values(TYPES[column["type"]], column["at"])]
        else:
            found[column["name"]] = [values("d", column[name]) for name in ("min", "max")]
    if "last_cycles" in header:
        found[""].append(values("d", header["last_cycles"]))
    return header, found


def cycles(begin: int, columns: dict[str, tuple[str, list[float]]], **more: Any) -> Cycles:
    count = len(next(iter(columns.values()))[1])
    return Cycles(
        array("d", range(begin, begin + count)),
        array("d", [1e12 + n for n in range(count)]),
        {name: array(TYPES[kind], values) for name, (kind, values) in columns.items()},
        {name: kind for name, (kind, _) in columns.items()},
        more.get("invalid", {}),
        more.get("lost", False),
    )


def test_each_type_arrives_exactly_and_only_the_columns_of_the_page() -> None:
    whole: dict[str, tuple[str, list[float]]] = {
        "0/0x6000:01": ("uint8", [1, 255, 3]),
        "0/0x6000:02": ("int64", [-(1 << 63), (1 << 63) - 1, (1 << 53) + 1]),
        "0/0x6000:03": ("float32", [0.5, -0.25, 3e38]),
        "0/0x6000:04": ("uint16", [7, 8, 9]),
    }
    batch = cycles(41, whole, invalid={"0/0x6000:02": [1], "0/0x6000:04": [0]}, lost=True)
    names = ["0/0x6000:02", "0/0x6000:01", "0/0x6000:03"]
    header, found = read(pack_cycles(batch, names, 7))
    assert header["kind"] == "raw"
    assert header["generation"] == 7
    assert header["lost"]
    assert [column["name"] for column in header["columns"]] == names
    assert header["invalid"] == [[0, 1]]
    assert found[""] == [[41, 42, 43], [1e12, 1e12 + 1, 1e12 + 2]]
    for name in names[:2]:
        assert found[name] == [whole[name][1]]
    assert found["0/0x6000:03"][0][:2] == [0.5, -0.25]


def test_cycles_that_a_page_has_are_left_out_with_their_marks() -> None:
    batch = cycles(10, {"a": ("int8", [1, 2, 3, 4])}, invalid={"a": [0, 2]})
    rest = batch.after(11)
    assert rest is not None
    assert [*rest.numbers] == [12, 13]
    assert [*rest.columns["a"]] == [3, 4]
    assert rest.invalid["a"] == [0]
    assert batch.after(13) is None
    assert batch.after(9) is batch


@given(
    st.lists(st.lists(st.integers(-100, 100), min_size=1, max_size=900), min_size=1, max_size=20)
)
def test_a_slow_page_gets_each_peak_at_its_place(parts: list[list[int]]) -> None:
    extremes, at = Extremes(["a"], 3), 1
    values: list[int] = []
    for part in parts:
        extremes.add(cycles(at, {"a": ("int8", [*part])}))
        values += part
        at += len(part)
    header, found = read(extremes.pack())
    first, _, last = found[""]
    assert header["kind"] == "minmax"
    assert header["count"] <= 2000
    assert first[0] == 1
    assert last[-1] == len(values)
    assert [n + 1 for n in last[:-1]] == first[1:]  # without gaps
    for begin, end, least, greatest in zip(first, last, *found["a"], strict=True):
        stretch = values[int(begin) - 1 : int(end)]
        assert (least, greatest) == (min(stretch), max(stretch))


def test_values_that_nobody_can_trust_are_no_extremes() -> None:
    extremes = Extremes(["a"], 1)
    extremes.add(cycles(1, {"a": ("float64", [1, 9, math.nan])}, invalid={"a": [1]}))
    header, found = read(extremes.pack())
    assert found["a"][0][0] == 1
    assert header["invalid"] == [[0, 1, 2]]
