"""Requests about Ethernet over EtherCAT (EoE)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

from ecatd.base.errors import StateError, UsageError
from ecatd.config.eoe import SlaveEoeConfig
from ecatd.description.bus import Slave
from ecatd.etg.eoe import NONE, IpParameters, parse_address, parse_interface, parse_mac, parse_name
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.eoe import get_ip, set_ip
from ecatd.master.mailbox.mailbox import Mailbox
from ecatd.operations.ethernet import Ip, ReadIp, WriteIp
from ecatd.operations.handlers import handles

from .conversations import OverMailboxes


class Ethernet(OverMailboxes):
    """The IP parameters of all slaves."""

    @handles(ReadIp)
    async def read(self, request: ReadIp) -> Ip:
        """The reply has the fields of `IpParameters.to_map`.

        Raises:
            StateError: There is no such slave, it has no EoE, or it refuses the request.
        """
        slave = self._find(request.slave)
        return cast("Ip", (await self._conversations.eoe(slave, get_ip)).to_map())

    @handles(WriteIp)
    async def write(self, request: WriteIp) -> Ip:
        """The reply has the fields of that of `read`, and those from before as `before`.

        Raises:
            StateError: As `read`.
            UsageError: A parameter is malformed.
        """
        slave = self._find(request.slave)
        wanted = _parameters(request)
        if not wanted:
            raise UsageError("nothing is to be written: give at least one IP parameter")

        def conversation(mailbox: Mailbox) -> Conversation[tuple[IpParameters, IpParameters]]:
            try:
                before = yield from get_ip(mailbox)
            except StateError:
                before = IpParameters()  # some slaves take parameters, and do not tell them
            after = replace(before, **wanted)
            if after.mac is None:
                own = SlaveEoeConfig().with_mac(self._bus.name, slave.position)
                after = replace(after, mac=own.mac)
            change.before, change.after = before.text, after.text
            yield from set_ip(mailbox, after)
            return before, after

        what, asked = f"{slave.label}, IP parameters", IpParameters(**wanted).text
        with self._changes.record(what, asked, request.by) as change:
            before, after = await self._conversations.eoe(slave, conversation)
        return cast("Ip", {**after.to_map(), "before": before.to_map()})

    def _find(self, name: int | str) -> Slave:
        slave = self._bus.find(name)
        if not slave.eoe:
            raise StateError(f"{slave.label} has no EoE: `ecatctl eoe` lists the slaves that have")
        return slave


def _parameters(request: WriteIp) -> dict[str, Any]:
    """The parameters that a request gives."""
    found: dict[str, Any] = {}
    if request.address is not None:
        found["address"], found["mask"] = parse_interface(request.address)
    for key, parse in (
        ("mac", parse_mac),
        ("gateway", parse_address),
        ("dns", parse_address),
        ("name", parse_name),
    ):
        if (text := getattr(request, key)) is not None:
            found[key] = None if text == NONE and key != "mac" else parse(text)
    return found
