"""The base class of simulated devices.

A new device defines its identity and its PDOs, and computes its inputs from its outputs:

    class Doubler(Device):
        vendor, product, revision, order = 0x0000FFFF, 1, 1, "Doubler"
        mailbox = Mailbox()
        rx_pdos = (Pdo(0x1600, "Outputs", 2, [Entry(0x7000, 1, "In", DataType.INTEGER16, 16)]),)
        tx_pdos = (Pdo(0x1A00, "Inputs", 3, [Entry(0x6000, 1, "Out", DataType.INTEGER16, 16)]),)

        def step(self, now):
            self[0x6000, 1] = 2 * self[0x7000, 1]
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import replace

from ecatd.base.addresses import address_text
from ecatd.base.errors import UsageError
from ecatd.etg.al import AlState
from ecatd.etg.diagnosis import Kind
from ecatd.etg.eoe import IpParameters
from ecatd.etg.pdo import Pdo

from ..esc import Event, Segment
from . import emergency, standard_objects
from .device_type import DeviceType
from .diagnosis import DiagnosisHistory
from .drift import Drift
from .ethernet import EchoHost, TapHost
from .mailbox import MailboxFault
from .modules import ModuleSlots
from .objects import Dictionary, Variable
from .pdo_objects import mapping_value, tell_instead
from .process_data import ProcessData
from .process_image import is_number
from .services import Services
from .state_checks import StateChecks
from .state_machine import AlCode, RefusedError, StateMachine
from .synchronization import Synchronization

_AL_CONTROL = 0x0120
_EVENT_MASK = 0x0204  # register: the events that interrupt the device
_EVENTS, _SYNC0_EVENT = 0x00FFFF03, 0x00000004  # without SYNC0 and SYNC1: too frequent
_OF_EMERGENCY = 0xE800  # diagnosis code with the error code of an emergency
_TIMEOUT = 1.0  # seconds that a change to OP waits for the master
_AWAKE, _WOKEN = -1, -2  # no numbers of changes: it makes steps; it has not made one yet


class Device(DeviceType):
    """A slave: its identity, dictionary, process data and behaviour.

    The attributes that describe it are those of `DeviceType`.

    Attributes:
        position: Position on the segment; -1 before `attach`.
        dictionary: The object dictionary.
        machine: The AL state machine.
        history: The diagnosis history, or None.
        remarks: What the file that describes it has wrong, and how it is simulated all the same.
    """

    _tells_rest = True
    """Whether `rests` speaks for `step` and `give`: it is as near in the order of classes."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        depth = {
            name: next(number for number, each in enumerate(cls.__mro__) if name in vars(each))
            for name in ("rests", "step", "give")
        }
        cls._tells_rest = depth["rests"] <= min(depth["step"], depth["give"])

    def __init__(self) -> None:
        # Class attributes describe a type; each device may change its own copies.
        self.rx_pdos = _copies(self.rx_pdos)
        self.tx_pdos = _copies(self.tx_pdos)
        self.files = dict(self.files)
        self.idns = [{number: copy(idn) for number, idn in each.items()} for each in self.idns]
        self.ethernet = TapHost(self.eoe_interface) if self.eoe_interface else EchoHost()
        self.position = -1
        self.remarks: list[str] = []
        self.dictionary = Dictionary()
        self.machine = StateMachine(
            self._enter,
            self._publish,
            bootstrap=self.bootstrap is not None,
            identification=lambda: None if self.device_id_register else self.device_id,
        )
        self._on_bus: Segment | None = None
        self._awaited = Event(0)
        self._deadline = 0.0
        self._requested_at: float | None = None  # a request for a state waits for `state_delay`
        self._next_step = 0.0
        self._asleep_since = _WOKEN
        self._drifts: dict[tuple[int, int], Drift] = {}
        self._last_outputs = b""
        self._slots: ModuleSlots | None = None
        self._sync = Synchronization(self.dc_modes, self.minimum_cycle_ns)
        self._add_objects()
        self.history = (
            DiagnosisHistory(self.dictionary, self.diagnosis_messages)
            if self.diagnosis_messages
            else None
        )
        self.describe()
        self._process_data.rebuild()
        for index, entries in self.told_mappings.items():
            values = None if entries is None else [mapping_value(entry) for entry in entries]
            tell_instead(self.dictionary, index, values)
        for index, assigned in self.told_assignments.items():
            tell_instead(self.dictionary, index, assigned)
        standard_objects.add_sync_managers(self.dictionary, self._process_data.settings)
        self.dictionary.remember()
        self._services = (
            Services(
                *(self.mailbox, self.bootstrap, self.dictionary, lambda: self.machine.state),
                *(self, self.idns, self.ethernet),
                sized_uploads=self.sized_uploads,
            )
            if self.mailbox
            else None
        )

    # --- for subclasses ------------------------------------------------------------------------

    def describe(self) -> None:
        """Adds objects to `dictionary`, or changes those made from the PDOs."""

    def step(self, now: float) -> None:
        """Computes the inputs from the outputs; called every `period` seconds (or `idle_period`).

        A device that rests is not called, see `rests`.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """

    def rests(self) -> bool:
        """Whether `step` and `give` go by outputs, objects and state only, and not by time, now.

        Then a step is made when one of them has changed, and again until a step changes no object.
        This speaks for the `step` and the `give` of this class and of the classes above it: a
        subclass with others, and without a `rests` of its own, makes each step.
        """
        return True

    def check(self, old: AlState, new: AlState) -> None:
        """Makes the device's own checks before a change to a higher state.

        Raises:
            RefusedError: The device refuses the change, with this AL status code.
        """

    def outputs_stopped(self) -> None:
        """Called when the device leaves OP, after outputs in the dictionary have become 0."""

    def receive(self, data: bytes) -> None:
        """Takes changed outputs; by default it writes them to the dictionary."""
        self._process_data.outputs.unpack(data)

    def give(self) -> bytes:
        """Returns the bytes of the mapped inputs; by default it reads them from the dictionary."""
        return self._process_data.inputs.pack()

    def on_file(self, name: str, data: bytes, password: int) -> None:
        """Takes a file that the master has written by FoE; by default it stores it in `files`.

        In BOOT (`self.machine.state`) it may be firmware.

        Raises:
            FoeError: The device refuses the file, with this FoE error code.
        """
        del password
        self.files[name] = data

    def with_module(self, slot: int, module: str) -> Device:
        """Makes the same device with another module in a slot.

        Args:
            slot: The slot, 1 first.
            module: Type of the module; "-" for an empty slot.

        Raises:
            UsageError: The device has no such slot, or the module does not exist.
        """
        raise UsageError(f"{self.order or self.name} takes no modules (slot {slot}, {module})")

    def entering(self, old: AlState, new: AlState) -> None:
        """Called when it changes its state, after the checks."""

    @property
    def program(self) -> tuple[int, int] | None:
        """A function in C that has the process data, and its context, for `Segment.set_program`.

        `receive` and `give` are not called then.
        """
        return None

    def set_pdos(self, rx_pdos: Iterable[Pdo], tx_pdos: Iterable[Pdo]) -> None:
        """Replaces all PDOs, for a device whose process data follow from other objects."""
        at = self._process_data.at
        self.rx_pdos, self.tx_pdos = _copies(rx_pdos), _copies(tx_pdos)
        self._make_process_data()
        self._process_data.rebuild()
        self._process_data.at = at

    # --- for devices, rigs and tests -----------------------------------------------------------

    def connection(self, index: int, subindex: int) -> Variable:
        """Returns the entry for a wire or plant: the PDO entry, unless the device converts it."""
        return self.dictionary.mapped(index, subindex)

    def fail(self, code: int, state: AlState = AlState.SAFEOP) -> None:
        """Falls back to a state, or stays in a lower one, with error flag and AL status code.

        From BOOT, only INIT can be reached.
        """
        now = self.machine.state
        if now == AlState.BOOT and state != AlState.INIT:
            state = now
        self.machine.fall_back(min(state, now), code)

    def select(self, identification: int | None) -> None:
        """Sets the selector with the device identification, 0 to 65535; None for no selector."""
        self.device_id = identification
        if self._on_bus and self.device_id_register:
            data = (identification or 0).to_bytes(2, "little")
            self._on_bus.write(self.position, self.device_id_register, data)

    def emergency(self, code: int, register: int, data: bytes = b"") -> None:
        """Sets the error register 0x1001 and, from PREOP on, sends an emergency.

        Args:
            code: Error code (ETG.1000.6, CiA 301); 0 means that the error is gone.
            register: New value of 0x1001.
            data: Device-specific data, at most five bytes.

        Raises:
            ValueError: A number does not fit, or there are more than five bytes.
        """
        body = emergency.encode(code, register, data)
        if 0x1001 in self.dictionary:
            self.dictionary[0x1001, 0].value = register
        if self.history and code:
            self.history.add(_OF_EMERGENCY | code << 16, Kind.ERROR)
        if self._services:
            self.wake()
            self._services.emergency(body)

    def drift(self, address: tuple[int, int], per_second: float, limit: float) -> None:
        """Lets a mapped input drift away from its true value from now on.

        Args:
            address: Index and subindex of the entry.
            per_second: How far, in raw units a second; 0: it is true again.
            limit: How far at most, in raw units; 0: to the end of its type.
        """
        self._drifts.pop(address, None)
        if per_second:
            self._drifts[address] = Drift(per_second, limit)
        self.wake()

    def check_drift(self, address: tuple[int, int]) -> None:
        """Checks that an input can drift.

        Raises:
            UsageError: It is not mapped, or has no numbers.
        """
        there = {(item.index, item.subindex): item for item in self._process_data.inputs.variables}
        numbers = sorted(key for key, item in there.items() if is_number(item))
        if address in numbers:
            return
        what = "has no numbers" if address in there else "is no mapped input"
        known = ", ".join(address_text(*key) for key in numbers[:8]) or "none"
        more = f" and {len(numbers) - 8} more" if len(numbers) > 8 else ""
        raise UsageError(
            f"{address_text(*address)} {what} of slave {self.position} "
            f"({self.order or self.name}); inputs with numbers: {known}{more}"
        )

    def reset(self) -> None:
        """Returns to the state after power-on: INIT, empty mailboxes, initial values of objects.

        Files and identity stay, as in a flash memory. A subclass with a state of its own extends
        this method. `Segment.power` resets the registers of the slave controller; if both are
        called, this method comes second.
        """
        if self.machine.state == AlState.OP:
            self._stop_outputs()
        self.dictionary.restore()
        self._process_data.rebuild()
        if self._services:
            self._services.close()
        self.ethernet.set_ip(IpParameters())
        self._sync.stop()
        self._awaited = Event(0)
        self._requested_at = None
        if self._on_bus:
            self._on_bus.map(self.position)
            self._lock_process_data(True)
            self._mask_events(_EVENTS)
            self.select(self.device_id)
        self.machine.reset()

    @property
    def mailbox_fault(self) -> MailboxFault:
        """The fault of the mailbox, which may be set at any time.

        Raises:
            UsageError: The property is set, but the device has no mailbox.
        """
        return self._services.server.fault if self._services else MailboxFault()

    @mailbox_fault.setter
    def mailbox_fault(self, fault: MailboxFault) -> None:
        if self._services is None:
            raise UsageError(f"slave {self.position} ({self.order}) has no mailbox to disturb")
        self.wake()
        self._services.server.fault = fault

    def __getitem__(self, key: tuple[int, int]) -> int:
        """Returns the integer value of the entry (index, subindex)."""
        value = self.dictionary.mapped(*key).value
        return value if isinstance(value, int) else 0

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        """Sets the integer value of the entry (index, subindex)."""
        self.dictionary.mapped(*key).value = value

    # --- description ---------------------------------------------------------------------------

    def sii_image(self) -> bytes:
        """Returns the content of the EEPROM; by default it is built from the attributes."""
        return self._build_sii(self._process_data.settings)

    def _add_objects(self) -> None:
        identity = (self.vendor, self.product, self.revision, self.serial)
        standard_objects.add_identity(self.dictionary, self.device_type, self.order, identity)
        self._make_process_data()
        if self.modules:
            self._slots = ModuleSlots(self.dictionary, self.modules, self.module_distance)
        if self.mailbox and (self.dc_modes or self.sync_parameters):
            self._sync.add_objects(self.dictionary, outputs=bool(self.rx_pdos))

    def _make_process_data(self) -> None:
        mapping = self.variable_mapping
        if isinstance(mapping, bool):
            mapping = [pdo.index for pdo in (*self.rx_pdos, *self.tx_pdos)] if mapping else ()
        self._process_data = ProcessData(
            self.dictionary,
            self.rx_pdos,
            self.tx_pdos,
            self._settings(),
            assignment=self.variable_assignment,
            mapping=mapping,
            limits=self.mapping_limits,
        )

    # --- on the segment ------------------------------------------------------------------------

    @property
    def room(self) -> tuple[int, int]:
        """Bytes that it needs in the images of the segment, with any assignment and mapping."""
        return (0, 0) if self.program else self._process_data.room

    @property
    def _segment(self) -> Segment:
        assert self._on_bus is not None, "the device is not attached to a segment"
        return self._on_bus

    def attach(
        self, segment: Segment, outputs_at: int, inputs_at: int, place: int | None = None
    ) -> None:
        """Becomes a slave of a segment, as at power-on.

        Args:
            segment: The segment.
            outputs_at: Offset of its outputs in the output image of the segment.
            inputs_at: Offset of its inputs in the input image.
            place: Position of the slave that it replaces; None appends a slave.
        """
        if self.position < 0:
            self.dictionary.remember()
        else:
            self.detach()  # its last segment may be closed already
        if place is None:
            place = segment.add(self.chip, self.sii_image())
        else:
            segment.replace(place, self.chip, self.sii_image())
        self.position = place
        self._on_bus = segment
        self._process_data.at = (outputs_at, inputs_at)
        if self.program:
            segment.set_program(place, *self.program)
        self._lock_process_data(True)
        self._mask_events(_EVENTS)
        self.select(self.device_id)
        if self._services:
            self._services.attach(segment, self.position)

    def detach(self) -> None:
        """Leaves the segment, so that another device can take its place."""
        self._on_bus = None
        if self._services:
            self._services.attach(None, self.position)
        self.reset()

    @property
    def sleeps(self) -> bool:
        """Whether the device rests and nothing has changed since: `run` would change nothing."""
        return self._asleep_since == self.dictionary.changes

    def wake(self) -> None:
        """Ends its rest: something has changed that is no object."""
        self._asleep_since = _WOKEN

    def handle(self, event: Event, now: float) -> None:
        """Handles events that the master has caused.

        Args:
            event: The events.
            now: CLOCK_MONOTONIC in seconds.
        """
        self.wake()
        if event & Event.RESET:
            self.reset()
        if event & Event.AL_CONTROL:
            self._requested_at = now
            self._take_request(now)
        if event & Event.WATCHDOG and self.machine.state == AlState.OP and not self.emulated:
            self.fail(AlCode.WATCHDOG)
        if event & self._awaited:
            self._wait_for(self._awaited & ~event)
            if not self._awaited:
                self.machine.finish()
        if self._services:
            self._set_mailbox()
            self._services.handle(event, now)

    def _take_request(self, now: float) -> None:
        """Takes the request for a state if `state_delay` is over."""
        if self._requested_at is None or now < self._requested_at + self.state_delay:
            return
        self._requested_at = None
        self._deadline = now + _TIMEOUT
        control = self._read(_AL_CONTROL, 2)
        if self.emulated:
            self.machine.follow(control)
        else:
            self.machine.request(control)

    def take_outputs(self) -> None:
        """Takes the outputs from the segment if the device is in OP and they have changed."""
        size = 0 if self.program else self._process_data.outputs.size
        if size and self.machine.state == AlState.OP:
            at = self._process_data.at[0]
            data = bytes(self._segment.outputs[at : at + size])
            if data != self._last_outputs:
                self._asleep_since = _WOKEN
                self._last_outputs = data
                self.receive(data)

    def run(self, now: float) -> None:
        """Makes one step and writes the inputs to the segment; needless while it sleeps.

        Args:
            now: CLOCK_MONOTONIC in seconds.
        """
        asleep_since = self._asleep_since
        self._take_request(now)
        if self.machine.pending is not None and now > self._deadline:
            outputs = self._awaited & Event.OUTPUTS
            self.machine.refuse(AlCode.NO_OUTPUTS if outputs else AlCode.NO_SYNC)
        in_op = self.machine.state == AlState.OP
        if self._sync.is_watched and in_op and self._sync.is_lost(self._read):
            self.fail(AlCode.SYNC_STOPPED)
        if self._services:
            self._set_mailbox()
            self._services.run(now)
        self._asleep_since = changes = _AWAKE
        if self.machine.state >= AlState.SAFEOP or now >= self._next_step:
            changes = self.dictionary.changes
            self.step(now)
            self._next_step = now + self.idle_period
        size = 0 if self.program else self._process_data.inputs.size
        if size and self.machine.state >= AlState.SAFEOP:
            at = self._process_data.at[1]
            self._segment.inputs[at : at + size] = self._drifted(self._given(size), now)
        # Whoever has just been woken will probably be so again: the next step shows.
        if asleep_since != _WOKEN and changes == self.dictionary.changes and self._has_rest():
            self._asleep_since = changes

    def _drifted(self, data: bytes, now: float) -> bytes:
        """The inputs as sensors that drift tell them."""
        if not self._drifts:
            return data
        offsets = {address: item.offset(now) for address, item in self._drifts.items()}
        return self._process_data.inputs.shifted(data, offsets)

    def _has_rest(self) -> bool:
        """Whether the device has nothing to do at a later time."""
        machine = self.machine
        return (
            self._tells_rest
            and self.rests()
            and not self._drifts
            and self._requested_at is None
            and machine.pending is None
            and not (self._sync.is_watched and machine.state == AlState.OP)
            and (self._services is None or self._services.rests)
        )

    def _set_mailbox(self) -> None:
        assert self._services is not None
        self._services.server.delay = self.answer_delay
        self._services.server.fixed_counter = self.mail_counter

    def _given(self, size: int) -> bytes:
        """The inputs, after a check: `give` may be that of a user's file.

        Raises:
            UsageError: They are no bytes, or not as many as are mapped.
        """
        data: object = self.give()
        if isinstance(data, bytes | bytearray) and len(data) == size:
            return bytes(data)
        what = f"{len(data)} bytes" if isinstance(data, bytes | bytearray) else repr(data)[:40]
        raise UsageError(
            f"slave {self.position}: give() of {type(self).__name__} returns {what}, but its "
            f"mapped inputs have {size}"
        )

    def _read(self, register: int, size: int) -> int:
        return int.from_bytes(self._segment.read(self.position, register, size), "little")

    def _publish(self, status: int, code: int) -> None:
        self.wake()
        if self._on_bus:
            self._on_bus.set_al_status(self.position, status, code)

    # --- state changes -------------------------------------------------------------------------

    def _enter(self, old: AlState, new: AlState) -> bool:
        """Carries out a state change; see `StateMachine`."""
        self._wait_for(Event(0))
        if new > old and not self.emulated:
            self._check(old, new)
        if old == AlState.OP:
            self._stop_outputs()
        if new < AlState.SAFEOP <= old:
            self._segment.map(self.position)
            self._lock_process_data(True)
            self._sync.stop()
        if new == AlState.SAFEOP and old == AlState.PREOP:
            self._process_data.start(self._segment, self.position)
            self._lock_process_data(False)
        if self._services and old == AlState.INIT:
            self._services.open(new)
        if self._services and new == AlState.INIT:
            self._services.close()
        if new == AlState.OP and self.mailbox:
            # A device with a processor enters OP only after the first outputs, and after a SYNC0
            # pulse if it uses SYNC0.
            outputs = Event.OUTPUTS if self._process_data.outputs.size else Event(0)
            self._wait_for(outputs | (Event.SYNC0 if self._sync.is_watched else Event(0)))
        self.entering(old, new)
        return not self._awaited

    def _wait_for(self, events: Event) -> None:
        """Notes the events for which a change to OP still waits, and enables them."""
        if events & ~self._awaited & Event.OUTPUTS:
            self._segment.await_outputs(self.position)
        if (events ^ self._awaited) & Event.SYNC0:
            self._mask_events(_EVENTS | (_SYNC0_EVENT if events & Event.SYNC0 else 0))
        self._awaited = events

    def _mask_events(self, mask: int) -> None:
        self._segment.write(self.position, _EVENT_MASK, mask.to_bytes(4, "little"))

    def _check(self, old: AlState, new: AlState) -> None:
        try:
            StateChecks(self, self._process_data, self._segment, self.position).check(new)
            if new == AlState.SAFEOP:
                if self._slots:
                    self._slots.check()
                self._sync.start(self._read)
            self.check(old, new)
        except RefusedError as refusal:
            code = emergency.refused(old, new)
            if self.state_emergencies and code is not None:
                self.emergency(code, self[0x1001, 0], refusal.diagnosis)
            raise

    def _lock_process_data(self, locked: bool) -> None:
        """Locks or unlocks the process data of a device with a processor, for SAFEOP and above."""
        if self.mailbox:
            self._process_data.lock(self._segment, self.position, locked)

    def _stop_outputs(self) -> None:
        self._last_outputs = b""
        self.receive(bytes(self._process_data.outputs.size))
        self.outputs_stopped()


def _copies(pdos: Iterable[Pdo]) -> tuple[Pdo, ...]:
    return tuple(replace(pdo, entries=[copy(entry) for entry in pdo.entries]) for pdo in pdos)
