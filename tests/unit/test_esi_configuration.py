"""What ESI files add to a configuration, and which PDOs they forbid."""

import re
import tomllib
from pathlib import Path

import pytest
from esi_sample import SAMPLE
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.config import Config, DcSlaveConfig, SignalConfig, read_config
from ecatd.config.pdos import PdoConfig, PdoEntryConfig
from ecatd.config.slave_settings import SlaveConfig
from ecatd.config.startup import StartupConfig
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.unit_codes import code, meaning
from ecatd.vendor.esi import EsiDevice, choose, list_devices, read_device
from ecatd.vendor.esi.check import pdo_problems
from ecatd.vendor.esi.configure import add_esi

COMMANDS = """<CoE SdoInfo="true"><InitCmds>
<InitCmd><Transition>IP</Transition><Transition>SO</Transition><Index>#x2000</Index>
  <SubIndex>3</SubIndex><Data>FEFF</Data><Comment>torque</Comment></InitCmd>
<InitCmd><Transition>PS</Transition><Index>#x2000</Index><SubIndex>1</SubIndex>
  <Data>01</Data></InitCmd>
<InitCmd CompleteAccess="1"><Transition>PS</Transition><Index>#x2001</Index><SubIndex>0</SubIndex>
  <Data>0300010002000300</Data></InitCmd>
<InitCmd><Transition>PS</Transition><Index>#x1C12</Index><SubIndex>0</SubIndex>
  <Data>00</Data></InitCmd>
<InitCmd><Transition>SI</Transition><Index>#x2002</Index><SubIndex>0</SubIndex>
  <Data>00</Data></InitCmd>
</InitCmds></CoE>"""
OBJECTS = """<Objects>
<Object><Index>#x2100</Index><Name>Setpoint</Name><Type>INT</Type><BitSize>16</BitSize><Info>
  <MinValue>-100</MinValue><MaxValue>100</MaxValue><Unit>#xFD260000</Unit></Info></Object>
<Object><Index>#x2101</Index><Name>Mode</Name><Type>DT0801EN8</Type><BitSize>8</BitSize></Object>
<Object><Index>#x2102</Index><Name>Odd</Name><Type>UINT</Type><BitSize>16</BitSize>
  <Info><MinValue>5</MinValue><MaxValue>9</MaxValue><Unit>#x00EE0000</Unit></Info></Object>
<Object><Index>#x2103</Index><Name>Whole</Name><Type>UINT</Type><BitSize>16</BitSize>
  <Info><MinValue>0</MinValue><MaxValue>65535</MaxValue></Info></Object>"""


def device(folder: Path, text: str = SAMPLE, kind: str = "AX2") -> EsiDevice:
    path = folder / "axis.xml"
    path.write_text(text)
    revision = 0x00020001 if kind == "AX2" else None
    return read_device(path, choose(list_devices(path), path, type=kind, revision=revision))


def entry(index: int, bits: int = 16, kind: DataType = DataType.INTEGER16, **more: str) -> Entry:
    return Entry(index, 0, more.pop("name", ""), kind, bits, **more)  # type: ignore[arg-type]


def bus(outputs: list[Entry], *, dc_bits: int = 64) -> Bus:
    slave = Slave(0, "", 0xFFFF, 0x1234, 0x00020002, coe=True, dc_bits=dc_bits)
    slave.outputs = [Pdo(0x1600, "", 2, outputs)]
    slave.inputs = [Pdo(0x1A00, "", 3, [entry(0x2100)])]
    return Bus("ecat0", 1000, [slave])


def added(found: EsiDevice, config: Config, on: Bus) -> tuple[Config, str]:
    """The configuration, as it is read again, and its text."""
    notes = add_esi(config, on, {0: found})
    text = write_config(config, on, "1.0", notes)
    return read_config(tomllib.loads(text)), text


@pytest.mark.parametrize("wrapped", [True, False])
def test_what_a_file_knows_is_taken_over(tmp_path: Path, *, wrapped: bool) -> None:
    commands = COMMANDS if wrapped else re.sub("</?InitCmds>", "", COMMANDS)  # as in ETG.2000
    text = SAMPLE.replace(
        '<CoE SdoInfo="true" PdoAssign="1" PdoConfig="1" CompleteAccess="0"/>', commands
    )
    found = device(tmp_path, text.replace("<Objects>", OBJECTS))
    outputs = [entry(0x2100), entry(0x2101, 8), entry(0x2102), entry(0x2103), entry(0x6040)]
    on = bus(outputs)
    on.slaves[0].inputs = []
    config, text = added(found, Config(), on)
    assert config.slave[0].type == "AX2"
    assert config.slave[0].startup == [
        StartupConfig("0x2000:03", "int16", "-2", transition="IP", comment="torque"),
        StartupConfig("0x2000:03", "int16", "-2", transition="SO", comment="torque"),
        StartupConfig("0x2000:01", "uint8", "1", comment="Settings, Mode"),
        StartupConfig("0x2001:00", hex="03 00 01 00 02 00 03 00", complete=True, comment="Table"),
    ]
    assert config.signal == [
        SignalConfig(0, "0x2100:00", unit="V", scale=0.001, minimum=-0.1, maximum=0.1),
        SignalConfig(0, "0x2101:00", values={"0": "off"}),
    ]
    names(text, "0x2100:00 Setpoint", "0x2103:00 Whole", "0x00020001", "0x00EE0000")
    names(text, "0x2102:00", 5, 9, "0x1C12:00", "0x2002:00", "SI", "not with 0x1602", "mandatory")


@pytest.mark.parametrize(
    ("info", "tokens"),
    [
        ("<IdentificationReg134>true</IdentificationReg134>", ["identification = N"]),
        ("<IdentificationAdo>#x0134</IdentificationAdo>", ["identification = N"]),
        (
            "<IdentificationAdo>#x1000</IdentificationAdo>",
            ["identification = N", "identification_register = 0x1000"],
        ),
        ("<IdentificationAdo>#x0012</IdentificationAdo>", ["alias = N"]),
    ],
)
def test_how_a_slave_tells_who_it_is(tmp_path: Path, info: str, tokens: list[str]) -> None:
    text = SAMPLE.replace("<Info><Electrical>", f"<Info>{info}<Electrical>", 1)
    assert info in text
    found = device(tmp_path, text)
    config, text = added(found, Config(), bus([]))
    comment = " ".join(line.strip("# ") for line in text.splitlines() if line.startswith("#"))
    names(comment, *tokens)
    wanted = Config(slave=[SlaveConfig(0, vendor=1, product=2, identification=7)])
    config, text = added(found, wanted, bus([]))
    assert "wherever it stands" not in text
    register = 0x1000 if "1000" in info else None
    assert (config.slave[0].identification, config.slave[0].identification_register) == (
        7,
        register,
    )
    assert "wherever it stands" not in added(device(tmp_path), Config(), bus([]))[1]


def test_a_type_that_the_slave_does_not_tell_is_that_of_the_file(tmp_path: Path) -> None:
    guessed = Entry(0x2100, 0, "", DataType.UNSIGNED16, 16)
    on = bus([guessed, Entry(0x2103, 0, "", DataType.INTEGER32, 32)])
    on.slaves[0].inputs = []
    found = device(tmp_path, SAMPLE.replace("<Objects>", OBJECTS))
    config, _ = added(found, Config(), on)
    types = {rule.entry: rule.type for rule in config.signal}
    assert types == {"0x2100:00": "int16"}


def test_what_is_configured_stays(tmp_path: Path) -> None:
    text = SAMPLE.replace(
        '<CoE SdoInfo="true" PdoAssign="1" PdoConfig="1" CompleteAccess="0"/>', COMMANDS
    )
    found = device(tmp_path, text.replace("<Objects>", OBJECTS))
    own = StartupConfig("0x2000:01", "uint8", "7")
    signal = SignalConfig(0, "0x2101:00", unit="rpm")
    config = Config(slave=[SlaveConfig(0, name="axis", startup=[own])], signal=[signal])
    on = bus([entry(0x2100, name="target", unit="A"), entry(0x2101, 8)])
    on.slaves[0].name = "X"
    config, text = added(found, config, on)
    assert config.signal == [signal, SignalConfig(0, "0x2100:00", minimum=-100.0, maximum=100.0)]
    assert [item for item in config.slave[0].startup if item.address == (0x2000, 1)] == [own]
    assert config.slave[0].type == "X"
    names(text, "0x2100:00 target in A")


@pytest.mark.parametrize(
    ("dc", "dc_bits", "expected", "words"),
    [
        ("#x0300|<CycleTimeSync0 Factor='1'>0</CycleTimeSync0>", 64, DcSlaveConfig(0), "defaults"),
        (
            "#x0300|<CycleTimeSync0 Factor='-4'>0</CycleTimeSync0>",
            64,
            DcSlaveConfig(0, 250.0),
            "250.0",
        ),
        ("#x0300|<CycleTimeSync0>125000</CycleTimeSync0>", 64, DcSlaveConfig(0, 125.0), "125.0"),
        (
            "#x0730|<CycleTimeSync1 Factor='2'>0</CycleTimeSync1>"
            "<ShiftTimeSync0>-5000</ShiftTimeSync0><ShiftTimeSync1>1000</ShiftTimeSync1>",
            64,
            DcSlaveConfig(0, 0.0, -5.0, 1001.0),
            "0x0730",
        ),
        ("#x0300|", 0, None, "no clock"),
        ("#x0300|<CycleTimeSync0>300000</CycleTimeSync0>", 64, None, "fit"),
        ("#x0000|", 64, None, "no [[dc.slave]]"),
    ],
)
def test_the_default_mode_of_the_clocks(
    tmp_path: Path, dc: str, dc_bits: int, expected: DcSlaveConfig | None, words: str
) -> None:
    activation, _, times = dc.partition("|")
    mode = (
        f"<OpMode><Name>First</Name><AssignActivate>{activation}</AssignActivate>{times}</OpMode>"
    )
    found = device(tmp_path, SAMPLE.replace("<Dc>", f"<Dc>{mode}"))
    config, text = added(found, Config(), bus([], dc_bits=dc_bits))
    assert config.dc.slave == ([expected] if expected else [])
    assert config.dc.enabled == bool(expected)
    assert text.index("- First") < text.index("- Synchron") < text.index("- DC (Sync0 and 1")
    names(text.partition("- Synchron")[0], *([words] if words else []))
    own = DcSlaveConfig(0, shift_us=77.0)
    config = Config()
    config.dc.slave.append(own)
    config.dc.enabled = True
    config, text = added(found, config, bus([], dc_bits=dc_bits))
    assert config.dc.slave == [own]
    assert "- First" in text


@pytest.mark.parametrize(
    ("pdos", "mapped", "problems"),
    [
        (None, {}, []),
        ([0x1600, 0x1601, 0x1A00], {}, []),
        ([0x1601, 0x1A00], {}, [("0x1600", "mandatory")]),
        ([0x1602, 0x1A00], {}, []),  # in place of the mandatory one
        ([0x1600, 0x1602, 0x1A00], {}, [("0x1600", "0x1602", "exclude")]),
        ([0x1600, 0x1701, 0x1A00], {}, [("0x1701", "0x1600", "0x1A00")]),
        ([0x1600, 0x1A00], {0x1600: ("0x6040:00", 16), 0x1A00: ("0x6041:00", 16)}, []),
        ([0x1600, 0x1A00], {0x1600: ("0x6060:00", 8)}, [("0x1600", "fixed")]),
        ([], {}, [("0x1600", "mandatory")]),
    ],
)
def test_pdos_that_the_file_forbids(
    tmp_path: Path,
    pdos: list[int] | None,
    mapped: dict[int, tuple[str, int]],
    problems: list[tuple[str, ...]],
) -> None:
    own = [PdoConfig(i, [PdoEntryConfig(bits, name)]) for i, (name, bits) in mapped.items()]
    found = list(pdo_problems(SlaveConfig(0, pdos=pdos, pdo=own), device(tmp_path)))
    assert len(found) == len(problems), found
    for text, words in zip(found, problems, strict=True):
        names(text, *words)


def test_modules_bring_pdos_of_their_own(tmp_path: Path) -> None:
    found = device(tmp_path, SAMPLE.replace("<Eeprom>", "<Slots><Slot/></Slots><Eeprom>", 1))
    assert not list(pdo_problems(SlaveConfig(0, pdos=[0x1600, 0x1701]), found))


@pytest.mark.parametrize("text", ["V", "m/s", "rpm", "°C", "counts", "%", "1/s"])
def test_units_and_their_codes(text: str) -> None:
    assert meaning(code(text)) == (text, 1.0)
    assert meaning(code(text) | 0x7F) is None


@given(st.integers(0, 0xFFFFFFFF))
def test_any_unit_code_has_a_meaning_or_none(number: int) -> None:
    found = meaning(number)
    assert found is None or found[1] > 0


def test_prefixes_are_scales() -> None:
    assert meaning(0xFD260000) == ("V", 0.001)
    assert meaning(0xFFB44700) == ("rpm", 0.1)
    assert meaning(0x03010300) == ("m/s", 1000.0)
