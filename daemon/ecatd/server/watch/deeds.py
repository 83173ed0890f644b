"""Finds out what frames of another master do: which registers they write, and of which slaves.

Commands, registers and AL states are those of ETG.1000.4.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum

from ecatd.etg.al import al_state_text
from ecatd.etg.frame_sizes import DATAGRAM_WKC, FIRST_DATAGRAM

_HEADER = struct.Struct("<BBHHHH")  # command, index, address, register, length, interrupt
_LENGTH, _MORE = 0x07FF, 0x8000
_TO_SINGLE = (2, 3, 5, 6)  # APWR, APRW, FPWR, FPRW
_TO_ALL = (8, 9, 13, 14)  # BWR, BRW; ARMW and FRMW write what they have read of one slave
_TO_IMAGE = (11, 12)  # LWR, LRW

_AL_CONTROL = 0x0120
_AREAS = (
    (0x0010, 0x0012, "station addresses"),
    (0x0100, 0x0110, "DL control"),
    (_AL_CONTROL, 0x0122, "AL control"),
    (0x0200, 0x0220, "event masks"),
    (0x0300, 0x0320, "error counters"),
    (0x0400, 0x0450, "watchdogs"),
    (0x0500, 0x0510, "EEPROM control"),
    (0x0600, 0x0700, "FMMUs"),
    (0x0800, 0x0900, "sync managers"),
    (0x0900, 0x0A00, "clocks"),
    (0x1000, 0x10000, "memory"),
)
"""First register of an area, the one after its last, and the name of the area."""


class Whom(IntEnum):
    """Which slaves a datagram writes to."""

    ALL = 0
    SINGLE = 1
    IMAGE = 2


_WORDS = {
    Whom.ALL: "of all slaves",
    Whom.SINGLE: "of single slaves",
    Whom.IMAGE: "of the process image",
}


@dataclass(frozen=True, slots=True)
class Deed:
    """A write to slaves.

    Attributes:
        whom: Which slaves it writes to.
        register: First register of the area; 0 for the process image.
        value: The value in words, where it matters.
    """

    whom: Whom
    register: int = 0
    value: str = ""


def deeds(frame: bytes) -> Iterator[Deed]:
    """Yields the writes of a frame that slaves have carried out.

    Args:
        frame: A frame that has come back, or its beginning. If the working counter of a datagram
            is cut off, the datagram counts as carried out.
    """
    at, more = FIRST_DATAGRAM, _MORE
    while more and at + _HEADER.size <= len(frame):
        command, _, _, register, length, _ = _HEADER.unpack_from(frame, at)
        data, more = at + _HEADER.size, length & _MORE
        at = data + (length & _LENGTH) + DATAGRAM_WKC
        if at <= len(frame) and not any(frame[at - DATAGRAM_WKC : at]):
            continue
        if command in _TO_IMAGE:
            yield Deed(Whom.IMAGE)
        elif command in _TO_SINGLE or command in _TO_ALL:
            whom = Whom.ALL if command in _TO_ALL else Whom.SINGLE
            value = frame[data : data + 1] if register == _AL_CONTROL else b""
            yield Deed(whom, _area(register), al_state_text(value[0] & 0x0F) if value else "")


def _area(register: int) -> int:
    return next((first for first, end, _ in _AREAS if first <= register < end), register)


def _named(done: Iterable[Deed]) -> dict[Whom, list[str]]:
    """Groups writes by the slaves concerned, in the order of registers, in words."""
    values: defaultdict[tuple[Whom, int], set[str]] = defaultdict(set)
    for deed in done:
        values[deed.whom, deed.register].add(deed.value)
    named: defaultdict[Whom, list[str]] = defaultdict(list)
    for whom, register in sorted(values):
        name = next((text for first, _, text in _AREAS if first == register), "register")
        more = ", ".join(sorted(filter(None, values[whom, register])))
        at = f" (0x{register:04X}{more and f': {more}'})"
        named[whom].append("outputs" if whom == Whom.IMAGE else name + at)
    return named


def facts(done: Iterable[Deed]) -> list[str]:
    """Describes writes one by one, such as `FMMUs (0x0600) of all slaves`."""
    return [f"{name} {_WORDS[whom]}" for whom, names in _named(done).items() for name in names]


def sentence(done: Iterable[Deed]) -> str:
    """Describes writes in one sentence: `It wrote AL control (0x0120: INIT) of all slaves`."""
    parts = [f"{', '.join(names)} {_WORDS[whom]}" for whom, names in _named(done).items()]
    return (
        f"It wrote {', and '.join(parts)}"
        if parts
        else ("As far as ecatd has seen, it has only read")
    )
