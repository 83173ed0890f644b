"""CANopen over EtherCAT (ETG.1000.6, "CoE"): SDO transfers and the SDO information service.

Each of them is a part of a conversation with one slave. `talks.talk_all` runs the conversations
with many slaves at the same time. An answer is accepted only for the object that was asked for: a
late answer to an abandoned request must not pass for the answer to the next one.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, TypeVar

from ecatd.model.errors import EcatError, NoAnswerError, SdoAbortError, StateError

from .line import Line
from .mailbox import HEADER_BYTES, Mailbox, Protocol
from .talks import Talk

T = TypeVar("T")

_COLLECTED_MAX = 16  # messages in a row, of a slave that sends without being asked
_TRIES = 0
"""Stands for `Line.tries`: of an upload, which changes nothing and so can be repeated."""

_SYNCHRONIZE_S = 2.0
"""Seconds a slave has to answer the requests that were abandoned because it was slow."""

_DOWNLOAD_S = 5.0
"""Seconds a slave has for a part of a download; some write their flash before they answer."""

_MOST = 1 << 16
"""Most bytes of an object; a slave that announces more is broken."""

_SHOWN = 16
"""Bytes of an object in a message of the log."""

_MAILBOX_LEAST = 16  # mailbox header, CoE header, SDO
_COE_HEADER = 2
_IDENTITY = 0x1018  # nobody asks for its subindices from 0x80 on, except `_synchronize`
_EMERGENCY, _SDO_REQUEST, _SDO_RESPONSE, _INFORMATION = 1, 2, 3, 8

_SDO = struct.Struct("<BHB4x")
_SDO_SIZE = 8
_SEGMENT_LEAST = 7
_COMMAND, _SEGMENT, _UPLOAD, _UPLOAD_SEGMENT, _ABORT = 0xE0, 0x00, 0x40, 0x60, 0x80
_DOWNLOAD, _DOWNLOADED, _DOWNLOADED_SEGMENT = 0x20, 0x60, 0x20
_COMPLETE, _EXPEDITED, _SIZED, _TOGGLE, _LAST = 0x10, 0x02, 0x01, 0x10, 0x01
_EXPEDITED_BYTES = 4

_INFO = struct.Struct("<BxH")
_INFO_MORE = 0x80
_GET_LIST, _GET_OBJECT, _GET_ENTRY, _INFO_ERROR = 1, 3, 5, 7
ALL_OBJECTS, OUTPUT_OBJECTS, INPUT_OBJECTS = 1, 2, 3
"""Lists of objects of the SDO information service: all, and those that RxPDOs or TxPDOs can map."""
_ACCESS_CATEGORY_MAPPING = 0x07  # what an entry description should contain: no values
_UNIT, _VALUES = 0x08, (0x10, 0x20, 0x40)  # default, minimum, maximum
_EVERYTHING = 0x7F


class ObjectDescription(NamedTuple):
    """An object as the SDO information service describes it.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index.
        max_subindex: Its highest subindex; 0: a variable.
        code: Its object code: 7 variable, 8 array, 9 record.
    """

    name: str
    data_type: int
    max_subindex: int
    code: int


class EntryDescription(NamedTuple):
    """An entry of an object as the SDO information service describes it.

    Attributes:
        name: Its name.
        data_type: Its CoE data type index; 0: there is no such entry.
        bit_length: Its length in bits.
        access: Its access rights, as in `DictionaryEntry`, and so with the others.
    """

    name: str
    data_type: int
    bit_length: int
    access: int
    unit: int = 0
    default: bytes | None = None
    minimum: bytes | None = None
    maximum: bytes | None = None


class Coe:
    """CoE of one slave.

    Args:
        position: Its position, for messages.
        station: Its configured station address.
        line: The state and the queue that all conversations with the slave share.
        alone: See `Mailbox`.

    Attributes:
        line: As given.
        mailbox: Its mailbox.
        emergencies: Error code and error register of each emergency that came between answers.
    """

    def __init__(self, position: int, station: int, line: Line, *, alone: bool = False) -> None:
        self.line = line
        self.mailbox = Mailbox(station, line, alone=alone)
        self.emergencies: list[tuple[int, int]] = []
        self._position = position
        self._patience_s: float | None = None  # for requests that give no time of their own

    def talk(self, part: Callable[[], Talk[T]]) -> Talk[T]:
        """Holds a whole conversation: waits for its turn, opens the mailbox, and runs `part`.

        Raises:
            NoAnswerError: The slave does not answer, or other conversations with it take too long.
            StateError: No mailbox for CoE is set up in the slave.
        """
        with self.line.join() as turn:
            yield from self.mailbox.wait_for_turn(turn)
            yield from self.open()
            return (yield from part())

    def open(self) -> Talk[None]:
        """Reads from the sync managers where the mailbox is.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: No mailbox for CoE is set up in the slave.
        """
        try:
            yield from self.mailbox.open(_MAILBOX_LEAST)
        except EcatError as error:
            raise type(error)(f"slave {self._position} has CoE, but {error}") from error

    def collect(self) -> Talk[None]:
        """Reads the messages that nobody has asked for: they are emergencies, or late answers.

        Raises:
            NoAnswerError: The slave does not answer, or other conversations with it take too long.
            StateError: No mailbox for CoE is set up in the slave, or a message is malformed.
        """
        with self.line.join() as turn:
            yield from self.mailbox.wait_for_turn(turn)
            late = self.line.unanswered
            yield from self.open()
            found = yield from self.mailbox.collect(_COLLECTED_MAX)
            take = self._split(lambda service, _: service == _EMERGENCY)
            expected = [kind == Protocol.COE and bool(take(body)) for kind, body in found]
            # Emergencies are no answers, so the next request need not look for a late one.
            if all(expected) and len(found) < _COLLECTED_MAX:
                self.line.unanswered = late

    def note(self, protocol: int, body: bytes) -> None:
        """Adds an emergency to `emergencies` that came while another protocol was spoken."""
        if protocol == Protocol.COE:
            with suppress(StateError):  # malformed: no emergency
                self._split(lambda _service, _data: None)(body)

    # --- SDO transfers -------------------------------------------------------------------------

    def upload(
        self, index: int, subindex: int, *, complete: bool = False, tries: int = _TRIES
    ) -> Talk[bytes]:
        """Reads an object. Asks again if no answer comes, or a malformed one.

        Args:
            index: Its index.
            subindex: The subindex, or the first one of a complete access.
            complete: Whether to read the whole object (complete access).
            tries: How many times to ask; 0: as often as the line of the slave says.

        Raises:
            SdoAbortError: The slave refused.
            NoAnswerError: It did not answer.
            StateError: Its answer was malformed.
        """
        where = self._object(index, subindex)
        return self._insist(where, tries, lambda: self._told_upload(index, subindex, complete))

    def download(
        self, index: int, subindex: int, data: bytes, *, complete: bool = False
    ) -> Talk[None]:
        """Writes an object. Never asks again, since each write may have an effect.

        Raises as `upload`.

        Args:
            index: Its index.
            subindex: The subindex, or the first one of a complete access.
            data: The value to write.
            complete: Whether to write the whole object (complete access).
        """
        where = self._object(index, subindex)
        self._tell(f"{where}: download of {_bytes(data)}")
        return self._insist(where, 1, lambda: self._download(index, subindex, data, complete))

    def _object(self, index: int, subindex: int) -> str:
        return f"slave {self._position}, 0x{index:04X}:{subindex:02X}"

    def _insist(self, where: str, tries: int, talk: Callable[[], Talk[T]]) -> Talk[T]:
        """Runs `talk` until it succeeds, at most `tries` times; errors then begin with `where`.

        Tries again after no answer or a malformed one, but not after an SDO abort.
        """
        problem: NoAnswerError | StateError | None = None
        tries = tries or self.line.tries
        self._patience_s = None
        for number in range(1, tries + 1):
            try:
                yield from self._synchronize()
            except (NoAnswerError, StateError) as error:
                problem = problem if isinstance(problem, StateError) else error
                break
            try:
                result = yield from talk()
                self.line.unanswered = False
                return result
            except SdoAbortError as abort:
                self.line.unanswered = False
                self._tell(f"{where}: refused: {abort}")
                raise SdoAbortError(abort.code, f"{where}: {abort}") from abort
            except (NoAnswerError, StateError) as error:
                problem = error
                self._tell(f"{where}: try {number} of {tries}: {error}")
                self._patience_s = _SYNCHRONIZE_S  # the slave may only be slow
        assert problem is not None
        raise type(problem)(f"{where}: {problem}") from problem

    def _synchronize(self) -> Talk[None]:
        """Waits until no late answer to an abandoned request can come any more.

        If the same object is asked for again, a late answer must not pass for the new one. So this
        sends a request that nobody else sends, and waits for its answer. Slaves answer in order,
        so all late answers have come before it.
        """
        if not self.line.unanswered:
            return
        self._tell(f"slave {self._position}: waits until no late answer can come any more")
        request = _SDO.pack(_UPLOAD, _IDENTITY, next(self.line.marks))

        def take(service: int, sdo: bytes) -> bool | None:
            is_sdo = service in (_SDO_REQUEST, _SDO_RESPONSE) and len(sdo) >= _SDO_SIZE
            return True if is_sdo and sdo[1:4] == request[1:4] else None

        yield from self._ask(_SDO_REQUEST, request, take, _SYNCHRONIZE_S)
        self.line.unanswered = False

    def _told_upload(self, index: int, subindex: int, complete: bool) -> Talk[bytes]:
        data = yield from self._upload(index, subindex, complete)
        self._tell(f"{self._object(index, subindex)}: upload of {_bytes(data)}")
        return data

    def _tell(self, text: str) -> None:
        self.line.log.debug(text, slaves=[self._position])

    def _upload(self, index: int, subindex: int, complete: bool) -> Talk[bytes]:
        head = _SDO.pack(_UPLOAD | (_COMPLETE if complete else 0), index, subindex)

        # In the answer to a complete access, some slaves set the bit for it, and some do not.
        mask = _COMMAND if complete else _COMMAND | _COMPLETE

        def is_answer(sdo: bytes) -> bool:
            return (sdo[0] ^ head[0]) & mask == 0 and sdo[1:4] == head[1:4]

        first = yield from self._ask_sdo(head, is_answer)
        if first[0] & _EXPEDITED:
            return first[4 : 8 - (first[0] >> 2 & 3)]
        (size,) = struct.unpack_from("<I", first, 4)
        if size > _MOST:
            raise StateError(f"the slave announces {size} bytes, more than {_MOST}")
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

    def _download(self, index: int, subindex: int, data: bytes, complete: bool) -> Talk[None]:
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
    ) -> Talk[bytes]:
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
                raise SdoAbortError(int.from_bytes(sdo[4:8], "little"))
            return sdo if service == _SDO_RESPONSE and is_answer(sdo) else None

        return self._ask(_SDO_REQUEST, request, take, patience_s)

    # --- SDO information -----------------------------------------------------------------------

    def list_objects(self, tries: int = _TRIES, kind: int = ALL_OBJECTS) -> Talk[list[int]]:
        """Reads the indices of all objects, or those of another list.

        Raises as `describe_object`.
        """

        def ask() -> Talk[list[int]]:
            wanted = struct.pack("<H", kind)
            body = yield from self._ask_information(_GET_LIST, wanted, wanted, 2)
            return [index for (index,) in struct.iter_unpack("<H", body[2 : len(body) & ~1])]

        return self._insist(f"slave {self._position}, list of objects", tries, ask)

    def describe_object(self, index: int, tries: int = _TRIES) -> Talk[ObjectDescription]:
        """Reads the description of an object.

        Args:
            index: Its index.
            tries: How many times to ask.

        Raises:
            SdoAbortError: There is no such object.
            NoAnswerError: The slave does not answer; perhaps it has no SDO information service.
            StateError: Its answer was malformed, or a mailbox error: it has no such service.
        """
        wanted = struct.pack("<H", index)

        def describe() -> Talk[ObjectDescription]:
            body = yield from self._ask_information(_GET_OBJECT, wanted, wanted, 6)
            data_type, max_subindex, code = struct.unpack_from("<HBB", body, 2)
            return ObjectDescription(_text(body[6:]), data_type, max_subindex, code)

        where = f"slave {self._position}, description of 0x{index:04X}"
        return self._insist(where, tries, describe)

    def describe_entry(
        self, index: int, subindex: int, tries: int = _TRIES, *, values: bool = False
    ) -> Talk[EntryDescription]:
        """Reads the description of an entry of an object; raises as `describe_object`.

        Args:
            index: Its index.
            subindex: Its subindex.
            tries: How many times to ask.
            values: Whether to ask for unit, default and limits, too.
        """
        address = struct.pack("<HB", index, subindex)
        wanted = address + bytes([_EVERYTHING if values else _ACCESS_CATEGORY_MAPPING])

        def describe() -> Talk[EntryDescription]:
            body = yield from self._ask_information(_GET_ENTRY, wanted, address, 10)
            given, data_type, bits, access = struct.unpack_from("<BHHH", body, 3)
            at, size = 10, (bits + 7) // 8
            unit = 0
            if given & _UNIT:
                unit, at = int.from_bytes(body[at : at + 4], "little"), at + 4
            found: list[bytes | None] = []
            for bit in _VALUES:
                part = body[at : at + size] if given & bit else b""
                found.append(part if part and len(part) == size else None)
                at += size if given & bit else 0
            return EntryDescription(_text(body[at:]), data_type, bits, access, unit, *found)

        where = f"slave {self._position}, description of 0x{index:04X}:{subindex:02X}"
        return self._insist(where, tries, describe)

    def _ask_information(self, opcode: int, wanted: bytes, begin: bytes, least: int) -> Talk[bytes]:
        """Asks for information, and returns the answer, joined from its fragments.

        Args:
            opcode: The service; its answer has the next higher opcode.
            wanted: The data of the request.
            begin: What the data of the answer begins with.
            least: Bytes that the answer must have.
        """
        body = b""

        def take(service: int, part: bytes) -> int | None:
            """Adds a fragment to `body`; returns how many fragments are still to come."""
            nonlocal body
            if service != _INFORMATION:
                return None
            if len(part) < _INFO.size:
                raise StateError(
                    f"the slave answered with a wrong frame: {len(part)} bytes of SDO information"
                )
            kind, left = _INFO.unpack_from(part)
            data = part[_INFO.size :]
            if kind & ~_INFO_MORE == _INFO_ERROR:
                raise SdoAbortError(int.from_bytes(data[:4], "little"))
            if kind & ~_INFO_MORE != opcode + 1 or not (body or data.startswith(begin)):
                return None
            body += data
            if len(body) > _MOST:
                raise StateError(f"the slave describes an object with more than {_MOST} bytes")
            return left if kind & _INFO_MORE else 0

        request = _INFO.pack(opcode, 0) + wanted
        left = yield from self._ask(_INFORMATION, request, take)
        while left:
            left = yield from self.mailbox.more(Protocol.COE, self._split(take))
        if len(body) < least:
            raise StateError(
                f"the slave answered with a wrong frame: a description of {len(body)} bytes"
            )
        return body

    # --- CoE -----------------------------------------------------------------------------------

    def _ask(
        self,
        service: int,
        request: bytes,
        take: Callable[[int, bytes], T | None],
        patience_s: float | None = None,
    ) -> Talk[T]:
        self.line.unanswered = True
        body = struct.pack("<H", service << 12) + request
        patience_s = self._patience_s if patience_s is None else patience_s
        return self.mailbox.ask(Protocol.COE, body, self._split(take), patience_s)

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


def _text(name: bytes) -> str:
    return name.split(b"\0", 1)[0].decode("latin-1")


def _bytes(data: bytes) -> str:
    """Data of an object, for the log: as many as fit into a line."""
    more = " ..." if len(data) > _SHOWN else ""
    return f"{len(data)} bytes: {data[:_SHOWN].hex(' ')}{more}"
