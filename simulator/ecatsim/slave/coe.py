"""CoE server (ETG.1000.6 "CANopen over EtherCAT"): SDO transfers and SDO information."""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum

from ecatd.etg.al import AlState

from .mailbox import HEADER_SIZE, MailboxError, RefusedMailError
from .objects import Dictionary
from .sdo import ABORT, SdoServer
from .sdo_information import InformationServer

_HEADER_SIZE = 2
_MIN_SDO = 8
_MIN_INFORMATION = 4


class Service(IntEnum):
    """CoE services."""

    EMERGENCY = 1
    SDO_REQUEST = 2
    SDO_RESPONSE = 3
    SDO_INFORMATION = 8


class CoeServer:
    """Answers CoE requests from an object dictionary.

    Args:
        dictionary: The objects.
        state: Returns the AL state, on which read and write access depend.
        reply_size: Bytes of the mailbox that the master reads.
        complete_access: Whether whole objects may be transferred at once.
        sized_uploads: See `DeviceType`.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        state: Callable[[], AlState],
        reply_size: int,
        *,
        complete_access: bool = True,
        sized_uploads: bool = True,
    ) -> None:
        room = reply_size - HEADER_SIZE - _HEADER_SIZE
        self._sdo = SdoServer(
            *(dictionary, state, room),
            complete_access=complete_access,
            sized_uploads=sized_uploads,
        )
        self._information = InformationServer(dictionary, room)

    def reset(self) -> None:
        """Ends a running transfer."""
        self._sdo.reset()

    def handle(self, body: bytes) -> list[bytes]:
        """Answers one request; see `mailbox.Handler`."""
        service = int.from_bytes(body[:_HEADER_SIZE], "little") >> 12
        request = body[_HEADER_SIZE:]
        if service == Service.SDO_REQUEST:
            _check_size(request, _MIN_SDO)
            reply = self._sdo.handle(request)
            # An abort is sent as an SDO request in both directions.
            kind = Service.SDO_REQUEST if reply[:1] == ABORT else Service.SDO_RESPONSE
            return [struct.pack("<H", kind << 12) + reply] if reply else []
        if service == Service.SDO_INFORMATION:
            _check_size(request, _MIN_INFORMATION)
            header = struct.pack("<H", service << 12)
            return [header + part for part in self._information.handle(request)]
        raise RefusedMailError(
            MailboxError.UNSUPPORTED_SERVICE
            if len(body) >= _HEADER_SIZE
            else MailboxError.SIZE_TOO_SHORT
        )


def _check_size(request: bytes, least: int) -> None:
    if len(request) < least:
        raise RefusedMailError(MailboxError.SIZE_TOO_SHORT)
