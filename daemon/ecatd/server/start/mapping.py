"""Reads the PDOs of each slave, and sets up its ESC for them.

Slaves with CoE have a PDO assignment that can be read (`assignment.py`), drives with SoE have
telegrams (`telegrams.py`). Other slaves have fixed PDOs, described by their SII (categories 50 and
51). `uncertain.py` decides how to use slaves that do not answer, or whose EEPROM is damaged.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.config import Config
from ecatd.config.resolve.believed import Believed, Reported, believe
from ecatd.description.bus import Slave
from ecatd.description.conditions import Condition
from ecatd.etg.datatypes import type_by_size
from ecatd.etg.pdo import Pdo
from ecatd.etg.pdo_layout import sync_manager_bytes
from ecatd.etg.sii import UNASSIGNED, USAGE_INPUTS, USAGE_OUTPUTS, Sii
from ecatd.master.engine.process_image import Image
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, converse
from ecatd.master.master import Master

from .assignment import Assignment
from .modules import Modules
from .object_access import RefusedError
from .pdo_writer import choose_from_sii, note_no_process_data, warn_of_no_direction
from .scanned import Scanned
from .slave_configuration import SlaveConfiguration
from .telegrams import Telegrams
from .watchdogs import WATCHED, watchdog_writes

_FEATURES, _NO_LRW = 0x0008, 0x0200
SYNC_MANAGER = 0x0800
FMMU = 0x0600
_FMMU_COUNT = 0x0004
_FMMUS_MAX = 16
_FMMU_READ, _FMMU_WRITE = 1, 2
_RAM = 0x1000
"""First byte of the process data memory of an ESC; registers are below it."""
_MODE, _BUFFERED = 0x03, 0x00
"""Bits of the control register of a sync manager with its mode (ESC data sheet, section II)."""


def read_modules(
    master: Master, scanned: Sequence[Scanned], cancelled: Callable[[], bool] = lambda: False
) -> None:
    """Reads the modules in the slots of the slaves with CoE, which must be in PREOP.

    If a slave does not answer, they are read again when its configuration is written.
    """
    _converse_with(master, [item for item in scanned if item.slave.coe], _ask_modules, cancelled)


def _converse_with(
    master: Master,
    items: Sequence[Scanned],
    part: Callable[[Scanned, Coe], Conversation[None]],
    cancelled: Callable[[], bool],
) -> None:
    """Has a conversation with each slave, and keeps the emergencies that come meanwhile."""
    coe = [master.coe(item.slave.position) for item in items]
    converse(master.registers, list(map(part, items, coe)), cancelled)
    for item, way in zip(items, coe, strict=True):
        item.emergencies += way.emergencies


def _ask_modules(item: Scanned, coe: Coe) -> Conversation[None]:
    try:
        modules = Modules(item, coe)
        item.slave.modules = yield from coe.converse(modules.detected)
    except (NoAnswerError, StateError, SdoAbortError):
        return


def configure_slaves(
    master: Master,
    scanned: Sequence[Scanned],
    config: Config,
    unexpected: Collection[int] = (),
    cancelled: Callable[[], bool] = lambda: False,
) -> None:
    """Writes the configuration of the slaves, which must be in PREOP, and reads their PDOs.

    Args:
        master: The master.
        scanned: All slaves; the results are added to them.
        config: The configuration.
        unexpected: Positions of slaves that are not the expected ones. Nothing is written to them.
        cancelled: Called while waiting; when it returns true, `StateError` is raised.

    Raises:
        StateError: A slave refuses its configuration, or `cancelled` returned true.
    """
    expected = [item for item in scanned if item.slave.position not in unexpected]
    for item in expected:
        item.settings = config.settings_of(item.slave.position)
        if (eoe := item.settings.eoe) is not None:
            eoe = eoe.with_mac(config.bus, item.slave.position)
            item.settings = replace(item.settings, eoe=eoe)
        item.slave.given_name = item.settings.name
        for module, wanted in zip(item.slave.modules, item.settings.modules, strict=False):
            module.name = wanted.name
        if item.settings.mailbox_timeout_ms is not None:
            master.set_mailbox_timeout(item.slave.position, item.settings.mailbox_timeout_ms / 1000)
        item.slave.group = item.settings.group_at(item.slave.position)
        if item.known and not item.speaks and not item.condition:
            take_pdos_from_sii(item)
    asked = [
        item
        for item in expected
        if item.known and item.condition != Condition.STUCK and (item.speaks or item.gets_ip)
    ]
    _converse_with(master, asked, _configure_and_read, cancelled)


def _configure_and_read(item: Scanned, coe: Coe) -> Conversation[None]:
    item.refused = []
    try:
        if item.settings.writes_objects or item.gets_ip:
            conversation = SlaveConfiguration(item, coe).write()
            item.refused = yield from conversation
        if not item.speaks:
            return
        reader = describer(item, coe)
        found = yield from reader.read()
        take_believed(item, found)
        item.guessed = reader.guessed
        if not item.condition:
            item.refused = [
                *item.refused,
                *warn_of_no_direction(item),
            ]
            item.settled += note_no_process_data(item)
    except RefusedError:
        raise
    except (NoAnswerError, StateError, SdoAbortError) as error:
        item.silence = str(error)
        item.nonsense = not isinstance(error, NoAnswerError)
        if not item.settings.writes_objects:  # else its PDOs may differ from those of its EEPROM
            told = Reported(_default(item.sii.outputs), _default(item.sii.inputs), silent=True)
            take_believed(item, believe(item.slave, item.sii, item.settings, told))


def describer(item: Scanned, coe: Coe) -> Assignment | Telegrams:
    """What reads the process data of a slave over its mailbox."""
    kind = Assignment if item.slave.coe else Telegrams
    return kind(item, coe)


def take_pdos_from_sii(item: Scanned) -> None:
    """Sets the PDOs of a slave without CoE and SoE: of those in its SII, the configured ones."""
    slave, sii = item.slave, item.sii
    slave.outputs, slave.inputs = _default(sii.outputs), _default(sii.inputs)
    choose_from_sii(item)
    take_believed(item, believe(slave, sii, item.settings, Reported(slave.outputs, slave.inputs)))
    for pdo in (*slave.outputs, *slave.inputs):
        for entry in pdo.entries:
            if not entry.is_gap and not entry.data_type:
                entry.data_type = type_by_size(entry.bit_length)
                item.guessed.add((entry.index, entry.subindex))


def take_believed(item: Scanned, found: Believed) -> None:
    """Notes what the process data of a slave are, or why that is not certain."""
    slave = item.slave
    slave.outputs, slave.inputs = found.outputs, found.inputs
    slave.contradictions = found.contradictions
    item.condition, item.why = found.condition, found.why
    item.notes = [f"{slave.label}: {note}" for note in found.notes]
    item.settled = [f"{slave.label}: {note}" for note in found.settled]


def _default(pdos: list[Pdo]) -> list[Pdo]:
    return [pdo for pdo in pdos if pdo.sync_manager != UNASSIGNED]


def without_lrw(master: Master, scanned: Sequence[Scanned]) -> set[int]:
    """Returns the positions of slaves that do not support LRW, by their SII or ESC features."""
    wanted = [(item.slave.position, _FEATURES, 2) for item in scanned]
    return {
        item.slave.position
        for item, features in zip(scanned, master.read_registers(wanted), strict=True)
        if item.sii.without_lrw or int.from_bytes(features, "little") & _NO_LRW
    }


def configure(master: Master, scanned: Sequence[Scanned], image: Image) -> Steps[None]:
    """Sets up sync managers, FMMUs and watchdogs of slaves, which must be in PREOP.

    Raises:
        StateError: A slave does not answer, or has too few sync managers or FMMUs for its process
            data.
    """
    wanted = [(item.slave.position, _FMMU_COUNT, 1) for item in scanned]
    counts = yield from master.reading(wanted)
    writes: list[tuple[int, int, bytes]] = []
    for item, count in zip(scanned, counts, strict=True):
        slave, available = item.slave, count[0]
        if item.unplaced:
            raise StateError(f"{slave.label}: {item.unplaced}")
        managers, fmmus = process_data_registers(item, image)
        _check_memory(slave, managers)
        writes += [(slave.position, *write) for write in managers]
        writes += _unused(slave, item.sii)
        writes += [(slave.position, *write) for write in watchdog_writes(item.settings)]
        if len(fmmus) > available:
            raise StateError(
                f"{slave.label} needs {len(fmmus)} FMMUs for its process data, but has {available}"
            )
        writes += [(slave.position, *write) for write in fmmus]
        # All FMMUs are written, so that none from an earlier master answers at these addresses.
        for number in range(len(fmmus), min(available, _FMMUS_MAX)):
            writes.append((slave.position, FMMU + 16 * number, bytes(16)))
    yield from master.writing(writes)


def process_data_registers(
    item: Scanned, image: Image
) -> tuple[list[tuple[int, bytes]], list[tuple[int, bytes]]]:
    """Returns the sync managers and the FMMUs that exchange the process data of a slave.

    Each with its register and the content.
    """
    slave, start = item.slave, image.domains[item.slave.domain].address
    managers: list[tuple[int, bytes]] = []
    fmmus: list[_Fmmu] = []
    for pdos, kind, offset in (
        (slave.outputs, _FMMU_WRITE, slave.output_offset),
        (slave.inputs, _FMMU_READ, slave.input_offset),
    ):
        for area in sync_manager_bytes(pdos):
            manager = item.sii.sync_managers[area.number]
            if not manager.virtual:
                watched = kind == _FMMU_WRITE and item.settings.watchdog_ms
                control = manager.control | (WATCHED if watched else 0)
                content = _sync_manager(manager.start, area.size, control)
                managers.append((SYNC_MANAGER + 8 * area.number, content))
            _map(fmmus, _Fmmu(start + offset + area.offset, area.size, manager.start, kind))
    return managers, [(FMMU + 16 * n, fmmu.registers()) for n, fmmu in enumerate(fmmus)]


def _check_memory(slave: Slave, managers: list[tuple[int, bytes]]) -> None:
    """Refuses process data whose buffers reach into each other in the memory of the slave.

    The EEPROM says where they begin, and the PDOs how long they are. A buffered sync manager uses
    three times its length (ESC data sheet, section I, "Buffered mode").

    Raises:
        StateError: Outputs and inputs would overwrite each other.
    """
    areas = []
    for register, content in managers:
        start, length, control = struct.unpack_from("<HHB", content)
        if start < _RAM:
            continue  # outputs of a digital I/O ESC are registers, and have no buffers
        buffers = 3 if control & _MODE == _BUFFERED else 1
        areas.append((start, start + buffers * length, (register - SYNC_MANAGER) // 8, buffers))
    areas.sort()
    for (start, end, one, buffers), (begin, _, other, _) in itertools.pairwise(areas):
        size = (end - start) // buffers
        if (
            start + size <= begin < end
        ):  # else the EEPROM was told to be wrong, and the slave refuses
            raise StateError(
                f"{slave.label}: {buffers} x {size} bytes of sync manager {one} from 0x{start:04X} "
                f"on reach into sync manager {other} at 0x{begin:04X}, so its process data would "
                f"overwrite each other: assign fewer PDOs, or shorter queues, so that it has at "
                f"most {(begin - start) // buffers} bytes"
            )


@dataclass(slots=True)
class _Fmmu:
    """An FMMU: maps whole bytes of the logical image to the memory of the slave."""

    logical: int
    length: int
    physical: int
    kind: int

    def registers(self) -> bytes:
        head = (self.logical, self.length, 0, 7, self.physical, 0, self.kind, 1)
        return struct.pack("<IHBBHBBB3x", *head)


def _map(fmmus: list[_Fmmu], new: _Fmmu) -> None:
    """Adds an FMMU, or extends the last one if possible, since some ESCs have few FMMUs."""
    last = fmmus[-1] if fmmus else None
    if (
        last is not None
        and last.kind == new.kind
        and last.logical + last.length == new.logical
        and last.physical + last.length == new.physical
    ):
        last.length += new.length
    else:
        fmmus.append(new)


def _sync_manager(start: int, length: int, control: int) -> bytes:
    return struct.pack("<HHBBBB", start, length, control, 0, 1, 0)


def _unused(slave: Slave, sii: Sii) -> list[tuple[int, int, bytes]]:
    """Returns the writes that switch off process-data sync managers without PDOs."""
    used = {pdo.sync_manager for pdo in (*slave.outputs, *slave.inputs) if pdo.bit_length}
    return [
        (
            slave.position,
            SYNC_MANAGER + 8 * number,
            struct.pack("<HHBBBB", manager.start, 0, manager.control, 0, 0, 0),
        )
        for number, manager in enumerate(sii.sync_managers)
        if manager.usage in (USAGE_OUTPUTS, USAGE_INPUTS)
        and number not in used
        and not manager.virtual
    ]
