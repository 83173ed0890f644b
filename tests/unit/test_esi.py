"""The ESI reader: what it finds in a file, and what it says about wrong ones."""

from pathlib import Path

import pytest
from esi_sample import SAMPLE

from conftest import names, naming
from ecatd.base.errors import ConfigError
from ecatd.etg.datatypes import DataType
from ecatd.etg.dictionary import ObjectCode
from ecatd.vendor.esi import EsiDevice, EsiEntry, Findings, choose, list_devices, read_device

R, W, W_UP_TO_SAFEOP = 0x07, 0x38, 0x18


def file(folder: Path, text: str | bytes) -> Path:
    path = folder / "x.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def axis(folder: Path, text: str = SAMPLE) -> EsiDevice:
    path = file(folder, text)
    return read_device(path, choose(list_devices(path), path, type="AX2", revision=0x00020001))


def test_devices_of_a_file(tmp_path: Path) -> None:
    choices = list_devices(file(tmp_path, SAMPLE))
    assert [str(item) for item in choices] == [
        "AX2 (product 0x00001234, revision 0x00020001)",
        "AX2 (product 0x00001234, revision 0x00010000)",
        "DI4 (product 0x00005678, revision 0x00000001)",
    ]
    assert choices[0].name == "Axis µ", "the English name"


@pytest.mark.parametrize(
    ("wanted", "number"),
    [
        ({"type": "DI4"}, 2),
        ({"product": 0x5678}, 2),
        ({"revision": 0x00010000}, 1),
        ({"type": "AX2", "revision": 0x00020001}, 0),
        ({"type": "AX2", "product": 0x1234, "revision": 0x00020001}, 0),
    ],
)
def test_choice(tmp_path: Path, wanted: dict[str, int], number: int) -> None:
    path = file(tmp_path, SAMPLE)
    assert choose(list_devices(path), path, **wanted).number == number  # type: ignore[arg-type]


def test_ambiguous_and_unknown_choices_list_what_there_is(tmp_path: Path) -> None:
    path = file(tmp_path, SAMPLE)
    choices = list_devices(path)
    with pytest.raises(ConfigError) as error:
        choose(choices, path, type="AX2")
    names(error.value, f"{path}: ", "2 devices", "type", "product", "revision")
    names(error.value, "AX2 (product 0x00001234, revision 0x00020001)")
    names(error.value, "AX2 (product 0x00001234, revision 0x00010000)")
    assert "DI4" not in str(error.value)
    with pytest.raises(ConfigError) as error:
        choose(choices[2:], path, type="DI5", product=1, revision=2)
    names(error.value, f"{path}: ", "no device", "'DI5'", "0x00000001", "0x00000002")
    names(error.value, "DI4 (product 0x00005678, revision 0x00000001)")
    assert "AX2" not in str(error.value)
    with pytest.raises(ConfigError, match=naming(f"{path}: ", "no devices")):
        choose([], path)
    with pytest.raises(ConfigError, match=naming("20 devices", "8 more")):
        choose(choices[:1] * 20, path)


def test_identity_and_hardware(tmp_path: Path) -> None:
    device = axis(tmp_path)
    assert (device.vendor, device.vendor_name) == (0xFFFF, "Example")
    assert (device.type, device.name) == ("AX2", "Axis µ")
    assert (device.product, device.revision) == (0x1234, 0x00020001)
    assert (device.group, device.group_name) == ("Drives", "All drives")
    assert (device.physics, device.ebus_current) == ("YKY", -150)
    assert device.fmmus == [1, 2, 3]
    assert [(s.usage, s.start, s.size, s.control, s.enable) for s in device.sync_managers] == [
        (1, 0x1000, 128, 0x26, 1),
        (2, 0x1080, 128, 0x22, 1),
        (3, 0x1100, 6, 0x64, 1),
        (4, 0x1180, 4, 0x20, 1),
    ]
    assert (device.protocols, device.coe_details) == (0x0C, 0x0F)
    assert device.eeprom_size == 1024
    assert device.config_data == bytes.fromhex("080C00000A000000")
    assert device.bootstrap == bytes.fromhex("0010000100120001")
    assert device.categories == [(0x0801, b"\1\2\3\4\5")]


def test_virtual_sync_managers_and_those_that_are_enabled_in_op(tmp_path: Path) -> None:
    text = SAMPLE
    for old, new in (
        ('"#x1180" ControlByte="#x20" Enable="1"', '"#x0998" ControlByte="#x00" Virtual="true"'),
        ('ControlByte="#x64" Enable="1"', 'ControlByte="#x64" Enable="1" OpOnly="1"'),
    ):
        assert old in text
        text = text.replace(old, new)
    assert [item.enable for item in axis(tmp_path, text).sync_managers] == [1, 1, 9, 4]


def test_clock_modes(tmp_path: Path) -> None:
    free, dc = axis(tmp_path).dc
    assert (free.name, free.description, free.assign_activate) == ("Synchron", "SM", 0)
    assert (dc.name, dc.assign_activate) == ("DC", 0x0700)
    assert (dc.cycle_time0, dc.cycle_factor0, dc.shift_time0) == (0, 1, -125000)
    assert (dc.cycle_time1, dc.cycle_factor1, dc.shift_time1) == (0, -2, 500)


def test_pdos(tmp_path: Path) -> None:
    device = axis(tmp_path)
    assert [
        (p.index, p.name, p.sync_manager, p.fixed, p.mandatory, p.excludes) for p in device.outputs
    ] == [
        (0x1600, "Control", 2, True, True, [0x1602]),
        (0x1601, "Target", 2, False, False, []),
        (0x1602, "Other control", 0xFF, False, False, [0x1600]),
    ]
    assert [(e.address, e.name, e.data_type, e.bit_length) for e in device.inputs[0].entries] == [
        ("0x6041:00", "Statusword", DataType.UNSIGNED16, 16),
        ("0x0000:00", "", DataType.PADDING, 5),
        ("0x2100:01", "Bits", DataType.BIT3, 3),
        ("0x2100:02", "More", DataType.INTEGER8, 8),
    ]


def test_objects(tmp_path: Path) -> None:
    objects = {item.index: item for item in axis(tmp_path).objects}
    assert list(objects) == [
        *(0x1000, 0x1008, 0x1009, 0x2000, 0x2001, 0x2002, 0x2003),
        *(0x6040, 0x6041),
    ]
    assert [(o.code, len(o.entries)) for o in objects.values()] == [
        (ObjectCode.VAR, 1),
        (ObjectCode.VAR, 1),
        (ObjectCode.VAR, 1),
        (ObjectCode.RECORD, 4),
        (ObjectCode.ARRAY, 4),
        (ObjectCode.VAR, 1),
        (ObjectCode.RECORD, 2),
        (ObjectCode.VAR, 1),
        (ObjectCode.VAR, 1),
    ]
    (name,) = objects[0x1008].entries
    assert (name.data_type, name.bits, name.default) == (DataType.VISIBLE_STRING, 48, b"Axis 2")
    (version,) = objects[0x1009].entries
    assert (version.bits, version.default) == (24, b"1.0"), "STRING(0) is as long as its default"
    buffer = objects[0x2003].entries[1]
    assert (buffer.data_type, buffer.bits) == (DataType.OCTET_STRING, 4096), "one entry"
    (key,) = objects[0x2002].entries
    assert (key.data_type, key.bits, key.default) == (DataType.OCTET_STRING, 32, b"\1\2\3\4")
    assert objects[0x6040].entries[0].access == R | W | 0x40
    assert objects[0x6041].entries[0].access == R | 0x80


def test_record(tmp_path: Path) -> None:
    record = next(item for item in axis(tmp_path).objects if item.index == 0x2000)
    assert record.name == "Settings"
    assert record.entries == [
        EsiEntry(0, "SubIndex 000", DataType.UNSIGNED8, 8, R, b"\4", line=record.entries[0].line),
        EsiEntry(
            1,
            "Mode",
            DataType.UNSIGNED8,
            8,
            R | W_UP_TO_SAFEOP | 0x300,
            values={0: "off"},
            line=record.entries[1].line,
        ),
        EsiEntry(
            3,
            "Limit",
            DataType.INTEGER16,
            16,
            R | W,
            default=b"\xfe\xff",
            minimum=b"\xf6\xff",
            maximum=b"\x64\x00",
            unit=0xFD440000,
            line=record.entries[2].line,
        ),
        EsiEntry(
            4, "Gain", DataType.REAL32, 32, W, b"\x00\x00\xc0\x3f", line=record.entries[3].line
        ),
    ]


def test_array(tmp_path: Path) -> None:
    array = next(item for item in axis(tmp_path).objects if item.index == 0x2001)
    assert [(e.subindex, e.name, e.data_type, e.bits, e.default) for e in array.entries] == [
        (0, "SubIndex 000", DataType.UNSIGNED8, 8, b"\3"),
        (1, "SubIndex 001", DataType.UNSIGNED16, 16, b"\1\0"),
        (2, "SubIndex 002", DataType.UNSIGNED16, 16, None),
        (3, "SubIndex 003", DataType.UNSIGNED16, 16, b"\0\3"),
    ]


def test_defaults_without_matching_names_go_by_their_order(tmp_path: Path) -> None:
    text = SAMPLE.replace("<SubItem><Name>Limit</Name>", "<SubItem><Name>Grenze</Name>")
    record = next(item for item in axis(tmp_path, text).objects if item.index == 0x2000)
    assert record.entries[1].default == b"\xfe", "the second one"


def test_a_text_is_no_default_of_a_number(tmp_path: Path) -> None:
    text = SAMPLE.replace(
        "<Type>STRING(0)</Type>\n                <BitSize>0<",
        "<Type>UDINT</Type>\n                <BitSize>32<",
    )
    objects = axis(tmp_path, text).objects
    (hardware,) = next(item for item in objects if item.index == 0x1009).entries
    assert (hardware.data_type, hardware.default) == (DataType.UNSIGNED32, None)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1", "windows-1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    data = SAMPLE.replace('encoding="utf-8"', f'encoding="{encoding}"').encode(encoding)
    assert list_devices(file(tmp_path, data))[0].name == "Axis µ"


def test_slots_and_dictionaries_elsewhere_are_told(tmp_path: Path) -> None:
    text = SAMPLE.replace("<Fmmu>Outputs</Fmmu>", "<Slots><Slot/><Slot/></Slots>")
    assert len(axis(tmp_path, text).slots) == 2
    start, end = text.index("<Dictionary>"), text.index("</Dictionary>")
    text = text[:start] + "<DictionaryFile>od.xml</DictionaryFile>" + text[end + 13 :]
    device = axis(tmp_path, text)
    assert (device.dictionary_file, device.objects) == ("od.xml", [])


WRONG = [
    ("<Id>#x0000FFFF</Id>", "<Id>0xGG</Id>", "<Id> is '0xGG': a number such as 10 or #x0A"),
    ("<Id>#x0000FFFF</Id>", "<Id>#x100000000</Id>", "<Id> | #x100000000 | 0 | 4294967295"),
    ("<Id>#x0000FFFF</Id>", "", "<Vendor> | <Id>"),
    ('ProductCode="#x00001234" RevisionNo="#x00020001"', 'ProductCode="a"',
     "ProductCode | <Type> | 'a'"),
    ("<Index>#x1600</Index>", "<Index>#x16000</Index>", "<Index> | #x16000 | 0 | 65535"),
    ("<Index>#x1601</Index>", "<Index>#x1600</Index>", "<RxPdo> | 0x1600 | second"),
    ('<RxPdo Sm="2">', '<RxPdo Sm="4">', "Sm | <RxPdo> | 4 sync managers"),
    ('Mandatory="true"', 'Mandatory="maybe"', "Mandatory | <RxPdo> | 'maybe'"),
    ("<BitLen>32</BitLen>", "<BitLen>0</BitLen>", "<BitLen> | 0"),
    ("<BitLen>32</BitLen>", "<BitLen>256</BitLen>", "<BitLen> | 256 | 255"),
    ("<BitLen>32</BitLen>", "<BitLen>x</BitLen>", "<BitLen> | 'x'"),
    ("<DataType>DINT<", "<DataType>DT6<", "<DataType> | 'DT6' | unknown"),
    (">MBoxState<", ">State<", "<Fmmu> | 'State' | unknown"),
    (">MBoxIn<", ">Mail<", "<Sm> | 'Mail' | unknown"),
    ("<CatNo>#x0801<", "<CatNo>30<", "category 30 | itself"),
    ("<AssignActivate>#x0700<", "<AssignActivate>#x70000<", "<AssignActivate> | #x70000"),
    ("<BitLen>32</BitLen>", "", "<Entry> | <BitLen>"),
    ("<Index>#x1601</Index>", "", "<RxPdo> | <Index>"),
    ("080C0000", "080C000", "<ConfigData> | '080C0000A000000'"),
    ("0010000100120001", "00" * 11, "<BootStrap> | 11 bytes"),
    ("0102030405", "x", "<Data> | 'x' | hexadecimal"),
    ("<Access>wo</Access>", "<Access>w</Access>", "<Access> | 'w' | ro | rw | wo"),
    ("PreOP_SafeOP", "Boot", "WriteRestrictions | 'Boot' | PreOP | SafeOP"),
    (">R</PdoMapping>", ">X</PdoMapping>", "<PdoMapping> | 'X' | R | T | RT"),
    ("<Index>#x2001</Index>", "<Index>#x2000</Index>", "object | 0x2000 | second"),
    ("<SubIdx>4</SubIdx>", "<SubIdx>3</SubIdx>", "subindex 3 | second"),
    ("<DefaultData>0600</DefaultData>", "<DefaultData>060001</DefaultData>", "3 bytes"),
    ("<DefaultValue>-2<", "<DefaultValue>-99999<", "<DefaultValue> | -99999 | -32768 | 65535"),
    ("<DefaultValue>1.5<", "<DefaultValue>a<", "<DefaultValue> | 'a' | number"),
    ("<LBound>1</LBound><Elements>3<", "<LBound>9</LBound><Elements>255<", "255"),
    ("<Type>UINT</Type>\n                <BitSize>16</BitSize><Info>", "<Type>DT9</Type><Info>",
     "data type | 'DT9' | <BitSize>"),
    ("Axis, first", "A & B", "'&' in place of '&amp;'"),
    ("Axis, first", "A &foo; B", "nothing defines '&foo;'"),
    ('"utf-8"', '"utf-99"', "encoding | 'utf-99' | unknown"),
]  # fmt: skip
NO_XML = [
    ("<EtherCATInfo ", "<EtherCATInfo><EtherCATInfo ", "XML | no element found"),
    ("</Descriptions>", "</Description>", "XML | mismatched tag"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG)
def test_r33_what_is_wrong_is_named_with_its_line_and_left_out(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in SAMPLE
    text = SAMPLE.replace(old, new, 1)
    path = file(tmp_path, text)
    findings = Findings()
    for choice in list_devices(path, findings):
        read_device(path, choice, findings)
    where, line, said = findings.texts[0].split(":", 2)
    assert where == str(tmp_path / "x.xml")
    names(said, *message.split(" | "))
    assert ";" in said, "the effect is told"
    assert 1 <= int(line) <= text.count("\n") + 1
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        for choice in list_devices(path, Findings(strict=True)):
            read_device(path, choice, Findings(strict=True))


@pytest.mark.parametrize(("old", "new", "message"), NO_XML)
def test_files_that_are_no_xml_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in SAMPLE
    with pytest.raises(ConfigError) as error:
        axis(tmp_path, SAMPLE.replace(old, new, 1))
    names(error.value, f"{tmp_path / 'x.xml'}:", *message.split(" | "))


def test_the_line_is_that_of_the_element(tmp_path: Path) -> None:
    text = SAMPLE.replace("<BitLen>32</BitLen>", "<BitLen>\n-1\n</BitLen>")
    line = 1 + text[: text.index("<BitLen>\n")].count("\n")
    (said,) = axis(tmp_path, text).findings.texts
    names(said, f"x.xml:{line}: ", "<BitLen>", -1, "PDO", "left out")


LAUGHS = (
    '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>'
    "<EtherCATInfo><Vendor><Name>&b;</Name></Vendor></EtherCATInfo>"
)
OUTSIDE = '<!DOCTYPE x [<!ENTITY f SYSTEM "/etc/passwd">]><EtherCATInfo>&f;</EtherCATInfo>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAUGHS, "x.xml:1: | <!DOCTYPE>"),
        ("<a>" * 100, "x.xml:1: | 64"),
        ("<EtherCATInfo>&f;</EtherCATInfo>", "x.xml: | no devices"),
        ("<a>" + "&" * 1_000_001, "x.xml:1: | 1000000 | '&'"),
        ("<Other/>", "x.xml:1: | <Other> | <EtherCATInfo>"),
        ("", "x.xml:1: | XML | no element found"),
        (b"\x7fELF\0\0", "x.xml:1: | XML | not well-formed"),
    ],
)
def test_files_that_are_none(tmp_path: Path, text: str | bytes, message: str) -> None:
    path = file(tmp_path, text)
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        choose(list_devices(path), path)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming(tmp_path / "no.xml", "No such file")):
        list_devices(tmp_path / "no.xml")


def test_r33_a_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    with path.open("wb") as hole:
        hole.truncate((128 << 20) + 1)
    with pytest.raises(ConfigError, match=naming(path, "128 MiB")):
        list_devices(path)


@pytest.mark.parametrize(
    ("written", "unit"),
    [("#x00B44700", 0x00B44700), ("00b44700", 0x00B44700), ("FD260000", 0xFD260000), ("257", 257)],
)
def test_unit_codes_are_written_in_several_ways(tmp_path: Path, written: str, unit: int) -> None:
    found = axis(tmp_path, SAMPLE.replace("#xFD440000", written))
    record = next(item for item in found.objects if item.index == 0x2000)
    assert record.entries[2].unit == unit
