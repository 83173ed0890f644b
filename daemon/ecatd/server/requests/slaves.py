"""Requests about slaves: passes each one to the module that carries it out."""

from __future__ import annotations

from typing import Any

from ecatd.base.errors import UsageError
from ecatd.base.log import Log
from ecatd.config import Config
from ecatd.description.bus import Bus
from ecatd.master.master import Master
from ecatd.master.worker import Worker
from ecatd.operations.bus import Rescan
from ecatd.operations.eeproms import ReadSii, WriteSii
from ecatd.operations.ethernet import ReadIp, WriteIp
from ecatd.operations.files import CancelFoe, PutFoe, ReadFoe, StartFoe, TakeFoe
from ecatd.operations.idns import ReadIdn, WriteIdn
from ecatd.operations.objects import DescribeObject, ListObjects, SdoRead, SdoWrite
from ecatd.operations.operation import Request
from ecatd.operations.registers import ReadErrors, ReadRegister, ResetErrors, WriteRegister

from .changes import ZENOH, Changes
from .conversations import Conversations
from .dictionaries import Dictionaries
from .eeproms import Eeproms
from .ethernet import Ethernet
from .files import Files, States
from .idns import Idns
from .objects import Meaning, Objects
from .registers import Registers
from .wire import Wire


class SlaveRequests:
    """Requests about the slaves of a bus that runs.

    Args:
        bus: The bus description.
        master: The master.
        config: The configuration as the user has given it.
        worker: The worker on which slaves are asked.
        conversations: The conversations with the mailboxes of the slaves.
        states: The AL states of the slaves.
        meaning: See `Objects`.
        changes: Tells of changes.
        log: The log for transfers of files.
    """

    def __init__(
        self,
        bus: Bus,
        master: Master,
        config: Config,
        worker: Worker,
        conversations: Conversations,
        states: States,
        meaning: Meaning,
        changes: Changes,
        log: Log,
    ) -> None:
        self._bus = bus
        self._dictionaries = Dictionaries(bus, conversations)
        self._objects = Objects(bus, conversations, self._dictionaries, meaning, changes)
        self._registers = Registers(bus, master, worker, changes)
        self._eeproms = Eeproms(bus, master, worker, conversations.places, changes)
        self._ethernet = Ethernet(bus, conversations, changes)
        self._idns = Idns(bus, conversations, changes)
        self._wire = Wire(bus, master, config, worker)
        self._files = Files(bus, conversations, states, changes, log)

    def check_free(self, position: int | None) -> None:
        """Checks that no file goes to or from a slave, or from any of them.

        Raises:
            BusyError: There is such a transfer.
        """
        self._files.check_free(position)

    def close(self) -> None:
        """Ends what goes on without requests: transfers of files, and a scan."""
        self._files.close()
        self._wire.close()

    async def answer(self, request: Request, slot: int = ZENOH) -> dict[str, Any]:
        """Carries a request out.

        Args:
            request: The request.
            slot: The slot of the program that asks through shared memory, or `ZENOH`.

        Raises:
            EcatError: The request cannot be carried out, or the slave refuses it.
        """
        match request:
            case SdoRead():
                return await self._objects.read(request)
            case SdoWrite():
                return await self._objects.write(request, slot)
            case ListObjects():
                return await self._dictionaries.list(request)
            case DescribeObject():
                return await self._dictionaries.describe(request)
            case ReadRegister():
                return await self._registers.read(request)
            case WriteRegister():
                self._files.check_free(self._bus.find(request.slave).position)
                return await self._registers.write(request)
            case ReadErrors():
                return await self._registers.errors()
            case ResetErrors():
                return await self._registers.reset_errors(request)
            case ReadSii():
                return await self._eeproms.read(request)
            case WriteSii():
                self._files.check_free(self._bus.find(request.slave).position)
                return await self._eeproms.write(request)
            case ReadIdn():
                return await self._idns.read(request)
            case WriteIdn():
                return await self._idns.write(request)
            case ReadIp():
                return await self._ethernet.read(request)
            case WriteIp():
                return await self._ethernet.write(request)
            case Rescan():
                return await self._wire.scan()
            case StartFoe():
                return self._files.start(request)
            case PutFoe():
                return self._files.put(request)
            case TakeFoe():
                return self._files.take(request)
            case ReadFoe():
                return self._files.describe(request.transfer)
            case CancelFoe():
                return await self._files.cancel(request)
        raise UsageError(f"the bus server cannot answer {request.op}")
