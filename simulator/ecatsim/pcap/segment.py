"""The slaves of a captured segment, as far as the datagrams tell."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

from ecatd.etg.sii import Sii
from ecatd.etg.sii_categories import FIRST_CATEGORY
from ecatd.etg.sii_check import check_sii
from ecatd.etg.sii_reader import read_sii

from .mailboxes import Mailbox
from .wire import Datagram, Exchange

_AP, _FP, _B, _L = (1, 2, 3, 13), (4, 5, 6, 14), (7, 8, 9), (10, 11, 12)
_READS, _WRITES = (1, 3, 4, 6, 7, 9), (2, 3, 5, 6, 8, 9)
_DISTRIBUTES = (13, 14)  # one slave is read, those behind it are written
LRD, LWR, LRW = _L
_REGISTERS = 0x1000
_STATION, _AL_CONTROL, _AL_STATUS, _AL_CODE = 0x0010, 0x0120, 0x0130, 0x0134
_SII_CONTROL, _SII_ADDRESS, _SII_DATA = 0x0502, 0x0504, 0x0508
_SII_READ, _SII_BUSY, _SII_8_BYTES = 0x01, 0x80, 0x40
_RX_ERRORS, _RX_ERRORS_END = 0x0300, 0x0314
_SYNC_MANAGERS, _FMMUS = 0x0800, 0x0600
_END = 0xFFFF
_CATEGORY_HEAD = 2  # words
_SLAVES_MAX, _AREAS_MAX, _CHANGES_MAX, _TIMES_MAX = 4096, 4096, 100_000, 1_000_000


@dataclass(frozen=True, slots=True)
class StateChange:
    """An AL status that a slave, or all of them, had from a time on.

    Attributes:
        time_ns: When the master read it.
        status: The AL status: the state, and bit 4 for an error.
        code: The AL status code, 0 if it was not read.
    """

    time_ns: int
    status: int
    code: int


@dataclass(frozen=True, slots=True)
class SyncManager:
    """A sync manager as the master has set it up.

    Attributes:
        number: Its number.
        start: Its address.
        size: Its bytes.
        control: Its control register.
        enabled: Whether it is switched on.
    """

    number: int
    start: int
    size: int
    control: int
    enabled: bool

    @property
    def outputs(self) -> bool:
        """Whether the master writes it."""
        return self.control & 0x0C == 0x04

    @property
    def mailbox(self) -> bool:
        """Whether it is a mailbox."""
        return self.control & 0x03 == 0x02


@dataclass(frozen=True, slots=True)
class Fmmu:
    """An FMMU as the master has set it up.

    Attributes:
        logical: Its logical address.
        size: Its bytes.
        physical: Its address in the slave.
        outputs: Whether it is written.
    """

    logical: int
    size: int
    physical: int
    outputs: bool


@dataclass(slots=True)
class Slave:
    """What is known about one slave.

    Attributes:
        position: Its position on the wire; None if no datagram has told it.
        station: Its station address, or 0.
        words: Words of its EEPROM that the master has read.
        states: Its AL status over time.
        mailbox: Its mailbox.
    """

    position: int | None
    station: int = 0
    words: dict[int, int] = field(default_factory=dict)
    states: list[StateChange] = field(default_factory=list)
    mailbox: Mailbox = field(default_factory=Mailbox)
    _memory: bytearray = field(default_factory=lambda: bytearray(_REGISTERS))
    _known: bytearray = field(default_factory=lambda: bytearray(_REGISTERS))
    _sii_at: int | None = None

    def register(self, address: int, size: int) -> bytes | None:
        """The last value of registers that was read or written; None if not all are known."""
        if not all(self._known[address : address + size]):
            return None
        return bytes(self._memory[address : address + size])

    def number(self, address: int, size: int) -> int | None:
        """The same as a number."""
        data = self.register(address, size)
        return None if data is None else int.from_bytes(data, "little")

    def store(self, address: int, data: bytes) -> None:
        """Notes the content of registers."""
        end = min(address + len(data), _REGISTERS)
        if address < end:
            self._memory[address:end] = data[: end - address]
            self._known[address:end] = b"\1" * (end - address)

    @property
    def sync_managers(self) -> list[SyncManager]:
        """The sync managers that the master has set up."""
        found = []
        for number in range(16):
            data = self.register(_SYNC_MANAGERS + 8 * number, 7)
            if data is not None and any(data):
                start, size, control, _, enable = struct.unpack("<HHBBB", data)
                found.append(SyncManager(number, start, size, control, bool(enable & 1)))
        return found

    @property
    def fmmus(self) -> list[Fmmu]:
        """The FMMUs that are switched on."""
        found = []
        for number in range(16):
            data = self.register(_FMMUS + 16 * number, 13)
            if data is not None and data[12] & 1:
                logical, size, _, _, physical, _, kind, _ = struct.unpack("<IHBBHBBB", data)
                found.append(Fmmu(logical, size, physical, kind == 2))
        return found

    # --- its EEPROM ----------------------------------------------------------------------------

    def note_command(self) -> None:
        """Notes that the master has written the control register of the EEPROM."""
        control, address = self.number(_SII_CONTROL, 2), self.number(_SII_ADDRESS, 4)
        if control is not None and address is not None and control >> 8 & 7 == _SII_READ:
            self._sii_at = address
            self._known[_SII_CONTROL + 1] = 0  # busy until the slave says otherwise

    def note_words(self, size: int) -> None:
        """Notes that the master has read the data register of the EEPROM."""
        status = self.register(_SII_CONTROL, 2)
        if self._sii_at is None or (status is not None and status[1] & _SII_BUSY):
            return
        most = 8 if status is None or status[0] & _SII_8_BYTES else 4
        data = self.register(_SII_DATA, min(size, most) & ~1) or b""
        for at in range(0, len(data), 2):
            self.words[self._sii_at + at // 2] = int.from_bytes(data[at : at + 2], "little")

    @property
    def image(self) -> bytes | None:
        """The content of its EEPROM, if the master has read the categories to their end.

        Words of the fixed part that were not read are 0.
        """
        at = FIRST_CATEGORY
        while at in self.words and self.words[at] != _END:
            length = self.words.get(at + 1)
            if length is None or at > 0x40000:
                return None
            at += 2 + length
        if at not in self.words or any(word not in self.words for word in range(0x40, at)):
            return None
        if any(word not in self.words for word in range(0x08, 0x0E)):
            return None
        return b"".join(self.words.get(word, 0).to_bytes(2, "little") for word in range(at + 1))

    @property
    def sii(self) -> Sii:
        """What is known of its EEPROM. What was not read is empty, or left out."""
        image = self.image
        return read_sii(self._read_words) if image is None else check_sii(image)

    def _read_words(self, word: int, count: int) -> bytes:
        # Type and length of a category are read alone: without them the chain ends.
        unread = _END if count <= _CATEGORY_HEAD else 0
        words = range(word, word + count)
        return b"".join(self.words.get(at, unread).to_bytes(2, "little") for at in words)

    @property
    def identity(self) -> tuple[int, int, int, int] | None:
        """Vendor, product, revision and serial number; None if they are not known."""
        if all(word in self.words for word in range(0x08, 0x0E)):
            sii = self.sii
            return sii.vendor, sii.product, sii.revision, sii.serial
        found = {s.subindex: s.data for s in self.mailbox.sdos if s.index == 0x1018 and s.data}
        if 1 in found and 2 in found:
            one, two, three, four = (
                int.from_bytes((found.get(n) or b"")[:4], "little") for n in range(1, 5)
            )
            return one, two, three, four
        return None

    @property
    def name(self) -> str:
        """Its order code or name, as far as it is known."""
        sii = self.sii
        if sii.order or sii.name:
            return sii.order or sii.name
        for sdo in self.mailbox.sdos:
            if sdo.index == 0x1008 and sdo.data and not sdo.writes:
                return sdo.data.split(b"\0", 1)[0].decode("latin-1")
        return ""

    @property
    def port_errors(self) -> bytes:
        """Error counters 0x0300 to 0x0313 as last read; bytes that were not read are 0."""
        return bytes(self._memory[_RX_ERRORS:_RX_ERRORS_END])


@dataclass(slots=True)
class Area:
    """Process data that the master exchanges with one datagram.

    Attributes:
        command: LRD, LWR or LRW.
        address: The first logical address.
        size: Bytes.
        counters: How often each working counter came.
        lost: How often it did not come back.
        last: The data as they came back last.
        changed: A byte for each byte: whether it had different values.
        times_ns: When it was sent.
    """

    command: int
    address: int
    size: int
    counters: Counter[int] = field(default_factory=Counter)
    lost: int = 0
    last: bytes = b""
    changed: bytearray = field(default_factory=bytearray)
    times_ns: list[int] = field(default_factory=list)

    def take(self, exchange: Exchange) -> None:
        """Notes an exchange."""
        if len(self.times_ns) < _TIMES_MAX:
            self.times_ns.append(exchange.time_ns)
        answer = exchange.answer
        if answer is None:
            self.lost += 1
            return
        self.counters[answer.wkc] += 1
        if answer.wkc == 0:
            return
        if self.last and answer.data != self.last:
            for at, (one, other) in enumerate(zip(self.last, answer.data, strict=True)):
                self.changed[at] |= one != other
        elif not self.last:
            self.changed = bytearray(self.size)
        self.last = answer.data

    @property
    def exchanges(self) -> int:
        """How often it was exchanged."""
        return sum(self.counters.values()) + self.lost

    @property
    def usual(self) -> int:
        """The working counter that came most often."""
        return self.counters.most_common(1)[0][0] if self.counters else 0

    @property
    def cycle_us(self) -> tuple[float, float, float] | None:
        """Median, shortest and longest time between two exchanges in µs."""
        steps = [(b - a) / 1000 for a, b in pairwise(self.times_ns)]
        return (median(steps), min(steps), max(steps)) if steps else None


class Segment:
    """Follows the datagrams of a capture.

    Attributes:
        slaves: The slaves, in the order in which they were met.
        areas: Process data, by command, address and size.
        states: AL status of all slaves together (broadcasts).
        count: Number of slaves that have answered a broadcast at most.
        counts: How often each number of slaves has answered a broadcast read of the AL status.
        clock: Station or position of the slave whose clock the others follow; None: no clock.
        first_ns: Time of the first datagram.
        last_ns: Time of the last one.
        unread: Number of datagrams that were not looked at, by reason.
    """

    def __init__(self) -> None:
        self.slaves: list[Slave] = []
        self.areas: dict[tuple[int, int, int], Area] = {}
        self.states: list[StateChange] = []
        self.count = 0
        self.counts: Counter[int] = Counter()
        self.clock: Slave | None = None
        self.first_ns = self.last_ns = 0
        self.unread: Counter[str] = Counter()
        self._by_position: dict[int, Slave] = {}
        self._by_station: dict[int, Slave] = {}

    def take(self, exchange: Exchange) -> None:
        """Takes a datagram with its answer."""
        self.first_ns = self.first_ns or exchange.time_ns
        self.last_ns = max(self.last_ns, exchange.time_ns)
        known = exchange.sent or exchange.answer
        assert known is not None, "there is one of them"
        if known.command in _L:
            self._area(known).take(exchange) if self._has_room(known) else None
            return
        answer = exchange.answer
        if answer is None or answer.wkc == 0:
            return
        if known.command in _B:
            self._broadcast(exchange.time_ns, exchange.sent, answer)
            return
        slave = self._find(known, exchange.sent)
        if slave is None:
            self.unread["datagrams to more slaves than there can be"] += 1
            return
        if known.command in _DISTRIBUTES:
            self.clock = slave
            return
        if known.command in _WRITES:
            self._written(exchange.time_ns, slave, known)
        if known.command in _READS:
            self._read(exchange.time_ns, slave, answer)

    def in_order(self) -> list[Slave]:
        """All slaves in the order of the wire, as far as it is known; the others behind."""
        return sorted(
            self.slaves,
            key=lambda s: (s.position is None, s.position or 0, s.station),
        )

    # --- whom a datagram is for ----------------------------------------------------------------

    def _find(self, known: Datagram, sent: Datagram | None) -> Slave | None:
        if known.command in _AP:
            position = -known.slave & 0xFFFF
            if sent is None:  # each slave has counted it up
                position = position + self.count & 0xFFFF
            found = self._by_position.get(position)
            if found is None and len(self.slaves) < _SLAVES_MAX and position < _SLAVES_MAX:
                found = self._by_position[position] = Slave(position)
                self.slaves.append(found)
            return found
        found = self._by_station.get(known.slave)
        if found is None and len(self.slaves) < _SLAVES_MAX:
            found = self._by_station[known.slave] = Slave(None, known.slave)
            self.slaves.append(found)
        return found

    def _set_station(self, slave: Slave, station: int) -> None:
        if not station:
            return
        same = self._by_station.get(station)
        if same is not None and same is not slave and same.position is None:
            # It was met by this address before the capture told where it is.
            self.slaves.remove(slave)
            same.position = slave.position
            if slave.position is not None:
                self._by_position[slave.position] = same
            slave = same
        slave.station = station
        self._by_station[station] = slave

    # --- what a datagram tells -----------------------------------------------------------------

    def _broadcast(self, time_ns: int, sent: Datagram | None, answer: Datagram) -> None:
        if answer.command in (7, 9):
            self.count = min(max(self.count, answer.wkc), _SLAVES_MAX)
        if answer.memory == _AL_STATUS and answer.command == 7:
            self.counts[answer.wkc] += 1
            self._note(self.states, time_ns, answer.data, None)
        if answer.command == 8 and sent is not None:
            for slave in self.slaves:
                slave.store(sent.memory, sent.data)
                if sent.memory <= _SII_CONTROL < sent.memory + len(sent.data):
                    slave.note_command()

    def _written(self, time_ns: int, slave: Slave, sent: Datagram) -> None:
        begin, end = sent.memory, sent.memory + len(sent.data)
        if begin >= _REGISTERS:
            self._message(time_ns, slave, sent, written=True)
            return
        slave.store(begin, sent.data)
        if begin <= _STATION and end >= _STATION + 2:
            self._set_station(slave, slave.number(_STATION, 2) or 0)
        if begin <= _SII_CONTROL + 1 < end:
            slave.note_command()

    def _read(self, time_ns: int, slave: Slave, answer: Datagram) -> None:
        begin, end = answer.memory, answer.memory + len(answer.data)
        if begin >= _REGISTERS:
            self._message(time_ns, slave, answer, written=False)
            return
        slave.store(begin, answer.data)
        if begin <= _STATION and end >= _STATION + 2:
            self._set_station(slave, slave.number(_STATION, 2) or 0)
        if begin <= _AL_STATUS and end >= _AL_STATUS + 1:
            code = slave.number(_AL_CODE, 2) if end >= _AL_CODE + 2 else None
            self._note(slave.states, time_ns, answer.data[_AL_STATUS - begin :], code)
        elif begin == _AL_CODE and slave.states:
            last = slave.states[-1]
            slave.states[-1] = StateChange(
                last.time_ns, last.status, slave.number(_AL_CODE, 2) or 0
            )
        if begin <= _SII_DATA and end >= _SII_DATA + 4:
            slave.note_words(end - _SII_DATA)

    @staticmethod
    def _note(changes: list[StateChange], time_ns: int, data: bytes, code: int | None) -> None:
        status = data[0] & 0x1F
        old = changes[-1] if changes else None
        if old is not None and old.status == status and (code is None or old.code == code):
            return
        if len(changes) < _CHANGES_MAX:
            changes.append(StateChange(time_ns, status, code or 0))

    def _message(self, time_ns: int, slave: Slave, datagram: Datagram, *, written: bool) -> None:
        if datagram.memory in self._mailboxes(slave, written=written):
            slave.mailbox.take(time_ns, datagram.data, written=written)

    @staticmethod
    def _mailboxes(slave: Slave, *, written: bool) -> Iterator[int]:
        found = False
        for manager in slave.sync_managers:
            if manager.mailbox:
                found = True
                if manager.outputs == written:
                    yield manager.start
        word = 0x18 if written else 0x1A
        if not found and slave.words.get(word):
            yield slave.words[word]

    def _has_room(self, known: Datagram) -> bool:
        key = known.command, known.address, len(known.data)
        if key in self.areas or len(self.areas) < _AREAS_MAX:
            return True
        self.unread["process data at more addresses than a bus has"] += 1
        return False

    def _area(self, known: Datagram) -> Area:
        key = known.command, known.address, len(known.data)
        return self.areas.setdefault(key, Area(*key))
