"""Reads ESI files: lists the devices of a file, and reads one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from ecatd.base.errors import ConfigError
from ecatd.etg.datatypes import DataType, is_real, is_signed, type_of_bits
from ecatd.etg.pdo import Entry
from ecatd.etg.sii import (
    CATEGORY_DC,
    CATEGORY_FMMU,
    CATEGORY_GENERAL,
    CATEGORY_RXPDO,
    CATEGORY_STRINGS,
    CATEGORY_SYNC_MANAGER,
    CATEGORY_TXPDO,
    UNASSIGNED,
)

from .device import (
    EsiChoice,
    EsiCommand,
    EsiDcMode,
    EsiDevice,
    EsiModule,
    EsiPdo,
    EsiSlot,
    EsiSyncManager,
    IdnCommand,
)
from .dictionary import EsiObject, read_dictionary, simple_type, type_in_esi
from .findings import Findings, MalformedError
from .shift import UNMOVED, Shift
from .xml import LEFT_OUT, Element, read_xml

_OUTLINE = (
    {"ethercatinfo"},
    {"vendor", "descriptions"},
    {"id", "name", "groups", "devices"},
    {"group", "device"},
    {"type", "name"},
)
"""What lists the devices, in small letters: elements in the wrong case are read, and told."""
_DEVICE_DEPTH = 3
_SM_USAGES = {"mboxout": 1, "mboxin": 2, "outputs": 3, "inputs": 4}
_MODE, _MAILBOX = 0x03, 0x02  # in the control byte of a sync manager
_VIRTUAL, _IN_OP_ONLY = 0x04, 0x08  # bits of the enable byte in the SII
_FMMU_USAGES = {"Outputs": 1, "Inputs": 2, "MBoxState": 3}
_PROTOCOLS = {"AoE": 1, "EoE": 2, "CoE": 4, "FoE": 8, "SoE": 16, "VoE": 32}
_TAKEN = ("CoE", "SoE")  # protocols whose start-up commands are taken
_COE_DETAILS = {"SdoInfo": 2, "PdoAssign": 4, "PdoConfig": 8, "PdoUpload": 16, "CompleteAccess": 32}
_SDO = 1
_OWN_CATEGORIES = {
    CATEGORY_STRINGS,
    CATEGORY_GENERAL,
    CATEGORY_FMMU,
    CATEGORY_SYNC_MANAGER,
    CATEGORY_TXPDO,
    CATEGORY_RXPDO,
    CATEGORY_DC,
}
_WRITE_IDN, _VALUE = 3, 0x40  # operation and element in the header of SoE
_SLOTS_MAX = 254
_NATURAL_BITS = (16, 32, 64)  # where a guess of the type may be wrong
_ENTRY_BITS, _GAP_BITS, _MOST_BITS = 0xFF, 0xF8, 0x7FFF
_LIST = "EtherCATInfoList"
Command = TypeVar("Command")

_UNUSED = {"ImageData16x14", "ImageFile16x14", "VendorSpecific"}


def list_devices(path: Path, findings: Findings | None = None) -> list[EsiChoice]:
    """Lists the devices of a file.

    Args:
        path: The file.
        findings: Takes what is wrong in it, such as devices without a product code.

    Raises:
        ConfigError: The file cannot be read, or is not an ESI file, or no device in it says which
            one it is.
    """
    lists = 0

    def wanted(element: Element, depth: int) -> bool:
        nonlocal lists
        if depth == 0:
            lists = element.tag == _LIST
            return True
        depth -= lists
        return depth < len(_OUTLINE) and _in_outline(element, depth)

    choices: list[EsiChoice] = []
    refused: list[MalformedError] = []
    number = 0
    for info in _infos(read_xml(path, wanted, findings)):
        devices = info.find("Descriptions", "Devices")
        for element in devices.all("Device") if devices else ():
            with element.instead("this device is left out"):
                try:
                    choice = _choice(number, element)
                except MalformedError as error:
                    refused.append(error)
                    raise
                identity = choice.type, choice.product, choice.revision
                if any(item.fits(*identity) for item in choices):
                    element.fail(f"{choice} is described a second time")
                choices.append(choice)
            number += 1
    if refused and not choices:
        raise refused[0]
    return choices


def read_device(path: Path, choice: EsiChoice, findings: Findings | None = None) -> EsiDevice:
    """Reads one device of a file completely.

    Args:
        path: The file.
        choice: The device.
        findings: Takes what is wrong in it and is left out; `EsiDevice.findings` of the result.

    Raises:
        ConfigError: The file is no XML, or does not say which device it describes; the message
            begins with file and line.
    """
    findings = Findings() if findings is None else findings
    seen = -1
    has_slots = False
    lists = 0

    def wanted(element: Element, depth: int) -> bool:
        nonlocal seen, has_slots, lists
        if depth == 0:
            lists = element.tag == _LIST
            return True
        depth -= lists
        if depth == _DEVICE_DEPTH + 1 and element.tag == "Slots":
            has_slots = True
        if depth == _DEVICE_DEPTH - 1 and element.tag == "Modules":  # they follow the devices
            return has_slots
        if depth == _DEVICE_DEPTH and element.tag == "Device":
            seen += 1
            return seen == choice.number
        if depth <= 1:
            return _in_outline(element, depth)
        return _in_outline(element, 2) if depth == 2 else element.tag not in _UNUSED

    for root in _infos(read_xml(path, wanted, findings)):
        element = root.find("Descriptions", "Devices", "Device")
        if element is not None:
            return _device(path, choice, root, element, findings)
    raise ConfigError(f"{path}: the file changed while it was read")


def _device(
    path: Path, choice: EsiChoice, root: Element, element: Element, findings: Findings
) -> EsiDevice:
    vendor = root.need("Vendor")
    groups = root.find("Descriptions", "Groups")
    group = element.text_of("GroupType")
    device = EsiDevice(
        path=str(path),
        line=element.line,
        findings=findings,
        vendor=_vendor(vendor),
        vendor_name=vendor.name(),
        type=choice.type,
        name=choice.name,
        product=choice.product,
        revision=choice.revision,
        group=group,
        group_name=_group_name(groups, group),
        physics=element.given("Physics"),
        fmmus=[_fmmu(item) for item in element.all("Fmmu")],
        sync_managers=[_sync_manager(item) for item in element.all("Sm")],
    )
    electrical = element.find("Info", "Electrical")
    if electrical is not None:
        device.ebus_current = electrical.number_or("EBusCurrent", 0, -0x8000, 0x7FFF)
    kind = element.need("Type")
    for name in ("ProductCode", "RevisionNo"):
        if not kind.given(name).strip():
            kind.note(f"<Type> has no {name}", "0 is used")
    info = element.find("Info")
    if info is not None:
        device.tells_identification = info.flag_of("IdentificationReg134")
        device.identification_register = info.number_or("IdentificationAdo", 0, high=0xFFFF)
    device.outputs = read_pdos(element.all("RxPdo"), device)
    device.inputs = read_pdos(element.all("TxPdo"), device)
    _read_mailbox(element, device)
    dc = element.find("Dc")
    for item in dc.all("OpMode") if dc else ():
        with item.instead():
            device.dc.append(_dc_mode(item))
    _read_eeprom(element, device)
    _read_profile(element, device)
    slots = element.find("Slots")
    device.slots = _slots(slots) if slots else []
    modules = root.find("Descriptions", "Modules") if device.slots else None
    for item in modules.all("Module") if modules else ():
        with item.instead("this module is left out"):
            module = _module(item)
            if any(slot.takes(module) for slot in device.slots):
                device.modules.append(module)
    return device


def _in_outline(element: Element, depth: int) -> bool:
    return element.tag.lower() in _OUTLINE[depth]


def _infos(root: Element) -> list[Element]:
    """The <EtherCATInfo> of a file; a list of them is what other programs write for a bus."""
    if root.tag == _LIST:
        return list(root.all("EtherCATInfo"))
    if root.tag != "EtherCATInfo":
        root.fail(f"the file begins with <{root.tag}>: an ESI file begins with <EtherCATInfo>")
    return [root]


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


def _vendor(vendor: Element) -> int:
    with vendor.instead("its vendor ID is 0"):
        return vendor.number_of("Id")
    return 0


def _fmmu(element: Element) -> int:
    if element.text not in _FMMU_USAGES and element.text:
        element.note(f"<Fmmu> is '{element.text}', which is unknown", "it is for nothing")
    return _FMMU_USAGES.get(element.text, 0)


def _sync_manager(element: Element) -> EsiSyncManager:
    control = element.attribute("ControlByte", high=0xFF)
    return EsiSyncManager(
        _usage(element, control),
        element.attribute("StartAddress", high=0xFFFF),
        element.attribute_or("DefaultSize", 0, high=0xFFFF),
        control,
        element.switch("Enable", 0xFF)
        | _VIRTUAL * element.flag("Virtual")
        | _IN_OP_ONLY * element.flag("OpOnly"),
        element.line,
    )


def _usage(element: Element, control: int) -> int:
    """What a sync manager is for; if the file does not say, as its control byte says.

    A buffered one without any text may be unused; it is used if PDOs lie in it (`sii_placement`).
    """
    usage = _SM_USAGES.get(element.text.lower())
    if usage is not None:
        return usage
    mailbox = control & _MODE == _MAILBOX
    if not element.text and not mailbox:
        return 0
    name = {True: ("MBoxIn", "MBoxOut"), False: ("Inputs", "Outputs")}[mailbox][control >> 2 & 1]
    if element.text:
        text = f"<Sm> is '{element.text}', which is unknown"
        element.note(text, f"{name} is used, as its control byte says")
    return _SM_USAGES[name.lower()]


def _slots(slots: Element) -> list[EsiSlot]:
    """The slots, each as often as the file says that it occurs."""
    index_step = slots.attribute("SlotIndexIncrement", high=0xFFFF)
    pdo_step = slots.attribute("SlotPdoIncrement", high=0xFFFF)
    most = slots.attribute_or("MaxSlotCount", _SLOTS_MAX, high=_SLOTS_MAX)
    found: list[EsiSlot] = []
    for element in slots.all("Slot"):
        slot = EsiSlot(
            element.name(),
            tuple(_idents(element)),
            tuple(item.text for item in _all(element, "ModuleClass", "Class")),
            element.attribute("SlotIndexIncrement", index_step, high=0xFFFF),
            element.attribute("SlotPdoIncrement", pdo_step, high=0xFFFF),
        )
        found += [slot] * element.attribute_or("MaxInstances", 1, high=_SLOTS_MAX)
    if len(found) > most:
        slots.note(f"there are {len(found)} slots, but MaxSlotCount is {most}", "the first count")
    return found[:most]


def _idents(element: Element) -> Iterator[int]:
    """The idents of the modules that a slot may have."""
    for item in element.all("ModuleIdent"):
        with item.instead():
            yield item.number()


def _all(element: Element, tag: str, inner: str) -> Iterable[Element]:
    """The children of a name. If a child has children itself, one of these has the text."""
    for child in element.all(tag):
        yield child.find(inner) or child


def _module(element: Element) -> EsiModule:
    kind = element.need("Type")
    return EsiModule(
        kind.attribute("ModuleIdent"),
        kind.given("ModuleClass"),
        kind.text,
        element.name(),
        element,
    )


def read_pdos(
    elements: Iterable[Element], device: EsiDevice, shift: Shift = UNMOVED
) -> list[EsiPdo]:
    """Reads PDOs of a device, or those of a module in a slot.

    A malformed PDO is left out. If others follow it in its sync manager, these would be read in the
    wrong place, which goes to `device.misplaced`.

    Args:
        elements: `<RxPdo>` or `<TxPdo>`.
        device: The device; its findings take what is left out.
        shift: How far the slot moves their indices, and those that they exclude.
    """
    elements = list(elements)
    movable = set(_movable(elements))
    result: dict[int, EsiPdo] = {}
    found: dict[int, Element] = {}
    lost: dict[int, str] = {}  # by sync manager, why the place of what follows is not known
    for element in elements:
        manager = _place(element, device)
        try:
            pdo = _pdo(element, manager, shift, movable)
        except MalformedError as error:
            device.findings.add(error.path, error.line, error.text, "this PDO is left out")
            lost.setdefault(manager, str(error))
            continue
        if manager in lost and manager != UNASSIGNED:
            device.misplaced.append(
                f"{lost[manager]}; so nobody knows where PDO 0x{pdo.index:04X} lies, which follows "
                f"in sync manager {manager}"
            )
        if _counts(element, pdo, result.get(pdo.index), device):
            result.pop(pdo.index, None)
            result[pdo.index], found[pdo.index] = pdo, element
    pdos = list(result.values())
    for pdo in sorted(pdos, key=lambda pdo: pdo.index):
        note_exclusions(found[pdo.index], pdo, pdos)
    return pdos


def note_exclusions(element: Element, pdo: EsiPdo, others: Iterable[EsiPdo]) -> None:
    """Notes which PDOs exclude a PDO, or are excluded by it, though both are assigned by default.

    Args:
        element: Where it is noted.
        pdo: The PDO.
        others: The other ones.
    """
    if pdo.sync_manager == UNASSIGNED:
        return
    for other in sorted(others, key=lambda other: other.index):
        excluded = other.index in pdo.excludes and other.index != pdo.index
        if excluded and other.sync_manager != UNASSIGNED:
            label = f"PDO 0x{pdo.index:04X} excludes 0x{other.index:04X}"
            element.note(f"{label}, but both are assigned by default", "both are used")


def _movable(elements: Iterable[Element]) -> Iterator[int]:
    """The indices, as they are written, of PDOs that depend on the slot."""
    for element in elements:
        index = element.find("Index")
        if index and index.flag("DependOnSlot"):
            with suppress(MalformedError):  # which `_pdo` tells
                yield index.number()


def _counts(element: Element, pdo: EsiPdo, known: EsiPdo | None, device: EsiDevice) -> bool:
    """Whether a PDO counts, if there is another one with its index: the one that is assigned."""
    if known is None:
        return True
    label = f"<{element.tag}> 0x{pdo.index:04X} is defined a second time"
    if known == pdo or pdo.sync_manager == UNASSIGNED:
        element.note(label, LEFT_OUT)
        return False
    if known.sync_manager == UNASSIGNED:
        element.note(label, "that which has no sync manager is left out")
        return True
    device.misplaced.append(f"{element.path}:{element.line}: {label}, with other entries")
    element.note(f"{label}, with other entries", LEFT_OUT)
    return False


def _place(element: Element, device: EsiDevice) -> int:
    """The sync manager that has a PDO by default."""
    count = len(device.sync_managers)
    effect = "it is not assigned by default"
    try:
        manager = element.attribute("Sm", UNASSIGNED, high=0xFF)
    except MalformedError as error:
        device.misplaced.append(f"{error}; so nobody knows where this PDO lies")
        element.note(error.text, effect)
        return UNASSIGNED
    if not element.given("Sm", "-").strip():
        element.note(f"Sm of <{element.tag}> is empty", effect)
    if count <= manager != UNASSIGNED:
        text = f"Sm of <{element.tag}> is {manager}, but there are {count} sync managers"
        element.note(text, effect)
        return UNASSIGNED
    return manager


def _pdo(element: Element, manager: int, shift: Shift, movable: set[int]) -> EsiPdo:
    template = element.given("Ref")
    if template and not element.has("Index"):
        element.fail(f"<{element.tag}> refers to '{template}', which is not in this file")
    index = shift.index(element.need("Index"))
    excludes = []
    for item in element.all("Exclude"):
        with item.instead():
            moves = item.number() in movable  # it means the PDO that is beside it in this module
            excludes.append(shift.index(item, moves=moves))
    return EsiPdo(
        index,
        element.name(),
        manager,
        read_entries(element, shift),
        fixed=element.flag("Fixed"),
        mandatory=element.flag("Mandatory"),
        excludes=excludes,
    )


def read_entries(pdo: Element, shift: Shift = UNMOVED) -> list[Entry]:
    """Reads the entries of a PDO, which ESI and ENI files write alike; arguments as `read_entry`.

    Raises:
        MalformedError: An entry is malformed; without it, those behind would be elsewhere.
    """
    entries = (read_entry(item, shift) for item in pdo.all("Entry"))
    return [part for entry in entries for part in _parts(entry)]


def _parts(entry: Entry) -> list[Entry]:
    """An entry; nothing if it has no bits, and gaps if it has more than a mapping can say."""
    if entry.bit_length <= _ENTRY_BITS:
        return [entry] * (entry.bit_length > 0)
    whole, rest = divmod(entry.bit_length, _GAP_BITS)
    sizes = [_GAP_BITS] * whole + [rest] * (rest > 0)
    return [Entry(0, 0, entry.name, DataType.PADDING, bits) for bits in sizes]


def read_entry(element: Element, shift: Shift = UNMOVED) -> Entry:
    """Reads an <Entry> of a PDO.

    Args:
        element: The element.
        shift: How far the slot of a module moves it.

    Raises:
        MalformedError: Its size is not known, or that of a value its address.
    """
    index = shift.index(element.need("Index"))
    name, type_name = element.name(), element.text_of("DataType")
    bits = _bits(element, type_name)
    if index == 0:
        return Entry(0, 0, name, DataType.PADDING, bits)
    if bits == 0:
        return Entry(index, 0, name, DataType.PADDING, 0)
    simple = simple_type(type_name, bits)
    kind = simple[0] if simple and simple[1] == bits else type_of_bits(bits)
    if type_name and simple is None and bits in _NATURAL_BITS:
        text = f"<DataType> is '{type_name}', which is unknown"
        element.note(text, f"{type_in_esi(kind)} is used, as it has {bits} bits")
    declared, size = simple_type(type_name, 0) or (kind, 0)
    if (is_signed(declared) and bits > size) or (is_real(declared) and bits != size):
        kind = type_of_bits(bits, signed=is_signed(declared))
        text = f"<DataType> is '{type_name}', which has {size} bits, but <BitLen> is {bits}"
        element.note(text, f"{type_in_esi(kind)} is used")
    subindex = element.number_of("SubIndex", 0, high=0xFF)
    return Entry(index, subindex, name, kind, bits)


def _bits(element: Element, type_name: str) -> int:
    """The size of an entry; if it is not given, that of its data type."""
    given = element.find("BitLen")
    simple = simple_type(type_name, 0)
    if given is None and simple is not None and simple[1]:
        element.note("<Entry> has no <BitLen>", f"{simple[1]} bits are used, as {type_name} has")
        return simple[1]
    bits = element.number_of("BitLen", high=_MOST_BITS)
    if bits == 0:
        element.note("<BitLen> is 0", "this entry is left out")
    elif bits > _ENTRY_BITS:
        text = f"<BitLen> is {bits}: an entry has at most {_ENTRY_BITS}"
        element.note(text, "these bits keep their place, but have no value")
    return bits


def _read_mailbox(element: Element, device: EsiDevice) -> None:
    mailbox = element.find("Mailbox")
    if mailbox is None:
        return
    for tag, bit in _PROTOCOLS.items():
        protocol = mailbox.find(tag)
        if protocol is None:
            continue
        device.protocols |= bit
        together = protocol.find("InitCmds")
        commands = (*protocol.all("InitCmd"), *(together.all("InitCmd") if together else ()))
        if commands and tag not in _TAKEN:
            commands[0].note(f"there are start-up commands of {tag}", "they are left out")
    coe = mailbox.find("CoE")
    if coe is not None:
        device.coe_details = _SDO
        for name, bit in _COE_DETAILS.items():
            device.coe_details |= bit * coe.flag(name)
        device.commands = read_commands(coe)
    soe = mailbox.find("SoE")
    if soe is not None:
        device.idns = read_idn_commands(soe)


def read_commands(coe: Element, shift: Shift = UNMOVED) -> list[EsiCommand]:
    """Reads the start-up commands in a `<CoE>`; leaves malformed ones out.

    By the schema of ETG.2000, the commands are children of `<CoE>`. Some files have an `<InitCmds>`
    around them, as ENI files do.
    """
    return _read_all(coe, lambda element: _command(element, shift))


def _read_all(protocol: Element, read: Callable[[Element], Command]) -> list[Command]:
    together = protocol.find("InitCmds")
    commands = []
    for element in (*protocol.all("InitCmd"), *(together.all("InitCmd") if together else ())):
        with element.instead("this start-up command is left out"):
            commands.append(read(element))
    return commands


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


def read_idn_commands(soe: Element) -> list[IdnCommand]:
    """Reads the start-up commands in a `<SoE>`, which ESI and ENI files write alike.

    Malformed ones are left out.
    """
    return _read_all(soe, _idn_command)


def _idn_command(element: Element) -> IdnCommand:
    data = element.find("Data")
    writes = element.number_of("OpCode", _WRITE_IDN, high=0xFF) == _WRITE_IDN
    value = element.number_of("Elements", _VALUE, high=0xFF) == _VALUE
    channel = element.attribute("Chn", 0, high=0xFF)  # that is how ESI files name the drive
    return IdnCommand(
        element.line,
        tuple(dict.fromkeys(item.text.upper() for item in element.all("Transition"))),
        element.number_of("DriveNo", channel, high=0xFF),
        element.number_of("IDN", high=0xFFFF),
        data.octets() if data and writes and value else b"",
        element.text_of("Comment"),
        element.flag_of("Disabled"),
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
    device.eeprom_size = eeprom.number_or("ByteSize", 0, high=0x80000)
    device.config_data = _octets(eeprom, "ConfigData", 14)
    device.bootstrap = _octets(eeprom, "BootStrap", 8)
    for item in eeprom.all("Category"):
        with item.instead("this category is left out"):
            number = item.number_of("CatNo", high=0xFFFE)
            if number in _OWN_CATEGORIES:
                item.fail(f"category {number} is one that the device itself describes")
            octets = item.find("Data")
            content = octets.octets(0x10000) if octets else item.text_of("DataString").encode()
            device.categories.append((number, content))


def _octets(eeprom: Element, tag: str, most: int) -> bytes:
    """The bytes in a child; what follows the first `most` ones, such as a checksum, is left out."""
    found = eeprom.find(tag)
    if found is None:
        return b""
    with found.instead():
        data = found.octets(0x10000)
        if len(data) > most + 2:
            found.note(f"<{tag}> has {len(data)} bytes", f"the first {most} are used")
        return data[:most]
    return b""


def _read_profile(element: Element, device: EsiDevice) -> None:
    objects: dict[int, EsiObject] = {}
    for profile in element.all("Profile"):
        messages = profile.find("DiagMessages")
        for message in messages.all("DiagMessage") if messages else ():
            with message.instead():
                number = message.number_of("TextId", high=0xFFFF)
                text = message.name("MessageText")
                if device.diagnosis_texts.setdefault(number, text) != text:
                    message.fail(f"the text 0x{number:04X} is there a second time")
        dictionary = profile.find("Dictionary")
        for item in read_dictionary(dictionary) if dictionary else ():
            if objects.setdefault(item.index, item) != item:
                label = f"object 0x{item.index:04X} is in another <Profile>, with other content"
                element.findings.add(element.path, item.line, label, LEFT_OUT)
        device.dictionary_file = device.dictionary_file or profile.text_of("DictionaryFile")
    device.objects = [objects[index] for index in sorted(objects)]
    if device.objects:
        device.dictionary_file = ""
    elif device.dictionary_file:
        text = f"the object dictionary is in another file, '{device.dictionary_file}'"
        element.note(text, "it is not read")
