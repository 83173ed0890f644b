"""ESI files as vendors ship them are used as far as they can be understood."""

from pathlib import Path

import pytest
from vendor_shapes import ENCODINGS, SHAPES, entry, esi, pdo

from conftest import names, naming
from ecatd.base.errors import ConfigError
from ecatd.etg.datatypes import DataType
from ecatd.etg.sii_check import check_sii
from ecatd.vendor.esi import EsiDevice, Findings, choose, list_devices, read_device
from ecatsim.esc import Segment
from ecatsim.files.esi import device_from_esi
from ecatsim.rigs import library as rigs
from ecatsim.slave.sync_managers import default_size


def written(folder: Path, data: str | bytes) -> Path:
    path = folder / "x.xml"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def read(path: Path) -> EsiDevice:
    findings = Findings()
    return read_device(path, choose(list_devices(path, findings), path), findings)


@pytest.mark.parametrize("name", SHAPES)
def test_r33_vendors_files_are_used_and_what_is_left_out_is_named(
    tmp_path: Path, name: str
) -> None:
    shape = SHAPES[name]
    path = written(tmp_path, shape.text)
    read(path)
    if shape.refused:
        with pytest.raises(ConfigError, match=naming(path, *shape.said.split(" | "))):
            device_from_esi(path)
        return
    device = device_from_esi(path)
    assert bool(device.remarks) == bool(shape.said), device.remarks
    if shape.said:
        assert any(
            all(token in text for token in shape.said.split(" | ")) for text in device.remarks
        ), device.remarks
        with pytest.raises(ConfigError):
            device_from_esi(path, strict=True)
    sizes = default_size(device.rx_pdos), default_size(device.tx_pdos)
    assert sizes == (shape.outputs, shape.inputs)
    segment = Segment()
    try:
        device.attach(segment, 0, 0)
    finally:
        segment.close()


@pytest.mark.parametrize("name", ["ProductCode", "RevisionNo"])
def test_a_file_whose_devices_are_all_left_out_says_why(tmp_path: Path, name: str) -> None:
    text = esi().replace('ProductCode="#x1" RevisionNo="1"', f'{name}="2.147"')
    with pytest.raises(ConfigError, match=naming(name, "2.147", "x.xml:3")):
        device_from_esi(written(tmp_path, text))
    with pytest.raises(ConfigError, match=naming("<device>", "<Device>", "left out")):
        device_from_esi(
            written(tmp_path, esi().replace("Device ", "device ").replace("/Device>", "/device>"))
        )


def test_entries_with_the_index_of_a_pdo_have_values_and_the_mapping_stays(tmp_path: Path) -> None:
    path = written(tmp_path, SHAPES["Synapticon: entries with the index of a PDO"].text)
    device = device_from_esi(path)
    device.receive(b"\x34\x12")
    device[0x1A00, 1] = -2
    assert (device[0x1600, 1], device.give()) == (0x1234, b"\xfe\xff")
    assert device.dictionary[0x1600, 1].value == 0x16000110, "what a master reads is the mapping"
    assert device.dictionary[0x1A00, 1].value == 0x1A000110
    device.reset()
    assert device[0x1600, 1] == 0


def test_a_signed_number_stays_signed_in_a_longer_entry(tmp_path: Path) -> None:
    path = written(tmp_path, SHAPES["a data type that is shorter than its entry"].text)
    device = device_from_esi(path)
    assert device.tx_pdos[0].entries[0].data_type == DataType.INTEGER32
    device[0x6000, 1] = -2
    assert device.give() == b"\xfe\xff\xff\xff"


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_names_in_any_encoding_reach_the_eeprom(tmp_path: Path, encoding: str) -> None:
    name = ENCODINGS[encoding]
    text = esi(encoding=encoding, name=name)
    codec = {"Shift_JIS": "cp932"}.get(encoding, encoding)
    path = written(tmp_path, text.encode(codec))
    device = device_from_esi(path)
    assert (device.name, device.remarks) == (name, [])
    assert check_sii(device.sii_image()).name == name


def test_names_of_entries_reach_the_object_dictionary(tmp_path: Path) -> None:
    out = pdo("RxPdo", 2, 0x1600, entry(0x7000, 1, name="目标位置"), name="输出")
    text = esi().replace(pdo("RxPdo", 2, 0x1600, entry(0x7000, 1)), out)
    device = device_from_esi(written(tmp_path, text.replace("UTF-8", "GBK").encode("gbk")))
    assert device.dictionary[0x7000, 1].name == "目标位置"
    assert device.dictionary.object(0x1600).name == "输出"


@pytest.mark.parametrize(
    ("declared", "codec", "name", "said"),
    [
        ("utf-8", "cp1252", "Größe", "not utf-8 | Windows-1252 | names may be wrong"),
        ("utf-16", "utf-8", "Größe", "'utf-16' | UTF-8"),
        ("rot13", "utf-8", "Größe", "'rot13' | unknown | UTF-8"),
        ("x-sjis", "cp932", "サーボ", ""),
        ("utf-8", "utf-8-sig", "伺服", ""),
        ("gb2312", "utf-8", "伺服驱动器。", "not gb2312 | UTF-8"),
    ],
)
def test_a_wrong_declaration_is_told(
    tmp_path: Path, declared: str, codec: str, name: str, said: str
) -> None:
    path = written(tmp_path, esi(encoding=declared, name=name).encode(codec))
    device = read(path)
    assert device.name == name
    assert bool(device.findings) == bool(said)
    for text in device.findings.texts:
        assert text.startswith(f"{path}:")
        assert all(token in text for token in said.split(" | "))


def test_a_rig_refuses_only_where_somebody_wants_it(tmp_path: Path) -> None:
    written(tmp_path, SHAPES["Elmo Gold: category 30 a second time"].text)
    rig = tmp_path / "rig.toml"
    rig.write_text('[[slave]]\nesi = "x.xml"\n')
    (text,) = rigs.make(str(rig)).remarks
    names(text, "slave 0 (Shape)", "category 30")
    rig.write_text('[[slave]]\nesi = "x.xml"\nstrict = true\n')
    with pytest.raises(ConfigError, match="category 30"):
        rigs.make(str(rig))
