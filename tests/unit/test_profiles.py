"""Device profiles: which entries they are about, what they mean, and what a wrong file is told."""

import re
from pathlib import Path
from typing import Any

import pytest

from conftest import names_at, naming
from ecatd.base.errors import ConfigError
from ecatd.config import Config, SignalConfig, load_config
from ecatd.config.flight_recorder import FlightRecorderConfig
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import Profiles, load_profiles
from ecatd.config.profiles.file import DEVICE, ENTRY
from ecatd.config.resolve import missing_folders
from ecatd.description.bus import Bus, ProfileName, Slave
from ecatd.description.units import is_unit, modelica_unit
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatgen.build import build_library
from ecatgen.ir import Connector

DOCUMENT = Path(__file__).parents[2] / "docs" / "device-profiles.md"
HEADER = """[[device]]
description = "A"
vendor = 1
product = [2]
"""


def slave(*entries: Entry, product: int = 2, outputs: bool = False) -> Slave:
    pdo = [Pdo(0x1600 if outputs else 0x1A00, "P", 2 if outputs else 3, list(entries))]
    return Slave(
        0, "A", 1, product, 3, outputs=pdo if outputs else [], inputs=[] if outputs else pdo
    )


def entry(index: int = 0x6000, subindex: int = 1, **more: object) -> Entry:
    return Entry(index, subindex, "x", DataType.INTEGER16, 16, **more)  # type: ignore[arg-type]


def of(tmp_path: Path, text: str) -> Profiles:
    (tmp_path / "a.toml").write_text(text)
    return load_profiles(Config(profiles=[str(tmp_path)]))


def connector(profiles: Profiles, made: Slave) -> Connector:
    (block,) = build_library(give_meanings(Bus("b", 1000, [made]), profiles), "P").blocks
    return (block.reads + block.writes)[0]


def test_two_points_make_a_scale(tmp_path: Path) -> None:
    profiles = of(
        tmp_path,
        HEADER
        + """[[device.entry]]
index = 0x6000
subindex = 1
unit = "A"
raw = [0, 1000]
physical = [0.004, 0.020]
""",
    )
    made = connector(profiles, slave(entry()))
    assert (made.kind, made.unit) == ("Real", "A")
    assert made.scale == pytest.approx(16e-6)
    assert made.offset == pytest.approx(0.004)
    assert 'quantity = "ElectricCurrent"' in made.modifiers
    assert made.scaling == f", {made.scale!r}, {made.offset!r}"
    assert connector(profiles, slave(entry(subindex=2))).kind == "Integer"
    assert connector(profiles, slave(entry(), product=4)).kind == "Integer"


def test_entries_repeat_for_each_channel(tmp_path: Path) -> None:
    profiles = of(
        tmp_path,
        HEADER + "[[device.entry]]\nindex = 0x6000\nsubindex = [1, 3]\nstep = 0x10\ncount = 2\n"
        'unit = "V"\nscale = 0.5\n',
    )
    addresses = [(0x6000, 1), (0x6010, 3), (0x6020, 1), (0x6008, 1), (0x6010, 2), (0x5FF0, 1)]
    kinds = [connector(profiles, slave(entry(*address))).kind for address in addresses]
    assert kinds == ["Real", "Real", "Integer", "Integer", "Integer", "Integer"]


@pytest.mark.parametrize(
    ("vendor", "message"),
    [
        ("9" * 5000, "a.toml:4: | digits"),
        ("0x" + "F" * 5000, "a.toml:4: | device[0].vendor: | 20000 bits"),
        ("[" * 5000, "a.toml: | nested"),
    ],
)
def test_values_beyond_all_measure_are_refused(tmp_path: Path, vendor: str, message: str) -> None:
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        of(tmp_path, f'[[device]]\ndescription = "x"\nproduct = [1]\nvendor = {vendor}\n')


def test_a_profile_of_the_user_wins(tmp_path: Path) -> None:
    text = """[[device]]
description = "EL3008 set to 0.001 V a digit"
vendor = 2
product = [0x0BC03052]
[[device.entry]]
index = 0x6000
subindex = 0x11
unit = "mV"
"""
    el3008 = Slave(
        0, "EL3008", 2, 0x0BC03052, 1, inputs=[Pdo(0x1A00, "", 3, [entry(0x6000, 0x11)])]
    )
    assert connector(load_profiles(), el3008).unit == "V"
    assert connector(of(tmp_path, text), el3008).unit == "mV"


def test_the_configuration_of_the_daemon_wins_over_profiles(tmp_path: Path) -> None:
    profiles = of(
        tmp_path,
        HEADER + '[[device.entry]]\nindex = 0x6000\nsubindex = 1\nunit = "V"\nscale = 2\n'
        'note = "kept"\n',
    )
    rule = SignalConfig(0, "0x6000:01", unit="bar", scale=0.25, offset=1.0)
    bus = give_meanings(Bus("b", 1000, [slave(entry())]), profiles, [rule])
    ((_, known, _),) = bus.slaves[0].entries(outputs=False)
    assert (known.unit, known.scale, known.offset) == ("bar", 0.25, 1.0)
    assert (known.note, known.quantity) == ("kept", "")


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ({}, ("level", "V", 2.0, 3.0, -8.0, 8.0, ["two"])),
        ({"name": "mine"}, ("mine", "V", 2.0, 3.0, -8.0, 8.0, ["two"])),
        ({"minimum": -1.0}, ("level", "V", 2.0, 3.0, -1.0, 8.0, ["two"])),
        # Unit, scale and offset go together, and the limits of the profile are in its unit.
        ({"unit": "bar"}, ("level", "bar", 1.0, 0.0, None, None, ["two"])),
        ({"scale": 1.0}, ("level", "", 1.0, 0.0, None, None, ["two"])),
        ({"offset": 4.0, "maximum": 5.0}, ("level", "", 1.0, 4.0, None, 5.0, ["two"])),
        ({"values": {"3": "three"}}, ("level", "V", 2.0, 3.0, -8.0, 8.0, ["three"])),
    ],
)
def test_the_configuration_counts_key_by_key(
    tmp_path: Path, rule: dict[str, Any], expected: tuple[object, ...]
) -> None:
    profiles = of(
        tmp_path,
        HEADER + '[[device.entry]]\nindex = 0x6000\nsubindex = 1\nname = "level"\nunit = "V"\n'
        "scale = 2\noffset = 3\nminimum = -8\nmaximum = 8\nvalues = { 2 = 'two' }\n",
    )
    rules = [SignalConfig(0, "0x6000:01", **rule)]
    bus = give_meanings(Bus("b", 1000, [slave(entry(), outputs=True)]), profiles, rules)
    ((_, known, _),) = bus.slaves[0].entries(outputs=True)
    found = (known.name, known.unit, known.scale, known.offset, known.minimum, known.maximum)
    assert (*found, [value.name for value in known.values]) == expected
    assert bus.slaves[0].profiles == [ProfileName("A")]


def test_limits_are_for_outputs(tmp_path: Path) -> None:
    profiles = of(
        tmp_path, HEADER + "[[device.entry]]\nindex = 0x6000\nsubindex = 1\nmaximum = 8\n"
    )
    bus = give_meanings(Bus("b", 1000, [slave(entry())]), profiles)
    ((_, known, _),) = bus.slaves[0].entries(outputs=False)
    assert known.maximum is None


@pytest.mark.parametrize(
    ("profile", "rule", "message"),
    [
        ("minimum = 40000\n", None, "a.toml: | 0x6000:01 | slave 0 (A)"),
        ("maximum = 8\n", {"minimum": 9.0}, "minimum 9 | maximum | 8"),
    ],
)
def test_limits_that_leave_no_value(
    tmp_path: Path, profile: str, rule: dict[str, Any] | None, message: str
) -> None:
    profiles = of(tmp_path, HEADER + f"[[device.entry]]\nindex = 0x6000\nsubindex = 1\n{profile}")
    rules = [] if rule is None else [SignalConfig(0, "0x6000:01", **rule)]
    with pytest.raises(ConfigError, match=naming(*message.split(" | "))):
        give_meanings(Bus("b", 1000, [slave(entry(), outputs=True)]), profiles, rules)


def test_numbers_may_stand_for_something(tmp_path: Path) -> None:
    profiles = of(
        tmp_path,
        HEADER + "[[device.entry]]\nindex = 0x6000\nsubindex = 1\n"
        '[device.entry.values]\n2 = "two"\n-1 = "less"\n0x10 = "more"\n',
    )
    made = connector(profiles, slave(entry()))
    assert made.kind == "Integer"
    assert [(v.number, v.name) for v in made.values] == [(-1, "less"), (2, "two"), (16, "more")]


def test_an_entry_may_be_a_variable_only(tmp_path: Path) -> None:
    profiles = of(
        tmp_path,
        HEADER + "[[device.entry]]\nindex = 0x6000\nsubindex = 1\nconnector = false\n",
    )
    (block,) = build_library(give_meanings(Bus("b", 1000, [slave(entry())]), profiles), "P").blocks
    assert (len(block.reads), block.right) == (1, ())
    assert block.reads[0].class_name == "output Integer"
    # What the model writes cannot be left to nobody.
    (block,) = build_library(
        give_meanings(Bus("b", 1000, [slave(entry(), outputs=True)]), profiles), "P"
    ).blocks
    assert len(block.left) == 1


def test_a_drive_is_known_by_its_entries() -> None:
    status, mode = entry(0x6041, 0), entry(0x6061, 0)
    drive = slave(mode, status)
    assert not connector(load_profiles(), drive).values  # no control word: no drive
    drive.outputs = [Pdo(0x1600, "", 2, [entry(0x6040, 0)])]
    (block,) = build_library(give_meanings(Bus("b", 1000, [drive]), load_profiles()), "P").blocks
    modes = next(c for c in block.reads if c.index == 0x6061)
    assert {v.number: v.name for v in modes.values}[8] == "cyclic synchronous position"
    drive.inputs[0].entries.append(entry(0x6861, 0))  # the second axis
    (block,) = build_library(give_meanings(Bus("b", 1000, [drive]), load_profiles()), "P").blocks
    assert block.reads[-1].values == modes.values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[device]\n", "1: TOML"),
        ("[[devices]]\n", "1: devices: not a key | 'device'"),
        ("[device]\n", "1: device: [[device]]"),
        ("[[device]]\nvendor = 1\n", "1: device[0].description: missing"),
        ('[[device]]\ndescription = "A"\n', "1: device[0].product: no device"),
        (
            '[[device]]\ndescription = "A"\nhas = ["6041"]\n',
            "3: device[0].has[0]: address | '6041'",
        ),
        (HEADER + "[[device.entry]]\nsubindex = 1\n", "5: device[0].entry[0].index: missing"),
        (
            HEADER + "[[device.entry]]\nindex = 1\nsubindex = 256\n",
            "7: device[0].entry[0].subindex: 256",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nscale = nan\n",
            "7: device[0].entry[0].scale: finite | nan",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nraw = [0, 1]\n",
            "5: device[0].entry[0].physical: missing",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nraw = [1, 1]\nphysical = [0, 1]\n",
            "7: device[0].entry[0].raw: differ",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nraw = [0, 1]\nphysical = [-1e308, 1e308]\n",
            "7: device[0].entry[0].raw: scale | inf",
        ),
        (
            HEADER + f"[[device.entry]]\nindex = 1\nraw = [0, {10**400}]\nphysical = [0, 1]\n",
            "7: device[0].entry[0].raw[1]: 1329 bits",
        ),
        (
            HEADER + f"[[device.entry]]\nindex = 1\nscale = {10**400}\n",
            "7: device[0].entry[0].scale: 1329 bits",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nraw = [0, 1]\nphysical = [0, 1]\nscale = 2\n",
            "9: device[0].entry[0].scale: twice",
        ),
        (
            HEADER + '[[device.entry]]\nindex = 1\nunit = "Volt"\n',
            "7: device[0].entry[0].unit: 'Volt'",
        ),
        (
            HEADER + f'[[device.entry]]\nindex = 1\nunit = "{"m." * 8}m"\n',
            "7: device[0].entry[0].unit: 'm.m.m.m.m.m.m.m.m' | 15",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nminimum = 2\nmaximum = 1\n",
            "7: device[0].entry[0].minimum: 2 | maximum | 1",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\nvalues = { 1 = 'a', 0x1 = 'b' }\n",
            "7: device[0].entry[0].values.0x1: twice",
        ),
        (
            HEADER + '[[device.entry]]\nindex = 1\n[device.entry.values]\na = "b"\n',
            "8: device[0].entry[0].values.a: whole number",
        ),
        (
            HEADER + "[[device.entry]]\nindex = 1\n" + HEADER + "[[device.entry]]\nindex = 0\n",
            "12: device[1].entry[0].index: 0",
        ),
        (
            HEADER + "entry = [\n{ index = 1 },\n{ index = 2, scale = 0 } ]\n",
            "7: device[0].entry[1].scale: 0",
        ),
    ],
)
def test_a_wrong_file_is_told_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as told:
        of(tmp_path, text)
    names_at(str(told.value).replace(f"{tmp_path}/", ""), f"a.toml:{message}")


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    file = tmp_path / "ecat0.toml"
    (tmp_path / "ours").mkdir()
    file.write_text('bus = "b"\nprofiles = [\n  "ours",\n  "nowhere",\n]\n')
    with pytest.raises(ConfigError) as told:
        load_profiles(load_config(file))
    names_at(str(told.value), f"{file}:4: profiles[1]: {tmp_path / 'nowhere'} | folder")
    assert load_profiles(None, [tmp_path / "nowhere"]) == load_profiles()


def test_a_folder_that_cannot_be_looked_at(tmp_path: Path) -> None:
    """Such as one in the home directory of another user; too long a name is one for root, too."""
    folder = tmp_path / ("x" * 300)
    with pytest.raises(ConfigError, match=naming(folder, "File name too long", "HOME")):
        load_profiles(None, [folder])
    with pytest.raises(ConfigError, match=naming(folder, "profiles[0]")):
        load_profiles(Config(profiles=[str(folder)]))
    assert missing_folders(Config(flight_recorder=FlightRecorderConfig(folder=str(folder))))


def test_our_own_profiles_are_about_every_device_once() -> None:
    devices = load_profiles().devices
    products = [(d.vendor, product) for d in devices for product in d.products]
    assert len(products) == len(set(products)) > 50


@pytest.mark.parametrize(
    "unit", ["1", "V", "mV", "rad/s", "N.m", "m/s2", "W/(m2.K)", "1/s", "degC"]
)
def test_units_of_modelica(unit: str) -> None:
    assert is_unit(unit)
    assert modelica_unit(unit) == unit


@pytest.mark.parametrize(
    ("unit", "spelled"),
    [("°C", "degC"), ("Nm", "N.m"), ("µm", "um"), ("%", ""), ("increments", ""), ("a b", "")],
)
def test_other_spellings_of_units(unit: str, spelled: str) -> None:
    assert modelica_unit(unit) == spelled


def test_the_documentation_has_every_key() -> None:
    text = DOCUMENT.read_text()
    for rules in (DEVICE, ENTRY):
        assert [key for key in rules if key != "entry" and f"`{key}`" not in text] == []


def test_the_profile_of_the_documentation(tmp_path: Path) -> None:
    (example,) = re.findall(r"^```toml\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    entries = [entry(index, subindex) for index in (0x6000, 0x6010) for subindex in (1, 2, 3, 4)]
    sensor = slave(*entries, product=0x13)
    sensor.vendor = 0xF00D
    (block,) = build_library(
        give_meanings(Bus("b", 1000, [sensor]), of(tmp_path, example)), "P"
    ).blocks
    assert [(c.kind, c.unit) for c in block.right] == [("Real", "m"), ("Integer", "")] * 2
    assert [value.name for value in block.right[3].values] == ["no echo", "good", "weak"]
    assert len(block.variables) == 4
    assert block.profiles == ("Level sensor LS-2: LS-2 manual, revision C, section 4.3",)


def test_the_documentation_names_every_file_of_ours() -> None:
    folder = Path(__file__).parents[2] / "daemon" / "ecatd" / "config" / "profiles"
    names = {file.name for file in folder.glob("*.toml")}
    assert names == set(re.findall(r"`(\w+\.toml)`", DOCUMENT.read_text()))
