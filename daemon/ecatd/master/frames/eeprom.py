"""Reads the SII EEPROMs of many slaves at the same time, and writes that of one (ETG.1000.4, 6.4).

A command reads four or eight bytes of an EEPROM, and takes some time. So all slaves work on their
commands at the same time.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.errors import StateError
from ecatd.base.timeouts import Timeout
from ecatd.etg.sii_categories import Words

from .datagrams import Datagrams, Place, Station

T = TypeVar("T")

_ASSIGNMENT = 0x0500
_FORCE_TO_MASTER, _TO_MASTER, _TO_DEVICE = b"\x02", b"\x00", b"\x01"
_CONTROL = 0x0502  # control and status, address (0x0504), data (0x0508)
_CONTROL_SIZE = 14
_DATA = 0x0508
_READ, _WRITE, _CLEAR = 0x0100, 0x0201, 0x0000  # writing must be enabled with the command: bit 0
_READS_8_BYTES = 0x0040
_NO_ACKNOWLEDGE, _NOT_ENABLED = 0x2000, 0x4000
_BUSY = 0x8000

_TRIES = 3
_BUSY_LIMIT = Timeout(0.5)
"""Seconds after which a busy EEPROM counts as broken; a command takes less than a millisecond."""

_SILENT_LIMIT = Timeout(1.0)
"""Seconds without an answer after which a slave counts as gone. A bad contact is shorter."""

_PAUSE = 0.0002
"""Seconds between two reads of the status while all EEPROMs are busy."""

_SHARE, _LESS, _NAP_MAX = 0.75, 0.9, 0.001
"""After commands, nobody asks for a while, since each question costs a frame and processor time:
for this share of the time that the last commands took, and less and less while they have ended by
then. Seconds, at most."""

_LATE = 0.05
"""Seconds without progress after which reading lets other work go on. A slave that is there, and
whose EEPROM works, is quicker."""


class _Unread(Exception):  # noqa: N818  it is no error
    """`decode` needs words that have not been read yet."""


class _Eeprom(Generic[T]):
    """One EEPROM while it is being read."""

    def __init__(self, slave: Station | Place, label: str, decode: Callable[[Words], T]) -> None:
        self.slave = slave
        self._label = label
        self._decode = decode
        self._known: dict[int, bytes] = {}  # by even word address, 4 bytes each
        self._wanted: list[int] = []  # even word addresses, the next one last
        self._asked = False  # whether the slave has the command to read the next wanted address
        self._tries = _TRIES
        self._busy_since: float | None = None
        self._silent_since: float | None = None
        self.command: bytes | None = None  # to be written to the slave next
        self.result: list[T | StateError] = []  # one at the end: what was decoded, or why not

    def _words(self, word: int, count: int) -> bytes:
        wanted = range(word & ~1, word + count, 2)
        self._wanted = [address for address in reversed(wanted) if address not in self._known]
        if self._wanted:
            raise _Unread
        start = 2 * (word & 1)
        return b"".join([self._known[address] for address in wanted])[start : start + 2 * count]

    def look(self, registers: bytes, answered: bool) -> None:
        """Evaluates the registers from 0x0502 on, and sets `command` or `result`.

        Raises:
            StateError: The EEPROM cannot be read.
        """
        now = time.monotonic()
        if not answered:
            self._asked = False  # it may have restarted, and know nothing of the command
            self._silent_since = self._silent_since or now
            if now - self._silent_since > _SILENT_LIMIT.seconds:
                raise self._error(
                    f"it cannot be read: the slave does not answer for {_SILENT_LIMIT}"
                )
            return
        self._silent_since = None
        status, address = struct.unpack_from("<HI", registers)
        if status & _BUSY:
            self._busy_since = self._busy_since or now
            if now - self._busy_since > _BUSY_LIMIT.seconds:
                raise self._error(f"it is busy for more than {_BUSY_LIMIT}")
            return
        self._busy_since = None
        if status & _NO_ACKNOWLEDGE:
            self._try_again(f"it does not acknowledge a command (status 0x{status:04X})")
            self._asked = False
            self.command = struct.pack("<H", _CLEAR)  # without it, no other command is accepted
            return
        if self._asked and address == self._wanted[-1]:
            self._tries = _TRIES
            for at in (0, 4) if status & _READS_8_BYTES else (0,):
                self._known[address + at // 2] = registers[6 + at : 10 + at]
            while self._wanted and self._wanted[-1] in self._known:
                self._wanted.pop()
        elif self._asked:
            self._try_again("it does not take a command")
        if not self._wanted:
            self._try_to_decode()
        if self._wanted:
            self._asked = True
            self.command = struct.pack("<HI", _READ, self._wanted[-1])

    def _try_to_decode(self) -> None:
        try:
            self.result = [self._decode(self._words)]
        except _Unread:
            return
        except StateError as error:
            raise self._error(str(error)) from error

    def _try_again(self, reason: str) -> None:
        self._tries -= 1
        if self._tries == 0:
            raise self._error(f"it cannot be read: {reason}")

    def _error(self, reason: str) -> StateError:
        return StateError(f"{self._label}: EEPROM: {reason}")


def read_eeproms(
    registers: Datagrams,
    slaves: Sequence[tuple[Station | Place, str]],
    decode: Callable[[Words], T],
    cancelled: Callable[[], bool] = lambda: False,
) -> list[T]:
    """Carries `reading_eeproms` out at once, where no other work waits."""
    return finish(reading_eeproms(registers, slaves, decode, cancelled))


def reading_eeproms(
    registers: Datagrams,
    slaves: Sequence[tuple[Station | Place, str]],
    decode: Callable[[Words], T],
    cancelled: Callable[[], bool] = lambda: False,
) -> Steps[list[T]]:
    """Reads the EEPROMs of many slaves as `reading_each`, all or none.

    Returns:
        What `decode` returned for each slave.

    Raises:
        StateError: An EEPROM cannot be read, or `decode` raised this. The message names the slave.
    """
    read: list[T] = []
    for item in (yield from reading_each(registers, slaves, decode, cancelled)):
        if isinstance(item, StateError):
            raise item
        read.append(item)
    return read


def reading_each(
    registers: Datagrams,
    slaves: Sequence[tuple[Station | Place, str]],
    decode: Callable[[Words], T],
    cancelled: Callable[[], bool] = lambda: False,
) -> Steps[list[T | StateError]]:
    """Reads the EEPROMs of many slaves at the same time. One that cannot be read delays no other.

    Then it gives them back, also after an error: register 0x0500 assigns them to the devices again
    (ETG.1000.6). It yields only while it waits for slaves that do not answer, or whose EEPROMs are
    busy for long. Another reader of the same EEPROM leaves another address in its registers, or
    the words of the same one.

    Args:
        registers: Access to the registers of the slaves.
        slaves: Address and label of each slave; messages use the label.
        decode: Decodes an EEPROM; it gets a function that returns words. If it needs words that
            have not been read yet, they are read, and `decode` is called again. So it should have
            no side effects, and ask for many words at once.
        cancelled: Called repeatedly while waiting; when it returns true, `StateError` is raised.

    Returns:
        For each slave, what `decode` returned, or a `StateError` that names the slave: its EEPROM
        cannot be read, or `decode` raised this.

    Raises:
        StateError: `cancelled` returned true.
    """
    eeproms = [_Eeprom(slave, label, decode) for slave, label in slaves]
    try:
        _assign_to_master(registers, eeproms)
        unread, progress = eeproms, time.monotonic()
        nap, in_vain = 0.0, False
        while unread:
            if cancelled():
                raise StateError("stopped while slaves were being read")
            moved = _look(registers, unread)
            unread = [item for item in unread if not item.result]
            took = time.monotonic() - progress
            if moved:
                progress += took
                nap = min(_SHARE * took if in_vain else _LESS * nap, _NAP_MAX)
                in_vain = False
                if unread and nap > _PAUSE:
                    time.sleep(nap)
                continue
            in_vain = True
            if took < _LATE:
                time.sleep(_PAUSE)
            else:
                yield
                _assign_to_master(registers, unread)
    finally:
        registers.exchange([slave.write(_ASSIGNMENT, _TO_DEVICE) for slave, _ in slaves])
    return [item.result[0] for item in eeproms]


def _assign_to_master(registers: Datagrams, eeproms: Sequence[_Eeprom[T]]) -> None:
    for owner in (_FORCE_TO_MASTER, _TO_MASTER):
        registers.exchange([item.slave.write(_ASSIGNMENT, owner) for item in eeproms])


def _look(registers: Datagrams, eeproms: Sequence[_Eeprom[T]]) -> bool:
    """Evaluates the answers to the last commands, and sends the next ones.

    Returns:
        Whether an EEPROM has got a command, or needs none any more.
    """
    answers = registers.exchange([item.slave.read(_CONTROL, _CONTROL_SIZE) for item in eeproms])
    for item, answer in zip(eeproms, answers, strict=True):
        item.command = None
        try:
            item.look(answer.data, answer.wkc == 1)
        except StateError as error:
            item.result = [error]
    asked = [item for item in eeproms if item.command and not item.result]
    registers.exchange([item.slave.write(_CONTROL, item.command or b"") for item in asked])
    return bool(asked) or any(item.result for item in eeproms)


def writing_eeprom(
    registers: Datagrams,
    slave: Station,
    label: str,
    word: int,
    data: bytes,
    before: dict[int, bytes],
) -> Steps[None]:
    """Writes words of an EEPROM, and reads them back. Does not write words that are right already.

    The EEPROM is assigned to the device again at the end, also after an error. The device uses the
    new words when it is switched on the next time.

    Args:
        registers: Access to the registers of the slave.
        slave: Address of the slave.
        label: Name of the slave in messages.
        word: Address of the first word.
        data: The words, little endian.
        before: Gets the previous contents of the words that are written, by word address, before
            the first one is written.

    Raises:
        StateError: The EEPROM cannot be read or written, or has other words afterwards.
    """
    count = len(data) // 2

    def read() -> Steps[bytes]:
        steps = reading_eeproms(registers, [(slave, label)], lambda words: words(word, count))
        (words,) = yield from steps
        return words

    now = yield from read()
    wrong = [at for at in range(0, len(data), 2) if now[at : at + 2] != data[at : at + 2]]
    if not wrong:
        return
    before.update({word + at // 2: now[at : at + 2] for at in wrong})
    try:
        for at in wrong:
            yield from _write_word(registers, slave, label, word + at // 2, data[at : at + 2])
    finally:
        registers.exchange([slave.write(_ASSIGNMENT, _TO_DEVICE)])
    after = yield from read()
    for at in wrong:
        if after[at : at + 2] != data[at : at + 2]:
            raise StateError(
                f"{label}: EEPROM: word 0x{word + at // 2:04X} has {after[at : at + 2].hex(' ')} "
                f"after {data[at : at + 2].hex(' ')} was written: it may be write-protected"
            )


def _write_word(
    registers: Datagrams, slave: Station, label: str, word: int, data: bytes
) -> Steps[None]:
    where = f"{label}: EEPROM: word 0x{word:04X} cannot be written"
    for _ in range(_TRIES):
        status = yield from _take(registers, slave, where)
        if status & _NO_ACKNOWLEDGE:  # until this is cleared, no other command is accepted
            registers.exchange([slave.write(_CONTROL, struct.pack("<H", _CLEAR))])
        # A write takes effect at the end of its frame, so each needs a frame of its own.
        registers.exchange([slave.write(_DATA, data)])
        registers.exchange([slave.write(_CONTROL, struct.pack("<HI", _WRITE, word))])
        status = yield from _wait_until_idle(registers, slave, where)
        if not status & (_NO_ACKNOWLEDGE | _NOT_ENABLED):
            return
    raise StateError(f"{where}: the EEPROM refuses the command (status 0x{status:04X})")


def _take(registers: Datagrams, slave: Station, where: str) -> Steps[int]:
    """Assigns an idle EEPROM to the master; returns its status (register 0x0502).

    Each word needs this, because somebody may read the EEPROM while a word is being written, and
    then give it back to the device.
    """
    while True:
        for owner in (_FORCE_TO_MASTER, _TO_MASTER):
            registers.exchange([slave.write(_ASSIGNMENT, owner)])
        waiting = _wait_until_idle(registers, slave, where)
        try:
            next(waiting)
        except StopIteration as idle:
            status: int = idle.value
            return status
        yield from waiting


def _wait_until_idle(registers: Datagrams, slave: Station, where: str) -> Steps[int]:
    """Waits until the EEPROM has carried out its command; returns its status (register 0x0502)."""
    now = time.monotonic()
    busy_until, silent_until = now + _BUSY_LIMIT.seconds, now + _SILENT_LIMIT.seconds
    while True:
        (answer,) = registers.exchange([slave.read(_CONTROL, 2)])
        status = int.from_bytes(answer.data, "little")
        if answer.wkc == 1 and not status & _BUSY:
            return status
        now = time.monotonic()
        if answer.wkc == 1 and now > busy_until:
            raise StateError(f"{where}: it is busy for more than {_BUSY_LIMIT}")
        if answer.wkc != 1 and now > silent_until:
            raise StateError(f"{where}: the slave does not answer for {_SILENT_LIMIT}")
        yield
