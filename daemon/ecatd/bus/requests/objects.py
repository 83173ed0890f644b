"""Requests about objects of slaves: SDO uploads and downloads."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from ecatd.log import Log
from ecatd.model.bus import Bus, Slave
from ecatd.model.datatypes import STRINGS, DataType, bit_length, decode, encode
from ecatd.model.errors import EcatError, NoAnswerError, SdoAbortError, StateError, UsageError
from ecatd.model.object_types import ObjectType, ObjectTypes
from ecatd.model.requests.objects import SdoRead, SdoWrite, check_data

from ..mailbox.sdo_information import describe_entry
from .conversations import Conversations

_SHOWN = 32
"""Bytes of a value in the log."""


class Objects:
    """The objects of all slaves.

    Args:
        bus: The bus description.
        conversations: The conversations with the slaves.
        log: The log for changes.
    """

    def __init__(self, bus: Bus, conversations: Conversations, log: Log) -> None:
        self._log = log
        self._bus = bus
        self._conversations = conversations
        self._types: dict[int, ObjectTypes] = {}
        self._described: dict[tuple[int, int, int], ObjectType] = {}  # what slaves were asked for
        self._mute: set[int] = set()  # positions of slaves that do not describe their objects

    async def read(self, request: SdoRead) -> dict[str, Any]:
        """Uploads an object; the reply has `data`, name, type and meaning."""
        slave = self._bus.find_coe(request.slave)
        data = await self._upload(slave, request.index, request.subindex, request.complete)
        known = self._type(slave, request.index, request.subindex)
        if request.complete:
            known = ObjectType(known.name)
        elif not known.data_type and bit_length(known.of(data).data_type):
            known = await self._asked(slave, request.index, request.subindex, data)
        return {"data": data, **known.of(data).to_map()}

    async def write(self, request: SdoWrite) -> dict[str, Any]:
        """Downloads an object; the reply has the fields of that of `read`, with the data sent."""
        slave = self._bus.find_coe(request.slave)
        index, subindex = request.index, request.subindex
        known, data = self._type(slave, index, subindex), request.data
        if data is None:
            assert request.value is not None
            if not known.data_type:
                known = await self._asked(slave, index, subindex)
            data = encode(DataType(known.data_type), request.value)
            check_data(data)
        before = await self._before(slave, request) if request.by else None
        await self._conversations.coe(
            slave, lambda coe: coe.download(index, subindex, data, complete=request.complete)
        )
        if request.by:
            self._tell(slave, request, before, data)
        return {"data": data, **known.of(data).to_map()}

    async def _before(self, slave: Slave, request: SdoWrite) -> bytes | None:
        """The value before a change, for the log; None if the slave does not return it."""
        index, subindex, complete = request.index, request.subindex, request.complete
        with suppress(EcatError):
            return await self._conversations.coe(
                slave, lambda coe: coe.upload(index, subindex, complete=complete, tries=1)
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
        if described := self._described.get((slave.position, index, subindex)):
            return described
        if slave.position not in self._types:
            self._types[slave.position] = ObjectTypes(slave)
        return self._types[slave.position].find(index, subindex)

    async def _asked(
        self, slave: Slave, index: int, subindex: int, value: bytes | None = None
    ) -> ObjectType:
        """What the slave says about an object of unknown type; it is asked once.

        If the slave does not describe the object, the type follows from the size of its value,
        which is read unless `value` has it.

        Raises:
            UsageError: No type has this size.
            EcatError: The slave does not return the object.
        """
        described = ObjectType()
        try:
            if slave.position not in self._mute:
                described = await self._description(slave, index, subindex)
        except SdoAbortError:
            pass
        except (NoAnswerError, StateError):
            value = await self._upload(slave, index, subindex, False)
            self._mute.add(slave.position)  # it does answer other requests
        if not described.data_type:
            if value is None:
                value = await self._upload(slave, index, subindex, False)
            described = self._type(slave, index, subindex).of(value)
            if not bit_length(described.data_type):
                raise UsageError(
                    f"the type of 0x{index:04X}:{subindex:02X} is not known and it has "
                    f"{len(value)} bytes; give it with --type"
                )
        self._described[slave.position, index, subindex] = described
        return described

    async def _description(self, slave: Slave, index: int, subindex: int) -> ObjectType:
        """The description by the slave; without a type if that is none of numbers or texts."""
        entry = await self._conversations.coe(
            slave, lambda coe: describe_entry(coe, index, subindex, tries=1)
        )
        if bit_length(entry.data_type) or entry.data_type in STRINGS:
            return ObjectType(entry.name, entry.data_type)
        return ObjectType()
