"""What is said of the frames of other masters."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.server.watch.foreign_masters import Whom, Write, describe, sentence, writes

BRD, FPWR, BWR, LRW = 7, 5, 8, 12


def datagram(
    command: int, register: int, data: bytes, wkc: int = 1, *, more: bool = False
) -> bytes:
    length = len(data) | (0x8000 if more else 0)
    return struct.pack("<BBHHHH", command, 0, 0x1001, register, length, 0) + data + bytes((wkc, 0))


def frame(*datagrams: bytes) -> bytes:
    return bytes(16) + b"".join(datagrams)


def test_all_datagrams_of_a_frame_count() -> None:
    done = set(
        writes(
            frame(
                datagram(BRD, 0x0130, b"\x08\x00", more=True),
                datagram(BWR, 0x0120, b"\x11\x00", wkc=8, more=True),
                datagram(BWR, 0x0610, bytes(16), more=True),
                datagram(FPWR, 0x0010, b"\x01\x10"),
                datagram(FPWR, 0x0120, b"\x04\x00"),  # after the last one: no part of it
            )
        )
    )
    assert describe(done) == [
        "AL control (0x0120: INIT) of all slaves",
        "FMMUs (0x0600) of all slaves",
        "station addresses (0x0010) of single slaves",
    ]
    names(sentence(done), "0x0120: INIT", "all slaves", "0x0010", "single slaves")


def test_values_are_gathered() -> None:
    done = [Write(Whom.ALL, 0x0120, state) for state in ("PREOP", "INIT", "INIT")]
    assert describe(done) == ["AL control (0x0120: INIT, PREOP) of all slaves"]


@pytest.mark.parametrize(
    ("one", "told"),
    [
        (datagram(LRW, 0x1000, bytes(4), 3), "outputs of the process image"),
        (datagram(FPWR, 0x0B00, b"\x00"), "register (0x0B00) of single slaves"),
        (datagram(FPWR, 0x0120, b"\x04\x00", 0), "only read"),
        (datagram(BRD, 0x0130, bytes(2)), "only read"),
        # Where the working counter, or the data, are cut off.
        (
            datagram(BWR, 0x0120, b"\x01\x00")[:11],
            "AL control (0x0120: INIT) of all slaves",
        ),
        (datagram(BWR, 0x0120, b"\x01\x00")[:10], "AL control (0x0120) of all slaves"),
    ],
)
def test_one_datagram(one: bytes, told: str) -> None:
    names(sentence(writes(frame(one))), told)


@given(st.binary(max_size=300))
def test_whatever_is_sent_is_told(data: bytes) -> None:
    done = list(writes(data))
    assert len(sentence(done)) > 0
    assert len(describe(done)) <= len(done)
