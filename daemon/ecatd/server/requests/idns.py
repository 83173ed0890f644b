"""Requests about IDNs of drives (SoE)."""

from __future__ import annotations

from typing import cast

from ecatd.base.errors import UsageError
from ecatd.etg.idns import idn_text
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.mailbox import Mailbox
from ecatd.master.mailbox.soe import read_idn, write_idn
from ecatd.operations.handlers import handles
from ecatd.operations.idns import Idn, ReadIdn, WriteIdn

from .changes import shown
from .conversations import OverMailboxes


class Idns(OverMailboxes):
    """The IDNs of all drives."""

    @handles(ReadIdn)
    async def read(self, request: ReadIdn) -> Idn:
        """The reply has the fields of `IdnValue.to_map`.

        Raises:
            StateError: There is no such slave or IDN, or the slave has no SoE.
        """
        slave = self._bus.find(request.slave)
        drive, number = request.drive, request.idn
        found = await self._conversations.soe(
            slave, lambda mailbox: read_idn(mailbox, drive, number)
        )
        return cast("Idn", found.to_map())

    @handles(WriteIdn)
    async def write(self, request: WriteIdn) -> Idn:
        """The reply has the fields of that of `read`, and the previous value as `before`.

        Raises:
            StateError: As `read`; or the drive refuses the value.
            UsageError: The value has another size than that of the IDN.
        """
        slave = self._bus.find(request.slave)
        drive, number, data = request.drive, request.idn, request.data

        def conversation(mailbox: Mailbox) -> Conversation[Idn]:
            old = yield from read_idn(mailbox, drive, number)
            change.what, change.before = f"{what} ({old.name})", shown(old.value)
            size, is_list = old.attribute.size, old.attribute.is_list
            if size and (len(data) % size or (not is_list and len(data) != size)):
                raise UsageError(
                    f"{idn_text(number)} ({old.name}) takes {size} bytes"
                    f"{' for each element' * is_list}, not {len(data)}"
                )
            yield from write_idn(mailbox, drive, number, data, is_list=is_list)
            return cast("Idn", {**old.to_map(), "value": data, "before": old.value})

        what = f"{slave.label}, drive {drive}, {idn_text(number)}"
        with self._changes.record(what, shown(data), request.by, is_secret=True) as change:
            return await self._conversations.soe(slave, conversation)
