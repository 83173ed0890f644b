"""The attributes of a type of device: identity, mailbox, PDOs and capabilities."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import byte_length

from ..esc import Chip
from . import sii
from .sii import DcMode, FmmuType, Mailbox, SmType, SyncManager
from .soe import Idn
from .sync_managers import default_size, derive

_SYNC_TO_DEVICE = 0xCC00  # registers 0x0150, 0x0151: SYNC0 and SYNC1 are outputs and AL events


class DeviceType:
    """The attributes that a device may define; a subclass of `Device` sets those it needs.

    Attributes:
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        serial: Serial number.
        alias: Configured station alias.
        device_id: Device identification (explicit device ID, for example of a rotary switch), or
            None. A master requests it with bit 5 of AL control.
        device_id_register: Address in the memory of the ESC where the device puts its
            identification instead; 0 for none.
        order: Order code, which masters show as the name.
        name: Name of the device.
        group: Group type.
        group_name: Name of the group.
        device_type: Object 0x1000.
        chip: The slave controller.
        pdi_control: SII word 0.
        pdi_config: SII word 1; None takes the value that the DC modes need.
        sync_pulse: SII word 2: length of SYNC pulses in 10 ns; with 0, a pulse lasts until the
            device acknowledges it.
        physical_ports: SII port types, nibbles from port 0: 0 none, 1 MII, 3 EBUS.
        ebus_current: Current drawn from the E-bus in mA.
        mailbox: The mailbox with CoE, or None for a device without a processor.
        bootstrap: The mailbox in BOOT, or None for a device without BOOT.
        sync_managers: Sync managers; None derives them from the mailbox and the PDOs.
        fmmus: Purposes of the FMMUs; None derives them from the sync managers.
        rx_pdos: RxPDOs (outputs); sync manager 0xFF means not assigned by default.
        tx_pdos: TxPDOs (inputs), in the same way.
        variable_assignment: Whether a master may write the PDO assignment 0x1C12 and 0x1C13.
        variable_mapping: Whether a master may write the PDO mapping 0x1600… and 0x1A00…: of all
            PDOs, or of those with the given indices.
        mapping_limits: Largest sizes of outputs and inputs in bytes with a variable mapping.
        told_mappings: What the mapping objects of PDOs tell a master instead of what the device
            does: by index of the PDO, the entries; None: there is no such object. For devices that
            contradict themselves.
        told_assignments: The same of the PDO assignments: by index, such as 0x1C13, the values.
        sized_uploads: Whether expedited uploads say how many of their four bytes are meant. If not,
            the others are 0xA5.
        dc_modes: The ways in which the device uses SYNC0 and SYNC1 (distributed clocks); without
            any, it ignores them.
        minimum_cycle_ns: Shortest cycle time of SYNC0 in ns that it accepts.
        modules: Ident of the module in each slot of a modular device (ETG.5001), slot 1 first, 0
            for an empty slot; none for a device without slots.
        module_distance: Distance between the objects of two neighbouring slots.
        pdos_in_sii: Whether the SII describes the PDOs; that of a modular device usually does not.
        sync_parameters: Whether it has the objects 0x1C32 and 0x1C33 even without DC modes.
        emulated: Whether the slave controller itself answers AL control (device emulation, register
            0x0141 bit 0): every state is entered without checks.
        longest_watchdog: Longest process data watchdog in seconds that the device accepts for
            SAFEOP; None accepts any time, and no watchdog.
        needs_eeprom: Whether the device reads its EEPROM before PREOP, so that the master must have
            handed it over (register 0x0500).
        state_emergencies: Whether it also sends an emergency, 0xA000 or 0xA001, when it refuses
            SAFEOP or OP.
        diagnosis_messages: How many messages its diagnosis history keeps (object 0x10F3); 0 for no
            history. Each emergency is in it.
        answer_delay: Seconds from a mail to its answer.
        mail_counter: The counter of all its mails, 0 to 7, of a device that does not count them;
            None counts.
        state_delay: Seconds from a request for a state to the state, or to its refusal.
        file_password: Password of the files, or None if any is accepted.
        file_limit: Size of the largest file in bytes that a master may write.
        file_busy: How many times each packet of a written file is answered with BUSY first.
        firmware_files: Files that can be written in BOOT only.
        firmware_valid: Whether there is firmware; without it only BOOT can be reached.
        files: Files for FoE, by name.
        idns: IDNs for SoE, by their numbers, of each drive in the device.
        eoe_interface: Network interface (TAP) behind its EoE, which the simulator makes; empty: it
            answers ping and the echo service itself.
        period: Seconds between two calls of `step`.
        idle_period: Least time between two calls in states without process data, in seconds. Nobody
            sees the difference for a device that only makes inputs.
    """

    vendor: int = 0
    product: int = 0
    revision: int = 0
    serial: int = 0
    alias: int = 0
    device_id: int | None = None
    device_id_register: int = 0
    order: str = ""
    name: str = ""
    group: str = ""
    group_name: str = ""
    device_type: int = 0x00001389
    chip: Chip = Chip()
    pdi_control: int = 0x0C05
    pdi_config: int | None = None
    sync_pulse: int = 0
    physical_ports: int = 0x11
    ebus_current: int = 0
    mailbox: Mailbox | None = None
    bootstrap: Mailbox | None = None
    sync_managers: Sequence[SyncManager] | None = None
    fmmus: Sequence[FmmuType] | None = None
    rx_pdos: Sequence[Pdo] = ()
    tx_pdos: Sequence[Pdo] = ()
    variable_assignment: bool = False
    variable_mapping: bool | Collection[int] = False
    mapping_limits: tuple[int, int] = (64, 64)
    told_mappings: Mapping[int, Sequence[Entry] | None] = {}
    told_assignments: Mapping[int, Sequence[int] | None] = {}
    sized_uploads: bool = True
    dc_modes: Sequence[DcMode] = ()
    minimum_cycle_ns: int = 0
    modules: Sequence[int] = ()
    module_distance: int = 0x10
    pdos_in_sii: bool = True
    sync_parameters: bool = False
    emulated: bool = False
    longest_watchdog: float | None = None
    needs_eeprom: bool = False
    state_emergencies: bool = False
    diagnosis_messages: int = 0
    answer_delay: float = 0.0
    mail_counter: int | None = None
    state_delay: float = 0.0
    file_password: int | None = None
    file_limit: int = 1 << 24
    file_busy: int = 0
    firmware_files: Collection[str] = ()
    firmware_valid: bool = True
    files: dict[str, bytes] = {}  # noqa: RUF012  each device has a copy
    idns: Sequence[dict[int, Idn]] = ()
    eoe_interface: str = ""
    period: float = 0.001
    idle_period: float = 0.0

    def _settings(self) -> Sequence[SyncManager]:
        """Returns the given sync managers, or the usual ones for the PDOs."""
        if self.sync_managers is not None:
            return list(self.sync_managers)
        room = byte_length(replace(pdo, sync_manager=0) for pdo in self.rx_pdos)
        if self.variable_mapping:
            room = max(room, self.mapping_limits[0])
        sizes = default_size(self.rx_pdos), default_size(self.tx_pdos)
        return derive(self.mailbox, *sizes, room)

    def _build_sii(self, settings: Sequence[SyncManager]) -> bytes:
        """Builds the SII image from the attributes."""
        fmmus = self.fmmus
        if fmmus is None:
            kinds = {sm.type for sm in settings}
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
                pdi_config=self._pdi_configuration(),
                sync_pulse=self.sync_pulse,
                mailbox=self.mailbox,
                bootstrap=self.bootstrap,
                sync_managers=settings,
                fmmus=fmmus,
                tx_pdos=self.tx_pdos if self.pdos_in_sii else (),
                rx_pdos=self.rx_pdos if self.pdos_in_sii else (),
                ebus_current=self.ebus_current,
                physical_ports=self.physical_ports,
                no_lrw=not self.chip.lrw,
                tells_identification=self.device_id is not None,
                identification_register=self.device_id_register,
                dc_modes=self.dc_modes,
            )
        )

    def _pdi_configuration(self) -> int:
        if self.pdi_config is not None:
            return self.pdi_config
        return _SYNC_TO_DEVICE if self.dc_modes else 0
