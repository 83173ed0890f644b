"""Requests about object dictionaries: which objects a slave has, and what each of them is."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeVar, cast

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.description.bus import Bus, Slave
from ecatd.etg.dictionary import DictionaryEntry, DictionaryObject
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.dictionary import read_object
from ecatd.master.mailbox.sdo_information import describe_entry, list_objects
from ecatd.operations.handlers import handles
from ecatd.operations.objects import DescribeObject, ListObjects, ObjectDescription
from ecatd.operations.objects import Objects as ObjectList

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
        self._kept: dict[int, _Descriptions] = {}  # by position

    @handles(ListObjects)
    async def list(self, request: ListObjects) -> ObjectList:
        """The reply has `objects`: the index of each object."""
        slave = self._bus.find_coe(request.slave)
        found = await self._ask(slave, list_objects)
        if self._of(slave).listed != found:
            self._kept[slave.position] = _Descriptions(found)
        return {"objects": found}

    @handles(DescribeObject)
    async def describe(self, request: DescribeObject) -> ObjectDescription:
        """The reply has the fields of `DictionaryObject.to_map`."""
        slave, index = self._bus.find_coe(request.slave), request.index
        kept = self._of(slave)
        if index not in kept.objects:
            kept.objects[index] = await self._ask(slave, lambda coe: read_object(coe, index))
        return cast("ObjectDescription", kept.objects[index].to_map())

    def kept_entry(self, slave: Slave, index: int, subindex: int) -> DictionaryEntry | None:
        """The entry as the slave has described it; None if it has not, or was not asked yet."""
        kept = self._of(slave)
        if index in kept.objects:
            return kept.objects[index].entries.get(subindex)
        return kept.entries.get((index, subindex))

    async def entry(self, slave: Slave, index: int, subindex: int) -> DictionaryEntry | None:
        """The entry as the slave describes it, which is asked once; None if it does not.

        Raises:
            EcatError: The slave does not answer at all.
        """
        kept = self._of(slave)
        if index not in kept.objects and (index, subindex) not in kept.entries and not kept.mute:

            def conversation(coe: Coe) -> Conversation[DictionaryEntry | None]:
                try:
                    found = yield from describe_entry(coe, index, subindex, tries=1)
                except SdoAbortError:
                    return None
                except (NoAnswerError, StateError):
                    yield from _check_answers(coe)
                    kept.mute = True
                    return None
                return DictionaryEntry(*found)

            kept.entries[index, subindex] = await self._conversations.coe(slave, conversation)
        return self.kept_entry(slave, index, subindex)

    def _of(self, slave: Slave) -> _Descriptions:
        return self._kept.setdefault(slave.position, _Descriptions())

    async def _ask(self, slave: Slave, part: Callable[[Coe], Conversation[T]]) -> T:
        def conversation(coe: Coe) -> Conversation[T]:
            try:
                return (yield from part(coe))
            except SdoAbortError:
                raise
            except (NoAnswerError, StateError) as error:
                yield from _check_answers(coe)
                raise type(error)(
                    f"{slave.label} does not describe its objects: {error}; take the descriptions "
                    "from its ESI file with --esi"
                ) from error

        return await self._conversations.coe(slave, conversation)


@dataclass(slots=True)
class _Descriptions:
    """What one slave has said about its objects.

    Attributes:
        listed: The index of each object; empty until it has listed them.
        objects: The objects that it has described as a whole, by index.
        entries: The entries that it was asked for alone, by index and subindex; None for those
            that it does not describe.
        mute: It describes nothing, though it answers other requests.
    """

    listed: list[int] = field(default_factory=list)
    objects: dict[int, DictionaryObject] = field(default_factory=dict)
    entries: dict[tuple[int, int], DictionaryEntry | None] = field(default_factory=dict)
    mute: bool = False


def _check_answers(coe: Coe) -> Conversation[None]:
    """Checks that a slave that has not described an object answers other requests.

    If it does not answer at all, the cause is another one, and so is the remedy.
    """
    with suppress(SdoAbortError):
        yield from coe.upload(_IDENTITY, 0, tries=1)
