"""The library of devices: names, parameters, what `ecatsim devices` prints."""

import json
import math

import pytest

from conftest import naming
from ecatd.base.errors import SdoAbortError, UsageError
from ecatd.description.witnesses import clash
from ecatd.etg import sii_reader
from ecatd.etg.al import AlState
from ecatd.etg.pdo import Entry, Pdo
from ecatsim.cli.main import main
from ecatsim.devices.library import library, make
from ecatsim.devices.parameters import Parameter
from ecatsim.plants.point import Point
from ecatsim.rig import Rig

# Vendor and product as the devices themselves have them; 0xFFFF is nobody's vendor ID.
OTHERS = {
    "SoeDrive": (0xFFFF, 0x5000),
    "EL6751CAN": (2, 0x1A5F3052),
    "C2922": (0x17, 0x2922),
    "KendrionCAN": (0x48554B, 0x694411),
    "CiA402": (0xFFFF, 0x402),
    "ElmoGold": (0x9A, 0x30924),
    "EPOS4": (0xFB, 0x61500000),
    "AKD": (0x6A, 0x414B44),
    "Circulo": (0x22D2, 0x301),
    "DigitalIO": (0xFFFF, 0xD10),
    "AnalogIO": (0xFFFF, 0xA10),
    "Encoder": (0xFFFF, 0x406),
    "ModularIO": (0xFFFF, 0xE10),
    "Loopback32": (0xFFFF, 0x3232),
}
BECKHOFF, FAMILIES = 2, {"EK": 0x2C52, "EL": 0x3052}


@pytest.mark.parametrize("item", library(), ids=lambda item: item.name)
def test_every_device_can_be_made_by_its_name(item):
    """Beckhoff makes a product code of the number in the name and the family."""
    if item.name in OTHERS:
        vendor, product = OTHERS[item.name]
    else:
        vendor, product = BECKHOFF, int(item.name[2:]) << 16 | FAMILIES[item.name[:2]]
    for name in (item.name, item.name.lower()):
        device = make(name)
        assert (device.vendor, device.product) == (vendor, product)
    assert (item.vendor, item.product) == (vendor, product)
    assert item.summary
    assert not item.summary.endswith(".")


def test_the_library_has_what_its_page_says():
    assert {"EK1100", "EL1018", "EL2008", "EL3008", "EL6751"} <= {item.name for item in library()}
    assert OTHERS.keys() <= {item.name for item in library()}


def test_unknown_devices_and_parameters_are_said():
    with pytest.raises(UsageError, match=naming("device", "'EL2009'", "EL2008")):
        make("EL2009")
    with pytest.raises(UsageError, match=naming("ecatsim", "devices")):
        make("")
    with pytest.raises(UsageError, match=naming("EK1100", "parameter", "'colour'")):
        make("ek1100", colour=1)


@pytest.mark.parametrize(
    ("parameter", "wrong", "message"),
    [
        (Parameter("n", "", 8, 0, 256), -1, "X | n | whole number | 0 | 256 | -1"),
        (Parameter("n", "", 8, 0, 256), 257, "n | 0 | 256 | 257"),
        (Parameter("n", "", 8, 0, 256), 1.5, "n | whole number | 1.5"),
        (Parameter("n", "", 8, 0), -1, "n | 0 | -1"),
        (Parameter("n", "", 8), True, "n | whole number | True"),
        (Parameter("n", "", 1.0, 0), float("nan"), "n | number | 0 | nan"),
        (Parameter("n", "", 1.0, 0, 2), float("nan"), "n | number | 0 | 2 | nan"),
        (Parameter("n", "", True), 1, "n | true | false"),
        (Parameter("n", "", "V"), 1, "n | text"),
        (Parameter("n", "", 16, choices=(16, 32)), 24, "n | 16 | 32 | 24"),
    ],
)
def test_values_of_parameters_are_checked(parameter, wrong, message):
    with pytest.raises(UsageError, match=naming(*message.split(" | "))):
        parameter.check("X", wrong)
    parameter.check("X", parameter.default)


def test_a_whole_number_is_a_number():
    Parameter("n", "", 1.5).check("X", 2)


def test_the_revision_of_an_island_follows_its_slots_and_not_its_modules():
    """SOEM takes slaves of one identity for the same, and reads the EEPROM of the first only."""
    kinds = ("DI8", "DO8", "AO2, AO2, AI2", "DI8, DO8")
    islands = [make("ModularIO", modules=modules) for modules in kinds]
    islands.append(islands[0].with_module(1, "AI2"))
    for island in islands:
        assert island.revision == 1
        assert [sm.start for sm in island.sync_managers] == [
            sm.start for sm in islands[0].sync_managers
        ]
    assert make("ModularIO", slots=9).revision != make("ModularIO", slots=10).revision != 1


def test_devices_of_one_identity_have_the_same_eeprom():
    """Of each device with a parameter: the EEPROM with another value of it."""
    numbers = [
        (item.name, parameter.name, parameter.default)
        for item in library()
        for parameter in item.parameters
        if type(parameter.default) is int and not parameter.choices
    ]
    assert ("SoeDrive", "axes", 1) in numbers
    for device, parameter, default in numbers:
        usual, other = make(device), make(device, **{parameter: default + 1})
        same = usual.sii_image() == other.sii_image()
        assert same or usual.revision != other.revision, (device, parameter)


def test_the_command_lists_all_devices(capsys):
    assert main(["devices"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for item in library():
        (line,) = (line for line in lines if line.startswith(item.name + " "))
        assert item.summary in line
        assert f"{item.vendor:08x}:{item.product:08x}:{item.revision:08x}" in line
    assert main(["devices", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["devices"]
    assert [row["name"] for row in rows] == [item.name for item in library()]
    (drive,) = (row for row in rows if row["name"] == "ElmoGold")
    assert (drive["output_size"], drive["input_size"]) == (16, 16)


# --- what the SII of real devices says -------------------------------------------------------


def test_the_sii_of_an_el2004_is_that_of_the_real_one():
    image = make("EL2004").sii_image()
    assert image[:2] == bytes.fromhex("0401"), "digital I/O"
    assert image[16:28] == bytes.fromhex("020000005230d40700001000")
    for text in (b"EL2004", b"DigOut", b"EL2004 4K. Dig. Ausgang 24V, 0.5A", b"Channel 4"):
        assert bytes([len(text)]) + text in image
    assert bytes.fromhex("2800010001ff") in image, "one FMMU, for outputs"
    assert bytes.fromhex("29000400000f000044000903") in image, "SM0 at 0x0F00, control 0x44"
    device = make("EL2004")
    assert [pdo.index for pdo in device.rx_pdos] == [0x1600, 0x1601, 0x1602, 0x1603]
    assert [pdo.entries[0].index for pdo in device.rx_pdos] == [0x7000, 0x7010, 0x7020, 0x7030]
    assert device.ebus_current == 100


def test_the_sii_of_an_ek1100_is_that_of_the_real_one():
    image = make("EK1100").sii_image()
    assert image[:2] == bytes.fromhex("000d")
    assert image[16:28] == bytes.fromhex("02000000522c4c0400001200")
    for text in (b"SystemBk", b"System Koppler", b"EK1100 EtherCAT-Koppler (2A E-Bus)"):
        assert bytes([len(text)]) + text in image
    assert make("EK1100").physical_ports == 0x0131
    assert make("EK1100").ebus_current == -2000


def test_ports_of_the_junction():
    """E-bus at ports 0 and 2, sockets at 1 and 3 (KYKY), in SII and register 0x0007."""
    junction = make("EK1122")
    assert junction.physical_ports == 0x1313
    assert [junction.chip.ports >> 2 * port & 3 for port in range(4)] == [2, 3, 2, 3]


@pytest.mark.parametrize("item", library(), ids=lambda item: item.name)
def test_the_sii_tells_a_master_the_process_data(item):
    """Masters of devices without mailbox have nothing else to go by."""
    device = make(item.name)
    image = device.sii_image()
    found = sii_reader.read_sii(lambda word, count: image[2 * word : 2 * (word + count)])
    assert (found.vendor, found.product, found.order) == (item.vendor, item.product, device.order)
    if not device.pdos_in_sii:  # it has a mailbox, so masters ask it
        assert device.mailbox
        assert not [*found.inputs, *found.outputs]
        return
    for pdos, of_device in ((found.inputs, device.tx_pdos), (found.outputs, device.rx_pdos)):
        assert [(pdo.index, pdo.sync_manager, pdo.bit_length) for pdo in pdos] == [
            (pdo.index, pdo.sync_manager, pdo.bit_length) for pdo in of_device
        ]
        assert all(entry.name for pdo in pdos for entry in pdo.entries if not entry.is_gap)


@pytest.mark.parametrize("item", library(), ids=lambda item: item.name)
def test_its_dictionary_and_its_sii_do_not_contradict_each_other(item):
    device = make(item.name)
    image = device.sii_image()
    found = sii_reader.read_sii(lambda word, count: image[2 * word : 2 * (word + count)])
    for pdo in (*found.outputs, *found.inputs):
        if not device.mailbox:
            continue
        entries = device.dictionary.object(pdo.index).entries
        values = [entries[n].value for n in range(1, entries[0].value + 1)]
        told = [Entry(value >> 16, value >> 8 & 0xFF, "", 0, value & 0xFF) for value in values]
        assert clash(Pdo(pdo.index, "", pdo.sync_manager, told), pdo) is None


# --- terminals -------------------------------------------------------------------------------


def test_status_word_of_an_el3102():
    """Bits 0, 1: range, 2-3 and 4-5: limits, 6: error, 13: sync error, 14: state, 15: toggle."""
    device = make("EL3102")
    device[0x8000, 0x07] = device[0x8000, 0x08] = 1
    device[0x8000, 0x13], device[0x8000, 0x14] = 1000, -1000
    measured = device.connection(0x6000, 0x11)
    words = []
    for value in (1000, 999, -1000, -1001, 40000, -40000):
        measured.value = float(value)
        device.step(0.0)
        words.append(int.from_bytes(device.give()[:2], "little") & 0x7FFF)
    low1, high1, same1, low2, high2, same2 = (0x04, 0x08, 0x0C, 0x10, 0x20, 0x30)
    assert words == [
        same1 | high2,
        low1 | high2,
        low1 | same2,
        low1 | low2,
        high1 | high2 | 0x42,
        low1 | low2 | 0x41,
    ]


def test_the_toggle_bit_changes_with_each_conversion():
    device = make("EL3102")
    toggles = []
    for _ in range(4):
        device.step(0.0)
        toggles.append(device.give()[1] >> 7)
    assert toggles == [1, 0, 1, 0]


def test_user_scale_of_an_analog_input():
    device = make("EL3102")
    device.connection(0x6010, 0x11).value = 1000.0
    device[0x8010, 0x01], device[0x8010, 0x11], device[0x8010, 0x12] = 1, -7, 2 << 16
    device.step(0.0)
    device.step(0.001)
    assert device[0x6010, 0x11] == 1993


def running(device):
    device.machine.state = AlState.OP
    return device


def test_analog_outputs_give_volts():
    device = running(make("EL4004"))
    device[0x7000, 1], device[0x7010, 1], device[0x7020, 1] = 32767, 16384, -100
    device.step(0.0)
    assert [device.voltage(i) for i in range(4)] == pytest.approx([10, 5, 0, 0], abs=1e-3)


def test_user_scale_of_an_analog_output():
    device = running(make("EL4008"))
    device[0x7070, 1] = 1000
    device[0x8070, 0x01], device[0x8070, 0x11], device[0x8070, 0x12] = 1, 50, 3 << 15
    device.step(0.0)
    assert device.connection(0x7070, 1).value == 1550


@pytest.mark.parametrize(
    ("mode", "after"), [(0, [3000, 3000]), (1, [19000, 18000]), (2, [20000, 20000])]
)
def test_what_an_analog_output_does_outside_of_op(mode, after):
    """0x80n0:05 Watchdog: 0 default output, 1 along the ramp (digits per ms), 2 hold."""
    device = running(make("EL4004"))
    device[0x8000, 0x05], device[0x8000, 0x13], device[0x8000, 0x14] = mode, 3000, 1000
    device[0x7000, 1] = 20000
    device.step(0.0)
    device.machine.state = AlState.SAFEOP
    device[0x7000, 1] = 0
    values = []
    for _ in after:
        device.step(0.0)
        values.append(device.connection(0x7000, 1).value)
    assert values == after


# --- generic devices -------------------------------------------------------------------------


def test_generic_digital_io_has_as_many_bits_as_asked_for():
    device = make("DigitalIO", inputs=11, outputs=3)
    device[0x6000, 11] = 1
    assert device.give() == bytes([0, 4])
    device.receive(bytes([5]))
    assert [device[0x7000, i] for i in (1, 2, 3)] == [1, 0, 1]
    assert make("DigitalIO", inputs=0, outputs=0).give() == b""


@pytest.mark.parametrize("bits", [16, 32])
def test_generic_analog_io_has_range_and_unit(bits):
    device = make("AnalogIO", inputs=3, outputs=2, bits=bits, range=250.0, unit="bar")
    entry = device.tx_pdos[0].entries[2]
    assert entry.unit == "bar"
    assert entry.scale * ((1 << bits - 1) - 1) == pytest.approx(250.0)
    assert len(device.give()) == 3 * bits // 8
    device.receive((-1 % (1 << bits)).to_bytes(bits // 8, "little") * 2)
    assert device[0x7000, 2] == -1
    with pytest.raises(UsageError, match=naming("AnalogIO", "bits", 16, 32, 24)):
        make("AnalogIO", bits=24)


def test_an_encoder_tells_where_its_shaft_is():
    encoder = make("Encoder", resolution=1000, turns=4)
    rig = Rig("shaft", [encoder])
    angle = Point((encoder, 0x6004, 0))
    rig.drive((encoder, 0x6004, 0), lambda now: 2 * math.pi * 10 * now)  # ten revolutions a second

    def position_at(now):
        rig.plants[0](now)
        encoder.step(now)
        return encoder[0x6004, 0]

    assert [position_at(now) for now in (0.00005, 0.02005, 0.39995, 0.40005)] == [0, 200, 3999, 0]
    assert encoder[0x6030, 1] == 600
    assert position_at(0.40005) == 0
    assert encoder[0x6030, 1] == 0
    angle.set(-0.001)
    encoder.step(1.0)
    assert encoder[0x6004, 0] == 3999
    objects = encoder.dictionary
    objects[0x6003, 0].write((1500).to_bytes(4, "little"))
    encoder.step(2.0)
    assert encoder[0x6004, 0] == 1500
    with pytest.raises(SdoAbortError):
        objects[0x6003, 0].write((4000).to_bytes(4, "little"))
    objects[0x6000, 0].write(b"\5\0")  # counter-clockwise, and scaled
    objects[0x6001, 0].write((100).to_bytes(4, "little"))
    objects[0x6002, 0].write((150).to_bytes(4, "little"))
    objects[0x6003, 0].write((7).to_bytes(4, "little"))
    angle.set(2 * math.pi - 0.001)
    encoder.step(3.0)
    assert encoder[0x6004, 0] == (7 - 100) % 150


def test_other_parameters_are_another_revision():
    """SOEM reads the EEPROM of the first slave of an identity, and takes it for all of them."""
    made = [
        make(name, **parameters)
        for name, parameters in (
            ("DigitalIO", {}),
            ("DigitalIO", {"inputs": 3, "outputs": 0}),
            ("DigitalIO", {"inputs": 0, "outputs": 5}),
            ("AnalogIO", {}),
            ("AnalogIO", {"inputs": 1}),
            ("AnalogIO", {"range": 20}),
        )
    ]
    identities = {(device.vendor, device.product, device.revision) for device in made}
    assert len(identities) == len(made)
    assert [device.revision for device in made if device is made[0] or device is made[3]] == [1, 1]
    assert make("AnalogIO", range=10).revision == 1
    assert make("DigitalIO", inputs=3, outputs=0).revision == made[1].revision
