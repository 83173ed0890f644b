"""The base class of simulated devices.

A device of one's own states its identity and its PDOs and computes its inputs from its outputs:

    class Doubler(Device):
        vendor, product, revision, order = 0x0000FFFF, 1, 1, "Doubler"
        rx_pdos = (Pdo(0x1600, "Outputs", 2, [Entry(0x7000, 1, "In", DataType.INTEGER16, 16)]),)
        tx_pdos = (Pdo(0x1A00, "Inputs", 3, [Entry(0x6000, 1, "Out", DataType.INTEGER16, 16)]),)
        mailbox = Mailbox()

        def step(self, now):
            self[0x6000, 1] = 2 * self[0x7000, 1]
"""

from __future__ import annotations

import copy
import struct
from collections.abc import Sequence
from typing import ClassVar

from ecatd.model import abort_codes
from ecatd.model.al import AlState
from ecatd.model.bus import Entry, Pdo
from ecatd.model.datatypes import DataType
from ecatd.model.errors import SdoAbortError, UsageError

from . import sii
from .coe import CoeServer
from .core import Chip, Event, ProcessDataMap, Segment
from .mailbox import MailboxServer, Protocol
from .objects import Access, Dictionary, ObjectCode, Value, Variable
from .process_image import ProcessImage
from .sii import FmmuType, Mailbox, SmType, SyncManager
from .state_machine import AlCode, Pending, Refused, StateMachine

_SM_REGISTERS = struct.Struct("<HHBBBB")
_SM_BASE = 0x0800
_MAILBOX_MODE = 0x02
_DIRECTION = 0x0C
_DIRECTION_WRITE = 0x04
_BUFFERED_OUTPUT = 0x64  # master writes, event to the device, watchdog
_BUFFERED_INPUT = 0x20
_MAILBOX_OUT = 0x26
_MAILBOX_IN = 0x22
_OUTPUTS_TIMEOUT = 1.0
_RX_ASSIGN, _TX_ASSIGN = 0x1C12, 0x1C13
_CAN_UPLOAD_COMPLETE = 0x20


class Device:
    """A slave: identity, dictionary, process data and behaviour.

    Attributes:
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        alias: Configured station alias.
        order: Order code; masters show it as the name.
        name: Name of the device.
        group: Group type.
        group_name: Name of the group.
        device_type: Object 0x1000.
        chip: The slave controller.
        pdi_control: SII word 0.
        pdi_config: SII word 1.
        physical_ports: SII port types, nibbles from port 0: 0 none, 1 MII, 3 EBUS.
        ebus_current: Current taken from the E-bus in mA.
        mailbox: The mailbox with CoE, or None for a device without one.
        sync_managers: Sync managers; None derives them from the mailbox and the PDOs.
        fmmus: Purposes of the FMMUs; None derives them from the sync managers.
        rx_pdos: RxPDOs (outputs); sync manager 0xFF marks one that is not mapped by default.
        tx_pdos: TxPDOs (inputs).
        variable_assignment: Whether a master may write the PDO assignment 0x1C12 and 0x1C13.
        period: Seconds between two calls of `step`.
    """

    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0
    alias: int = 0
    order: str = ""
    name: str = ""
    group: str = ""
    group_name: str = ""
    device_type: int = 0x00001389
    chip: Chip = Chip()
    pdi_control: int = 0x0C05
    pdi_config: int = 0
    physical_ports: int = 0x11
    ebus_current: int = 0
    mailbox: Mailbox | None = None
    sync_managers: Sequence[SyncManager] | None = None
    fmmus: Sequence[FmmuType] | None = None
    rx_pdos: Sequence[Pdo] = ()
    tx_pdos: Sequence[Pdo] = ()
    variable_assignment: bool = False
    period: float = 0.001

    _WORDS: ClassVar = {True: ("RxPDO", _RX_ASSIGN), False: ("TxPDO", _TX_ASSIGN)}

    def __init__(self) -> None:
        # Class attributes describe a type; a device may change its own copies.
        self.rx_pdos = copy.deepcopy(tuple(self.rx_pdos))
        self.tx_pdos = copy.deepcopy(tuple(self.tx_pdos))
        self.position = -1
        self.dictionary = Dictionary()
        self._assigned = {
            outputs: [p.index for p in pdos if p.sync_manager != sii.UNASSIGNED]
            for outputs, pdos in ((True, self.rx_pdos), (False, self.tx_pdos))
        }
        self._settings = self._default_sync_managers()
        self._segment: Segment | None = None
        self._outputs_at = self._inputs_at = 0
        self._deadline = 0.0
        self._last_outputs = b""
        self._describe_objects()
        self.describe()
        self._make_images()
        self.machine = StateMachine(self._enter, self._publish)
        self._coe: CoeServer | None = None
        self._mails: MailboxServer | None = None
        if self.mailbox:
            self._coe = CoeServer(
                self.dictionary,
                lambda: self.machine.state,
                self.mailbox.send_size,
                complete_access=bool(self.mailbox.coe_details & _CAN_UPLOAD_COMPLETE),
            )
            self._mails = MailboxServer({Protocol.COE: self._coe.handle}, self._put_mail)

    # --- for subclasses ------------------------------------------------------------------------

    def describe(self) -> None:
        """Adds objects to `dictionary`, or changes those made from the PDOs."""

    def step(self, now: float) -> None:
        """Computes the inputs from the outputs; called every `period` seconds.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """

    def check(self, old: AlState, new: AlState) -> None:
        """Checks of the device itself before a change to a higher state.

        Raises:
            Refused: The device does not follow; with the AL status code to report.
        """

    def changed(self, old: AlState, new: AlState) -> None:
        """Called when a change of state is made."""

    def outputs_stopped(self) -> None:
        """Called when the device leaves OP: outputs in the dictionary have become 0."""

    def receive(self, data: bytes) -> None:
        """Takes changed outputs; by default into the dictionary."""
        self._outputs.unpack(data)

    def give(self) -> bytes:
        """Returns the inputs; by default from the dictionary."""
        return self._inputs.pack()

    def __getitem__(self, key: tuple[int, int]) -> int:
        """The integer value of the entry (index, subindex)."""
        value = self.dictionary[key].value
        return value if isinstance(value, int) else 0

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        """Sets the integer value of the entry (index, subindex)."""
        self.dictionary[key].value = value

    # --- description ---------------------------------------------------------------------------

    def assigned(self, *, outputs: bool) -> list[Pdo]:
        """The PDOs of one direction that are mapped now, in the order of the process image."""
        pdos = {pdo.index: pdo for pdo in (self.rx_pdos if outputs else self.tx_pdos)}
        return [pdos[index] for index in self._assigned[outputs]]

    def sii_image(self) -> bytes:
        """The content of the EEPROM."""
        fmmus = self.fmmus
        if fmmus is None:
            kinds = {sm.type for sm in self._settings}
            fmmus = [FmmuType.OUTPUTS] if SmType.OUTPUTS in kinds else []
            fmmus += [FmmuType.INPUTS] if SmType.INPUTS in kinds else []
        return sii.build(
            sii.Description(
                vendor=self.vendor,
                product=self.product,
                revision=self.revision,
                serial=self.serial,
                alias=self.alias,
                order=self.order,
                name=self.name or self.order,
                group=self.group,
                group_name=self.group_name,
                pdi_control=self.pdi_control,
                pdi_config=self.pdi_config,
                mailbox=self.mailbox,
                sync_managers=self._settings,
                fmmus=fmmus,
                tx_pdos=self.tx_pdos,
                rx_pdos=self.rx_pdos,
                ebus_current=self.ebus_current,
                physical_ports=self.physical_ports,
            )
        )

    def _default_sync_managers(self) -> list[SyncManager]:
        if self.sync_managers is not None:
            return list(self.sync_managers)
        sizes = {
            outputs: (sum(p.bit_length for p in self.assigned(outputs=outputs)) + 7) // 8
            for outputs in (True, False)
        }
        at, result = 0x1000, []
        if self.mailbox:
            box = self.mailbox
            result = [
                SyncManager(SmType.MAILBOX_OUT, box.receive, box.receive_size, _MAILBOX_OUT),
                SyncManager(SmType.MAILBOX_IN, box.send, box.send_size, _MAILBOX_IN),
            ]
            at = max(box.receive + box.receive_size, box.send + box.send_size)
        if self.rx_pdos or self.mailbox:
            on = int(sizes[True] > 0)
            result.append(SyncManager(SmType.OUTPUTS, at, sizes[True], _BUFFERED_OUTPUT, on))
            at += 3 * max(sizes[True], 0x40)  # a real controller keeps three buffers
        if self.tx_pdos or self.mailbox:
            on = int(sizes[False] > 0)
            result.append(SyncManager(SmType.INPUTS, at, sizes[False], _BUFFERED_INPUT, on))
        return result

    def _channel(self, kind: SmType) -> int | None:
        for channel, sm in enumerate(self._settings):
            if sm.type == kind:
                return channel
        return None

    def _describe_objects(self) -> None:
        """Objects that follow from identity and PDOs: 0x10xx, 0x16xx, 0x1Axx, 0x1Cxx, entries."""
        objects, u32 = self.dictionary, DataType.UNSIGNED32
        objects.variable(0x1000, "Device type", u32, self.device_type)
        objects.variable(0x1008, "Device name", DataType.VISIBLE_STRING, self.order or " ")
        objects.variable(0x1009, "Hardware version", DataType.VISIBLE_STRING, "00")
        objects.variable(0x100A, "Software version", DataType.VISIBLE_STRING, "01")
        identity = (
            ("Vendor ID", self.vendor),
            ("Product code", self.product),
            ("Revision", self.revision),
            ("Serial number", self.serial),
        )
        objects.record(
            0x1018,
            "Identity",
            [Variable(0x1018, i, name, u32, value=v) for i, (name, v) in enumerate(identity, 1)],
            type=0x0023,
        )
        for pdos, right in ((self.rx_pdos, Access.RX_PDO), (self.tx_pdos, Access.TX_PDO)):
            for pdo in pdos:
                self._describe_pdo(pdo, right)
        objects.array(
            0x1C00,
            "Sync manager type",
            DataType.UNSIGNED8,
            [int(sm.type) for sm in self._settings],
        )
        for outputs, (word, index) in self._WORDS.items():
            self._describe_assignment(index, f"{word} assign", outputs)

    def _describe_pdo(self, pdo: Pdo, right: Access) -> None:
        self.dictionary.array(
            pdo.index,
            pdo.name,
            DataType.UNSIGNED32,
            [e.index << 16 | e.subindex << 8 | e.bit_length for e in pdo.entries],
        )
        for entry in pdo.entries:
            if not entry.is_gap:
                self._describe_entry(entry, right)

    def _describe_entry(self, entry: Entry, right: Access) -> None:
        try:
            kind = DataType(entry.data_type)
        except ValueError:
            raise UsageError(
                f"{self.order}: entry {entry.address} has the unknown type 0x{entry.data_type:X}"
            ) from None
        access = (Access.RW if right == Access.RX_PDO else Access.RO) | right
        name = entry.name.rpartition("__")[2]  # SII names carry the group of the entry as well
        variable = Variable(
            entry.index, entry.subindex, name, kind, entry.bit_length, access
        )
        if entry.index in self.dictionary:
            item = self.dictionary.object(entry.index)
            item.entries.setdefault(entry.subindex, variable)
            if 0 in item.entries and item.code != ObjectCode.VAR:
                item.entries[0].value = item.max_subindex
        elif entry.subindex == 0:
            item = self.dictionary.record(entry.index, name, [], code=ObjectCode.VAR, type=kind)
            item.entries[0] = variable
        else:
            self.dictionary.record(entry.index, f"Object 0x{entry.index:04X}", [variable])

    def _describe_assignment(self, index: int, name: str, outputs: bool) -> None:
        values = self._assigned[outputs]
        right = Access.READ | Access.WRITE_PREOP if self.variable_assignment else Access.RO
        pdos = len(self.rx_pdos if outputs else self.tx_pdos)
        item = self.dictionary.array(
            index, name, DataType.UNSIGNED16, [*values, *[0] * (pdos - len(values))], right
        )
        item.entries[0].value = len(values)
        item.entries[0].on_write = lambda count: self._assign(outputs, count)

    def _assign(self, outputs: bool, count: Value) -> None:
        """The master writes the number of assigned PDOs, which makes the assignment valid."""
        index = self._WORDS[outputs][1]
        known = {pdo.index for pdo in (self.rx_pdos if outputs else self.tx_pdos)}
        entries = self.dictionary.object(index).entries
        if not isinstance(count, int) or count >= len(entries):
            raise SdoAbortError(abort_codes.VALUE_TOO_HIGH)
        wanted = [self[index, i] for i in range(1, count + 1)]
        if not known.issuperset(wanted) or len(set(wanted)) < len(wanted):
            raise SdoAbortError(abort_codes.VALUE_RANGE)
        self._assigned[outputs] = wanted
        self._make_images()

    def _make_images(self) -> None:
        self._outputs = ProcessImage(self.assigned(outputs=True), self.dictionary)
        self._inputs = ProcessImage(self.assigned(outputs=False), self.dictionary)

    # --- on the segment ------------------------------------------------------------------------

    @property
    def room(self) -> tuple[int, int]:
        """Bytes that the outputs and the inputs may take at most, whatever is assigned."""
        return (
            (sum(pdo.bit_length for pdo in self.rx_pdos) + 7) // 8,
            (sum(pdo.bit_length for pdo in self.tx_pdos) + 7) // 8,
        )

    def attach(self, segment: Segment, outputs_at: int, inputs_at: int) -> None:
        """Becomes the next slave of a segment.

        Args:
            segment: The segment.
            outputs_at: Where its outputs begin in the output image of the segment.
            inputs_at: Where its inputs begin in the input image.
        """
        self.position = segment.add(self.chip, self.sii_image())
        self._segment = segment
        self._outputs_at, self._inputs_at = outputs_at, inputs_at
        self._lock_process_data(True)

    def handle(self, event: Event, now: float) -> None:
        """Reacts to what the master did."""
        assert self._segment is not None
        if event & Event.AL_CONTROL:
            control = int.from_bytes(self._segment.read(self.position, 0x0120, 2), "little")
            self._deadline = now + _OUTPUTS_TIMEOUT
            self.machine.request(control)
        if event & Event.WATCHDOG and self.machine.state == AlState.OP:
            self.machine.fall_back(AlState.SAFEOP, AlCode.WATCHDOG)
        if event & Event.OUTPUTS:
            self._finish_pending()
        if self._mails and self.machine.state >= AlState.PREOP:
            if event & Event.MAILBOX_OUT:
                self._mails.was_read()
            if event & Event.MAILBOX_AGAIN:
                self._mails.again()
            if event & Event.MAILBOX_IN:
                mail = self._segment.take_mail(self.position)
                if mail:
                    self._mails.receive(mail)

    def take_outputs(self) -> None:
        """Takes the outputs of the segment, in OP and if they changed."""
        assert self._segment is not None
        size = self._outputs.size
        if size and self.machine.state == AlState.OP:
            data = bytes(self._segment.outputs[self._outputs_at : self._outputs_at + size])
            if data != self._last_outputs:
                self._last_outputs = data
                self.receive(data)

    def run(self, now: float) -> None:
        """Makes one step and gives the inputs to the segment."""
        assert self._segment is not None
        if self.machine.pending is not None and now > self._deadline:
            self.machine.refuse(AlCode.NO_OUTPUTS)
        self.step(now)
        if self._inputs.size and self.machine.state >= AlState.SAFEOP:
            at = self._inputs_at
            self._segment.inputs[at : at + self._inputs.size] = self.give()

    def _publish(self, status: int, code: int) -> None:
        assert self._segment is not None
        self._segment.set_al_status(self.position, status, code)

    def _put_mail(self, mail: bytes, again: bool) -> bool:
        assert self._segment is not None
        return self._segment.put_mail(self.position, mail, again=again)

    # --- state changes -------------------------------------------------------------------------

    def _enter(self, old: AlState, new: AlState) -> None:
        if new > old:
            self._check_step_up(new)
            self.check(old, new)
        if new == AlState.SAFEOP and old == AlState.PREOP:
            self._start_process_data()
        if new == AlState.OP and self._needs_outputs():
            self._await_outputs()
        if old == AlState.OP:
            self._stop_outputs()
        if new < AlState.SAFEOP <= old:
            self._stop_process_data()
        if AlState.INIT in (old, new) and self._mails and self._coe:
            self._mails.reset()
            self._coe.reset()
        self.changed(old, new)

    def _check_step_up(self, new: AlState) -> None:
        if new == AlState.PREOP and self.mailbox:
            box = self.mailbox
            self._check_mailbox(0, box.receive, box.receive_size, _DIRECTION_WRITE)
            self._check_mailbox(1, box.send, box.send_size, 0)
        if new == AlState.SAFEOP:
            self._check_data(SmType.OUTPUTS, self._outputs.size, AlCode.OUTPUTS)
            self._check_data(SmType.INPUTS, self._inputs.size, AlCode.INPUTS)

    def _sync_manager(self, channel: int) -> tuple[int, int, int, bool]:
        """Start, size, control and whether it is enabled, as the master set them."""
        assert self._segment is not None
        raw = self._segment.read(self.position, _SM_BASE + 8 * channel, 8)
        start, size, control, _, activate, _ = _SM_REGISTERS.unpack(raw)
        return start, size, control, bool(activate & 1)

    def _check_mailbox(self, channel: int, start: int, size: int, direction: int) -> None:
        set_start, set_size, control, enabled = self._sync_manager(channel)
        right = control & 3 == _MAILBOX_MODE and control & _DIRECTION == direction
        if not (enabled and right and set_start == start and 16 <= set_size <= size):
            raise Refused(AlCode.MAILBOX)

    def _check_data(self, kind: SmType, size: int, code: AlCode) -> None:
        channel = self._channel(kind)
        if channel is None:
            return
        start, set_size, control, enabled = self._sync_manager(channel)
        if size == 0:
            if enabled and set_size:
                raise Refused(code)
            return
        direction = _DIRECTION_WRITE if kind == SmType.OUTPUTS else 0
        right = control & 3 == 0 and control & _DIRECTION == direction
        if not (enabled and right and set_size == size and start == self._settings[channel].start):
            raise Refused(code)

    def _lock_process_data(self, locked: bool) -> None:
        """A device with a processor opens its process data from SAFEOP on."""
        if self._segment is None or not self.mailbox:
            return
        for kind in (SmType.OUTPUTS, SmType.INPUTS):
            channel = self._channel(kind)
            if channel is not None:
                self._segment.lock_sync_manager(self.position, channel, locked)

    def _start_process_data(self) -> None:
        assert self._segment is not None
        starts = {sm.type: sm.start for sm in self._settings}
        self._segment.map(
            self.position,
            ProcessDataMap(
                starts.get(SmType.OUTPUTS, 0),
                self._outputs.size,
                self._outputs_at,
                starts.get(SmType.INPUTS, 0),
                self._inputs.size,
                self._inputs_at,
            ),
        )
        self._lock_process_data(False)
        self._last_outputs = b""

    def _stop_process_data(self) -> None:
        assert self._segment is not None
        self._segment.map(self.position, None)
        self._lock_process_data(True)

    def _needs_outputs(self) -> bool:
        """A device with a processor enters OP with the first outputs."""
        return bool(self.mailbox and self._outputs.size)

    def _await_outputs(self) -> None:
        assert self._segment is not None
        self._segment.await_outputs(self.position)
        raise Pending

    def _finish_pending(self) -> None:
        if self.machine.pending is not None:
            old = self.machine.state
            self.machine.finish()
            self.changed(old, self.machine.state)

    def _stop_outputs(self) -> None:
        self._last_outputs = b""
        self.receive(bytes(self._outputs.size))
        self.outputs_stopped()
