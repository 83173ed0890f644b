"""CANopen over EtherCAT (ETG.1000.6, "CoE"): SDO transfers.

A transfer is a part of a conversation with one slave. `conversation.run_conversations` runs the
conversations with many slaves at the same time. An answer is accepted only if it is for the
requested object: a late answer to an abandoned request must not pass for the answer to the next
one.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from ecatd.base.errors import EcatError, NoAnswerError, SdoAbortError, StateError
from ecatd.etg.error_codes import abort_error

from .conversation import Conversation
from .mailbox import HEADER_BYTES, Mailbox, Protocol
from .mailbox_queue import MailboxQueue

T = TypeVar("T")

_COLLECTED_MAX = 16  # most messages that are read in a row, if a slave sends them unasked
TRIES_OF_QUEUE = 0
"""Stands for `MailboxQueue.tries`, the default for uploads, which may be repeated."""

_SYNCHRONIZE_S = 2.0
"""Seconds that a slow slave has to answer the requests that were abandoned."""

_DOWNLOAD_S = 5.0
"""Seconds that a slave has for a part of a download. Some slaves write their flash before they
answer."""

OBJECT_MAX = 1 << 16
"""Most bytes of an object. A slave that announces more is broken."""

_SHOWN = 16
"""Most bytes of an object in a message of the log."""

_MAILBOX_LEAST = 16  # mailbox header, CoE header, SDO
_COE_HEADER = 2
_IDENTITY = 0x1018  # only `_synchronize` reads its subindices from 0x80 on
_EMERGENCY, _SDO_REQUEST, _SDO_RESPONSE = 1, 2, 3

_SDO = struct.Struct("<BHB4x")
_SDO_SIZE = 8
_SEGMENT_LEAST = 7
_COMMAND, _SEGMENT, _UPLOAD, _UPLOAD_SEGMENT, _ABORT = 0xE0, 0x00, 0x40, 0x60, 0x80
_DOWNLOAD, _DOWNLOADED, _DOWNLOADED_SEGMENT = 0x20, 0x60, 0x20
_COMPLETE, _EXPEDITED, _SIZED, _TOGGLE, _LAST = 0x10, 0x02, 0x01, 0x10, 0x01
_EXPEDITED_BYTES = 4


class UnsizedBytes(bytes):
    """The four bytes of an answer that does not say how many of them are meant."""

    def cut(self, size: int) -> bytes:
        """Returns the bytes of a type, if it has at most four."""
        return bytes(self[:size]) if 0 < size <= _EXPEDITED_BYTES else bytes(self)


class Coe:
    """CoE of one slave.

    Args:
        position: Position of the slave, for messages.
        station: Its configured station address.
        queue: The queue and the state that all conversations with the slave share.
        alone: See `Mailbox`.

    Attributes:
        position: The argument `position`.
        queue: The argument `queue`.
        mailbox: The mailbox of the slave.
        emergencies: Error code and error register of each emergency that came between answers.
    """

    def __init__(
        self, position: int, station: int, queue: MailboxQueue, *, alone: bool = False
    ) -> None:
        self.position = position
        self.queue = queue
        self.mailbox = Mailbox(station, queue, alone=alone)
        self.mailbox.on_other = self.note
        self.emergencies: list[tuple[int, int]] = []
        self._patience_s: float | None = None  # for requests that give no time of their own

    def converse(self, part: Callable[[], Conversation[T]]) -> Conversation[T]:
        """Holds a whole conversation: waits for its turn, opens the mailbox, and runs `part`.

        Raises:
            NoAnswerError: The slave does not answer, or other conversations with it take too long.
            StateError: No mailbox for CoE is set up in the slave.
        """
        with self.queue.join() as turn:
            yield from self.mailbox.wait_for_turn(turn)
            yield from self.open()
            return (yield from part())

    def open(self) -> Conversation[None]:
        """Reads address and size of the mailbox from the sync managers.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: No mailbox for CoE is set up in the slave.
        """
        try:
            yield from self.mailbox.open(_MAILBOX_LEAST)
        except EcatError as error:
            raise type(error)(f"slave {self.position} has CoE or SoE, but {error}") from error

    def collect(self) -> Conversation[None]:
        """Reads messages without a request: they are emergencies, or late answers.

        Raises:
            NoAnswerError: The slave does not answer, or other conversations with it take too long.
            StateError: No mailbox for CoE is set up in the slave, or a message is malformed.
        """
        with self.queue.join() as turn:
            yield from self.mailbox.wait_for_turn(turn)
            late = self.queue.unanswered
            yield from self.open()
            found = yield from self.mailbox.collect(_COLLECTED_MAX)
            take = self._split(lambda service, _: service == _EMERGENCY)
            expected = [kind == Protocol.COE and bool(take(body)) for kind, body in found]
            # Emergencies are no answers, so the next request need not look for a late one.
            if all(expected) and len(found) < _COLLECTED_MAX:
                self.queue.unanswered = late

    def note(self, protocol: int, body: bytes) -> None:
        """Adds a message to `emergencies` if it is one; for messages during another protocol."""
        if protocol == Protocol.COE:
            with suppress(StateError):  # a malformed message is no emergency
                self._split(lambda _service, _data: None)(body)

    # --- SDO transfers -------------------------------------------------------------------------

    def upload(
        self,
        index: int,
        subindex: int,
        *,
        complete: bool = False,
        tries: int = TRIES_OF_QUEUE,
        size: int = 0,
    ) -> Conversation[bytes]:
        """Reads an object. Asks again if no answer comes, or a malformed one.

        Args:
            index: Index of the object.
            subindex: The subindex, or the first one of a complete access.
            complete: Whether to read the whole object (complete access).
            tries: Number of tries; 0 for `MailboxQueue.tries`.
            size: Bytes of its type. They count if the slave does not say how many of the four bytes
                of an expedited answer are meant. 0: the type is not known; then all four bytes are
                returned, as `UnsizedBytes`.

        Raises:
            SdoAbortError: The slave refused the request.
            NoAnswerError: It did not answer.
            StateError: Its answer was malformed.
        """
        where = self._object(index, subindex)
        return self.insist(
            where, tries, lambda: self._logged_upload(index, subindex, complete, size)
        )

    def download(
        self, index: int, subindex: int, data: bytes, *, complete: bool = False
    ) -> Conversation[None]:
        """Writes an object. Never repeats the request, since each write may have an effect.

        Raises as `upload`.

        Args:
            index: Index of the object.
            subindex: The subindex, or the first one of a complete access.
            data: The value to write.
            complete: Whether to write the whole object (complete access).
        """
        where = self._object(index, subindex)
        self._log(f"{where}: download of {_bytes(data)}")
        return self.insist(where, 1, lambda: self._download(index, subindex, data, complete))

    def _object(self, index: int, subindex: int) -> str:
        return f"slave {self.position}, 0x{index:04X}:{subindex:02X}"

    def insist(
        self, where: str, tries: int, part: Callable[[], Conversation[T]]
    ) -> Conversation[T]:
        """Runs `part` until it succeeds, at most `tries` times. Its errors begin with `where`.

        It is run again if there was no answer or a malformed one, but not after an SDO abort.
        """
        problem: NoAnswerError | StateError | None = None
        tries = tries or self.queue.tries
        self._patience_s = None
        for number in range(1, tries + 1):
            try:
                yield from self._synchronize()
            except (NoAnswerError, StateError) as error:
                problem = problem if isinstance(problem, StateError) else error
                break
            try:
                result = yield from part()
                self.queue.unanswered = False
                return result
            except SdoAbortError as abort:
                self.queue.unanswered = False
                self._log(f"{where}: refused: {abort}")
                raise abort_error(abort.code, f"{where}: {abort}") from abort
            except (NoAnswerError, StateError) as error:
                problem = error
                self._log(f"{where}: try {number} of {tries}: {error}")
                self._patience_s = _SYNCHRONIZE_S  # the slave may only be slow
        assert problem is not None
        raise type(problem)(f"{where}: {problem}") from problem

    def _synchronize(self) -> Conversation[None]:
        """Waits until no late answer to an abandoned request can come any more.

        If the same object is read again, a late answer must not pass for the new one. So this sends
        a request that differs from all others, and waits for its answer. Slaves answer in order, so
        all late answers have come before that.
        """
        if not self.queue.unanswered:
            return
        self._log(f"slave {self.position}: waits until no late answer can come any more")
        request = _SDO.pack(_UPLOAD, _IDENTITY, next(self.queue.marks))

        def take(service: int, sdo: bytes) -> bool | None:
            is_sdo = service in (_SDO_REQUEST, _SDO_RESPONSE) and len(sdo) >= _SDO_SIZE
            return True if is_sdo and sdo[1:4] == request[1:4] else None

        yield from self.ask(_SDO_REQUEST, request, take, _SYNCHRONIZE_S)
        self.queue.unanswered = False

    def _logged_upload(
        self, index: int, subindex: int, complete: bool, size: int
    ) -> Conversation[bytes]:
        data = yield from self._upload(index, subindex, complete)
        if size and isinstance(data, UnsizedBytes):
            data = data.cut(size)
        self._log(f"{self._object(index, subindex)}: upload of {_bytes(data)}")
        return data

    def _log(self, text: str) -> None:
        self.queue.log.debug(text, slaves=[self.position])

    def _upload(self, index: int, subindex: int, complete: bool) -> Conversation[bytes]:
        head = _SDO.pack(_UPLOAD | (_COMPLETE if complete else 0), index, subindex)

        # In the answer to a complete access, some slaves set the bit for it, and some do not.
        mask = _COMMAND if complete else _COMMAND | _COMPLETE

        def is_answer(sdo: bytes) -> bool:
            return (sdo[0] ^ head[0]) & mask == 0 and sdo[1:4] == head[1:4]

        first = yield from self._ask_sdo(head, is_answer)
        if first[0] & _EXPEDITED:
            if not first[0] & _SIZED:  # then its bits for unused bytes mean nothing (ETG.1000.6)
                return UnsizedBytes(first[4:8])
            return first[4 : 8 - (first[0] >> 2 & 3)]
        (size,) = struct.unpack_from("<I", first, 4)
        if size > OBJECT_MAX:
            raise StateError(f"the slave announces {size} bytes, more than {OBJECT_MAX}")
        data, toggle, last = first[_SDO_SIZE:], 0, False
        while len(data) < size and not last:
            part = yield from self._ask_sdo(
                _SDO.pack(_UPLOAD_SEGMENT | toggle, 0, 0),
                lambda sdo: sdo[0] & _COMMAND == _SEGMENT,
            )
            if part[0] & _TOGGLE != toggle:
                raise StateError("the slave answered with a wrong frame: a segment is missing")
            unused = part[0] >> 1 & 7 if len(part) == 1 + _SEGMENT_LEAST else 0
            last = bool(part[0] & _LAST)
            if not last and len(part) - unused <= 1:
                raise StateError("the slave answered with a wrong frame: a segment without data")
            data += part[1 : len(part) - unused]
            toggle ^= _TOGGLE
        if len(data) < size:
            raise StateError(f"the slave announces {size} bytes and sends {len(data)}")
        return data[:size]

    def _download(
        self, index: int, subindex: int, data: bytes, complete: bool
    ) -> Conversation[None]:
        head = struct.pack("<BHB", _DOWNLOAD | (_COMPLETE if complete else 0), index, subindex)

        def is_answer(sdo: bytes) -> bool:
            return sdo[0] & _COMMAND == _DOWNLOADED and sdo[1:4] == head[1:4]

        if 0 < len(data) <= _EXPEDITED_BYTES and not complete:
            command = head[0] | _EXPEDITED | _SIZED | (_EXPEDITED_BYTES - len(data)) << 2
            request = bytes([command]) + head[1:] + data.ljust(_EXPEDITED_BYTES, b"\0")
            yield from self._ask_sdo(request, is_answer, _DOWNLOAD_S)
            return
        room = self.mailbox.size - HEADER_BYTES - _COE_HEADER - _SDO_SIZE
        request = bytes([head[0] | _SIZED]) + head[1:] + struct.pack("<I", len(data)) + data[:room]
        yield from self._ask_sdo(request, is_answer, _DOWNLOAD_S)
        toggle, sent = 0, room
        while sent < len(data):
            part = data[sent : sent + room + _SEGMENT_LEAST]
            sent += len(part)
            unused = max(0, _SEGMENT_LEAST - len(part))
            command = _SEGMENT | toggle | unused << 1 | (_LAST if sent == len(data) else 0)
            answer = yield from self._ask_sdo(
                bytes([command]) + part.ljust(_SEGMENT_LEAST, b"\0"),
                lambda sdo: sdo[0] & _COMMAND == _DOWNLOADED_SEGMENT,
                _DOWNLOAD_S,
            )
            if answer[0] & _TOGGLE != toggle:
                raise StateError("the slave answered with a wrong frame: a segment is missing")
            toggle ^= _TOGGLE

    def _ask_sdo(
        self,
        request: bytes,
        is_answer: Callable[[bytes], bool],
        patience_s: float | None = None,
    ) -> Conversation[bytes]:
        begins = request[0] & _COMMAND in (_UPLOAD, _DOWNLOAD)

        def take(service: int, sdo: bytes) -> bytes | None:
            if service not in (_SDO_REQUEST, _SDO_RESPONSE):
                return None
            if len(sdo) < _SDO_SIZE:
                raise StateError(f"the slave answered with a wrong frame: {len(sdo)} bytes of SDO")
            # Slaves send an abort as a request or as a response. The abort of a segment need not
            # carry index and subindex.
            if sdo[0] & _COMMAND == _ABORT:
                if begins and sdo[1:4] != request[1:4]:
                    return None
                raise abort_error(int.from_bytes(sdo[4:8], "little"))
            return sdo if service == _SDO_RESPONSE and is_answer(sdo) else None

        return self.ask(_SDO_REQUEST, request, take, patience_s)

    # --- CoE -----------------------------------------------------------------------------------

    def ask(
        self,
        service: int,
        request: bytes,
        take: Callable[[int, bytes], T | None],
        patience_s: float | None = None,
    ) -> Conversation[T]:
        """Sends a message and waits for its answer; raises as `Mailbox.ask`.

        Args:
            service: The CoE service of the message.
            request: What follows the CoE header.
            take: Decodes the CoE service and the data of a message; returns None if it is not the
                answer.
            patience_s: Seconds that the slave has; None: as usual.
        """
        self.queue.unanswered = True
        body = struct.pack("<H", service << 12) + request
        patience_s = self._patience_s if patience_s is None else patience_s
        return self.mailbox.ask(Protocol.COE, body, self._split(take), patience_s)

    def more(self, take: Callable[[int, bytes], T | None]) -> Conversation[T]:
        """Waits for a further part of an answer; `take` and errors as with `ask`."""
        return self.mailbox.more(Protocol.COE, self._split(take))

    def _split(self, take: Callable[[int, bytes], T | None]) -> Callable[[bytes], T | None]:
        """Returns a function that calls `take` with the CoE service and the data of a message.

        It also adds emergencies to `emergencies`.
        """

        def split(body: bytes) -> T | None:
            if len(body) < _COE_HEADER:
                raise StateError(f"the slave answered with a wrong frame: {len(body)} bytes of CoE")
            service = int.from_bytes(body[:_COE_HEADER], "little") >> 12
            if service == _EMERGENCY and len(body) >= _COE_HEADER + 3:
                self.emergencies.append(struct.unpack_from("<HB", body, _COE_HEADER))
            return take(service, body[_COE_HEADER:])

        return split


def _bytes(data: bytes) -> str:
    """Returns a text with the first bytes of an object, for the log."""
    more = " ..." if len(data) > _SHOWN else ""
    return f"{len(data)} bytes: {data[:_SHOWN].hex(' ')}{more}"
