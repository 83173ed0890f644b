"""Requests about objects of slaves: SDO uploads and downloads."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ecatd.log import Log
from ecatd.model.bus import Bus, Slave
from ecatd.model.datatypes import STRINGS, DataType, bit_length, decode, encode
from ecatd.model.errors import EcatError, UsageError
from ecatd.model.object_types import ObjectType, ObjectTypes
from ecatd.model.pdo import Entry
from ecatd.model.requests.objects import SdoRead, SdoWrite, check_data

from .conversations import Conversations
from .dictionaries import Dictionaries

Meaning = Callable[[Slave, Entry], Entry]

_SHOWN = 32
"""Bytes of a value in the log."""


class Objects:
    """The objects of all slaves.

    Args:
        bus: The bus description.
        conversations: The conversations with the slaves.
        dictionaries: The object dictionaries of the slaves.
        meaning: Gives an object that is not in the process data its meaning, from device profiles
            and `[[signal]]` tables.
        log: The log for changes.
    """

    def __init__(
        self,
        bus: Bus,
        conversations: Conversations,
        dictionaries: Dictionaries,
        meaning: Meaning,
        log: Log,
    ) -> None:
        self._log = log
        self._bus = bus
        self._conversations = conversations
        self._dictionaries = dictionaries
        self._meaning = meaning
        self._types: dict[int, ObjectTypes] = {}
        self._units: dict[tuple[int, int, int], ObjectType] = {}  # of objects with a meaning

    async def read(self, request: SdoRead) -> dict[str, Any]:
        """Uploads an object; the reply has `data`, name, type and meaning."""
        slave = self._bus.find_coe(request.slave)
        data = await self._upload(slave, request.index, request.subindex, request.complete)
        if request.complete:
            known = ObjectType(self._type(slave, request.index, request.subindex).name)
        else:
            known = await self._asked_type(slave, request.index, request.subindex)
        return {"data": data, **known.of(data).to_map()}

    async def write(self, request: SdoWrite) -> dict[str, Any]:
        """Downloads an object; the reply has the fields of that of `read`, with the data sent."""
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
        before = await self._before(slave, request) if request.by else None
        await self._conversations.coe(
            slave,
            lambda coe: coe.download(index, subindex, data, complete=request.complete),
            changes=True,
        )
        if request.by:
            self._tell(slave, request, before, data)
        return {"data": data, **known.of(data).to_map()}

    async def _before(self, slave: Slave, request: SdoWrite) -> bytes | None:
        """The value before a change, for the log; None if the slave does not return it."""
        index, subindex, complete = request.index, request.subindex, request.complete
        with suppress(EcatError):
            return await self._conversations.coe(
                slave,
                lambda coe: coe.upload(index, subindex, complete=complete, tries=1),
                changes=True,
            )
        return None

    def _tell(self, slave: Slave, request: SdoWrite, before: bytes | None, data: bytes) -> None:
        known = self._type(slave, request.index, request.subindex)
        if request.complete:
            known = ObjectType(known.name)

        def text(value: bytes) -> str:
            if request.complete or not known.of(value).data_type or len(value) > _SHOWN:
                more = " ..." if len(value) > _SHOWN else ""
                return f"{len(value)} bytes: {value[:_SHOWN].hex(' ')}{more}"
            return str(decode(known.of(value).data_type, value))

        name = f" ({known.name})" if known.name else ""
        was = "" if before is None else f"from {text(before)} "
        self._log.notice(
            f"{slave.label}, 0x{request.index:04X}:{request.subindex:02X}{name}: changed {was}to "
            f"{text(data)} by {request.by}"
        )

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
        found = self._type(slave, index, subindex).of(now)
        if not bit_length(found.data_type):
            raise UsageError(
                f"the type of 0x{index:04X}:{subindex:02X} is not known and it has {len(now)} "
                "bytes; give it with --type"
            )
        return found
