"""Device files: what they can say, and what is said of those that are wrong."""

import base64
import random
import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conftest import names, names_at, naming
from ecatd.base.errors import ConfigError, SdoAbortError
from ecatd.etg.datatypes import DataType
from ecatsim import Access, Chip, Device, Mailbox, Rig, Simulation
from ecatsim.chip import MODELS
from ecatsim.devices.beckhoff import EL3008
from ecatsim.esc import Segment
from ecatsim.files import any_device, device_attributes, device_file
from ecatsim.slave.objects import ObjectCode
from ecatsim.slave.sii import DcMode, Description, FmmuType, SmType, SyncManager, build

SMALL = """\
vendor = 0xFFFF
product = 1
name = "Doubler"
[[pdo]]
index = 0x1600
entry = [{ index = 0x7000, subindex = 1, name = "In", type = "int16" }]
[[pdo]]
index = 0x1A00
entry = [{ index = 0x6000, subindex = 1, name = "Out", type = "int16", loopback = "0x7000:01" }]
"""

FULL = """\
vendor = 0x9A
product = 0x30924
revision = 0x10420
serial = 7
alias = 3
order = "GCON"
name = "Gold"
group = "Drives"
group_name = "Elmo Drives"
device_type = 0x00020192
pdi_control = 0x0C08
ebus_current = -2000
variable_assignment = true
period = 0.002
ports = ["mii", "ebus"]
fmmus = ["outputs", "inputs", "mailbox-state"]
device_id = 12
variable_mapping = [0x1600]
mapping_limits = [32, 16]
longest_watchdog = 2
needs_eeprom = true
answer_delay = 0.01
firmware_files = ["firmware.efw"]
files = { "log.txt" = "base64:aGVsbG8=" }

[bootstrap]
receive_size = 512
send = 0x1400
send_size = 512

[chip]
type = 0x12
build = 3
fmmus = 4
sync_managers = 6
ram_kib = 4

[mailbox]
receive = 0x1800
receive_size = 140
send = 0x1900
send_size = 160
protocols = ["coe", "foe"]
coe_details = ["sdo", "sdo-information", "pdo-assignment", "complete-access"]

[[sync_manager]]
type = "mailbox-out"
start = 0x1800
size = 140
control = 0x26

[[sync_manager]]
type = "mailbox-in"
start = 0x1900
size = 160
control = 0x22

[[sync_manager]]
type = "outputs"
start = 0x1100
size = 4
control = 0x64

[[sync_manager]]
type = "inputs"
start = 0x1180
size = 3
control = 0x20
enable = 9

[[pdo]]
index = 0x1600
name = "Targets"
[[pdo.entry]]
index = 0x607A
name = "Target position"
type = "DINT"
unit = "rad"
scale = 0.001
offset = -1
value = -5

[[pdo]]
index = 0x1A00
entry = [
  { index = 0x6041, type = "uint16", value = 0x0250 },
  { gap = 7, name = "Status__" },
  { index = 0x6000, subindex = 3, type = "bool", value = true },
]

[[pdo]]
index = 0x1A01
assigned = false
entry = [{ index = 0x6000, subindex = 4, type = "BIT3", bits = 3 }]

[[object]]
index = 0x2000
name = "Gain"
type = "REAL32"
access = "rw"
value = 1.5
default = 1
unit = "mV"
min = -2.5

[[object]]
index = 0x2001
name = "Speeds"
type = "int32"
access = "rw-preop"
values = [1, -2, 3]
names = ["slow", "back", "fast"]
min = -100
max = 1000

[[object]]
index = 0x2002
name = "Settings"
structure = 0x0800
entry = [
  { subindex = 1, name = "Text", type = "string", value = "Grüße", bits = 80, access = "rw" },
  { subindex = 2, type = "octet_string", value = "01 02 ff" },
  { subindex = 4, type = "unicode_string", value = "Ω" },
  { subindex = 5, type = 0x0260, data = "01 02 03 04" },
  { subindex = 6, type = "uint32", abort = 0x08000022 },
  { subindex = 7, type = "uint8", access = 0x0047 },
]

[[object]]
index = 0x6000
name = "Status"
entry = [{ subindex = 3, name = "Ready" }]
"""


def load(folder: Path, text: str) -> Device:
    file = folder / "device.toml"
    file.write_text(text, "utf-8")
    return any_device.load(file)


def test_nine_lines_make_a_device(tmp_path: Path) -> None:
    device = load(tmp_path, SMALL)
    assert (device.vendor, device.product, device.order) == (0xFFFF, 1, "Doubler")
    simulation = Simulation(Rig("one", [device]))
    try:
        device[0x7000, 1] = -77
        device.step(0.0)
        assert device[0x6000, 1] == -77
    finally:
        simulation.close()


def test_two_lines_make_a_device(tmp_path: Path) -> None:
    assert load(tmp_path, "vendor = 1\nproduct = 2\n").order == "device"


def test_identity_and_strings(tmp_path: Path) -> None:
    device = load(tmp_path, FULL)
    assert (device.vendor, device.product, device.revision) == (0x9A, 0x30924, 0x10420)
    assert (device.serial, device.alias, device.device_type) == (7, 3, 0x20192)
    assert (device.order, device.name) == ("GCON", "Gold")
    assert (device.group, device.group_name) == ("Drives", "Elmo Drives")
    assert (device.pdi_control, device.ebus_current, device.period) == (0x0C08, -2000, 0.002)
    assert device.variable_assignment
    assert (device.device_id, device.variable_mapping, device.mapping_limits) == (
        12,
        (0x1600,),
        (32, 16),
    )
    assert (device.longest_watchdog, device.needs_eeprom, device.answer_delay) == (2, True, 0.01)
    assert device.bootstrap == Mailbox(receive_size=512, send=0x1400, send_size=512)
    assert (device.firmware_files, device.files) == (("firmware.efw",), {"log.txt": b"hello"})


def test_chip_and_its_settings(tmp_path: Path) -> None:
    device = load(tmp_path, FULL)
    chip = Chip(type=0x12, build=3, fmmus=4, sync_managers=6, ram_kib=4, ports=0b1011)
    assert device.chip == chip
    assert device.physical_ports == 0x31
    assert device.mailbox == Mailbox(0x1800, 140, 0x1900, 160, protocols=0x0C, coe_details=0x27)
    assert device.sync_managers == (
        SyncManager(SmType.MAILBOX_OUT, 0x1800, 140, 0x26),
        SyncManager(SmType.MAILBOX_IN, 0x1900, 160, 0x22),
        SyncManager(SmType.OUTPUTS, 0x1100, 4, 0x64),
        SyncManager(SmType.INPUTS, 0x1180, 3, 0x20, 9),
    )
    assert device.fmmus == (FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE)


def test_a_chip_has_a_name(tmp_path: Path) -> None:
    text = "vendor = 1\nproduct = 2\n"
    device = load(
        tmp_path, text + 'chip = { model = "ET1200", fmmus = 2 }\nports = ["mii", "ebus"]'
    )
    assert device.chip == replace(MODELS["ET1200"], fmmus=2, ports=0b1011)
    with pytest.raises(ConfigError, match=naming("chip.model:", "'ET1300'", '"ET1200"')):
        load(tmp_path, text + 'chip.model = "ET1300"')


def test_a_clock_that_the_sii_switches_off(tmp_path: Path) -> None:
    """It is there, unless the chip is one that goes by the SII."""
    data = build(Description(1, 2, 3, pdi_control=0x0104))
    for text, answers in (
        ("", 1),
        ("chip = { dc = true }", 1),
        ("chip = { dc = false }", 0),
        ('chip = { model = "ET1200" }', 0),
        ('chip = { model = "ET1200", dc_by_sii = false }', 1),
    ):
        segment = Segment()
        load(tmp_path, inline(data) + text).attach(segment, 0, 0)
        body = struct.pack("<BBHHHH", 1, 0, 0, 0x0910, 8, 0) + bytes(10)
        raw = bytes(12) + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body)) + body
        answer = segment.process(raw.ljust(60, b"\0"))
        assert answer is not None
        assert answer[34] == answers, text
        segment.close()


def test_process_data(tmp_path: Path) -> None:
    device = load(tmp_path, FULL)
    (target,) = device.rx_pdos
    assert (target.index, target.name, target.sync_manager) == (0x1600, "Targets", 2)
    (entry,) = target.entries
    assert (entry.data_type, entry.bit_length) == (DataType.INTEGER32, 32)
    assert (entry.unit, entry.scale, entry.offset) == ("rad", 0.001, -1.0)
    first, second = device.tx_pdos
    assert [entry.bit_length for entry in first.entries] == [16, 7, 1]
    assert (first.sync_manager, second.sync_manager) == (3, 0xFF)
    assert first.entries[1].is_gap
    assert device.give() == bytes.fromhex("5002 80")
    assert device[0x607A, 0] == -5


def test_objects(tmp_path: Path) -> None:
    objects = load(tmp_path, FULL).dictionary
    gain = objects.entry(0x2000, 0)
    assert (gain.type, gain.access, gain.encode().hex()) == (DataType.REAL32, Access.RW, "0000c03f")
    assert (gain.default, gain.unit, gain.minimum) == (1.0, 0xFD260000, -2.5)
    speeds = objects.object(0x2001)
    assert (speeds.name, speeds.code, speeds.max_subindex) == ("Speeds", ObjectCode.ARRAY, 3)
    assert [speeds.entries[i].name for i in (1, 2, 3)] == ["slow", "back", "fast"]
    assert [speeds.entries[i].value for i in range(4)] == [3, 1, -2, 3]
    assert speeds.entries[2].access == Access.READ | Access.WRITE_PREOP
    with pytest.raises(SdoAbortError, match="too high"):
        speeds.entries[1].write((1001).to_bytes(4, "little"))
    record = objects.object(0x2002)
    assert (record.code, record.type, record.max_subindex) == (ObjectCode.RECORD, 0x0800, 7)
    assert sorted(record.entries) == [0, 1, 2, 4, 5, 6, 7]
    assert [record.entries[i].encode() for i in (1, 2, 4, 5)] == [
        "Grüße".encode("latin-1"),
        b"\1\2\xff",
        "Ω".encode("utf-16-le"),
        b"\1\2\3\4",
    ]
    assert [record.entries[i].bits for i in (1, 2, 4, 5)] == [80, 24, 16, 32]
    with pytest.raises(SdoAbortError) as abort:
        record.entries[6].encode()
    assert abort.value.code == 0x08000022
    assert record.entries[7].access == 0x47


def test_object_of_a_pdo_keeps_what_is_not_said_of_it(tmp_path: Path) -> None:
    item = load(tmp_path, FULL).dictionary.object(0x6000)
    assert (item.name, sorted(item.entries)) == ("Status", [0, 3, 4])
    assert (item.entries[3].name, item.entries[3].value) == ("Ready", 1)
    assert item.entries[3].access & Access.TX_PDO


def test_only_the_listed_objects(tmp_path: Path) -> None:
    text = (
        SMALL.replace("[[pdo]]", "complete_dictionary = true\n[mailbox]\n[[pdo]]", 1)
        + '[[object]]\nindex = 0x1000\n[[object]]\nindex = 0x2000\nname = "N"\ntype = "uint8"\n'
    )
    device = load(tmp_path, text)
    assert [item.index for item in device.dictionary] == [0x1000, 0x2000, 0x6000, 0x7000]


def image(**changes: int) -> bytes:
    device = EL3008()
    for name, value in changes.items():
        setattr(device, name, value)
    return device.sii_image()


def inline(data: bytes) -> str:
    return f'sii = "base64:{base64.b64encode(data).decode()}"\n'


def test_an_image_beside_the_file_or_in_it(tmp_path: Path) -> None:
    (tmp_path / "el3008.bin").write_bytes(image())
    for text in ('sii = "el3008.bin"\n', inline(image())):
        device = load(tmp_path, text)
        assert (device.order, device.product) == ("EL3008", EL3008.product)
        assert device.sii_image() == image()
        assert device.dictionary[0x6000, 0x11].type == DataType.INTEGER16


def test_what_is_added_to_an_image(tmp_path: Path) -> None:
    text = inline(image()) + "alias = 300\nserial = 5\nchip = { fmmus = 3 }\n"
    text += "[[object]]\nindex = 0x8000\nname = 'Gain'\ntype = 'uint8'\nvalue = 3\n"
    device = load(tmp_path, text)
    assert device.sii_image() == image(alias=300, serial=5)  # with the checksum of that
    assert device.chip.fmmus == 3
    assert device[0x8000, 0] == 3
    assert len(device.tx_pdos) == 16


def test_other_process_data_than_in_the_image(tmp_path: Path) -> None:
    text = (
        inline(image()) + "[[pdo]]\nindex = 0x1A02\nentry = [{ index = 0x6010, type = 'uint8' }]\n"
    )
    device = load(tmp_path, text)
    assert device.sii_image() == image()
    assert [(pdo.index, pdo.sync_manager) for pdo in device.tx_pdos] == [(0x1A02, 3)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('sii = "nothing.bin"', "device.toml:1: sii: 'nothing.bin' | No such file"),
        ('sii = "base64:AAA"', "device.toml:1: sii: base64 | padding"),
        ('sii = "base64:é"', "device.toml:1: sii: base64 | ASCII"),
        ('sii = "base64:AAAA"', "device.toml:1: sii: 3 bytes"),
        ("sii = 5", "device.toml:1: sii: text | 5"),
        ("vendor = 1\nproduct = 2\nstrict = true", "device.toml:3: strict: `sii`"),
    ],
)
def test_mistakes_in_images(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        load(tmp_path, text)
    names_at(str(error.value).replace(f"{tmp_path}/", ""), message)


def test_an_image_with_mistakes_unless_that_is_not_wanted(tmp_path: Path) -> None:
    wrong = bytearray(image())
    wrong[14] ^= 1
    with pytest.raises(ConfigError, match=naming("device.toml:2: sii:", "checksum")):
        load(tmp_path, "strict = true\n" + inline(bytes(wrong)))
    device = load(tmp_path, inline(bytes(wrong)))
    assert device.sii_image() == bytes(wrong)
    (remark,) = device.remarks
    names_at(remark.replace(f"{tmp_path}/", ""), "device.toml:1: sii: byte 0x000E | checksum")
    assert load(tmp_path, "strict = false\n" + inline(b"")).sii_image() == b""


@pytest.mark.parametrize("upper", [":020000040000FA\n", ":020000020000FC\r\n", "\n"])
def test_an_image_in_intel_hex(tmp_path: Path, upper: str) -> None:
    data = image()
    (tmp_path / "eeprom.hex").write_text(upper + intel_hex(data))
    assert load(tmp_path, 'sii = "eeprom.hex"').sii_image() == data
    for old, new, tokens in (
        (":10", ":11", "eeprom.hex:| damaged | checksum"),
        (":00000001FF", "", "eeprom.hex | no end | cut off"),
        (":00000001FF", ":0000000AF6\n", "eeprom.hex:| type 10"),
        (":00000001FF", "x", "eeprom.hex:| colon"),
        (":00000001FF", ":0100000012ED\n:00000001FF", "eeprom.hex:| byte 0x0 | another value"),
        (":", "S00600004844521B\n:", "eeprom.hex | Motorola | objcopy"),
    ):
        (tmp_path / "eeprom.hex").write_text(intel_hex(data).replace(old, new, 1))
        with pytest.raises(ConfigError) as error:
            load(tmp_path, 'sii = "eeprom.hex"')
        for token in tokens.split("| "):
            assert token.strip() in str(error.value)


@pytest.mark.parametrize("head", ["\ufeff", "; made by a tool\n", "# made\n\n"])
def test_an_image_in_intel_hex_with_something_before_it(tmp_path: Path, head: str) -> None:
    data = image()
    (tmp_path / "eeprom.hex").write_text(head + intel_hex(data), "utf-8")
    assert load(tmp_path, 'sii = "eeprom.hex"').sii_image() == data


def test_blocks_that_are_missing_in_intel_hex_are_told(tmp_path: Path) -> None:
    lines = intel_hex(image()).splitlines(keepends=True)
    (tmp_path / "eeprom.hex").write_text("".join([*lines[:4], *lines[6:]]))
    remarks = load(tmp_path, 'sii = "eeprom.hex"').remarks
    names(remarks[0], "eeprom.hex", "0x40 to 0x5F", "0xFF")


def intel_hex(data: bytes) -> str:
    """The lines of 16 bytes that have been written, as a programmer of EEPROMs saves them."""
    lines = []
    for at in range(0, len(data), 16):
        part = data[at : at + 16]
        if part.strip(b"\xff") or at + 16 >= len(data):
            record = bytes([len(part), at >> 8, at & 0xFF, 0]) + part
            lines.append(f":{(record + bytes([-sum(record) & 0xFF])).hex().upper()}")
    return "\n".join([*lines, ":00000001FF", ""])


def test_dc_modes(tmp_path: Path) -> None:
    text = """\
vendor = 1
product = 1
[[dc_mode]]
name = "Synchron"
assign_activate = 0
[[dc_mode]]
name = "DC"
description = "with SYNC0"
sync0_cycle_ns = 1000000
sync0_shift_ns = -500
"""
    assert load(tmp_path, text).dc_modes == (
        DcMode("Synchron", 0),
        DcMode("DC", 0x0300, 1_000_000, sync0_shift_ns=-500, description="with SYNC0"),
    )
    with pytest.raises(
        ConfigError, match=naming("device.toml:5: dc_mode[0].assign_activate:", 65536)
    ):
        load(tmp_path, text.replace("assign_activate = 0", "assign_activate = 65536"))


def test_a_device_that_contradicts_itself(tmp_path: Path) -> None:
    more = """
mailbox = {}
[[told]]
index = 0x1600
values = [0x70000110, 0x8]
[[told]]
index = 0x1A00
missing = true
[[told]]
index = 0x1C13
values = [0x001A]
"""
    device = load(tmp_path, SMALL.replace("[[pdo]]", more + "[[pdo]]", 1))
    read = device.dictionary.entry
    assert [read(0x1600, i).decode(read(0x1600, i).encode()) for i in range(3)] == [
        2,
        0x70000110,
        8,
    ]
    assert 0x1A00 not in device.dictionary
    assert [read(0x1C13, i).decode(read(0x1C13, i).encode()) for i in range(2)] == [1, 0x001A]
    assert device.room == (2, 2), "what counts is as it was"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("index = 0x1C0F\nvalues = []", "told[0].index | 0x1C10"),
        ("index = 0x1A00", "`values` | `missing = true`"),
        ("index = 0x1A00\nvalues = []\nmissing = true", "`values` | `missing = true`"),
        ("index = 0x1C13\nvalues = [65536]", "told[0].values[0] | 65536 | 65535"),
    ],
)
def test_mistakes_in_told(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        load(tmp_path, f"{SMALL}[[told]]\n{row}\n")


def test_an_assignment_may_name_a_pdo_that_does_not_exist(tmp_path: Path) -> None:
    values = "".join(
        f'{{ subindex = {i}, name = "{i}", type = "uint{8 if i == 0 else 16}", value = {value} }}, '
        for i, value in enumerate((2, 0x1A07, 0x1A00))
    )
    head = SMALL.replace('name = "Doubler"', 'name = "Doubler"\nmailbox = {}')
    more = f'[[object]]\nindex = 0x1C13\nname = "Assign"\nentry = [{values}]\n'
    device = load(tmp_path, head + more)
    assert [device[0x1C13, i] for i in range(3)] == [2, 0x1A07, 0x1A00]
    assert device._process_data.inputs.size == 2


def test_everything_that_a_device_describes_has_a_key(tmp_path: Path) -> None:
    """Attributes of `Device` that not a key of the same name sets are set by others."""
    other = {
        "rx_pdos": "pdo",
        "tx_pdos": "pdo",
        "sync_managers": "sync_manager",
        "dc_modes": "dc_mode",
        "idns": "idn",
        "told_mappings": "told",
        "told_assignments": "told",
    }
    names = {other.get(name, name) for name in device_attributes.attributes()}
    assert names <= set(device_file.keys())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("product = 1", "", "device.toml: product: missing | whole number"),
        ("product = 1", "prodct = 1", "device.toml:2: prodct: not a key | 'product'"),
        (
            "product = 1",
            "product = true",
            "device.toml:2: product: whole number | true",
        ),
        (
            "product = 1",
            "product = 1\nalias = 1979-05-27",
            "device.toml:3: alias: whole number | 1979-05-27",
        ),
        (
            '"Doubler"',
            f'"{"日" * 86}"',
            "device.toml:3: name: 258 bytes | 255",
        ),
        (
            "product = 1",
            "product = 1\nperiod = 0",
            "device.toml:3: period: 0 | 0.0001 | 3600",
        ),
        (
            "product = 1",
            "product = 1\nperiod = nan",
            "device.toml:3: period: finite | nan",
        ),
        (
            "product = 1",
            "product = 1\nvariable_assignment = 1",
            "device.toml:3: variable_assignment: true | false | 1",
        ),
        (
            "product = 1",
            'product = 1\nports = "mii"',
            'device.toml:3: ports: list | "none" | "ebus" | "mii" | \'mii\'',
        ),
        (
            "product = 1",
            'product = 1\nports = ["mii", "mii", "mii", "mii", "mii"]',
            "device.toml:3: ports: 5 | 4",
        ),
        (
            "product = 1",
            'product = 1\nports = ["mii"]\nchip.ports = 3',
            "device.toml:4: chip.ports: `ports`",
        ),
        (
            "product = 1",
            "product = 1\nchip = 3",
            "device.toml:3: chip: [chip] | 3",
        ),
        (
            "product = 1",
            "product = 1\nchip.fmus = 3",
            "device.toml:3: chip.fmus: not a key | 'fmmus'",
        ),
        (
            "product = 1",
            "product = 1\nchip.dc_bits = 48",
            "device.toml:3: chip.dc_bits: 48 | 32 | 64",
        ),
        (
            "product = 1",
            "product = 1\nmailbox.receive_size = 9",
            "device.toml:3: mailbox.receive_size: 9 | 32 | 1486",
        ),
        (
            "product = 1",
            "product = 1\nmailbox.send = 0x1010",
            "device.toml:3: mailbox.send: overlap | 0x1000 | 0x107F | 0x1010",
        ),
        (
            "product = 1",
            "product = 1\nmailbox.protocols = 256",
            "device.toml:3: mailbox.protocols: 256 | 0 | 255",
        ),
        (
            "product = 1",
            'product = 1\nfmmus = ["output"]',
            'device.toml:3: fmmus[0]: \'output\' | "unused" | "outputs"',
        ),
        (
            "product = 1",
            "product = 1\nvariable_mapping = [7]",
            "device.toml:3: variable_mapping[0]: PDO | 7",
        ),
        (
            "product = 1",
            "product = 1\nmapping_limits = [7]",
            "device.toml:3: mapping_limits: two | outputs | inputs",
        ),
        (
            "product = 1",
            "product = 1\nfirmware_files = [7]",
            "device.toml:3: firmware_files[0]: text | 7",
        ),
        (
            "product = 1",
            'product = 1\nfiles = { log = "nothing.txt" }',
            "device.toml:3: files.log: 'nothing.txt' | No such file",
        ),
        (
            "[[pdo]]",
            '[[sync_manager]]\ntype = "outputs"\nstart = 0x1000\n[[pdo]]',
            "device.toml:4: sync_manager[0].size: missing | whole number",
        ),
        (
            "[[pdo]]",
            "sync_manager = []\n[[pdo]]",
            "device.toml:5: pdo[0]: sync manager | outputs",
        ),
        (
            "0x1600",
            "0x1900",
            "device.toml:5: pdo[0].index: 0x1900 | 0x1600 | 0x17FF",
        ),
        (
            "0x1600",
            "0x160000",
            "device.toml:5: pdo[0].index: 0x160000 | 0x1600 | 0x1BFF",
        ),
        (
            "index = 0x1600",
            "index = 0x1600\n[[pdo]]\nindex = 0x1600",
            "device.toml:7: pdo[1].index: 0x1600 | second",
        ),
        (
            "index = 0x1600",
            'index = 0x1600\ndirection = "out"',
            "device.toml:6: pdo[0].direction: not a key | index | name | assigned",
        ),
        (
            "index = 0x1600",
            "index = 0x1600\nassigned = false\nsync_manager = 2",
            "device.toml:7: pdo[0].sync_manager: assigned",
        ),
        (
            '"int16", loop',
            '"int17", loop',
            "device.toml:9: pdo[1].entry[0].type: 'int17' | bool | int8",
        ),
        (
            'type = "int16" }',
            'typ = "int16" }',
            "device.toml:6: pdo[0].entry[0].typ: not a key | 'type'",
        ),
        (
            ', type = "int16" }',
            " }",
            'device.toml:6: pdo[0].entry[0].type: missing | "uint16"',
        ),
        (
            'type = "int16" }',
            'type = "int16", bits = 17 }',
            "device.toml:6: pdo[0].entry[0].bits: 17 | 1 | 16",
        ),
        (
            'type = "int16" }',
            'type = "float", bits = 16 }',
            "device.toml:6: pdo[0].entry[0].bits: 16 | REAL32 | 32",
        ),
        (
            'type = "int16" }',
            'type = "int16", scale = 0 }',
            "device.toml:6: pdo[0].entry[0].scale: 0",
        ),
        (
            'type = "int16" }',
            'type = "int16", value = 40000 }',
            "device.toml:6: pdo[0].entry[0].value: 40000 | -32768 | 32767",
        ),
        (
            'type = "int16" }',
            'type = "int16", loopback = "0x6000:01" }',
            "device.toml:6: pdo[0].entry[0].loopback: input",
        ),
        (
            '"0x7000:01"',
            '"0x7000:02"',
            "device.toml:9: pdo[1].entry[0].loopback: 0x7000:02 | output",
        ),
        (
            '"0x7000:01"',
            '"7000.1"',
            "device.toml:9: pdo[1].entry[0].loopback: \"0x6000:01\" | '7000.1'",
        ),
        (
            "entry = [{ index = 0x7000,",
            "entry = [{ gap = 8 }, { gap = 8, index = 0x7000,",
            "device.toml:6: pdo[0].entry[1].index: gap",
        ),
        (
            "entry = [{ index = 0x7000",
            "entry = [7, { index = 0x7000",
            "device.toml:6: pdo[0].entry[0]: [[pdo.entry]] | 7",
        ),
        (
            "[[pdo]]",
            "pdo.index = 0x1600\n[[object]]",
            "device.toml:4: pdo: [[pdo]] | table",
        ),
        (
            "[[pdo]]",
            "[[pdo]",
            "device.toml:4: TOML | ']]'",
        ),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in SMALL
    text = SMALL.replace(old, new, 1)
    if "pdo.index" in new:
        text = text.split("[[object]]")[0]
    with pytest.raises(ConfigError) as error:
        load(tmp_path, text)
    names_at(str(error.value).replace(f"{tmp_path}/", ""), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = 'N'\ntype = 'uint8'", "index: missing | whole number"),
        ("index = 0x2000", 'type: missing | "uint16"'),
        ("index = 0x2000\ntype = 'float'\nvalue = 1e39", "value: 1e+39 | large"),
        ("index = 0x2000\ntype = 'string'\nvalue = 7", "value: text | 7"),
        ("index = 0x2000\ntype = 'string'\nvalue = '日'", "value: characters | Latin-1"),
        (
            "index = 0x2000\ntype = 'string'\nbits = 16\nvalue = 'abc'",
            "value: 16 bits",
        ),
        (
            "index = 0x2000\ntype = 'octet_string'\nvalue = 'xyz'",
            "value: hexadecimal | 'xyz'",
        ),
        ("index = 0x2000\ntype = 0x0260\nvalue = 1", "value: 0x0260 | `data`"),
        ("index = 0x2000\ntype = 'uint8'\nvalue = 1\ndata = '01'", "data: `value`"),
        (
            "index = 0x2000\ntype = 'uint8'\naccess = 'r'",
            "access: 'r' | \"ro\"",
        ),
        ("index = 0x2000\ntype = 'uint8'\naccess = 65536", "access: 65536 | 65535"),
        ("index = 0x2000\ntype = 'uint8'\nmin = -1", "min: -1 | 0 | 255"),
        ("index = 0x2000\ntype = 'string'\nmax = 1", "max: VISIBLE_STRING"),
        (
            "index = 0x2000\ntype = 'uint8'\nunit = 'furlong'",
            "unit: 'furlong'",
        ),
        ("index = 0x2000\ntype = 'uint8'\ndefault = 256", "default: 256 | 0"),
        ("index = 0x2000\ntype = 'uint8'\nabort = 0", "abort: 0 | 1"),
        ("index = 0x2000\ntype = 'uint8'\nnames = ['a']", "names: `values`"),
        (
            "index = 0x2000\ntype = 'uint8'\nvalues = [1, 256]",
            "values[1]: 256 | 255",
        ),
        ("index = 0x2000\ntype = 'uint8'\nvalues = [1]\nnames = []\nvalue = 3", "value: `values`"),
        ("index = 0x2000\ntype = 'uint8'\nvalues = [1]\nnames = ['a', 'b']", "names: 2 | 1"),
        (
            "index = 0x2000\ntype = 'uint8'\nvalues = [1]\nnames = [2]",
            "names[0]: text | 2",
        ),
        ("index = 0x2000\nvalue = 3\nentry = []", "value: `entry`"),
        ("index = 0x2000\nentry = [{ type = 'bool' }]", "entry[0].subindex: missing"),
        (
            "index = 0x2000\nentry = [{ subindex = 1, type = 'bool' }, { subindex = 1 }]",
            "entry[1].subindex: 1 | second",
        ),
        ("index = 0x1018\ntype = 'uint8'", "entry: missing"),
        ("index = 0x1018\ntype = 'uint8'\nvalues = [1]", "index: PDOs | standards | `entry`"),
        ("index = 0x1000\nentry = [{ subindex = 1 }]", "entry: variable"),
        ("index = 0x2000\ntype = 'bool'\ncode = 'var'", "code: 'var' | \"variable\""),
        ("index = 0x2000\nindex2 = 1", "index2: not a key | 'index'"),
    ],
)
def test_mistakes_in_objects(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        load(tmp_path, f"vendor = 1\nproduct = 2\n[[object]]\n{text}\n")
    key = re.match(r"\w+", message)
    assert key
    lines = [i for i, line in enumerate(text.splitlines(), 4) if line.startswith(key[0] + " =")]
    said = str(error.value).replace(f"{tmp_path}/", "")
    names_at(said, f"device.toml:{lines[0] if lines else 3}: object[0].{message}")


def test_object_described_twice(tmp_path: Path) -> None:
    text = "vendor = 1\nproduct = 2\n" + "[[object]]\nindex = 0x2000\ntype = 'bool'\n" * 2
    with pytest.raises(
        ConfigError, match=naming("device.toml:7: object[1].index:", "0x2000", "second")
    ):
        load(tmp_path, text)


def test_process_data_that_do_not_fit_into_the_chip(tmp_path: Path) -> None:
    entry = "{ index = 0x7000, subindex = 1, type = 'uint64' },"
    text = "vendor = 1\nproduct = 2\nchip.ram_kib = 1\n[[pdo]]\nindex = 0x1600\n[[pdo]]\n"
    text = text.replace("[[pdo]]\n", f"[[pdo]]\nentry = [{entry * 200}]\n", 1)
    with pytest.raises(
        ConfigError, match=naming("device.toml:4: pdo:", "0x1000", "0x163F", "0x13FF")
    ):
        load(tmp_path, text.removesuffix("[[pdo]]\n"))


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming(tmp_path / "nothing.toml", "No such file")):
        any_device.load(tmp_path / "nothing.toml")
    with pytest.raises(ConfigError, match=naming(tmp_path, "Is a directory")):
        any_device.load(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(ConfigError, match=naming("bytes.toml:1:", "UTF-8", "start byte")):
        any_device.load(tmp_path / "bytes.toml")
    with pytest.raises(ConfigError, match=naming("device.toml:", "nested")):
        load(tmp_path, "a = " + "[" * 100_000)
    with pytest.raises(ConfigError, match=naming("device.toml:1:", "digits")):
        load(tmp_path, "product = " + "1" * 5000)


VALUES = [
    "-1",
    "0",
    "0xFFFF",
    "1e400",
    "nan",
    "true",
    "''",
    "'bool'",
    "[]",
    "{}",
    "[[1]]",
    "9" * 30,
]
VALUES += [
    "{ slave = 1 }",
    "1979-05-27",
    '"\\u0000"',
    "'0x6000:01'",
    "'base64:AAAA'",
    "'日'",
    "0b1",
]


def mutate(text: str, seed: int) -> str:
    """A document with a few mistakes: in values, in keys, in lines or in characters."""
    chance = random.Random(seed)
    lines = text.splitlines()
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(lines))
        way = chance.randrange(6)
        if way == 0:
            lines.insert(chance.randrange(len(lines)), lines[at])
        elif way == 1 and len(lines) > 1:
            del lines[at]
        elif way == 2 and lines[at]:
            place = chance.randrange(len(lines[at]))
            lines[at] = (
                lines[at][:place] + chance.choice("[]{}\"'=.,#0x\0é") + lines[at][place + 1 :]
            )
        elif way == 3:
            lines[at] = re.sub(r"\b[a-z]\w* =", lambda m: m[0][1:], lines[at], count=1)
        else:
            values = list(re.finditer(r"(?<== )(\"[^\"]*\"|'[^']*'|[^\s,}\]]+)", lines[at]))
            if values:
                match = chance.choice(values)
                new = chance.choice(VALUES)
                lines[at] = lines[at][: match.start()] + new + lines[at][match.end() :]
    return "\n".join(lines) + "\n"


@settings(max_examples=150)
@given(st.sampled_from([SMALL, FULL]), st.integers(0, 2**32))
def test_mistakes_never_end_in_anything_but_a_message(
    tmp_path_factory: pytest.TempPathFactory, text: str, seed: int
) -> None:
    folder = tmp_path_factory.getbasetemp()
    said = ""
    try:
        simulation = Simulation(Rig("one", [load(folder, mutate(text, seed))]))
    except ConfigError as error:
        said = str(error)
    else:
        simulation.step()
        simulation.close()
    assert re.fullmatch(rf"({re.escape(str(folder))}/device\.toml(:\d+)?: .+)?", said)


def test_idns_are_those_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "device.toml"
    row = '[[idn]]\nidn = "S-0-0001"\nname = "Cycle time"\nattribute = 0x110000\nvalue = "d0 07"\n'
    file.write_text(f"vendor = 0xFFFF\nproduct = 1\n{row}unit = 'us'\nmaximum = 8000\n")
    (drive,) = any_device.load(file).idns
    assert (drive[1].name, drive[1].value, drive[1].maximum) == ("Cycle time", b"\xd0\x07", 8000)
    for wrong, word in ((f"{row}{row}", "twice"), (row.replace("S-0", "X-0"), "'X-0-0001'")):
        file.write_text(f"vendor = 0xFFFF\nproduct = 1\n{wrong}")
        with pytest.raises(ConfigError, match=word):
            any_device.load(file)
