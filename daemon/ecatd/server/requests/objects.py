"""Requests about objects of slaves: SDO uploads and downloads."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import cast

from ecatd.base.errors import EcatError, UsageError
from ecatd.config import Config
from ecatd.description.bus import Bus, Slave
from ecatd.description.object_types import ObjectType, ObjectTypes
from ecatd.etg.datatypes import STRINGS, DataType, bit_length, decode, encode
from ecatd.etg.pdo import Entry
from ecatd.master.mailbox.coe import UnsizedBytes
from ecatd.operations.handlers import handles
from ecatd.operations.objects import Sdo, SdoRead, SdoWrite, check_data

from .changes import SHOWN, Changes, shown
from .conversations import Conversations, OverMailboxes
from .dictionaries import Dictionaries

Meaning = Callable[[Slave, Entry], Entry]


class Objects(OverMailboxes):
    """The objects of all slaves.

    Args:
        bus: With `conversations` and `changes`, see `OverMailboxes`.
        dictionaries: The object dictionaries of the slaves.
        meaning: Gives an object that is not in the process data its meaning, from device profiles
            and `[[signal]]` tables.
        config: Has the start-up lists, which are told beside what a slave refuses.
    """

    def __init__(
        self,
        bus: Bus,
        conversations: Conversations,
        dictionaries: Dictionaries,
        meaning: Meaning,
        changes: Changes,
        config: Config,
    ) -> None:
        super().__init__(bus, conversations, changes)
        self._dictionaries = dictionaries
        self._meaning = meaning
        self._config = config
        self._types: dict[int, ObjectTypes] = {}
        self._units: dict[tuple[int, int, int], ObjectType] = {}  # of objects with a meaning

    @handles(SdoRead)
    async def read(self, request: SdoRead) -> Sdo:
        """Uploads an object; the reply has `data`, name, type and meaning."""
        slave = self._bus.find_coe(request.slave)
        data = await self._upload(slave, request.index, request.subindex, request.complete)
        if request.complete:
            known = ObjectType(self._type(slave, request.index, request.subindex).name)
        else:
            known = await self._asked_type(slave, request.index, request.subindex)
            data = await self._sized(slave, request.index, request.subindex, data, known)
        return cast("Sdo", {"data": data, **known.of(data).to_map()})

    @handles(SdoWrite)
    async def write(self, request: SdoWrite) -> Sdo:
        """Downloads an object; the answer has the data sent."""
        slave = self._bus.find_coe(request.slave)
        index, subindex = request.index, request.subindex
        known, data = self._type(slave, index, subindex), request.data
        if data is None:
            assert request.value is not None
            known = await self._asked_type(slave, index, subindex)
            if not known.data_type:
                known = await self._type_by_size(slave, index, subindex)
            data = encode(DataType(known.data_type), request.value)
            check_data(data)
        kind = None if request.complete else known
        name = f" ({known.name})" if known.name else ""
        what = f"{slave.label}, 0x{index:04X}:{subindex:02X}{name}"
        after = _shown(data, kind)
        written = self._config.settings_of(slave.position).startup_value((index, subindex))
        note = f"; the start-up list has {written.text} for it" if written is not None else ""
        with self._changes.record(what, after, request.by, is_secret=True, note=note) as change:
            if not change.before:
                before = await self._before(slave, request)
                change.before = "" if before is None else _shown(before, kind)
            await self._conversations.coe(
                slave,
                lambda coe: coe.download(index, subindex, data, complete=request.complete),
            )
        return cast("Sdo", {"data": data, **known.of(data).to_map()})

    async def _before(self, slave: Slave, request: SdoWrite) -> bytes | None:
        """The value before a change, for the log; None if the slave does not return it."""
        index, subindex, complete = request.index, request.subindex, request.complete
        with suppress(EcatError):
            data = await self._conversations.coe(
                slave,
                lambda coe: coe.upload(index, subindex, complete=complete, tries=1),
            )
            known = self._type(slave, index, subindex)
            return await self._sized(slave, index, subindex, data, known)
        return None

    async def _sized(
        self, slave: Slave, index: int, subindex: int, data: bytes, known: ObjectType
    ) -> bytes:
        """The bytes that belong to a value, if the slave has not said how many that are.

        Those of its type; the dictionary of the slave says how long a text is.
        """
        if not isinstance(data, UnsizedBytes):
            return data
        bits = bit_length(known.data_type)
        if not bits:
            entry = await self._dictionaries.entry(slave, index, subindex)
            bits = entry.bit_length if entry is not None else 0
        return data.cut((bits + 7) // 8)

    async def _upload(self, slave: Slave, index: int, subindex: int, complete: bool) -> bytes:
        return await self._conversations.coe(
            slave, lambda coe: coe.upload(index, subindex, complete=complete)
        )

    def _type(self, slave: Slave, index: int, subindex: int) -> ObjectType:
        """What is known about an object without asking the slave."""
        known = self._plain_type(slave, index, subindex)
        if not bit_length(known.data_type) or known.unit:
            return known
        key = slave.position, index, subindex
        if key not in self._units or self._units[key].data_type != known.data_type:
            kind = known.data_type
            entry = Entry(index, subindex, known.name, kind, bit_length(kind))
            with suppress(EcatError):  # the object can have no value within its limits
                entry = self._meaning(slave, entry)
            self._units[key] = ObjectType(
                known.name or entry.name, kind, entry.unit, entry.scale, entry.offset
            )
        return self._units[key]

    def _plain_type(self, slave: Slave, index: int, subindex: int) -> ObjectType:
        """The same, without the meaning of objects that are not in the process data."""
        if slave.position not in self._types:
            self._types[slave.position] = ObjectTypes(slave)
        known = self._types[slave.position].find(index, subindex)
        entry = self._dictionaries.kept_entry(slave, index, subindex)
        if known.data_type or entry is None:
            return known
        if bit_length(entry.data_type) or entry.data_type in STRINGS:
            return ObjectType(entry.name or known.name, entry.data_type)
        return known  # neither a number nor a text

    async def _asked_type(self, slave: Slave, index: int, subindex: int) -> ObjectType:
        """As `_type`, but the slave is asked about an object of unknown type."""
        if not self._type(slave, index, subindex).data_type:
            await self._dictionaries.entry(slave, index, subindex)
        return self._type(slave, index, subindex)

    async def _type_by_size(self, slave: Slave, index: int, subindex: int) -> ObjectType:
        """The unsigned type that has the size of the object's value, which is read.

        Raises:
            UsageError: No number has this size.
            EcatError: The slave does not return the object.
        """
        now = await self._upload(slave, index, subindex, False)
        if isinstance(now, UnsizedBytes):
            raise UsageError(
                f"the type of 0x{index:04X}:{subindex:02X} is not known, and {slave.label} does "
                "not say how many bytes it has; give it with --type"
            )
        found = self._type(slave, index, subindex).of(now)
        if not bit_length(found.data_type):
            raise UsageError(
                f"the type of 0x{index:04X}:{subindex:02X} is not known and it has {len(now)} "
                "bytes; give it with --type"
            )
        return found


def _shown(data: bytes, known: ObjectType | None) -> str:
    """The value of an object in a line about a change; None stands for any bytes."""
    if known is None or len(data) > SHOWN:
        return shown(data)
    data_type = known.of(data).data_type
    value = decode(data_type, data)
    # A text may contain what looks like another line.
    return (
        repr(value)
        if data_type in (DataType.VISIBLE_STRING, DataType.UNICODE_STRING)
        else str(value)
    )
