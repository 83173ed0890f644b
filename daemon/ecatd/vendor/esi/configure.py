"""Adds to the configuration of a bus what ESI files say about its slaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.config import Config, DcSlaveConfig, SignalConfig
from ecatd.config.clocks import SYNC_MAX_US
from ecatd.config.idns import startup_idn
from ecatd.config.pdos import INPUT_PDOS, OUTPUT_PDOS, PdoConfig, PdoEntryConfig
from ecatd.config.resolve.believed import remaining, usual_witness
from ecatd.config.slave_settings import ALIAS, IDENTIFICATION_REGISTERS, ON_REQUEST, SlaveConfig
from ecatd.config.startup import TRANSITIONS, startup_parameter
from ecatd.config.writer import Notes
from ecatd.description.bus import Bus, Slave
from ecatd.description.limits import UNIT_BYTES
from ecatd.description.object_types import ObjectType, ObjectTypes
from ecatd.description.witnesses import (
    COE,
    CONFIGURATION,
    ESI,
    SII,
    SOE,
    Contradiction,
    clash,
    contradictions_text,
)
from ecatd.etg.datatypes import (
    STRINGS,
    bit_length,
    decode,
    is_real,
    is_signed,
    type_alias,
    type_by_size,
    value_range,
)
from ecatd.etg.idns import idn_text
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.scaling import to_physical
from ecatd.etg.unit_codes import meaning

from .check import described_pdos
from .device import EsiCommand, EsiDcMode, EsiDevice, EsiPdo, IdnCommand
from .dictionary import EsiEntry
from .modules import plug

_ASSIGNMENTS = range(0x1C10, 0x1C30)
_SYNC0, _SYNC1 = 0x0300, 0x0400
_SIGNAL_BITS = 64


def add_esi(config: Config, bus: Bus, devices: Mapping[int, EsiDevice]) -> Notes:
    """Adds the facts of ESI files to a configuration. Values that are configured already stay.

    Start-up commands, units, limits and named values of process data, and the default mode of the
    distributed clocks become tables. The rest becomes comments.

    Args:
        config: The configuration, which is changed; its positions are those of the slaves.
        bus: The bus. Slaves and entries without a name get the name that their device has.
        devices: The description of slaves, by position.
    """
    notes = Notes()
    for position, device in sorted(devices.items()):
        slave = bus.slaves[position]
        device = plug(device, [module.ident for module in slave.modules])
        settings = config.settings_of(position)
        if settings not in config.slave:
            config.slave.append(settings)
        _Adder(config, slave, settings, device, notes).add()
    config.slave.sort(key=lambda item: item.position)
    return notes


def _type(entry: Entry, kind: int) -> str | None:
    """The type of a `[[signal]]` table; None if the slave tells no other numbers than its file."""
    if not is_signed(kind) and not is_real(kind):
        return None
    guess = entry.data_type in (0, type_by_size(entry.bit_length)) or entry.data_type in STRINGS
    odd = is_real(entry.data_type) and bit_length(entry.data_type) != entry.bit_length
    fits = bit_length(kind) == entry.bit_length
    return type_alias(kind) if fits and (guess or odd) else None


class _Adder:
    """Adds the facts of one device to the configuration of its slave."""

    def __init__(
        self, config: Config, slave: Slave, settings: SlaveConfig, device: EsiDevice, notes: Notes
    ) -> None:
        self._config, self._slave, self._settings = config, slave, settings
        self._device = device
        self._about = notes.slaves.setdefault(slave.position, [])
        self._beside = notes.pdos.setdefault(slave.position, [])
        self._modes = notes.clocks.setdefault(slave.position, [])
        self._known = {(o.index, e.subindex): e for o in device.objects for e in o.entries}

    def add(self) -> None:
        device, slave = self._device, self._slave
        other = device.revision != slave.revision
        self._about.append(
            f"{Path(device.path).name}: {device.type}, {device.name}, of {device.vendor_name}"
            + (f"; it describes revision 0x{device.revision:08X}" if other else "")
        )
        slave.name = slave.name or device.type
        self._add_identification()
        self._name_modules()
        described = [*device.outputs, *device.inputs]
        told = {(e.index, e.subindex): e for pdo in described for e in pdo.entries if not e.is_gap}
        configured = {rule.address for rule in self._config.signal if rule.slave == slave.position}
        for outputs in (True, False):
            for _, entry, _ in slave.entries(outputs=outputs):
                address = entry.index, entry.subindex
                known, mapped = self._known.get(address), told.get(address)
                name = (mapped.name if mapped else "") or (known.name if known else "")
                entry.name = entry.name or name
                if address not in configured and (known or mapped):
                    configured.add(address)
                    self._add_signal(entry, known, mapped, outputs=outputs)
        self._describe_pdos()
        self._choose_witness()
        if slave.coe:
            for command in device.commands:
                self._add_command(command)
        if slave.soe:
            for idn in device.idns:
                self._add_idn(idn)
        self._add_modes()

    def _add_identification(self) -> None:
        """Adds where the slave has its identification, or a comment if it is found otherwise."""
        device, settings = self._device, self._settings
        register = device.identification_register
        where = register in IDENTIFICATION_REGISTERS and register not in (ALIAS, ON_REQUEST)
        if settings.identification is not None:
            if where and settings.identification_register is None:
                settings.identification_register = register
            return
        if settings.mark is not None:
            return
        number = self._slave.identification or "N"
        if where:
            keys = f"identification = {number} and identification_register = 0x{register:04X}"
        elif device.tells_identification or register == ON_REQUEST:
            keys = f"identification = {number}"
        elif register == ALIAS:
            keys = f"alias = {self._slave.alias or 'N'}"
        else:
            return
        self._about.append(
            f"It has a selector or the like: with {keys} in place of position, ecatd finds it "
            "wherever it stands."
        )

    def _name_modules(self) -> None:
        types = {module.ident: module.type for module in self._device.modules}
        for slot, module in enumerate(self._slave.modules, 1):
            module.name = module.name or types.get(module.ident, "")
            if module.ident and module.ident not in types:
                self._about.append(
                    f"{Path(self._device.path).name} does not describe the module in slot {slot}, "
                    f"0x{module.ident:08X}"
                )

    # --- process data --------------------------------------------------------------------------

    def _describe_pdos(self) -> None:
        for title, pdos in (("outputs", self._device.outputs), ("inputs", self._device.inputs)):
            texts = [_offer(pdo) for pdo in pdos]
            if texts:
                self._beside.append(f"{title} that it offers: {'; '.join(texts)}")

    def _choose_witness(self) -> None:
        """Where witnesses contradict each other, believes the one that agrees with the file."""
        settings = self._settings
        esi = described_pdos(self._device, self._slave)
        found = remaining(self._slave, settings, esi)
        asked = [item for item in found if item.pdo in esi]
        if not asked or settings.pdo_source is not None or settings.pdo:
            return
        for source in (COE, SOE, SII):
            if all(_agrees(item, source) for item in asked):
                settings.pdo_source = source
                break
        else:
            if usual_witness(self._slave) == SOE:  # telegrams cannot be described by tables
                self._about.append(f"{contradictions_text(asked)}. Choose with pdo_source.")
                return
            settings.pdo_source = CONFIGURATION
            settings.pdo = [_table(esi[item.pdo][0]) for item in asked]
        self._about.append(
            f"{contradictions_text(asked)}. With this pdo_source, ecatd believes what the ESI file "
            "says: check that on the machine."
        )

    def _add_signal(
        self, entry: Entry, known: EsiEntry | None, mapped: Entry | None, *, outputs: bool
    ) -> None:
        rule = SignalConfig(self._slave.position, entry.address)
        rule.type = _type(entry, mapped.data_type if mapped else known.data_type if known else 0)
        if known is not None:
            self._add_meaning(rule, entry, known, outputs=outputs)
        if rule != SignalConfig(self._slave.position, entry.address):
            self._config.signal.append(rule)

    def _add_meaning(
        self, rule: SignalConfig, entry: Entry, known: EsiEntry, *, outputs: bool
    ) -> None:
        if entry.bit_length > _SIGNAL_BITS:
            if known.unit or known.values:
                text = f"{entry.address} has {entry.bit_length} bits"
                self._about.append(f"{text}, so it gets neither unit nor names of values")
            return
        scale = entry.scale
        if known.unit and not entry.is_physical:
            found = meaning(known.unit)
            if found is None or len(found[0].encode()) > UNIT_BYTES:
                self._about.append(f"{entry.address} has an unknown unit code, 0x{known.unit:08X}")
            else:
                rule.unit, scale = found[0] or None, found[1]
                rule.scale = None if scale == 1 else scale
        if known.values and not entry.values:
            named = {n: t for n, t in known.values.items() if t.isprintable() and abs(n) < 10**10}
            rule.values = {str(number): text for number, text in named.items()}
            if len(named) < len(known.values):
                count = len(known.values) - len(named)
                self._about.append(f"{entry.address}: {count} names of values are left out")
        offset = entry.offset if entry.is_physical else 0.0
        if outputs and entry.minimum is None and entry.maximum is None:
            self._add_limits(rule, entry, known, scale, offset)

    def _add_limits(
        self, rule: SignalConfig, entry: Entry, known: EsiEntry, scale: float, offset: float
    ) -> None:
        if known.minimum is None and known.maximum is None:
            return
        if known.minimum is None or known.maximum is None or known.bits != entry.bit_length:
            why = f"has {known.bits} bits in the ESI file"
            if known.bits == entry.bit_length:
                why = "has only one limit in the ESI file"
            self._about.append(f"{entry.address} {why}, so ecatd uses no limits of it")
            return
        try:
            low, high = (decode(known.data_type, data) for data in (known.minimum, known.maximum))
        except UsageError:
            low = high = 0
        if not isinstance(low, int | float) or not isinstance(high, int | float) or low >= high:
            text = f"{entry.address} has limits from {low} to {high} in the ESI file"
            self._about.append(f"{text}, which ecatd does not use")
            return
        real, bits = is_real(known.data_type), entry.bit_length
        whole = (-math.inf, math.inf) if real else value_range(known.data_type, bits)
        if (low, high) == whole or not math.isfinite(high - low):
            return
        if low <= 0 <= high:
            rule.minimum, rule.maximum = (to_physical(raw, scale, offset) for raw in (low, high))
        else:  # the safe value, zero, must be in the range
            self._about.append(
                f"{entry.address} has raw values from {low} to {high}, which ecatd does not use "
                "as limits, because its safe value is 0"
            )

    # --- start-up commands ---------------------------------------------------------------------

    def _add_command(self, command: EsiCommand) -> None:
        address = command.index, command.subindex
        text = f"0x{command.index:04X}:{command.subindex:02X}"
        if command.index in (*_ASSIGNMENTS, *OUTPUT_PDOS, *INPUT_PDOS):
            self._about.append(f"Start-up command for {text}: pdos and [[slave.pdo]] do that.")
            return
        known = self._known.get(address)
        kind = ObjectType(data_type=known.data_type) if known else None
        for transition in command.transitions:
            if any(
                (item.address, item.transition) == (address, transition)
                for item in self._settings.startup
            ):
                continue
            try:
                if transition not in TRANSITIONS:
                    raise UsageError(f"the transition is one of {', '.join(TRANSITIONS)}")
                self._settings.startup.append(
                    startup_parameter(
                        kind or ObjectTypes(self._slave).find(*address),
                        address,
                        command.data,
                        complete=command.complete,
                        transition=transition,
                        comment=command.comment or self._name(command),
                    )
                )
            except UsageError as error:
                where = f"{Path(self._device.path).name}, line {command.line}"
                self._about.append(
                    f"Start-up command for {text} in {transition} ({where}) left out: {error}."
                )

    def _add_idn(self, command: IdnCommand) -> None:
        text = f"{idn_text(command.idn)} of drive {command.drive}"
        for transition in command.transitions:
            if any(
                (item.number, item.drive, item.transition)
                == (command.idn, command.drive, transition)
                for item in self._settings.idn
            ):
                continue
            try:
                if transition not in TRANSITIONS:
                    raise UsageError(f"the transition is one of {', '.join(TRANSITIONS)}")
                if command.disabled or not command.data:
                    raise UsageError("it is switched off, or writes no value")
                self._settings.idn.append(
                    startup_idn(
                        command.idn,
                        command.drive,
                        command.data,
                        transition=transition,
                        comment=command.comment,
                    )
                )
            except UsageError as error:
                where = f"{Path(self._device.path).name}, line {command.line}"
                self._about.append(
                    f"Start-up command for {text} in {transition} ({where}) left out: {error}."
                )

    def _name(self, command: EsiCommand) -> str:
        """The names of the object and of the entry that a command writes."""
        names = [item.name for item in self._device.objects if item.index == command.index]
        known = self._known.get((command.index, command.subindex))
        if known is not None and not command.complete:
            names.append(known.name)
        return ", ".join(dict.fromkeys(filter(None, names)))

    # --- distributed clocks --------------------------------------------------------------------

    def _add_modes(self) -> None:
        dc = self._config.dc
        configured = any(rule.slave == self._slave.position for rule in dc.slave)
        if self._device.dc:
            file = Path(self._device.path).name
            self._modes.append(f"DC modes of {self._slave.label} in {file}, the default first:")
        for number, mode in enumerate(self._device.dc):
            words = filter(None, (mode.description, f"AssignActivate 0x{mode.assign_activate:04X}"))
            text = f"- {mode.name} ({', '.join(words)}): "
            rule = self._sync_pulses(mode)
            if rule is None:
                self._modes.append(f"{text}no [[dc.slave]]")
                continue
            problem = self._problem(rule)
            self._modes.append(f"{text}[[dc.slave]] with {_keys(rule)}{problem and f'; {problem}'}")
            if number == 0 and not configured and not problem:
                dc.slave.append(rule)
                dc.enabled = True

    def _sync_pulses(self, mode: EsiDcMode) -> DcSlaveConfig | None:
        """The SYNC pulses of a mode; None if it has none."""
        if mode.assign_activate & _SYNC0 != _SYNC0:
            return None
        cycle_ns = self._config.domain_cycle_us(self._slave.position) * 1000
        sync0 = _scaled(cycle_ns, mode.cycle_factor0) or mode.cycle_time0 or cycle_ns
        sync1 = 0.0
        if mode.assign_activate & _SYNC1:
            # Register 0x09A4 is the time from SYNC0 to SYNC1: whole periods, then the shift.
            period = _scaled(sync0, mode.cycle_factor1) or mode.cycle_time1
            sync1 = max(0.0, period - sync0) + mode.shift_time1
        return DcSlaveConfig(
            self._slave.position,
            0.0 if sync0 == cycle_ns else sync0 / 1000,
            mode.shift_time0 / 1000 if mode.shift_time0 else None,
            sync1 / 1000,
        )

    def _problem(self, rule: DcSlaveConfig) -> str:
        """Why this slave cannot make these SYNC pulses; empty if it can."""
        cycle = self._config.domain_cycle_us(self._slave.position)
        sync0 = self._config.sync0_us(rule)
        if not self._slave.dc_bits:
            return "this slave has no clock"
        times = (sync0, abs(rule.shift_us or 0), abs(rule.sync1_us))
        ns, frames = round(sync0 * 1000), cycle * 1000
        if max(times) > SYNC_MAX_US or rule.sync1_us < 0 or ns < 1 or (ns % frames and frames % ns):
            return f"this does not fit the cycle, {cycle} µs"
        return ""


def _agrees(item: Contradiction, witness: str) -> bool:
    """Whether a witness says of a PDO what the ESI file says."""
    by_witness = {pdo.witness: pdo for pdo in item.accounts}
    return witness in by_witness and clash(by_witness[witness], by_witness[ESI]) is None


def _table(pdo: Pdo) -> PdoConfig:
    entries = [
        PdoEntryConfig(entry.bit_length, None if entry.is_gap else entry.address)
        for entry in pdo.entries
    ]
    return PdoConfig(pdo.index, entries)


def _scaled(cycle_ns: float, factor: int) -> float:
    """A multiple of a cycle, with a negative factor a fraction; 0 without a factor."""
    return cycle_ns * factor if factor >= 0 else cycle_ns / -factor


def _keys(rule: DcSlaveConfig) -> str:
    keys = {"sync0_us": rule.sync0_us, "shift_us": rule.shift_us, "sync1_us": rule.sync1_us}
    texts = [f"{key} = {value}" for key, value in keys.items() if value]
    return ", ".join(texts) or "its defaults"


def _offer(pdo: EsiPdo) -> str:
    words = ["mandatory"] * pdo.mandatory + ["fixed"] * pdo.fixed
    if pdo.excludes:
        words.append(f"not with {', '.join(f'0x{index:04X}' for index in pdo.excludes)}")
    text = f"0x{pdo.index:04X} {pdo.name}".rstrip()
    return f"{text} ({', '.join(words)})" if words else text
