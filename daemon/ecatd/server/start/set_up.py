"""Brings slaves from INIT to OP: steps that the start uses for all slaves, and recovery for some.

The steps of recovery do not touch slaves in OP. A slave that fails is left out of the next steps,
and the others go on. If a slave goes away during a step, recovery begins again without it.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterable, Sequence
from copy import copy

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import ConfigError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import REMEDIES
from ecatd.etg.al import AlState
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import SiiMailbox
from ecatd.etg.sii_reader import read_sii
from ecatd.master.al_states import why_not_reached
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.mailbox.conversation import run_conversations
from ecatd.master.master import Master, SilentSlaveError

from .clock_registers import SYNC_CONTROL
from .found_bus import FoundBus
from .mapping import configure, describer, process_data_registers, take_pdos_from_sii
from .process_data import ProcessData
from .slave_configuration import (
    Missed,
    SlaveConfiguration,
    leave,
    write_configurations,
    write_parameters,
)
from .watchdogs import check_watchdogs

_SYNC_MANAGERS, _MAILBOXES_SIZE = 0x0800, 16
_ACTIVATE = (0x0806, 0x080E)
_EEPROM_ASSIGNMENT, _TO_DEVICE = 0x0500, b"\x01"
_DL_STATUS = 0x0110

_FIRST_CYCLES = 3
"""Least number of cycles with valid outputs before OP is requested."""


def read_mailboxes(master: Master) -> list[bytes]:
    """Reads the settings of the sync managers of all mailboxes: registers 0x0800 to 0x080F.

    Slaves must be in PREOP.

    Returns:
        For each slave, 16 bytes; empty if it has no mailbox, or is absent.
    """
    wanted = [(position, _SYNC_MANAGERS, _MAILBOXES_SIZE) for position in master.wire]
    found = [b""] * len(master.stations)
    for position, data in zip(master.wire, master.read_registers(wanted), strict=True):
        managers = [struct.unpack("<HHBBBB", data[at : at + 8]) for at in (0, 8)]
        enabled = any(manager[4] & 1 for manager in managers)
        # Without the status (0x0805), which belongs to the slave.
        kept = [struct.pack("<HHBBBB", *m[:3], 0, m[4], 0) for m in managers]
        found[position] = b"".join(kept) if enabled else b""
    return found


def count_links(master: Master) -> list[int]:
    """Reads the number of ports with a link of each slave, in the order of the wire.

    It is in the DL status (ETG.1000.4).
    """
    wanted = [(position, _DL_STATUS, 2) for position in master.wire]
    status = [int.from_bytes(data, "little") for data in master.read_registers(wanted)]
    # Two bits a port: loop closed, communication established.
    return [sum(bits >> 8 + 2 * port & 3 == 2 for port in range(4)) for bits in status]


def wait_for_outputs(
    shared: SharedMemory,
    bus: Bus,
    patience: Timeout,
    cancelled: Callable[[], bool] = lambda: False,
) -> Steps[None]:
    """Waits until outputs have been sent a few times: slaves need valid outputs before OP.

    Raises:
        StateError: The engine does not run, or `cancelled` returned true.
    """
    cycles = _FIRST_CYCLES + bus.output_cycles - 1
    first = shared.header.cycle
    deadline = time.monotonic() + cycles * bus.cycle_time_us * 1e-6 + patience.seconds
    while shared.header.cycle < first + cycles:
        if time.monotonic() > deadline:
            raise StateError(f"the cyclic engine does not exchange outputs within {patience}")
        if cancelled():
            raise StateError("stopped while outputs were sent for the first time")
        yield


class SetUp:
    """Sets up slaves that have restarted, while the bus runs. Use it on the worker.

    Args:
        found: The slaves, with the results of the start. Slaves that answer again are removed from
            its `uncertain`.
        data: The process data.
        shared: The shared memory.
    """

    def __init__(self, found: FoundBus, data: ProcessData, shared: SharedMemory) -> None:
        self._found = found
        self._master = found.master
        self._shared = shared
        self._bus = found.bus
        self._scanned = found.scanned
        self._image = data.image
        self._clocks = data.clocks
        self._patience = found.config.state_timeout
        self._unconfigured: set[int] = set()  # slaves that need their configuration before SAFEOP
        self._new = {n for n, item in enumerate(found.scanned) if not item.known}

    def is_new(self, position: int) -> None:
        """Notes that another device has taken the place of a slave, as its table permits."""
        self._new.add(position)

    def _read_new(self, positions: Iterable[int]) -> Steps[dict[int, Missed]]:
        """Reads the SII of slaves that are there for the first time.

        Returns:
            Why slaves cannot be used, by position.
        """
        new = sorted(self._new & {*positions})
        missed: dict[int, Missed] = {}
        mailboxes = yield from self._master.reading_mailboxes(new)
        siis = yield from self._master.reading_eeproms(read_sii, new)
        for position, sii, mailbox in zip(new, siis, mailboxes, strict=True):
            item = self._scanned[position]
            was = copy(item.slave)
            item.sii, item.read_at = sii, time.time()
            self._found.mailboxes[position] = mailbox
            if not item.speaks:
                try:
                    take_pdos_from_sii(item)
                except ConfigError as error:
                    missed[position] = Missed(str(error), changed=True)
                outputs, inputs = item.slave.outputs, item.slave.inputs
                text = _difference(was, outputs, inputs, described=not item.known)
                item.slave.outputs, item.slave.inputs = was.outputs, was.inputs
                if text:
                    missed.setdefault(position, Missed(text, changed=True))
            if item.unplaced:
                missed.setdefault(position, Missed(item.unplaced, changed=True))
        return missed

    def read_at(self, position: int) -> float | None:
        """When the EEPROM of a slave was read, in Unix seconds; None if it was never there."""
        return self._scanned[position].read_at

    def device(self, position: int) -> dict[str, int]:
        """Revision and serial number of the device that was there last; it may be another one."""
        item = self._scanned[position]
        last = item.sii if item.read_at else item.slave
        return {"revision": last.revision, "serial": last.serial}

    def registers(self, position: int) -> list[tuple[int, bytes]]:
        """Sync managers and FMMUs for process data as a slave got them: registers and contents."""
        item = self._scanned[position]
        if item.unplaced:
            return []
        managers, fmmus = process_data_registers(item, self._image)
        return [*managers, *fmmus]

    def has_boot(self, position: int) -> bool:
        """Whether the EEPROM of a slave describes a mailbox for BOOT (ETG.1000.6)."""
        has_mailbox = bool(self._found.mailboxes[position])
        return has_mailbox and self._scanned[position].sii.bootstrap.exists

    def ask(
        self, positions: Iterable[int], state: AlState = AlState.OP
    ) -> Steps[dict[int, Missed]]:
        """Requests a state; returns the slaves that did not reach it, by position."""
        patience = self._patience
        missed = yield from self._master.al_states.request(state, patience, positions)
        return {
            item.position: Missed(f"it does not reach {why_not_reached(item, state, patience)}")
            for item in missed
        }

    def leave(self, positions: Iterable[int], state: AlState) -> Steps[list[str]]:
        """Writes the parameters of slaves before they go down; see `configurations.leave`."""
        items = [self._scanned[position] for position in sorted(positions)]
        # A parameter of SP may change an object that a parameter of PS has set.
        if state not in (AlState.SAFEOP, AlState.OP):
            down = [item for item in items if item.settings.has_parameters("SP")]
            self._unconfigured.update(item.slave.position for item in down)
        return (yield from leave(self._master, items, state, self._patience))

    def run(
        self,
        positions: Iterable[int],
        state: AlState = AlState.OP,
        *,
        begin: AlState = AlState.INIT,
    ) -> Steps[dict[int, Missed]]:
        """Brings slaves that have their station address to a state.

        Args:
            positions: The slaves.
            state: PREOP, SAFEOP or OP; or BOOT, for slaves that support it.
            begin: INIT; or PREOP, for slaves that are in PREOP with a working mailbox and must
                keep the values that were written to them there. Such a slave gets its configuration
                only if it has not had it since it was last in INIT.

        Returns:
            The slaves that do not reach the state, by position.

        Raises:
            StateError: A slave does not answer any more.
        """
        here = set(positions)
        missed = yield from self._read_new(here)
        here -= missed.keys()
        first = AlState.BOOT if state == AlState.BOOT else AlState.PREOP
        if begin == AlState.INIT:
            missed |= yield from self._restart(here, first)
        if state == first:
            return missed
        here -= missed.keys()
        missed |= yield from self._configure_again(here & self._unconfigured)
        here -= missed.keys()
        missed |= yield from self._compare(here)
        here -= missed.keys()
        items = [self._scanned[position] for position in sorted(here)]
        yield from configure(self._master, items, self._image)
        missed |= yield from self._check_new(here)
        here -= missed.keys()
        if self._clocks is not None:
            late = yield from self._clocks.rejoin(here, self._shared)
            missed |= {position: Missed(text) for position, text in late.items()}
            here -= late.keys()
        missed |= yield from self.ask(here, AlState.SAFEOP)
        here -= missed.keys()
        if state == AlState.SAFEOP or not here:
            return missed
        missed |= yield from self.write_before_op(here)
        here -= missed.keys()
        yield from wait_for_outputs(self._shared, self._bus, self._patience)
        missed |= yield from self.ask(here, AlState.OP)
        return missed

    def write_before_op(self, positions: Iterable[int]) -> Steps[dict[int, Missed]]:
        """Writes the parameters of SO to slaves in SAFEOP; returns those that cannot go on."""
        items = [self._scanned[position] for position in sorted(positions)]
        _, missed = yield from write_parameters(self._master, items, "SO")
        return missed

    def _check_new(self, positions: Iterable[int]) -> Steps[dict[int, Missed]]:
        """Checks the watchdogs of slaves that are there for the first time, as at the start."""
        missed: dict[int, Missed] = {}
        for position in sorted(self._new & {*positions}):
            item = self._scanned[position]
            try:
                yield from check_watchdogs(self._master, self._bus, [item], self._found.config)
            except SilentSlaveError:
                raise  # it is gone again, so nothing is known of its watchdog
            except (ConfigError, StateError) as error:
                missed[position] = Missed(str(error), changed=True)
            else:
                item.known = True
                self._new.discard(position)
        return missed

    def _restart(self, positions: Iterable[int], state: AlState) -> Steps[dict[int, Missed]]:
        """Brings slaves over INIT to PREOP or BOOT, and sets up their mailboxes for it.

        Returns:
            The slaves that do not reach the state, by position.
        """
        here = set(positions)
        self._unconfigured |= here
        missed = yield from self.ask(here, AlState.INIT)
        here -= missed.keys()
        yield from self._prepare(here, state)
        missed |= yield from self.ask(here, state)
        return missed

    def _prepare(self, positions: Iterable[int], state: AlState) -> Steps[None]:
        """Sets up mailboxes for PREOP or BOOT, and gives slaves the access to their EEPROMs."""
        off, writes = [], []
        for position in positions:
            if self._scanned[position].slave.sync0_ns:
                writes.append((position, SYNC_CONTROL, bytes(2)))
            if mailboxes := self._found.mailboxes[position]:
                off += [(position, register, b"\0") for register in _ACTIVATE]
                if state == AlState.BOOT:
                    mailboxes = _for_boot(mailboxes, self._scanned[position].sii.bootstrap)
                writes.append((position, _SYNC_MANAGERS, mailboxes))
            writes.append((position, _EEPROM_ASSIGNMENT, _TO_DEVICE))
        # The settings of a sync manager can be changed only while it is off (ETG.1000.4).
        yield from self._master.writing(off)
        yield from self._master.writing(writes)

    def _configure_again(self, positions: Iterable[int]) -> Steps[dict[int, Missed]]:
        """Writes the configuration of slaves in PREOP again: they lose it when they restart."""
        items = [self._scanned[position] for position in sorted(positions)]
        items = [
            item for item in items if item.gets_ip or (item.speaks and item.settings.writes_objects)
        ]
        _, missed = yield from write_configurations(self._master, items, SlaveConfiguration.write)
        self._unconfigured -= set(positions) - missed.keys()
        return missed

    def _compare(self, positions: Iterable[int]) -> Steps[dict[int, Missed]]:
        """Finds slaves whose PDOs have changed: a restarted slave may lose its assignment."""
        items = [self._scanned[position] for position in sorted(positions)]
        items = [item for item in items if item.speaks]
        conversations = [
            describer(item, self._master.coe(item.slave.position)).read_pdos() for item in items
        ]
        found, failed = yield from run_conversations(self._master.registers, conversations)
        missed = {}
        for number, error in failed.items():
            position = items[number].slave.position
            if not items[number].silence:
                missed[position] = Missed(f"its PDO assignment cannot be read: {error}")
        for number, now in found.items():
            item = items[number]
            position = item.slave.position
            if now.condition:
                text = f"{now.why}; {REMEDIES[now.condition]}"
            else:
                text = _difference(item.slave, now.outputs, now.inputs, described=not item.known)
            if text:
                missed[position] = Missed(text, changed=True)
                continue
            item.silence = ""
            if not item.sii.damaged:
                self._found.uncertain.pop(position, None)
        return missed


def _for_boot(mailboxes: bytes, box: SiiMailbox) -> bytes:
    """Returns the mailbox sync managers with the addresses and sizes for BOOT."""
    places = ((box.receive, box.receive_size), (box.send, box.send_size))
    return b"".join(
        struct.pack("<HH", *place) + mailboxes[at + 4 : at + 8]
        for at, place in zip((0, 8), places, strict=True)
    )


def _difference(
    slave: Slave, outputs: Sequence[Pdo], inputs: Sequence[Pdo], *, described: bool
) -> str:
    """Returns how the PDOs differ from the earlier ones, and what to do; empty if they are equal.

    Args:
        slave: The slave, with its earlier PDOs.
        outputs: Its RxPDOs now.
        inputs: Its TxPDOs now.
        described: Whether the earlier PDOs are from the file with the description of the bus.
    """
    then = "in the description of the bus" if described else "at the start"
    for name, assigned, before, now in (
        ("outputs", "0x1C12", slave.outputs, outputs),
        ("inputs", "0x1C13", slave.inputs, inputs),
    ):
        if _layout(before) == _layout(now):
            continue
        again = (
            f"then run `ecatctl state {slave.position} OP`, or "
            + ("write a new description (`ecatctl scan -o FILE`) and " if described else "")
            + "restart ecatd to use what it has now"
        )
        for was, pdo in zip(before, now, strict=False):
            if was.index == pdo.index and _entries(was) != _entries(pdo):
                return (
                    f"its PDO 0x{pdo.index:04X} carries other entries than {then} "
                    f"({_changed_entry(was, pdo)}): write its mapping as it was, {again}"
                )
        return (
            f"its {name} are other PDOs than {then} ({_names(now)}, not {_names(before)}): "
            f"assign them as they were ({assigned}), {again}"
        )
    return ""


def _changed_entry(before: Pdo, now: Pdo) -> str:
    """Describes the first entry that differs."""
    for number, (was, is_) in enumerate(zip(_entries(before), _entries(now), strict=False), 1):
        if was != is_:
            return f"entry {number} is {_entry(is_)}, not {_entry(was)}"
    return f"{len(now.entries)} entries, not {len(before.entries)}"


def _entry(entry: tuple[int, int, int]) -> str:
    index, subindex, bits = entry
    return f"0x{index:04X}:{subindex:02X} with {bits} bits" if index else f"a gap of {bits} bits"


def _entries(pdo: Pdo) -> list[tuple[int, int, int]]:
    return [(entry.index, entry.subindex, entry.bit_length) for entry in pdo.entries]


def _layout(pdos: Sequence[Pdo]) -> list[tuple[int, int, list[tuple[int, int, int]]]]:
    return [(pdo.index, pdo.sync_manager, _entries(pdo)) for pdo in pdos]


def _names(pdos: Sequence[Pdo]) -> str:
    return ", ".join(f"0x{pdo.index:04X} with {pdo.bit_length} bits" for pdo in pdos) or "none"
