"""Walks along the categories of an SII (ETG.2010).

Categories follow from word 0x40 on, each with its type and its length in words; 0xFFFF follows the
last one. Any of this can be wrong in a real device.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import ClassVar, NoReturn

from .sii import CATEGORY_END, Sii, SiiProblem

Words = Callable[[int, int], bytes]
"""Returns words of an EEPROM. Arguments: word address, and number of words."""

FIRST_CATEGORY = 0x40

_SIZE = 0x3E  # word
_WORDS_MAX = 0x10000
_IMAGE_WORDS_MAX = 0x40000  # 4 MBit, the largest EEPROM of ETG.1000.6
_WORDS_PER_KIBIT = 64
_CATEGORIES_MAX = 256
_PROBLEMS_MAX = 100
_KNOWN = {*range(10), 10, 20, 30, 40, 41, 42, 43, 50, 51, 60, 70, 80, 90, 100, 110}
_VENDOR_SPECIFIC = 0x0800  # types from here on; lower ones belong to the standard


def whole_image(words: Words) -> bytes:
    """Reads a whole EEPROM: the size in word 0x3E, or more if the categories need it."""

    def word(address: int) -> int:
        return int.from_bytes(words(address, 1), "little")

    size = _WORDS_PER_KIBIT * (word(_SIZE) + 1)  # word 0x3E has the size in KiBit, less 1
    at = FIRST_CATEGORY
    for _ in range(_CATEGORIES_MAX):
        if at >= _IMAGE_WORDS_MAX - 1 or word(at) == CATEGORY_END:
            break
        at += 2 + word(at + 1)
    end = min(at + 1, _IMAGE_WORDS_MAX)
    if size > _IMAGE_WORDS_MAX or size < end:
        size = 1 << (end - 1).bit_length()
    return words(0, size)


class Stop(Exception):  # noqa: N818  not an error, but the end of a part
    """Ends decoding of a malformed category, or of all further categories."""


class CategoryReader:
    """Reads categories of an SII, and notes what is wrong with their chain.

    Args:
        words: Reads words of the EEPROM.

    Attributes:
        wanted: Types of the categories that are read.
        sii: What has been decoded.
    """

    wanted: ClassVar[frozenset[int]]

    def __init__(self, words: Words) -> None:
        self._words = words
        self.sii = Sii()

    def stop(self, byte: int, text: str, effect: str) -> NoReturn:
        """Notes a problem, and ends the part that is being decoded by raising `Stop`."""
        self.note(byte, text, effect)
        raise Stop

    def note(self, byte: int, text: str, effect: str = "", *, damage: bool = True) -> None:
        """Adds a problem, unless there are too many already.

        Args:
            byte: Offset in the EEPROM.
            text: What is wrong.
            effect: How the reader handles it.
            damage: Whether information is lost.
        """
        if len(self.sii.problems) < _PROBLEMS_MAX:
            self.sii.problems.append(SiiProblem(byte, text, effect, damage))

    def walk(self, found: dict[int, list[tuple[int, bytes]]], present: set[int]) -> None:
        """Walks along the categories, up to their end or to a mistake in their chain.

        Args:
            found: Takes the wanted categories: by type, byte offset and data of each of this type.
            present: Takes the types of all categories.

        Raises:
            Stop: The chain is malformed.
        """
        at, end = FIRST_CATEGORY, self._size()
        for _ in range(_CATEGORIES_MAX):
            if at >= end:
                self.stop(
                    2 * at,
                    f"the categories reach to the end of the EEPROM, which has {end} words "
                    f"(word 0x{_SIZE:X}), without 0xFFFF behind the last one",
                    "if there are more, they are not read",
                )
            kind, length = struct.unpack("<HH", self._words(at, 2))
            if kind == CATEGORY_END:
                self.end_of_categories(at)
                return
            if kind == 0 and length == 0:
                self.stop(
                    2 * at,
                    f"there is no category at word 0x{at:04X}, only zeros",
                    "the rest is not read",
                )
            if at + 2 + length > end:
                self.stop(
                    2 * at,
                    f"category {kind} at word 0x{at:04X} claims {length} words, more than fit: "
                    f"{max(0, end - at - 2)} are left of the {end} words of the EEPROM "
                    f"(word 0x{_SIZE:X})",
                    "neither this one nor the following ones are read",
                )
            if kind < _VENDOR_SPECIFIC and kind not in _KNOWN:
                text = f"category {kind} at word 0x{at:04X} is unknown"
                self.note(2 * at, text, "it is left out", damage=False)
            self.begin_category(at, kind, length)
            if kind in self.wanted:
                found.setdefault(kind, []).append((2 * at + 4, self._words(at + 2, length)))
            present.add(kind)
            at += 2 + length
        self.stop(2 * at, f"more than {_CATEGORIES_MAX} categories", "the rest is not read")

    def _size(self) -> int:
        """Number of words that the EEPROM has by word 0x3E; the maximum if this word is 0."""
        (kibit,) = struct.unpack("<H", self._words(_SIZE, 1))
        return min((kibit + 1) * _WORDS_PER_KIBIT, _WORDS_MAX) if kibit else _WORDS_MAX

    def begin_category(self, word: int, kind: int, length: int) -> None:
        """Called for each category, with its word address, type and length in words."""

    def end_of_categories(self, word: int) -> None:
        """Called with the word address of the end of the categories, 0xFFFF."""
