"""The base class of simulated devices.

A device of one's own states its identity and its PDOs and computes its inputs from its outputs:

    class Doubler(Device):
        vendor, product, revision, order = 0x0000FFFF, 1, 1, "Doubler"
        mailbox = Mailbox()
        rx_pdos = (Pdo(0x1600, "Outputs", 2, [Entry(0x7000, 1, "In", DataType.INTEGER16, 16)]),)
        tx_pdos = (Pdo(0x1A00, "Inputs", 3, [Entry(0x6000, 1, "Out", DataType.INTEGER16, 16)]),)

        def step(self, now):
            self[0x6000, 1] = 2 * self[0x7000, 1]
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

from ecatd.model.al import AlState
from ecatd.model.bus import Pdo

from ..core import Chip, Event, ProcessDataMap, Segment
from . import sii, standard_objects, sync_managers
from .coe import CoeServer
from .mailbox import MailboxServer, Protocol
from .objects import Access, Dictionary, Variable
from .process_image import ProcessImage
from .sii import FmmuType, Mailbox, SmType, SyncManager
from .state_machine import AlCode, StateMachine

_AL_CONTROL = 0x0120
_OUTPUTS_TIMEOUT = 1.0
_COMPLETE_ACCESS = 0x20


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
        physical_ports: SII port types, nibbles from port 0: 0 none, 1 MII, 3 EBUS.
        ebus_current: Current taken from the E-bus in mA.
        mailbox: The mailbox with CoE, or None for a device without a processor.
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
    physical_ports: int = 0x11
    ebus_current: int = 0
    mailbox: Mailbox | None = None
    sync_managers: Sequence[SyncManager] | None = None
    fmmus: Sequence[FmmuType] | None = None
    rx_pdos: Sequence[Pdo] = ()
    tx_pdos: Sequence[Pdo] = ()
    variable_assignment: bool = False
    period: float = 0.001

    def __init__(self) -> None:
        # Class attributes describe a type; a device may change its own copies.
        self.rx_pdos = copy.deepcopy(tuple(self.rx_pdos))
        self.tx_pdos = copy.deepcopy(tuple(self.tx_pdos))
        self.position = -1
        self.dictionary = Dictionary()
        self.machine = StateMachine(self._enter, self._publish)
        self._on_bus: Segment | None = None
        self._outputs_at = self._inputs_at = 0
        self._deadline = 0.0
        self._last_outputs = b""
        self._add_objects()
        self.describe()
        self._make_images()
        self._settings = (
            sync_managers.derive(self.mailbox, self._outputs.size, self._inputs.size)
            if self.sync_managers is None
            else list(self.sync_managers)
        )
        standard_objects.add_sync_managers(self.dictionary, self._settings)
        self._start_mailbox()

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
            RefusedError: The device does not follow; with the AL status code to report.
        """

    def outputs_stopped(self) -> None:
        """Called when the device leaves OP: outputs in the dictionary have become 0."""

    def receive(self, data: bytes) -> None:
        """Takes changed outputs; by default into the dictionary."""
        self._outputs.unpack(data)

    def give(self) -> bytes:
        """Returns the inputs; by default from the dictionary."""
        return self._inputs.pack()

    def connection(self, index: int, subindex: int) -> Variable:
        """What a wire or a plant connects to: the entry itself, unless the device converts it."""
        return self.dictionary[index, subindex]

    def fail(self, code: int, state: AlState = AlState.SAFEOP) -> None:
        """Falls back to a state, or stays in a lower one, with an AL status code."""
        self.machine.fall_back(min(state, self.machine.state), code)

    def __getitem__(self, key: tuple[int, int]) -> int:
        """The integer value of the entry (index, subindex)."""
        value = self.dictionary[key].value
        return value if isinstance(value, int) else 0

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        """Sets the integer value of the entry (index, subindex)."""
        self.dictionary[key].value = value

    # --- description ---------------------------------------------------------------------------

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
                mailbox=self.mailbox,
                sync_managers=self._settings,
                fmmus=fmmus,
                tx_pdos=self.tx_pdos,
                rx_pdos=self.rx_pdos,
                ebus_current=self.ebus_current,
                physical_ports=self.physical_ports,
            )
        )

    def _add_objects(self) -> None:
        objects = self.dictionary
        identity = (self.vendor, self.product, self.revision, self.serial)
        standard_objects.add_identity(objects, self.device_type, self.order, identity)
        standard_objects.add_pdos(objects, self.rx_pdos, Access.RX_PDO)
        standard_objects.add_pdos(objects, self.tx_pdos, Access.TX_PDO)
        self._rx, self._tx = (
            standard_objects.PdoAssignment(
                objects,
                index,
                name,
                pdos,
                variable=self.variable_assignment,
                changed=self._make_images,
            )
            for index, name, pdos in (
                (0x1C12, "RxPDO assign", self.rx_pdos),
                (0x1C13, "TxPDO assign", self.tx_pdos),
            )
        )

    def _make_images(self) -> None:
        self._outputs = ProcessImage(self._rx.pdos, self.dictionary)
        self._inputs = ProcessImage(self._tx.pdos, self.dictionary)

    def _start_mailbox(self) -> None:
        self._coe: CoeServer | None = None
        self._mails: MailboxServer | None = None
        if self.mailbox:
            self._coe = CoeServer(
                self.dictionary,
                lambda: self.machine.state,
                self.mailbox.send_size,
                complete_access=bool(self.mailbox.coe_details & _COMPLETE_ACCESS),
            )
            self._mails = MailboxServer({Protocol.COE: self._coe.handle}, self._put_mail)

    # --- on the segment ------------------------------------------------------------------------

    @property
    def room(self) -> tuple[int, int]:
        """Bytes that the outputs and the inputs take at most, whatever is assigned."""
        return (
            sum(pdo.bit_length for pdo in self.rx_pdos) // 8 + 1,
            sum(pdo.bit_length for pdo in self.tx_pdos) // 8 + 1,
        )

    @property
    def _segment(self) -> Segment:
        assert self._on_bus is not None, "the device is not attached to a segment"
        return self._on_bus

    def attach(self, segment: Segment, outputs_at: int, inputs_at: int) -> None:
        """Becomes the next slave of a segment.

        Args:
            segment: The segment.
            outputs_at: Where its outputs begin in the output image of the segment.
            inputs_at: Where its inputs begin in the input image.
        """
        self.position = segment.add(self.chip, self.sii_image())
        self._on_bus = segment
        self._outputs_at, self._inputs_at = outputs_at, inputs_at
        self._lock_process_data(True)

    def handle(self, event: Event, now: float) -> None:
        """Reacts to what the master did.

        Args:
            event: What happened.
            now: CLOCK_MONOTONIC in seconds.
        """
        if event & Event.AL_CONTROL:
            control = int.from_bytes(self._segment.read(self.position, _AL_CONTROL, 2), "little")
            self._deadline = now + _OUTPUTS_TIMEOUT
            self.machine.request(control)
        if event & Event.WATCHDOG and self.machine.state == AlState.OP:
            self.fail(AlCode.WATCHDOG)
        if event & Event.OUTPUTS:
            self.machine.finish()
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
        size = self._outputs.size
        if size and self.machine.state == AlState.OP:
            data = bytes(self._segment.outputs[self._outputs_at : self._outputs_at + size])
            if data != self._last_outputs:
                self._last_outputs = data
                self.receive(data)

    def run(self, now: float) -> None:
        """Makes one step and gives the inputs to the segment.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """
        if self.machine.pending is not None and now > self._deadline:
            self.machine.refuse(AlCode.NO_OUTPUTS)
        self.step(now)
        if self._inputs.size and self.machine.state >= AlState.SAFEOP:
            at = self._inputs_at
            self._segment.inputs[at : at + self._inputs.size] = self.give()

    def _publish(self, status: int, code: int) -> None:
        self._segment.set_al_status(self.position, status, code)

    def _put_mail(self, mail: bytes, again: bool) -> bool:
        return self._segment.put_mail(self.position, mail, again=again)

    # --- state changes -------------------------------------------------------------------------

    def _enter(self, old: AlState, new: AlState) -> bool:
        """Carries out a state change; see `StateMachine`."""
        if new > old:
            self._check_settings(new)
            self.check(old, new)
        if new == AlState.SAFEOP and old == AlState.PREOP:
            self._start_process_data()
        if old == AlState.OP:
            self._stop_outputs()
        if new < AlState.SAFEOP <= old:
            self._segment.map(self.position, None)
            self._lock_process_data(True)
        if AlState.INIT in (old, new) and self._mails and self._coe:
            self._mails.reset()
            self._coe.reset()
        if new == AlState.OP and self.mailbox and self._outputs.size:
            # A device with a processor enters OP with the first outputs.
            self._segment.await_outputs(self.position)
            return False
        return True

    def _check_settings(self, new: AlState) -> None:
        if new == AlState.PREOP and self.mailbox:
            sync_managers.check_mailbox(self._segment, self.position, self.mailbox)
        if new == AlState.SAFEOP:
            sync_managers.check_process_data(
                self._segment,
                self.position,
                self._settings,
                self._outputs.size,
                self._inputs.size,
            )

    def _lock_process_data(self, locked: bool) -> None:
        """A device with a processor opens its process data from SAFEOP on."""
        for kind in (SmType.OUTPUTS, SmType.INPUTS):
            channel = sync_managers.channel_of(self._settings, kind)
            if self.mailbox and channel is not None:
                self._segment.lock_sync_manager(self.position, channel, locked)

    def _start_process_data(self) -> None:
        starts = {sm.type: sm.start for sm in self._settings}
        where = ProcessDataMap(
            starts.get(SmType.OUTPUTS, 0),
            self._outputs.size,
            self._outputs_at,
            starts.get(SmType.INPUTS, 0),
            self._inputs.size,
            self._inputs_at,
        )
        self._segment.map(self.position, where)
        self._lock_process_data(False)
        self._last_outputs = b""

    def _stop_outputs(self) -> None:
        self._last_outputs = b""
        self.receive(bytes(self._outputs.size))
        self.outputs_stopped()
