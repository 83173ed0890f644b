"""Captures a real segment: reads everything that a rig file needs to simulate it.

This is the only module of ecatsim that acts as a master; it uses the master of ecatd.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from ecatd.base.errors import EcatError, NoAnswerError, SdoAbortError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.etg.al import AlState
from ecatd.etg.dictionary import DictionaryObject
from ecatd.etg.sii import USAGE_INPUTS, USAGE_OUTPUTS
from ecatd.etg.sii_categories import whole_image
from ecatd.etg.sii_check import check_sii
from ecatd.master.frames.interface import look
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, converse
from ecatd.master.mailbox.dictionary import read_dictionary
from ecatd.master.master import Master
from ecatd.server.start.clocks import clock_bits

from .slave.pdo_objects import ASSIGNMENTS

Progress = Callable[[str], None]
"""A function that gets a line of text about the current step."""

PORTS_IN_ORDER = (3, 1, 2)
"""The ports behind the processing unit, in the order in which a frame leaves through them."""

_PATIENCE = Timeout(5.0)
_CHIP, _DL_STATUS = 0x0000, 0x0110
_WATCHDOG_DIVIDER, _WATCHDOG_PDI, _WATCHDOG_DATA = 0x0400, 0x0410, 0x0420
_CHIP_SIZE = 10
_COE = 0x04
_STATE = 0x0F  # the state bits of the AL status
_PROGRESS_OBJECTS = 25


@dataclass(frozen=True, slots=True)
class Upload:
    """The answer of a slave to an upload.

    Attributes:
        data: The data, or None.
        abort: The SDO abort code if the slave refused, else 0.
        problem: The error if the slave neither sent data nor refused.
    """

    data: bytes | None = None
    abort: int = 0
    problem: str = ""


@dataclass(slots=True)
class CapturedSlave:
    """The captured data of a slave.

    Attributes:
        position: Position on the wire.
        name: Name of the slave.
        sii: The whole content of its EEPROM.
        chip: Registers 0x0000 to 0x0009.
        dl_status: Register 0x0110.
        clock: Whether register 0x0910 (system time) answers.
        watchdogs: Registers 0x0400, 0x0410 and 0x0420: divider, and the times of the watchdogs of
            PDI and process data.
        coe: Whether it supports CoE, as its EEPROM says.
        objects: Its object dictionary; None if the slave does not describe it or it was not read.
        values: The answers to uploads by index and subindex.
        notes: Errors by which data could not be captured.
    """

    position: int
    name: str
    sii: bytes
    chip: bytes
    dl_status: int
    clock: bool
    coe: bool
    watchdogs: tuple[int, int, int] = (2498, 1000, 1000)
    objects: list[DictionaryObject] | None = None
    values: dict[tuple[int, int], Upload] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def assignments(self) -> list[int]:
        """Indices of the objects that assign PDOs: 0x1C10 plus the number of the sync manager."""
        sii = check_sii(self.sii)
        numbers = {*sii.channels(USAGE_OUTPUTS), *sii.channels(USAGE_INPUTS)}
        return [ASSIGNMENTS + number for number in sorted(numbers)]


def capture(interface: str, progress: Progress, *, objects: bool = True) -> list[CapturedSlave]:
    """Reads all slaves of a segment; leaves it in PREOP if it was there, else in INIT.

    Args:
        interface: Network interface.
        progress: Called with a line of text before each step.
        objects: Whether to read the object dictionaries.

    Raises:
        StateError: A master is using the slaves, or some do not reach PREOP.
        EcatError: As `Master`.
    """
    master = Master([interface])
    try:
        before = int.from_bytes(look(interface).data, "little") & _STATE
        if before & (AlState.SAFEOP | AlState.OP):
            raise StateError(
                f"slaves on '{interface}' are in SAFEOP or OP: a master is using them, and a scan "
                f"would interrupt it; stop the master first"
            )
        master.scan(_PATIENCE)
        count = len(master.stations)
        try:
            master.al_states.wait_for(AlState.PREOP, _PATIENCE)
            clocks = clock_bits(master)
            slaves = [
                _slave(master, i, count, bool(clocks[i]), progress, objects) for i in range(count)
            ]
        finally:
            if before != AlState.PREOP:
                master.al_states.wait_for(AlState.INIT, _PATIENCE)
    finally:
        master.close()
    return slaves


def _slave(
    master: Master, position: int, count: int, clock: bool, progress: Progress, objects: bool
) -> CapturedSlave:
    name = master.name(position)
    here = f"slave {position + 1} of {count}: {name}"
    progress(f"{here}: EEPROM")
    (sii,) = master.read_eeproms(whole_image, [position])

    def word(register: int) -> int:
        return int.from_bytes(master.register_read(position, register, 2), "little")

    (protocols,) = struct.unpack_from("<H", sii.ljust(0x40, b"\0"), 2 * 0x1C)
    slave = CapturedSlave(
        position,
        name,
        sii,
        master.register_read(position, _CHIP, _CHIP_SIZE),
        word(_DL_STATUS),
        clock,
        bool(protocols & _COE),
        (word(_WATCHDOG_DIVIDER), word(_WATCHDOG_PDI), word(_WATCHDOG_DATA)),
    )
    if slave.coe:
        report = (lambda line: progress(f"{here}: {line}")) if objects else None
        coe = master.coe(position)
        try:
            converse(master.registers, [coe.converse(lambda: _read_objects(slave, coe, report))])
        except EcatError as error:  # the rest of the slave can be simulated
            slave.notes.append(str(error))
    return slave


def _read_objects(slave: CapturedSlave, coe: Coe, progress: Progress | None) -> Conversation[None]:
    """Reads the PDOs; with `progress`, reads all objects of the dictionary first."""
    if progress is not None:
        progress("object dictionary")
        try:
            slave.objects = yield from read_dictionary(coe)
        except EcatError as error:
            slave.notes.append(f"object dictionary: {error}")
    total = len(slave.objects or ())
    for number, item in enumerate(slave.objects or (), 1):
        if progress is not None and number % _PROGRESS_OBJECTS == 0:
            progress(f"object {number} of {total}")
        for subindex in item.entries:
            slave.values[item.index, subindex] = yield from _upload(coe, item.index, subindex)
    yield from _read_pdos(slave, coe)


def _upload(coe: Coe, index: int, subindex: int) -> Conversation[Upload]:
    try:
        return Upload((yield from coe.upload(index, subindex)))
    except SdoAbortError as error:
        return Upload(abort=error.code)
    except (NoAnswerError, StateError) as error:
        return Upload(problem=str(error))


def _read_pdos(slave: CapturedSlave, coe: Coe) -> Conversation[None]:
    """Uploads assignment and mapping of the PDOs, except values that were read before."""

    def value(index: int, subindex: int) -> Conversation[int]:
        key = (index, subindex)
        if key not in slave.values:
            slave.values[key] = yield from _upload(coe, index, subindex)
        return number(slave.values[key])

    for index in slave.assignments:
        for i in range(1, (yield from value(index, 0)) + 1):
            pdo = yield from value(index, i)
            for subindex in range(1, (yield from value(pdo, 0)) + 1 if pdo else 0):
                yield from value(pdo, subindex)


def number(upload: Upload | None) -> int:
    """Converts an upload to an unsigned integer; 0 if there is no data."""
    return int.from_bytes(upload.data or b"", "little") if upload else 0


def topology(dl_status: list[int]) -> list[tuple[int, int]]:
    """Finds out where each slave is plugged in, from the DL status of all slaves.

    Args:
        dl_status: Register 0x0110 of each slave, in processing order; bits 9, 11, 13 and 15 show
            which ports have communication.

    Returns:
        For each slave, the position of the slave that it is plugged into and the port there;
        (-1, 0) for the first one.
    """
    free = [[p for p in PORTS_IN_ORDER if status >> 9 + 2 * p & 1] for status in dl_status]
    places: list[tuple[int, int]] = []
    for slave in range(len(dl_status)):
        parent = slave - 1
        while parent >= 0 and not free[parent]:
            parent = places[parent][0]
        if parent >= 0:
            places.append((parent, free[parent].pop(0)))
        else:  # the first slave, or a status that contradicts the order
            places.append((slave - 1, 1) if slave else (-1, 0))
    return places
