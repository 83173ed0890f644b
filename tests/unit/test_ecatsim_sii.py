import struct

import pytest

from conftest import names, naming
from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii_check import check_sii
from ecatsim.rigs import library as rigs
from ecatsim.slave import sii
from ecatsim.slave.device import Device
from ecatsim.slave.sii import Description, FmmuType, Mailbox, SmType, SyncManager, checksum


def parse(image):
    """An SII parser that shares nothing with the builder but the standard."""

    def word(at):
        return image[2 * at] | image[2 * at + 1] << 8

    result = {
        "vendor": word(8) | word(9) << 16,
        "product": word(10) | word(11) << 16,
        "revision": word(12) | word(13) << 16,
        "serial": word(14) | word(15) << 16,
        "alias": word(4),
        "mailbox": [word(0x18 + i) for i in range(5)],
        "bytes": (word(0x3E) + 1) * 128,
        "categories": [],
        "strings": [""],
    }
    at = 0x40
    while word(at) != 0xFFFF:
        kind, words = word(at), word(at + 1)
        body = image[2 * at + 4 : 2 * at + 4 + 2 * words]
        result["categories"].append(kind)
        if kind == 10:
            rest = body[1:]
            for _ in range(body[0]):
                result["strings"].append(rest[1 : 1 + rest[0]].decode("latin-1"))
                rest = rest[1 + rest[0] :]
        elif kind == 30:
            result["general"] = body
        elif kind == 40:
            result["fmmus"] = list(body)
        elif kind == 41:
            result["sms"] = [struct.unpack_from("<HHBBBB", body, i) for i in range(0, len(body), 8)]
        elif kind in (50, 51):
            pdos = []
            while len(body) >= 8:
                index, count, manager, _, name, _ = struct.unpack_from("<HBBBBH", body)
                entries = [struct.unpack_from("<HBBBBH", body, 8 + 8 * i)[:5] for i in range(count)]
                pdos.append((index, manager, result["strings"][name], entries))
                body = body[8 + 8 * count :]
            result[kind] = pdos
        at += 2 + words
    return result


def test_checksum_of_a_real_coupler():
    # First words of the EEPROM of an EK1100 (PDI control 0x0D00), whose checksum is 0x46.
    assert checksum(bytes([0x00, 0x0D]) + bytes(12)) == 0x46
    # An EL2004: PDI control 0x0104, PDI configuration 2 0x000F.
    assert checksum(bytes([0x04, 0x01, 0, 0, 0, 0, 0x0F]) + bytes(7)) == 0xD8


def test_image_says_everything_that_the_description_says():
    value = Entry(0x6000, 1, "Value", DataType.INTEGER16, 16)
    image = sii.build(
        Description(
            vendor=0x12345678,
            product=0x9ABCDEF0,
            revision=3,
            serial=4,
            alias=0x55AA,
            order="AB12",
            name="A thing",
            group="Things",
            group_name="Many things",
            mailbox=Mailbox(0x1000, 100, 0x1080, 90, protocols=0x0C, coe_details=0x2F),
            sync_managers=[SyncManager(SmType.MAILBOX_OUT, 0x1000, 100, 0x26)],
            fmmus=[FmmuType.OUTPUTS, FmmuType.INPUTS, FmmuType.MAILBOX_STATE],
            tx_pdos=[Pdo(0x1A00, "In", 3, [value, Entry(0, 0, "", 0, 8)])],
            rx_pdos=[Pdo(0x1600, "Out", 0xFF, [])],
            ebus_current=-2000,
            physical_ports=0x0131,
            no_lrw=True,
        )
    )
    found = parse(image)
    assert (found["vendor"], found["product"]) == (0x12345678, 0x9ABCDEF0)
    assert (found["revision"], found["serial"], found["alias"]) == (3, 4, 0x55AA)
    assert found["mailbox"] == [0x1000, 100, 0x1080, 90, 0x0C]
    assert image[14] == checksum(image[:14])
    assert found["bytes"] == len(image) == 2048
    assert found["categories"] == [10, 30, 40, 41, 50, 51]
    strings, general = found["strings"], found["general"]
    assert strings[1] == "AB12", "SOEM takes the first string as the name"
    assert [strings[general[i]] for i in (0, 2, 3)] == ["Things", "AB12", "A thing"]
    assert general[5] == 0x2F
    assert general[11] == 2
    assert struct.unpack_from("<h", general, 12) == (-2000,)
    assert struct.unpack_from("<H", general, 16) == (0x0131,)
    assert found["fmmus"] == [1, 2, 3, 0xFF]
    assert found["sms"] == [(0x1000, 100, 0x26, 0, 1, 1)]
    text = strings.index("Value")
    entries = [(0x6000, 1, text, 3, 16), (0, 0, 0, 0, 8)]
    assert found[50] == [(0x1A00, 3, "In", entries)]
    assert found[51] == [(0x1600, 0xFF, "Out", [])]


def test_dc_modes_are_category_60():
    """24 bytes a mode, in the order of the standard; texts are strings of the image."""
    modes = (
        sii.DcMode("Free run", 0x0000),
        sii.DcMode("DC", 0x0700, 250_000, 2, -1000, -4, 2000, "SYNC0 and SYNC1"),
    )
    image = sii.build(
        Description(1, 2, 3, order="D", pdi_config=0xEE03, sync_pulse=7, dc_modes=modes)
    )
    found = parse(image)
    assert found["categories"] == [10, 30, 60]
    assert struct.unpack_from("<HH", image, 2) == (0xEE03, 7)
    body = image[image.index(struct.pack("<HH", 60, 24)) + 4 :]
    name, description = found["strings"].index("DC"), found["strings"].index("SYNC0 and SYNC1")
    assert struct.unpack_from("<IiihHhBB4s", body, 24) == (
        *(250_000, -1000, 2000, -4, 0x0700, 2),
        *(name, description, bytes(4)),
    )
    first = struct.unpack_from("<IiihHhBB4s", body)
    assert first == (0, 0, 0, 0, 0, 1, found["strings"].index("Free run"), 0, bytes(4))


def test_a_dc_mode_that_does_not_fit_is_refused():
    mode = sii.DcMode("Slow", sync0_cycle_ns=1 << 32)
    with pytest.raises(UsageError, match=naming("DC mode 'Slow'", "category 60")):
        sii.build(Description(1, 2, 3, dc_modes=[mode]))


def test_long_image_grows_and_too_long_texts_are_cut():
    entries = [Entry(0x6000, i, f"{i:03}" * 99, DataType.UNSIGNED8, 8) for i in range(1, 40)]
    pdos = [Pdo(0x1A00, "", 3, entries)]
    image = sii.build(Description(1, 2, 3, order="x", tx_pdos=pdos))
    found = parse(image)
    assert len(image) == found["bytes"] == 16384
    assert all(len(text) <= 255 for text in found["strings"])
    assert len(found[50][0][3]) == 39


@pytest.mark.parametrize("name", ["", '"quoted"', "naïve", "Ω", "伺服驱动器", "Ã©", "end"])
def test_weird_names_are_kept(name):
    assert check_sii(sii.build(Description(1, 2, 3, order=name))).order == name


def test_names_without_room_are_told():
    told = []
    entries = [Entry(0x6000, i, f"{i}号", DataType.UNSIGNED8, 8) for i in range(1, 255)]
    more = [Entry(0x6001, i, f"{i}番", DataType.UNSIGNED8, 8) for i in range(1, 9)]
    pdos = [Pdo(0x1A00, "伺" * 100, 3, entries), Pdo(0x1A01, "", 3, more)]
    image = sii.build(Description(1, 2, 3, order="x", tx_pdos=pdos), told.append)
    names(told[0], "255 bytes", "left out")
    names(told[1], "names", 255, "left out")
    assert check_sii(image).inputs[0].name == "伺" * 85, "cut between two letters"


TROLL = [
    ("Gold EtherCAT GCON Drive", 0x9A, 0x00030924, 0x00010420),
    ("EK1100", 2, 0x044C2C52, 0x00120000),
    ("EL1018", 2, 0x03FA3052, 0x00110000),
    ("EL2008", 2, 0x07D83052, 0x00100000),
    ("EL3008", 2, 0x0BC03052, 0x00140000),
    ("EL3008", 2, 0x0BC03052, 0x00140000),
    ("EL6751", 2, 0x1A5F3052, 0x00140000),
    ("EL6751", 2, 0x1A5F3052, 0x00140000),
]


def test_troll_has_its_identities_in_order():
    found = [parse(device.sii_image()) for device in rigs.make("troll").devices]
    assert [(f["strings"][1], f["vendor"], f["product"], f["revision"]) for f in found] == TROLL


def test_pdos_of_the_terminals_are_those_of_the_real_ones():
    devices = rigs.make("troll").devices
    inputs, outputs, analog = (parse(devices[i].sii_image()) for i in (2, 3, 4))
    name = inputs["strings"].index("Input")
    assert inputs["sms"] == [(0x1000, 1, 0x00, 0, 1, 4)]
    assert inputs[50] == [
        (0x1A00 + i, 0, f"Channel {i + 1}", [(0x6000 + 16 * i, 1, name, 1, 1)]) for i in range(8)
    ]
    name = outputs["strings"].index("Output")
    assert outputs["sms"] == [(0x0F00, 1, 0x44, 0, 9, 3)]
    assert outputs[51] == [
        (0x1600 + i, 0, f"Channel {i + 1}", [(0x7000 + 16 * i, 1, name, 1, 1)]) for i in range(8)
    ]
    index, manager, text, entries = analog[50][2]
    assert (index, manager, text) == (0x1A02, 3, "AI Standard Channel 2")
    assert [(i, s, analog["strings"][n], t, b) for i, s, n, t, b in entries] == [
        (0x6010, 0x01, "Status__Underrange", 1, 1),
        (0x6010, 0x02, "Status__Overrange", 1, 1),
        (0x6010, 0x03, "Status__Limit 1", 0x31, 2),
        (0x6010, 0x05, "Status__Limit 2", 0x31, 2),
        (0x6010, 0x07, "Status__Error", 1, 1),
        (0x0000, 0x00, "Status__", 0, 1),
        (0x0000, 0x00, "Status__", 0, 6),
        (0x6010, 0x0F, "Status__TxPDO State", 1, 1),
        (0x6010, 0x10, "Status__TxPDO Toggle", 1, 1),
        (0x6010, 0x11, "Value", 3, 16),
    ]


def test_a_device_class_sets_the_length_of_its_pulses() -> None:
    class Pulsed(Device):
        vendor, product, order = 1, 2, "Pulsed"
        sync_pulse = 250

    assert struct.unpack_from("<H", Pulsed().sii_image(), 4) == (250,)
