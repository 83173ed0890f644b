"""Columns have the values of entries of any type, wherever they begin in the image."""

import struct
from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from ecatd.etg.datatypes import DataType
from ecatd.operations.image import DomainImage
from ecatd.trace.columns import Columns
from ecatd.trace.cycles import PADDING, Cycle, DomainState

BYTES = 56
LAYOUT: list[DomainImage] = [
    {
        "output_bytes": 0,
        "input_bytes": BYTES,
        "datagrams": [
            {
                "command": 12,
                "address": 0,
                "offset": 0,
                "length": BYTES,
                "wkc_expected": 1,
                "group": -1,
                "split": 0,
            }
        ],
    }
]
KINDS = [
    *((DataType.UNSIGNED32, bits, False, False) for bits in (1, 3, 8, 13, 32)),
    *((DataType.INTEGER32, bits, True, False) for bits in (2, 8, 17, 32)),
    *((DataType.UNSIGNED64, bits, False, False) for bits in (47, 64)),
    *((DataType.INTEGER64, bits, True, False) for bits in (33, 64)),
    (DataType.REAL32, 32, False, True),
    (DataType.REAL64, 64, False, True),
]


def expected(image: bytes, entry: Any) -> float:
    word = int.from_bytes(image, "little") >> entry.bit_offset & (1 << entry.bit_length) - 1
    if entry.real:
        form = "f" if entry.bit_length == 32 else "d"
        return float(struct.unpack(f"<{form}", word.to_bytes(entry.bit_length // 8, "little"))[0])
    if entry.signed and word >> entry.bit_length - 1:
        return word - (1 << entry.bit_length)
    return word


@given(
    st.lists(st.tuples(st.sampled_from(KINDS), st.sampled_from([0, 1, 5, 8])), max_size=6),
    st.lists(st.binary(min_size=BYTES, max_size=BYTES), max_size=4),
    st.integers(1, 300),
)
def test_each_value_is_that_of_the_bits(
    kinds: list[tuple[tuple[int, int, bool, bool], int]], images: list[bytes], times: int
) -> None:
    entries: list[Any] = []
    end = 0
    for (kind, bits, signed, real), gap in kinds:
        entry = {"data_type": kind, "bit_length": bits, "signed": signed, "real": real}
        place = {"bit_offset": end + gap, "domain": 0, "output": False}
        entries.append(SimpleNamespace(**entry, **place))
        end += gap + bits
    columns = Columns(entries, LAYOUT)
    state = DomainState(is_known=True, is_complete=True, absent=0)
    rows = images * times
    for number, image in enumerate(rows):
        columns.add(Cycle(number, number, number, (state,)), [bytearray(image + bytes(PADDING))])
    assert len(columns) == len(rows)
    batch = columns.take()
    assert [*batch.cycles] == [*range(len(rows))]
    for entry, column in zip(entries, batch.columns, strict=True):
        assert len(column) == len(rows)
        for image, value in zip(images, column, strict=False):
            wanted = expected(image, entry)
            assert value == wanted or (value != value and wanted != wanted)
    assert len(columns.take().cycles) == 0
