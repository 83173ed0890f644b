"""Reads ESI files: lists the devices of a file, and reads one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from ecatd.model.datatypes import DataType, type_of_bits
from ecatd.model.errors import ConfigError
from ecatd.model.pdo import Entry
from ecatd.model.sii import UNASSIGNED

from .device import (
    EsiChoice,
    EsiCommand,
    EsiDcMode,
    EsiDevice,
    EsiModule,
    EsiPdo,
    EsiSlot,
    EsiSyncManager,
)
from .dictionary import read_dictionary, simple_type
from .shift import UNMOVED, Shift
from .xml import Element, read_xml

_OUTLINE = (
    {"EtherCATInfo"},
    {"Vendor", "Descriptions"},
    {"Id", "Name", "Groups", "Devices"},
    {"Group", "Device"},
    {"Type", "Name"},
)
_DEVICE_DEPTH = 3
_LISTED = 12
_SM_USAGES = {"MBoxOut": 1, "MBoxIn": 2, "Outputs": 3, "Inputs": 4}
_VIRTUAL, _IN_OP_ONLY = 0x04, 0x08  # bits of the enable byte in the SII
_FMMU_USAGES = {"Outputs": 1, "Inputs": 2, "MBoxState": 3}
_PROTOCOLS = {"AoE": 1, "EoE": 2, "CoE": 4, "FoE": 8, "SoE": 16, "VoE": 32}
_COE_DETAILS = {"SdoInfo": 2, "PdoAssign": 4, "PdoConfig": 8, "PdoUpload": 16, "CompleteAccess": 32}
_SDO = 1
_SLOTS_MAX = 254
_UNUSED = {"ImageData16x14", "ImageFile16x14", "VendorSpecific"}


def list_devices(path: Path) -> list[EsiChoice]:
    """Lists the devices of a file.

    Raises:
        ConfigError: The file cannot be read, or is not an ESI file.
    """

    def wanted(element: Element, depth: int) -> bool:
        return depth == 0 or (depth < len(_OUTLINE) and element.tag in _OUTLINE[depth])

    root = _root(read_xml(path, wanted))
    devices = root.find("Descriptions", "Devices")
    return [
        _choice(number, element)
        for number, element in enumerate(devices.all("Device") if devices else ())
    ]


def choose(
    choices: Sequence[EsiChoice],
    path: Path,
    *,
    type: str | None = None,
    product: int | None = None,
    revision: int | None = None,
) -> EsiChoice:
    """Finds the only device with a type, product code and revision.

    Args:
        choices: The devices of the file.
        path: The file, for messages.
        type: Name of the type, or None for any.
        product: Product code, or None for any.
        revision: Revision number, or None for any.

    Raises:
        ConfigError: No device fits, or several do; the message lists them.
    """
    fitting = [item for item in choices if item.fits(type, product, revision)]
    if len(fitting) == 1:
        return fitting[0]
    if not choices:
        raise ConfigError(f"{path}: the file describes no devices")
    listed = ", ".join(str(item) for item in (fitting or choices)[:_LISTED])
    left = len(fitting or choices) - _LISTED
    listed += f" and {left} more" if left > 0 else ""
    if fitting:
        raise ConfigError(
            f"{path}: {len(fitting)} devices fit: choose one by type, product and revision: "
            f"{listed}"
        )
    wanted = [f"type '{type}'"] if type is not None else []
    wanted += [f"product 0x{product:08X}"] if product is not None else []
    wanted += [f"revision 0x{revision:08X}"] if revision is not None else []
    raise ConfigError(f"{path}: no device has {' and '.join(wanted)}; there are {listed}")


def read_device(path: Path, choice: EsiChoice) -> EsiDevice:
    """Reads one device of a file completely.

    Raises:
        ConfigError: The file is malformed; the message begins with file and line.
    """
    seen = -1
    has_slots = False

    def wanted(element: Element, depth: int) -> bool:
        nonlocal seen, has_slots
        if depth == _DEVICE_DEPTH + 1 and element.tag == "Slots":
            has_slots = True
        if depth == _DEVICE_DEPTH - 1 and element.tag == "Modules":  # they follow the devices
            return has_slots
        if depth == _DEVICE_DEPTH and element.tag == "Device":
            seen += 1
            return seen == choice.number
        if depth == 1:
            return element.tag in _OUTLINE[1]
        return element.tag in _OUTLINE[2] if depth == 2 else element.tag not in _UNUSED

    root = _root(read_xml(path, wanted))
    vendor = root.need("Vendor")
    element = root.find("Descriptions", "Devices", "Device")
    if element is None:
        raise ConfigError(f"{path}: the file changed while it was read")
    groups = root.find("Descriptions", "Groups")
    group = element.text_of("GroupType")
    device = EsiDevice(
        path=str(path),
        line=element.line,
        vendor=vendor.number_of("Id"),
        vendor_name=vendor.name(),
        type=choice.type,
        name=choice.name,
        product=choice.product,
        revision=choice.revision,
        group=group,
        group_name=_group_name(groups, group),
        physics=element.attributes.get("Physics", ""),
        fmmus=[_FMMU_USAGES.get(item.text, 0) for item in element.all("Fmmu")],
        sync_managers=[_sync_manager(item) for item in element.all("Sm")],
    )
    electrical = element.find("Info", "Electrical")
    if electrical is not None:
        device.ebus_current = electrical.number_of("EBusCurrent", 0, -0x8000, 0x7FFF)
    info = element.find("Info")
    if info is not None:
        device.tells_identification = info.flag_of("IdentificationReg134")
        device.identification_register = info.number_of("IdentificationAdo", 0, high=0xFFFF)
    device.outputs = read_pdos(element.all("RxPdo"), device)
    device.inputs = read_pdos(element.all("TxPdo"), device)
    _read_mailbox(element, device)
    dc = element.find("Dc")
    device.dc = [_dc_mode(item) for item in dc.all("OpMode")] if dc else []
    _read_eeprom(element, device)
    _read_profile(element, device)
    slots = element.find("Slots")
    device.slots = _slots(slots) if slots else []
    modules = root.find("Descriptions", "Modules") if device.slots else None
    found = [_module(item) for item in modules.all("Module")] if modules else []
    device.modules = [item for item in found if any(slot.takes(item) for slot in device.slots)]
    return device


def _root(root: Element) -> Element:
    if root.tag != "EtherCATInfo":
        root.fail(f"the file begins with <{root.tag}>: an ESI file begins with <EtherCATInfo>")
    return root


def _choice(number: int, element: Element) -> EsiChoice:
    kind = element.need("Type")
    return EsiChoice(
        number,
        kind.text,
        element.name(),
        kind.attribute("ProductCode"),
        kind.attribute("RevisionNo"),
    )


def _group_name(groups: Element | None, group: str) -> str:
    for item in groups.all("Group") if groups else ():
        if item.text_of("Type") == group:
            return item.name()
    return ""


def _sync_manager(element: Element) -> EsiSyncManager:
    return EsiSyncManager(
        _SM_USAGES.get(element.text, 0),
        element.attribute("StartAddress", high=0xFFFF),
        element.attribute("DefaultSize", high=0xFFFF),
        element.attribute("ControlByte", high=0xFF),
        element.attribute("Enable", high=0xFF)
        | _VIRTUAL * element.flag("Virtual")
        | _IN_OP_ONLY * element.flag("OpOnly"),
        element.line,
    )


def _slots(slots: Element) -> list[EsiSlot]:
    """The slots, each as often as the file says that it occurs."""
    index_step = slots.attribute("SlotIndexIncrement", high=0xFFFF)
    pdo_step = slots.attribute("SlotPdoIncrement", high=0xFFFF)
    most = slots.attribute("MaxSlotCount", _SLOTS_MAX, high=_SLOTS_MAX)
    found: list[EsiSlot] = []
    for element in slots.all("Slot"):
        slot = EsiSlot(
            element.name(),
            tuple(item.number() for item in element.all("ModuleIdent")),
            tuple(item.text for item in _all(element, "ModuleClass", "Class")),
            element.attribute("SlotIndexIncrement", index_step, high=0xFFFF),
            element.attribute("SlotPdoIncrement", pdo_step, high=0xFFFF),
        )
        found += [slot] * element.attribute("MaxInstances", 1, high=_SLOTS_MAX)
    return found[:most]


def _all(element: Element, tag: str, inner: str) -> Iterable[Element]:
    """The children of a name. If a child has children itself, one of these has the text."""
    for child in element.all(tag):
        yield child.find(inner) or child


def _module(element: Element) -> EsiModule:
    kind = element.need("Type")
    return EsiModule(
        kind.attribute("ModuleIdent"),
        kind.attributes.get("ModuleClass", ""),
        kind.text,
        element.name(),
        element,
    )


def read_pdos(
    elements: Iterable[Element], device: EsiDevice, shift: Shift = UNMOVED
) -> list[EsiPdo]:
    """Reads PDOs of a device, or those of a module in a slot.

    Args:
        elements: `<RxPdo>` or `<TxPdo>`.
        device: The device.
        shift: How far the slot moves their indices.

    Raises:
        ConfigError: An element is malformed; the message begins with file and line.
    """
    result: dict[int, EsiPdo] = {}
    for element in elements:
        index = shift.index(element.need("Index"))
        manager = element.attribute("Sm", UNASSIGNED, high=0xFF)
        if manager != UNASSIGNED and manager >= len(device.sync_managers):
            element.fail(
                f"Sm of <{element.tag}> is {manager}, but there are "
                f"{len(device.sync_managers)} sync managers"
            )
        if index in result:
            element.fail(f"<{element.tag}> 0x{index:04X} is defined a second time")
        result[index] = EsiPdo(
            index,
            element.name(),
            manager,
            [read_entry(item, shift) for item in element.all("Entry")],
            fixed=element.flag("Fixed"),
            mandatory=element.flag("Mandatory"),
            excludes=[shift.index(item) for item in element.all("Exclude")],
        )
    return list(result.values())


def read_entry(element: Element, shift: Shift = UNMOVED) -> Entry:
    """Reads an <Entry> of a PDO, which ESI and ENI files write alike.

    Args:
        element: The element.
        shift: How far the slot of a module moves it.

    Raises:
        ConfigError: The element is malformed; the message begins with file and line.
    """
    index = shift.index(element.need("Index"))
    bits = element.number_of("BitLen", low=1, high=0xFF)
    if index == 0:
        return Entry(0, 0, element.name(), DataType.PADDING, bits)
    simple = simple_type(element.text_of("DataType"), bits)
    kind = simple[0] if simple and simple[1] == bits else type_of_bits(bits)
    subindex = element.number_of("SubIndex", 0, high=0xFF)
    return Entry(index, subindex, element.name(), kind, bits)


def _read_mailbox(element: Element, device: EsiDevice) -> None:
    mailbox = element.find("Mailbox")
    if mailbox is None:
        return
    for tag, bit in _PROTOCOLS.items():
        if mailbox.find(tag) is not None:
            device.protocols |= bit
    coe = mailbox.find("CoE")
    if coe is not None:
        device.coe_details = _SDO
        for name, bit in _COE_DETAILS.items():
            device.coe_details |= bit * coe.flag(name)
        device.commands = read_commands(coe)


def read_commands(coe: Element, shift: Shift = UNMOVED) -> list[EsiCommand]:
    """Reads the start-up commands in a `<CoE>`; arguments and errors as `read_pdos`.

    By the schema of ETG.2000, the commands are children of `<CoE>`. Some files have an `<InitCmds>`
    around them, as ENI files do.
    """
    together = coe.find("InitCmds")
    elements = [*coe.all("InitCmd"), *(together.all("InitCmd") if together else ())]
    return [_command(element, shift) for element in elements]


def _command(element: Element, shift: Shift) -> EsiCommand:
    data = element.find("Data")
    return EsiCommand(
        element.line,
        tuple(dict.fromkeys(item.text.upper() for item in element.all("Transition"))),
        shift.index(element.need("Index")),
        element.number_of("SubIndex", 0, high=0xFF),
        data.octets() if data else b"",
        element.flag("CompleteAccess"),
        element.text_of("Comment"),
    )


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) == 1 else value


def _dc_mode(element: Element) -> EsiDcMode:
    times, factors = {}, {}
    for tag in ("CycleTimeSync0", "CycleTimeSync1", "ShiftTimeSync0", "ShiftTimeSync1"):
        item = element.find(tag)
        # Files have negative numbers with a sign, or as hexadecimal two's complement.
        times[tag] = _signed(element.number_of(tag, 0, -(1 << 31)), 32)
        factors[tag] = _signed(item.attribute("Factor", 0, -0x8000, 0xFFFF), 16) if item else 0
    return EsiDcMode(
        element.name(),
        element.text_of("Desc"),
        element.number_of("AssignActivate", 0, high=0xFFFF),
        times["CycleTimeSync0"],
        factors["CycleTimeSync0"],
        times["ShiftTimeSync0"],
        times["CycleTimeSync1"],
        factors["CycleTimeSync1"],
        times["ShiftTimeSync1"],
    )


def _read_eeprom(element: Element, device: EsiDevice) -> None:
    eeprom = element.find("Eeprom")
    if eeprom is None:
        return
    device.eeprom_size = eeprom.number_of("ByteSize", 0, high=0x80000)
    for tag, most in (("ConfigData", 14), ("BootStrap", 8)):
        found = eeprom.find(tag)
        data = found.octets(most + 2)[:most] if found else b""  # some files append the checksum
        if tag == "ConfigData":
            device.config_data = data
        else:
            device.bootstrap = data
    for item in eeprom.all("Category"):
        octets = item.find("Data")
        content = octets.octets(0x10000) if octets else item.text_of("DataString").encode()
        device.categories.append((item.number_of("CatNo", high=0xFFFE), content))


def _read_profile(element: Element, device: EsiDevice) -> None:
    for profile in element.all("Profile"):
        messages = profile.find("DiagMessages")
        for message in messages.all("DiagMessage") if messages else ():
            number = message.number_of("TextId", high=0xFFFF)
            device.diagnosis_texts[number] = message.name("MessageText")
        dictionary = profile.find("Dictionary")
        if dictionary is not None:
            device.objects = read_dictionary(dictionary)
            return
        device.dictionary_file = device.dictionary_file or profile.text_of("DictionaryFile")
