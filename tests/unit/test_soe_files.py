"""Drives with SoE in ESI files, ENI files, EEPROMs and the configuration."""

import re
from pathlib import Path

import pytest
from soe_samples import NETWORK, SHAPES

from conftest import names, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.config import Config, IdnConfig, SlaveConfig, load_config
from ecatd.config.resolve.believed import remaining
from ecatd.config.resolve.slaves import check_slaves
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave
from ecatd.description.witnesses import contradictions_text
from ecatd.etg.idns import Attribute
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii_check import check_sii
from ecatd.vendor.eni import convert, read_network
from ecatd.vendor.esi import list_devices, read_device
from ecatd.vendor.esi.check import described_pdos
from ecatd.vendor.esi.configure import add_esi
from ecatd.vendor.esi.findings import Findings
from ecatsim.files.esi import device_from_esi, image_from_esi

pytestmark = pytest.mark.unprivileged

LIST, WORD = Attribute(0x00550000), Attribute(0x00110000)


def read(path: Path, text: str) -> Config:
    path.write_text(text)
    return load_config(path)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_file_of_each_shape_is_used_whole(shape: str, tmp_path: Path) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(SHAPES[shape])
    device = read_device(path, list_devices(path)[0])
    told: list[str] = []
    sii = check_sii(image_from_esi(device, told.append))
    assert [*sii.problems, *told, *device.findings.texts] == []
    for read_pdos, first in ((sii.outputs, 0x0018), (sii.inputs, 0x0010)):
        assert [pdo.index for pdo in read_pdos] == [first, first + 0x1000]
    whole = [(e.index, e.bit_length) for pdo in sii.outputs for e in pdo.entries]
    words = [] if "without" in shape else [(134, 16)]
    assert whole == 2 * [*words, (36, 32)]
    made = device_from_esi(path)
    lists = {24: [36], 16: [51]} if words else {}
    found = made.idns[1] if made.idns else {}
    assert {n: [*memoryview(found[n].value).cast("H")] for n in (24, 16) if n in found} == lists


@pytest.mark.parametrize(("shape", "drive"), [("InitCmd in SoE", 0), ("InitCmd in InitCmds", 1)])
def test_commands_of_esi_files_become_idns(shape: str, drive: int, tmp_path: Path) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(SHAPES[shape])
    device = read_device(path, list_devices(path)[0])
    bus = Bus("b", 1000, [Slave(0, "Servo2", 0xFFFF, 0x5001, 1, soe=True)])
    config = Config(bus="b")
    notes = add_esi(config, bus, {0: device})
    (slave,) = config.slave
    assert slave.idn == [
        IdnConfig("S-0-0016", "S-0-0051", drive=drive, comment="AT list"),
        IdnConfig("P-0-0009", hex="07 00"),
    ]
    text = write_config(config, bus, "1.0", notes)
    assert read(tmp_path / "c.toml", text).slave[0].idn == slave.idn


def test_commands_of_eni_files_become_idns(tmp_path: Path) -> None:
    path = tmp_path / "line.xml"
    path.write_text(NETWORK)
    found = convert(read_network(path), "b")
    brake = IdnConfig("P-0-0060", hex="11 00", drive=1, comment="brake")
    assert found.config.slave[0].idn == [
        IdnConfig("S-0-0016", "S-0-0051, S-0-0040", comment="AT list"),
        brake,
        IdnConfig("P-0-0060", hex="11 00", drive=1, comment="brake", transition="SO"),
    ]
    assert found.bus.slaves[0].soe
    (left,) = found.report.unsupported
    assert "S-0-0017 of drive 0 writes no value" in left.text
    text = write_config(found.config, found.bus, "1.0", found.notes)
    assert read(tmp_path / "c.toml", text).slave[0].idn == found.config.slave[0].idn


def test_values_are_those_of_the_kind_that_the_drive_says() -> None:
    assert IdnConfig("S-0-0016", "S-0-0051, s-0-40").data(LIST) == b"\x33\0\x28\0"
    assert IdnConfig("S-0-0016", hex="04 00 04 00 33 00 28 00").data(LIST) == b"\x33\0\x28\0"
    assert IdnConfig("S-0-0001", "300").data(WORD) == b"\x2c\x01"
    for wrong in (IdnConfig("S-0-0001", "70000"), IdnConfig("S-0-0001", "much")):
        with pytest.raises(UsageError):
            wrong.data(WORD)
    with pytest.raises(UsageError, match="begins with its lengths"):
        IdnConfig("S-0-0016", hex="33 00 28 00").data(LIST)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("value = 1", ["idn", "is missing"]),
        ('idn = "X-0-0001"\nvalue = 1', ["idn", "is not an IDN"]),
        ('idn = "S-0-0001"', ["value", "is missing", "hex"]),
        ('idn = "S-0-0001"\nvalue = 1\nhex = "00"', ["hex", "in place of value"]),
        ('idn = "S-0-0001"\nvalue = true', ["value", "a number"]),
        ('idn = "S-0-0001"\nvalue = nan', ["value", "finite"]),
        ('idn = "S-0-0001"\nhex = "0"', ["hex", "hexadecimal bytes"]),
        ('idn = "S-0-0001"\nhex = ""', ["hex", "1 to"]),
        ('idn = "S-0-0001"\nvalue = 1\ndrive = 8', ["drive", "from 0 to 7"]),
        ('idn = "S-0-0001"\nvalue = 1\ntransition = "XX"', ["transition", "PS"]),
    ],
)
def test_wrong_tables_are_refused_with_their_line(
    keys: str, words: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "c.toml"
    with pytest.raises(
        ConfigError, match=naming(f"slave[0].idn[0].{words[0]}", *words[1:])
    ) as caught:
        read(file, f"[[slave]]\nposition = 0\n[[slave.idn]]\n{keys}\n")
    assert re.match(rf"{re.escape(str(file))}:\d+: ", str(caught.value))


def test_what_a_slave_cannot_take_is_refused(tmp_path: Path) -> None:
    text = '[[slave]]\nposition = 0\n[[slave.idn]]\nidn = "S-0-0001"\nvalue = 1\n'
    with pytest.raises(ConfigError, match=naming("slave 0 (EL1018)", "no SoE", "[[slave.idn]]")):
        check_slaves(read(tmp_path / "c.toml", text), Bus("b", 1, [Slave(0, "EL1018", 2, 3, 4)]))
    text = '[[slave]]\nposition = 0\npdos = ["0x1600"]\n'
    drive = Bus("b", 1, [Slave(0, "Servo", 2, 3, 4, soe=True)])
    with pytest.raises(ConfigError, match=naming("telegrams", "S-0-0016")):
        check_slaves(read(tmp_path / "c.toml", text), drive)


WRONG = "<InitCmd><Transition>PS</Transition><IDN>S-0-16</IDN><Data>0700</Data></InitCmd>"


def test_malformed_commands_are_named_and_left_out(tmp_path: Path) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(SHAPES["InitCmd in SoE"].replace("<SoE>", f"<SoE>{WRONG}", 1))
    device = read_device(path, list_devices(path)[0])
    assert [command.idn for command in device.idns] == [16, 32777]
    (finding,) = device.findings.texts
    names(finding, "<IDN>", "S-0-16", "left out")
    with pytest.raises(ConfigError, match=naming("<IDN>", "S-0-16")):
        read_device(path, list_devices(path)[0], Findings(strict=True))
    path.write_text(NETWORK.replace("<SoE><InitCmds>", f"<SoE><InitCmds>{WRONG}", 1))
    network = read_network(path)
    assert [command.idn for command in network.slaves[0].idns] == [16, 32828, 17]
    names(network.findings.texts, "<IDN>", "S-0-16", "left out", "Servo 1 (Servo2)")


@pytest.mark.parametrize(
    ("listed", "settings", "text"),
    [
        ([(135, 16), (51, 32)], SlaveConfig(0), ""),
        ([(135, 16), (40, 32), (51, 32)], SlaveConfig(0), ""),  # somebody has listed them
        (
            [(135, 16), (51, 16)],
            SlaveConfig(0),
            "PDO 0x0010: SoE places 0x0033:00 in 16 bits at bit 16, the ESI file in 32 bits at "
            "bit 16",
        ),
        ([(135, 16), (51, 16)], SlaveConfig(0, idn=[IdnConfig("S-0-0016", "S-0-0051")]), ""),
    ],
)
def test_telegrams_are_compared_with_esi_files(
    listed: list[tuple[int, int]], settings: SlaveConfig, text: str, tmp_path: Path
) -> None:
    path = tmp_path / "servo.xml"
    path.write_text(SHAPES["indices are IDNs"])
    device = read_device(path, list_devices(path)[0])
    at = Pdo(0x0010, "AT 1", 3, [Entry(number, 0, "", 0, bits) for number, bits in listed])
    slave = Slave(0, "Servo2", 0xFFFF, 0x5001, 1, soe=True, inputs=[at])
    found = remaining(slave, settings, described_pdos(device, slave))
    assert contradictions_text(found) == text
