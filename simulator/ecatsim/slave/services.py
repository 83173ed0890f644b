"""The mailbox services of a device: CoE, EoE and SoE from PREOP on, FoE also in BOOT."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ecatd.etg.al import AlState

from ..esc import Event, Segment
from .coe import CoeServer
from .eoe import EoeServer, EthernetHost
from .foe import FileHost, FoeServer
from .mailbox import MailboxServer, Protocol
from .objects import Dictionary
from .sii import Mailbox
from .soe import Idn, SoeServer

_OUT, _IN = 0, 1  # sync managers of the mailboxes that the master writes and reads
_EOE, _COE, _FOE, _SOE = 0x02, 0x04, 0x08, 0x10  # bits of the supported protocols, SII word 0x1C
_COMPLETE_ACCESS = 0x20


class Services:
    """Serves the mailbox of one device.

    Args:
        mailbox: The mailbox from PREOP on.
        bootstrap: The mailbox in BOOT, or None.
        dictionary: The objects for CoE.
        state: Returns the AL state.
        host: The device whose files FoE serves.
        drives: The IDNs of each of its drives, for SoE.
        ethernet: What is behind its EoE.
        sized_uploads: See `DeviceType`.

    Attributes:
        server: The server for the mailbox protocol.
    """

    def __init__(
        self,
        mailbox: Mailbox,
        bootstrap: Mailbox | None,
        dictionary: Dictionary,
        state: Callable[[], AlState],
        host: FileHost,
        drives: Sequence[dict[int, Idn]],
        ethernet: EthernetHost,
        *,
        sized_uploads: bool = True,
    ) -> None:
        self._mailbox = mailbox
        self._bootstrap = bootstrap
        self._coe = CoeServer(
            dictionary,
            state,
            mailbox.send_size,
            complete_access=bool(mailbox.coe_details & _COMPLETE_ACCESS),
            sized_uploads=sized_uploads,
        )
        self._foe = FoeServer(host)
        self._soe = SoeServer(drives, state)
        self._bus: tuple[Segment, int] | None = None
        self._is_open = False
        self._waiting = False  # whether there may be a mail of the master in the mailbox
        self._ethernet = ethernet
        self.server = MailboxServer({}, self._put)
        self._eoe = EoeServer(ethernet, lambda body: self.server.send(Protocol.EOE, body))

    def attach(self, segment: Segment | None, position: int) -> None:
        """Connects to a slave of a segment, closed as in INIT; None disconnects."""
        self._bus = (segment, position) if segment else None
        self.close()
        if not segment:
            self._ethernet.close()

    def open(self, state: AlState) -> None:
        """Starts to serve, in PREOP or BOOT."""
        boot = state == AlState.BOOT
        box = self._bootstrap if boot and self._bootstrap else self._mailbox
        self._is_open = True
        self._waiting = True  # a master may write before the state is reached
        self._foe.start(box.receive_size, box.send_size, boot=boot)
        if self._mailbox.protocols & _FOE:
            self.server.handlers[Protocol.FOE] = self._foe.handle
        self._eoe.start(box.send_size)
        if self._mailbox.protocols & _EOE and not boot:
            self.server.handlers[Protocol.EOE] = self._eoe.handle
        self._soe.start(box.send_size)
        if self._mailbox.protocols & _SOE and not boot:
            self.server.handlers[Protocol.SOE] = self._soe.handle
        if self._mailbox.protocols & _COE and not boot:
            self.server.handlers[Protocol.COE] = self._coe.handle

    def close(self) -> None:
        """Ends all transfers and empties the mailboxes, as in INIT."""
        self._is_open = False
        self._waiting = False
        self._empty()
        self.server.handlers.clear()
        self.server.reset()
        self._coe.reset()

    @property
    def rests(self) -> bool:
        """Whether `run` would do nothing before the next event."""
        if not self._is_open:
            return True
        unasked = Protocol.EOE in self.server.handlers and self._ethernet.sends_unasked
        return not self._waiting and not unasked and self.server.rests

    def handle(self, event: Event, now: float) -> None:
        """Handles mailbox events that the master has caused."""
        if not self._is_open:
            return
        if event & Event.MAILBOX_OUT:
            self.server.was_read()
        if event & Event.MAILBOX_AGAIN:
            self.server.again()
        if event & Event.MAILBOX_IN:
            self._waiting = True
            self.run(now)

    def run(self, now: float) -> None:
        """Takes a waiting mail and offers answers that are due."""
        if not self._is_open:
            return
        if Protocol.EOE in self.server.handlers and self.server.has_room:
            self._eoe.run()
        self.server.tick(now)
        if self._waiting and self.server.accepts and self._bus:
            self._waiting = False
            segment, position = self._bus
            mail = segment.take_mail(position)
            if mail:
                self.server.receive(mail, now)

    def emergency(self, body: bytes) -> None:
        """Sends an emergency if CoE is served now."""
        if Protocol.COE in self.server.handlers:
            self.server.send(Protocol.COE, body)

    def _empty(self) -> None:
        if self._bus:
            segment, position = self._bus
            for channel in (_OUT, _IN):  # deactivation discards the content
                segment.lock_sync_manager(position, channel, True)
                segment.lock_sync_manager(position, channel, False)

    def _put(self, mail: bytes, again: bool) -> bool:
        if self._bus is None:
            return False
        segment, position = self._bus
        return segment.put_mail(position, mail, again=again)
