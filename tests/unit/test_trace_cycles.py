"""Frames of a cycle become its process image, whatever is missing."""

import struct

from ecatd.etg.frame_sizes import FIRST_DATAGRAM
from ecatd.operations.image import DomainImage
from ecatd.trace.cycles import CycleReader

LRW, NOP = 12, 0
CYCLE_NS = 1_000_000
LAYOUT: list[DomainImage] = [
    {
        "output_bytes": 2,
        "input_bytes": 2,
        "datagrams": [
            {
                "command": LRW,
                "address": 0x100000,
                "offset": 0,
                "length": 4,
                "wkc_expected": 3,
                "group": -1,
                "split": 0,
            }
        ],
    }
]


def frame(number: int, data: bytes, wkc: int, *, event: int = 0) -> bytes:
    """A frame of the engine with one datagram."""
    head = struct.pack("<BBIHH", LRW, 0x80 | number & 0x7F, 0x100000, len(data), event)
    return bytes(FIRST_DATAGRAM) + head + data + struct.pack("<H", wkc)


def record(cycle: int, data: bytes, *, sent: bool, at_ns: int = 0) -> bytes:
    """A `cyclic_frame_record`."""
    head = struct.pack("<QIBBH", at_ns or cycle * CYCLE_NS, len(data), 0, sent, cycle & 0xFFFF)
    return head + data.ljust(-(-len(data) // 8) * 8, b"\0")


def exchange(cycle: int, outputs: bytes, inputs: bytes | None, wkc: int = 3) -> bytes:
    """The records of a cycle; without inputs, its frame is lost."""
    sent = record(cycle, frame(cycle, outputs + b"\0\0", 0), sent=True)
    if inputs is None:
        return sent
    return sent + record(cycle, frame(cycle, outputs + inputs, wkc, event=4), sent=False)


def read(reader: CycleReader, records: bytes) -> list[tuple[int, bool, bytes]]:
    return [
        (cycle.number, cycle.domains[0].is_complete, bytes(reader.images[0][:4]))
        for cycle in reader.read(records)
    ]


def test_lost_and_wrong_answers_leave_the_last_inputs() -> None:
    reader = CycleReader(LAYOUT, CYCLE_NS, newest=100, now_ns=100 * CYCLE_NS)
    records = (
        exchange(99, b"a0", b"A0")  # it may have lost frames, so it is left out
        + exchange(100, b"a1", b"A1")
        + exchange(101, b"a2", None)
        + exchange(102, b"a3", b"A3", wkc=1)
        + exchange(104, b"a5", b"A5")
        + exchange(105, b"", None)
    )
    assert read(reader, records) == [
        (100, True, b"a1A1"),
        (101, False, b"a2A1"),
        (102, False, b"a3A1"),
        (104, True, b"a5A5"),
    ]


def test_numbers_go_on_beyond_sixteen_bits_and_after_a_gap() -> None:
    newest = 5 * 65536 + 3
    reader = CycleReader(LAYOUT, CYCLE_NS, newest=newest, now_ns=newest * CYCLE_NS)
    first = 5 * 65536 - 2
    found = read(reader, b"".join(exchange(first + n, b"oo", b"ii") for n in range(-1, 5)))
    assert [number for number, *_ in found] == [first + n for n in range(4)]
    reader.restart()
    later = first + 40 * 65536 + 7  # frames in between were overwritten
    found = read(reader, b"".join(exchange(later + n, b"oo", b"ii") for n in range(-1, 2)))
    assert [number for number, *_ in found] == [later]


def test_a_cycle_of_which_the_first_frames_were_overwritten_is_left_out() -> None:
    """The rest of it says nothing of the outputs that were in them."""
    reader = CycleReader(LAYOUT, CYCLE_NS, newest=50, now_ns=50 * CYCLE_NS)
    whole = [exchange(50 + n, b"oo", b"ii") for n in range(5)]
    rest = whole[0][len(exchange(50, b"oo", None)) :]
    assert [number for number, *_ in read(reader, rest + b"".join(whole[1:3]))] == [51]
    reader.restart()
    assert [number for number, *_ in read(reader, b"".join(whole[2:]))] == [53]


def test_an_answer_to_another_frame_does_not_count() -> None:
    reader = CycleReader(LAYOUT, CYCLE_NS, newest=7, now_ns=7 * CYCLE_NS)
    late = record(8, frame(7, b"b1B1", 3), sent=False)
    short = record(8, b"\0" * 5, sent=False)
    records = (
        exchange(6, b"", None)
        + exchange(7, b"b1", None)
        + record(8, frame(8, b"b2\0\0", 0), sent=True)
        + late
        + short
        + exchange(9, b"b3", b"B3")
        + exchange(10, b"b4", b"B4")
    )
    assert read(reader, records) == [
        (7, False, b"b1\0\0"),
        (8, False, b"b2\0\0"),
        (9, True, b"b3B3"),
    ]


def test_a_domain_is_unknown_until_its_first_exchange_and_old_after_a_bad_one() -> None:
    """A cycle in which a slow domain is not due has what its last exchange has left."""
    reader = CycleReader(LAYOUT, CYCLE_NS, newest=5, now_ns=5 * CYCLE_NS)
    nothing = bytes(FIRST_DATAGRAM) + struct.pack("<BBIHHHH", 7, 0x85, 0, 2, 0, 0, 0)
    records = (
        record(4, nothing, sent=True)
        + record(5, nothing, sent=True)
        + exchange(6, b"c1", b"C1", wkc=1)
        + record(7, nothing, sent=True)
        + exchange(8, b"c2", b"C2")
        + record(9, nothing, sent=True)
        + record(10, nothing, sent=True)
    )
    states = [cycle.domains[0] for cycle in reader.read(records)]
    assert [(state.is_known, state.is_complete) for state in states] == [
        *((False, False), (True, False), (True, False), (True, True), (True, True)),
    ]
    reader.restart()
    states = [
        cycle.domains[0]
        for cycle in reader.read(b"".join(record(20 + n, nothing, sent=True) for n in range(3)))
    ]
    assert [state.is_known for state in states] == [False]
