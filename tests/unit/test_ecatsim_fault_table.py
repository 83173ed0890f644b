"""The faults on demand: one table from which Python, TOML, commands and documentation follow."""

import inspect
import re
from pathlib import Path

import pytest

from conftest import names_at, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatsim import Rig, Simulation
from ecatsim.devices.library import make
from ecatsim.faults import FAULTS, Faults, FrameFault, SlaveFault, parse
from ecatsim.files import rig_file
from ecatsim.parameters import parameters

DOCUMENT = Path(__file__).parents[2] / "docs" / "simulator-control.md"
SAMPLES = {
    "drop": {"count": 3},
    "delay": {"delay_us": 500},
    "duplicate": {"all_frames": True},
    "corrupt": {"bits": 2, "probability": 0.25, "seed": 7},
    "noise": {"slave": 1},
    "wkc": {"value": -1, "at_cycle": 100, "every": 10, "count": 0},
    "break-link": {"slave": 1, "port": 1},
    "heal-link": {"slave": 1},
    "power-off": {"slave": 2},
    "power-on": {"slave": 2},
    "swap": {"slave": 0, "device": "EL2008"},
    "module": {"slave": 1, "slot": 3, "module": "DI8"},
    "al-error": {"slave": 1, "code": 0x1D, "state": "PREOP"},
    "emergency": {"slave": 0, "code": 0x8130, "register": 0x10, "data": "0102030405"},
    "mailbox": {"slave": 0, "mode": "slow", "delay_s": 0.5},
    "eeprom": {"slave": 0, "content": "image", "file": "/tmp/x.bin", "at_power_on": True},
    "clock": {"slave": 0, "step_ns": -5000, "drift_ppm": 12.5},
    "identification": {"slave": 1, "value": 42},
    "drift": {"slave": 0, "entry": "0x6000:01", "per_second": -2.5, "limit": 100.0},
    "can-noise": {"slave": 0, "chance": 0.25, "seed": 3},
    "can-short": {"slave": 0, "level": "dominant"},
    "can-bus-off": {"slave": 0},
    "can-babble": {"slave": 0, "id": 0x10},
    "can-bit-rate": {"slave": 0, "node": "drive", "kbit": 250},
    "can-node": {"slave": 0, "node": "1", "power": "off"},
}


@pytest.fixture
def faults():
    simulation = Simulation(Rig("bench", [make("Loopback32") for _ in range(3)]))
    yield simulation.faults
    simulation.close()


def sample(kind):
    return FAULTS[kind].from_values(SAMPLES[kind])


def test_these_are_the_faults():
    assert list(FAULTS) == list(SAMPLES)


@pytest.mark.parametrize("kind", SAMPLES)
def test_written_down_and_read_again(kind):
    fault = sample(kind)
    assert fault.to_values() == SAMPLES[kind]
    assert FAULTS[kind].from_values(fault.to_values()) == fault
    assert parse({"kind": kind, **SAMPLES[kind]}, "rig.toml: fault 1") == fault
    as_texts = {name: str(value) for name, value in SAMPLES[kind].items() if value is not True}
    typed = {name: True for name, value in SAMPLES[kind].items() if value is True}
    assert FAULTS[kind].from_values(as_texts | typed) == fault, "as on the command line"


@pytest.mark.parametrize("kind", SAMPLES)
def test_a_method_of_the_same_name_and_signature(kind):
    method = getattr(Faults, kind.replace("-", "_"))
    assert method.fault is FAULTS[kind]


def test_a_method_adds_its_fault(faults):
    number = faults.al_error(1, code=0x1D, at_cycle=100)
    assert number == 1
    (state,) = faults.list()
    assert str(state.fault) == "al-error slave=1 code=0x001D at_cycle=100"
    assert (state.id, state.struck, state.done) == (1, 0, False)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "fly"}, "'fly' | drop | delay"),
        ({"kind": "drop", "at": 5}, "drop: 'at' | at_cycle"),
        ({"kind": "break-link"}, "break-link: slave | missing"),
        ({"kind": "drop", "count": "many"}, "drop: count | 'many' | integer"),
        ({"kind": "drop", "probability": 2}, "drop: probability | 2 | 0"),
        ({"kind": "drop", "all_frames": 1}, "drop: all_frames | 1 | true | false"),
        ({"kind": "delay", "delay_us": 0}, "delay: delay_us | 0 | 1"),
        ({"kind": "wkc", "value": 0}, "wkc: value | 0"),
        ({"kind": "mailbox", "slave": 0, "mode": "odd"}, "mailbox: mode | 'odd' | none"),
        (
            {"kind": "al-error", "slave": 0, "code": float("nan")},
            "al-error: code | nan | 0x0001 | 0xFFFF",
        ),
        (
            {"kind": "emergency", "slave": 0, "code": 1, "data": "0x"},
            "emergency: data | '0x' | 5 bytes",
        ),
        (
            {"kind": "emergency", "slave": 0, "code": 1, "data": "112233445566"},
            "emergency: data | 112233445566 | 5 bytes",
        ),
        ({"kind": "clock", "slave": 0}, "clock: step_ns | drift_ppm"),
        (
            {"kind": "eeprom", "slave": 0, "content": "image"},
            "eeprom: `image` | file",
        ),
    ],
)
def test_wrong_tables_are_one_sentence(table, message):
    with pytest.raises(ConfigError) as caught:
        parse(table, "rig.toml: fault 1")
    text = str(caught.value)
    names_at(text, f"rig.toml: fault 1: {message}")
    assert "\n" not in text


def test_paths_are_relative_to_the_rig_file():
    table = {"kind": "swap", "slave": 0, "device": "valve.toml"}
    assert parse(table, "", Path("/rigs")).device == "/rigs/valve.toml"
    table = {"kind": "swap", "slave": 0, "device": "valve.py:Valve"}
    assert parse(table, "", Path("/rigs")).device == "/rigs/valve.py:Valve"
    table = {"kind": "swap", "slave": 0, "device": "EL2008"}
    assert parse(table, "", Path("/rigs")).device == "EL2008"
    table = {"kind": "eeprom", "slave": 0, "content": "image", "file": "x.bin"}
    assert parse(table, "", Path("/rigs")).file == "/rigs/x.bin"


def usage(kind):
    """A fault as a row of the documentation."""
    own = [p for p in parameters(FAULTS[kind]) if p.name not in COMMON]
    words = [kind]
    for p in own:
        option = f"--{p.name.replace('_', '-')}"
        if p.required:
            words.append(p.name.replace("_", "-").upper())
        else:
            value = "" if p.type is bool else f" {p.name.rpartition('_')[2].upper()}"
            words.append(f"[{option}{value}]")
    meanings = [
        f"{p.name}: {p.about.help}" + ("" if p.type in (bool, str) else f" ({p.allowed})")
        for p in own
        if p.name != "slave"
    ]
    return f"| `{' '.join(words)}` | {FAULTS[kind].summary()} | {'; '.join(meanings) or '–'} |"


COMMON = [p.name for p in parameters(FrameFault)]


def test_the_documentation_has_the_table():
    text = DOCUMENT.read_text()
    missing = [usage(kind) for kind in FAULTS if usage(kind) not in text]
    assert not missing, "\n".join(missing)
    for parameter in parameters(FrameFault):
        assert f"`--{parameter.name.replace('_', '-')}`" in text


def test_rig_files_have_faults(tmp_path):
    slaves = '[[slave]]\ndevice = "Loopback32"\n' * 4
    (example,) = re.findall(r"^```toml\n(\[\[fault.*?)^```", DOCUMENT.read_text(), re.M | re.S)
    file = tmp_path / "rig.toml"
    file.write_text(slaves + example)
    (fault,) = rig_file.load(file).faults
    assert str(fault) == "break-link slave=2 at_cycle=1000"
    file.write_text(slaves + example.replace("slave = 2", "slave = 4"))
    with pytest.raises(ConfigError) as caught:
        rig_file.load(file)
    names_at(caught.value, f"{file}:9: fault[0]: break-link: slave 4 | 0 | 3")


@pytest.mark.parametrize("kind", [k for k, cls in FAULTS.items() if "slave" in SAMPLES[k]])
def test_there_is_such_a_slave(faults, kind):
    values = SAMPLES[kind] | {"slave": 3}
    with pytest.raises(UsageError, match=naming(f"{kind}: ", "slave 3", 0, 2)):
        faults.add(FAULTS[kind].from_values(values))


def test_a_slave_fault_names_its_slave_first():
    of_slaves = [cls for cls in FAULTS.values() if issubclass(cls, SlaveFault)]
    assert of_slaves
    for cls in of_slaves:
        assert next(iter(inspect.signature(cls).parameters)) == "slave"
