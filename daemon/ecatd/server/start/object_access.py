"""Reads objects of a slave that are lists, and writes numbers, with errors for refused writes."""

from __future__ import annotations

import struct

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.description.bus import Slave
from ecatd.etg.error_codes import abort_error
from ecatd.etg.sii import Sii
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation


class RefusedError(StateError):
    """A slave refuses its configuration, so another try is useless.

    Attributes:
        slave: The slave.
        why: What it does or has, as a sentence without its subject, the slave.
        where: File, line and key of what it refuses; empty if it is not from one place.
    """

    def __init__(self, slave: Slave, why: str, where: str = "") -> None:
        super().__init__(f"{where}: {slave.label} {why}" if where else f"{slave.label} {why}")
        self.slave, self.why, self.where = slave, why, where

    @property
    def of_it(self) -> str:
        """The sentence about a slave that has been named already."""
        return f"{self.where}: it {self.why}" if self.where else f"it {self.why}"


def write(
    slave: Slave, coe: Coe, address: tuple[int, int], form: str, value: int, what: str
) -> Conversation[None]:
    """Writes a number to an object, as a part of a conversation.

    Args:
        slave: The slave.
        coe: CoE of the slave.
        address: Index and subindex.
        form: Format of the number, as in `struct`.
        value: The number.
        what: The meaning of the number, for messages.

    Raises:
        RefusedError: The slave refuses it.
    """
    try:
        yield from coe.download(*address, struct.pack(f"<{form}", value))
    except SdoAbortError as abort:
        where = f"0x{address[0]:04X}:{address[1]:02X}"
        raise RefusedError(slave, f"refuses {what} ({where}): {reason(abort)}") from abort


def reason(abort: SdoAbortError) -> str:
    """Returns code and text of an abort without its object, which the message has already."""
    return str(abort_error(abort.code))


class MissingListError(SdoAbortError):
    """The slave has no such list, or does not tell its length."""


class ValueLists:
    """Reads lists from one slave, by complete access if it supports that.

    Args:
        coe: CoE of the slave.
        label: Label of the slave, for messages.
        sii: SII of the slave.
    """

    def __init__(self, coe: Coe, label: str, sii: Sii) -> None:
        self._coe = coe
        self._label = label
        self._at_once = sii.complete_access

    def read(self, index: int, size: int, most: int) -> Conversation[list[int]]:
        """Reads an object that is a list of values. A missing object counts as an empty list.

        Raises as `read_existing`, but no `SdoAbortError` about subindex 0.
        """
        try:
            return (yield from self.read_existing(index, size, most))
        except MissingListError:
            return []

    def read_existing(self, index: int, size: int, most: int) -> Conversation[list[int]]:
        """Reads an object that is a list of values.

        Args:
            index: Index of the object.
            size: Bytes of a value.
            most: Most values that are accepted.

        Raises:
            MissingListError: There is no such list.
            SdoAbortError: The slave refuses to tell one of the values.
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed.
        """
        if not self._at_once:
            return (yield from self._one_by_one(index, size, most))
        values = yield from self._whole(index, size, most)
        if values is None:
            values = yield from self._one_by_one(index, size, most)
            # The object exists, so complete access does not work with this slave.
            self._at_once = False
        return values

    def _whole(self, index: int, size: int, most: int) -> Conversation[list[int] | None]:
        """Reads the list by complete access; returns None if this does not work with the slave.

        A byte of padding follows the number of values (ETG.1000.6, 5.6.2).
        """
        try:
            data = yield from self._coe.upload(index, 0, complete=True, tries=1)
        except (SdoAbortError, NoAnswerError, StateError):
            return None
        if not data or data[0] > most or len(data) != 2 + data[0] * size:
            return None
        return [int.from_bytes(data[at : at + size], "little") for at in range(2, len(data), size)]

    def _one_by_one(self, index: int, size: int, most: int) -> Conversation[list[int]]:
        """Reads the list value by value."""
        try:
            count = yield from self._coe.upload(index, 0, size=1)
        except SdoAbortError as abort:
            raise MissingListError(abort.code, str(abort)) from abort
        if len(count) < 1 or count[0] > most:
            raise StateError(
                f"{self._label}: 0x{index:04X}:00 announces {count.hex()} entries, but at most "
                f"{most} are possible"
            )
        values = []
        for subindex in range(1, count[0] + 1):
            data = yield from self._coe.upload(index, subindex, size=size)
            if len(data) != size:
                raise StateError(
                    f"{self._label}: 0x{index:04X}:{subindex:02X} has {len(data)} bytes, not {size}"
                )
            values.append(int.from_bytes(data, "little"))
        return values
