"""Makes a device from an ESI file (ETG.2000): its SII image (ETG.2010) and object dictionary."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from ecatd.base.errors import ConfigError, UsageError
from ecatd.base.files import is_folder
from ecatd.etg import error_codes
from ecatd.etg.datatypes import STRINGS, DataType
from ecatd.etg.error_codes import abort_error
from ecatd.etg.sii import SiiProblem
from ecatd.etg.sii_check import check_sii, is_description
from ecatd.vendor.esi import (
    Described,
    EsiChoice,
    EsiDevice,
    EsiEntry,
    EsiObject,
    EsiPdo,
    Findings,
    Name,
    choose,
    devices_in,
    files_in,
    fitting,
    module_problems,
    parse_code,
    parse_name,
    plug,
    read_device,
)

from ..slave import sii
from ..slave.device import Device
from ..slave.modules import MODULE_OBJECTS
from ..slave.objects import Access, ObjectCode, Value, Variable
from ..slave.pdo_objects import ASSIGNMENTS
from ..slave.sync_managers import channels_of
from .sii_image import DeviceFromSii

_PORTS = {" ": 0, "Y": 1, "H": 1, "K": 3}
_IDENTITY = 0x1018
_MANDATORY, _FIXED = 0x01, 0x10  # flags of a PDO in the SII
_SMALLEST_EEPROM = 128
_SHOWN = 8
_MAPPABLE = Access.RX_PDO | Access.TX_PDO


def device_from_esi(
    path: Path | str,
    type: str | None = None,
    product: int | str | None = None,
    revision: int | str | None = None,
    modules: Sequence[str | int] = (),
    *,
    strict: bool = False,
) -> Device:
    """Makes a device from its description in an ESI file; `remarks` has what is wrong in it.

    Args:
        path: The file, or a folder of ESI files; the folders in it are searched, too.
        type: Name of the type (the text of <Type>), or None for any. As in `ecatctl --devices`, it
            may be `TYPE:REVISION` or a product code such as "0x03FA3052", too.
        product: Product code, also as a text such as "0x03FA3052"; None for any.
        revision: Revision number, also as a text; None for any.
        modules: Type or ident of the module in each slot, slot 1 first; "" or 0 for an empty slot.
            Slots after the last one are empty.
        strict: Whether to refuse a file with mistakes.

    Raises:
        ConfigError: The file cannot be used, or it has no matching device or module, or several; or
            the device would have its process data in other places than a real one.
    """
    source = Path(path)
    devices, listed = _devices(source, _states(source), strict)
    findings = Findings(strict=strict)
    findings.take(listed)
    path, chosen = _choose(source, devices, findings, type, product, revision)
    esi = _device(path, _state(path), chosen, strict)
    where = f"{path}:{esi.line}"
    try:
        idents = _idents(esi, modules)
        for problem in module_problems(esi, idents):
            raise UsageError(f"{esi.type} {problem}")
        plugged = plug(esi, idents)
        if plugged.misplaced:
            raise ConfigError(plugged.misplaced[0])
        device = DeviceFromEsi(plugged, idents)
        if strict and device.remarks:
            raise ConfigError(device.remarks[0])
        device.remarks = list(dict.fromkeys((*findings.texts, *device.remarks)))
        return device
    except ConfigError:
        raise
    except UsageError as error:
        raise ConfigError(f"{where}: {error}") from error


def _choose(
    source: Path,
    devices: Sequence[Described],
    findings: Findings,
    type: str | None,
    product: int | str | None,
    revision: int | str | None,
) -> Described:
    """Finds the only device; arguments as for `device_from_esi`.

    Raises:
        ConfigError: None fits, several do, or type, product and revision contradict each other.
    """
    name: Name = type, None, None
    if type is not None and not any(choice.type == type for _, choice in devices):
        try:
            name = parse_name(type)
        except UsageError as error:
            raise ConfigError(f"{source}: type is {error}") from error
    wanted = (
        name[0],
        _number(source, "product", product, name[1]),
        _number(source, "revision", revision, name[2]),
    )
    found = fitting(devices, wanted, findings)
    if len(found) == 1:
        return found[0]
    choices = [choice for _, choice in found or devices]
    kind, with_code, with_revision = wanted
    choose(choices, source, type=kind, product=with_code, revision=with_revision, findings=findings)
    raise AssertionError("several devices fit, or none")


def _number(source: Path, key: str, value: int | str | None, named: int | None) -> int | None:
    """A product code or revision, which the name of the type may say, too."""
    number = parse_code(value) if isinstance(value, str) else value
    if number is None and value is not None:
        raise ConfigError(f"{source}: {key} is '{value}': a number such as 0x03FA3052 is allowed")
    if number is not None and named is not None and number != named:
        raise ConfigError(
            f"{source}: {key} is 0x{number:08X}, but type says 0x{named:08X}: remove one of them"
        )
    return named if number is None else number


def _idents(esi: EsiDevice, modules: Sequence[str | int]) -> list[int]:
    """Finds the ident of the module in each slot of a device, slot 1 first.

    Raises:
        UsageError: The file has no such module, or several with this type.
    """
    idents: list[int] = []
    for module in modules:
        found = {item.ident for item in esi.modules if module == item.type}
        ident = parse_code(module) if isinstance(module, str) and not found else module
        if module == "" or isinstance(ident, int):
            found = {int(ident or 0)}
        if len(found) != 1:
            known = ", ".join(item.type for item in esi.modules[:_SHOWN]) or "none"
            count = f"{len(found)} modules have" if found else "no module has"
            raise UsageError(
                f"{count} the type '{module}' in the slots of {esi.type}: write the ident, such as "
                f"0x00000108, or one of {known}"
            )
        idents += found
    return idents + [0] * (len(esi.slots) - len(idents))


def _state(path: Path) -> tuple[int, int]:
    """Returns time and size of a file, which change when it is written."""
    try:
        info = path.stat()
    except (OSError, ValueError):  # the reader reports the error
        return 0, 0
    return info.st_mtime_ns, info.st_size


def _states(source: Path) -> tuple[tuple[int, int], ...]:
    """The state of a file, or those of all files in a folder."""
    return tuple(map(_state, files_in(source) if is_folder(source) else [source]))


# Cached: files can have tens of megabytes, and a rig may have many devices from each.
@lru_cache(maxsize=16)
def _devices(
    source: Path, _states: tuple[tuple[int, int], ...], strict: bool
) -> tuple[list[Described], Findings]:
    findings = Findings(strict=strict)
    return devices_in([source], findings), findings


@lru_cache(maxsize=64)
def _device(path: Path, _state: tuple[int, int], choice: EsiChoice, strict: bool) -> EsiDevice:
    return read_device(path, choice, Findings(strict=strict))


def image_from_esi(esi: EsiDevice, tell: Callable[[str], None]) -> bytes:
    """Builds the SII image of a device, as a configuration tool would write it to the EEPROM.

    Args:
        esi: The device.
        tell: Called with each contradiction in the description.

    Raises:
        UsageError: The description does not fit into an EEPROM.
    """
    sync_managers = [
        sii.SyncManager(sii.SmType(item.usage), item.start, item.size, item.control, item.enable)
        for item in esi.sync_managers
    ]
    flags = {
        pdo.index: _FIXED * pdo.fixed | _MANDATORY * pdo.mandatory
        for pdo in (*esi.outputs, *esi.inputs)
    }
    description = sii.Description(
        vendor=esi.vendor,
        product=esi.product,
        revision=esi.revision,
        order=esi.type,
        name=esi.name,
        group=esi.group,
        group_name=esi.group_name,
        mailbox=_mailbox(esi, tell),
        bootstrap=_bootstrap(esi),
        sync_managers=sync_managers,
        fmmus=[sii.FmmuType(usage) for usage in esi.fmmus],
        rx_pdos=esi.outputs,
        tx_pdos=esi.inputs,
        ebus_current=esi.ebus_current,
        physical_ports=sum(_PORTS.get(kind, 0) << 4 * i for i, kind in enumerate(esi.physics[:4])),
        dc_modes=[
            sii.DcMode(
                mode.name,
                mode.assign_activate,
                mode.cycle_time0 % (1 << 32),
                mode.cycle_factor0,
                mode.shift_time0,
                mode.cycle_factor1,
                mode.shift_time1,
                mode.description,
            )
            for mode in esi.dc
        ],
        config_data=esi.config_data,
        pdo_flags=flags,
        categories=esi.categories,
        size=max(esi.eeprom_size, _SMALLEST_EEPROM),
    )
    return sii.build(description, tell)


def _mailbox(esi: EsiDevice, tell: Callable[[str], None]) -> sii.Mailbox | None:
    if not esi.protocols:
        return None
    areas = {item.usage: item for item in esi.sync_managers}
    out, back = areas.get(sii.SmType.MAILBOX_OUT), areas.get(sii.SmType.MAILBOX_IN)
    if out is None or back is None:
        tell(f"{esi.type} has a <Mailbox>, but no <Sm> MBoxOut and MBoxIn; it has no mailbox")
        return None
    return sii.Mailbox(out.start, out.size, back.start, back.size, esi.protocols, esi.coe_details)


def _bootstrap(esi: EsiDevice) -> sii.Mailbox | None:
    if len(esi.bootstrap) < 8:
        return None
    receive, receive_size, send, send_size = struct.unpack("<HHHH", esi.bootstrap)
    return sii.Mailbox(receive, receive_size, send, send_size, esi.protocols, esi.coe_details)


def _said(problem: SiiProblem) -> str:
    """A problem of an image that was made from a file: the place in it does not matter."""
    return f"{problem.text}{'; ' if problem.effect else ''}{problem.effect}"


class DeviceFromEsi(DeviceFromSii):
    """A device that behaves as its ESI file says.

    Args:
        esi: The description, with the modules in its slots.
        modules: Ident of the module in each slot.
    """

    def __init__(self, esi: EsiDevice, modules: Sequence[int] = ()) -> None:
        self._esi = esi
        self.modules = modules
        if esi.slots:
            self.module_distance = esi.slots[0].index_step
        said: list[str] = []
        image = image_from_esi(esi, said.append)
        content = check_sii(image)
        said += [f"EEPROM of {esi.type}: {_said(item)}" for item in content.problems]
        super().__init__(image, content)
        where = f"{esi.path}:{esi.line}"
        self.remarks = [*esi.findings.texts, *(f"{where}: {text}" for text in said)]

    def describe(self) -> None:
        """Adds the object dictionary and the rules for PDO assignment."""
        if self.mailbox and self.mailbox.protocols & 0x04:
            for item in self._esi.objects:
                self._add_object(item)
        for kind, pdos in (
            (sii.SmType.OUTPUTS, self._esi.outputs),
            (sii.SmType.INPUTS, self._esi.inputs),
        ):
            channels = channels_of(self._process_data.settings, kind)
            for channel in channels:
                members = self.dictionary.object(ASSIGNMENTS + channel).entries
                check = members[0].on_write
                if check is not None:
                    alone = len(channels) == 1
                    mandatory = {
                        pdo.index
                        for pdo in pdos
                        if pdo.mandatory and (alone or pdo.sync_manager == channel)
                    }
                    members[0].on_write = _with_rules(pdos, mandatory, check, members)

    def _add_object(self, item: EsiObject) -> None:
        objects = self.dictionary
        if self.modules and item.index in MODULE_OBJECTS:
            return
        if is_description(item.index):
            if item.index in objects:
                objects.object(item.index).name = item.name
            return
        before = objects.object(item.index).entries if item.index in objects else {}
        entries = dict(before)
        for entry in item.entries:
            variable = _variable(item.index, entry)
            if entry.subindex in before:
                variable.access |= before[entry.subindex].access & _MAPPABLE
                if item.index == _IDENTITY:
                    variable.value = before[entry.subindex].value
            entries[entry.subindex] = variable
        kind = item.entries[-1].data_type if item.entries and item.code != ObjectCode.RECORD else 0
        made = objects.record(item.index, item.name, [], code=item.code, type=kind)
        made.entries |= entries
        if item.code != ObjectCode.VAR and made.entries[0].value == 0:
            made.entries[0].value = made.max_subindex


def _variable(index: int, entry: EsiEntry) -> Variable:
    variable = Variable(
        index,
        entry.subindex,
        entry.name,
        entry.data_type,
        entry.bits,
        entry.access,
        value=_nothing(entry.data_type),
        unit=entry.unit,
    )
    if entry.default is not None:
        variable.value = variable.decode(entry.default)
    if entry.data_type not in STRINGS:
        variable.minimum = _limit(variable, entry.minimum)
        variable.maximum = _limit(variable, entry.maximum)
    return variable


def _nothing(kind: DataType) -> Value:
    if kind in STRINGS:
        return "" if kind == DataType.VISIBLE_STRING else b""
    return 0


def _limit(variable: Variable, data: bytes | None) -> float | None:
    value = variable.decode(data) if data is not None else None
    return value if isinstance(value, int | float) else None


def _with_rules(
    pdos: Sequence[EsiPdo],
    mandatory: set[int],
    check: Callable[[Value], None],
    members: dict[int, Variable],
) -> Callable[[Value], None]:
    """Extends the check of a PDO assignment by mandatory PDOs and PDOs that exclude others."""
    known = {pdo.index: pdo for pdo in pdos}

    def write_count(count: Value) -> None:
        check(count)
        assert isinstance(count, int)
        assigned = [known[int(members[i].value)] for i in range(1, count + 1)]
        excluded = any(pdo.is_excluded(assigned) for pdo in assigned)
        lacking = mandatory - {pdo.index for pdo in assigned}
        if excluded or (assigned and not all(known[i].is_excluded(assigned) for i in lacking)):
            raise abort_error(error_codes.VALUE_RANGE)

    return write_count
