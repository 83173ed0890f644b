"""Requests about object dictionaries: which objects a slave has, and what each of them is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from ecatd.model.bus import Bus, Slave
from ecatd.model.dictionary import DictionaryObject
from ecatd.model.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.model.requests.objects import DescribeObject, ListObjects

from ..mailbox.coe import Coe
from ..mailbox.dictionary import read_object
from ..mailbox.sdo_information import list_objects
from ..mailbox.talks import Talk
from .conversations import Conversations

T = TypeVar("T")

_IDENTITY = 0x1018
"""An object that every slave with CoE has."""


class Dictionaries:
    """The object dictionaries of all slaves.

    Descriptions of objects are kept, since a slave takes seconds to describe all of them. They are
    read again if the slave lists other objects than before: it may be another device, or have
    another firmware.

    Args:
        bus: The bus description.
        conversations: The conversations with the slaves.
    """

    def __init__(self, bus: Bus, conversations: Conversations) -> None:
        self._bus = bus
        self._conversations = conversations
        self._lists: dict[int, list[int]] = {}
        self._objects: dict[tuple[int, int], DictionaryObject] = {}

    async def list(self, request: ListObjects) -> dict[str, Any]:
        """The reply has `objects`: the index of each object."""
        slave = self._bus.find_coe(request.slave)
        found = await self._ask(slave, list_objects)
        if self._lists.get(slave.position) != found:
            self._lists[slave.position] = found
            self._objects = {
                key: item for key, item in self._objects.items() if key[0] != slave.position
            }
        return {"objects": found}

    async def describe(self, request: DescribeObject) -> dict[str, Any]:
        """The reply has the fields of `DictionaryObject.to_map`."""
        slave = self._bus.find_coe(request.slave)
        key = slave.position, request.index
        if key not in self._objects:
            self._objects[key] = await self._ask(slave, lambda coe: read_object(coe, request.index))
        return self._objects[key].to_map()

    async def _ask(self, slave: Slave, part: Callable[[Coe], Talk[T]]) -> T:
        def talk(coe: Coe) -> Talk[T]:
            try:
                return (yield from part(coe))
            except SdoAbortError:
                raise
            except (NoAnswerError, StateError) as error:
                # If a slave does not answer at all, the cause is another one, and so is the remedy.
                yield from coe.upload(_IDENTITY, 0, tries=1)
                raise type(error)(
                    f"{slave.label} does not describe its objects: {error}; take the descriptions "
                    "from its ESI file with --esi"
                ) from error

        return await self._conversations.coe(slave, talk)
