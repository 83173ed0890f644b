"""Rig files: what they can say, and what is said of those that are wrong."""

import re
from pathlib import Path

import pytest
from esi_sample import SAMPLE
from hypothesis import given, settings
from hypothesis import strategies as st
from test_ecatsim_device_file import SMALL, mutate

from conftest import names_at, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.etg.sii_check import check_sii
from ecatsim import Device, Rig, Simulation
from ecatsim.rigs import library as rigs

RIG = """\
name = "bench"

[[slave]]
device = "EK1100"

[[slave]]
device = "EL2008"
alias = 5

[[slave]]
device = "EL1018"
serial = 77

[[slave]]
device = "EL3008"

[[slave]]
device = "doubler.toml"

[[slave]]
device = "counter.py:Counter"
parameters = { step = 3 }

[[slave]]
vendor = 0xFFFF
product = 9
alias = 6
[[slave.pdo]]
index = 0x1A00
entry = [{ index = 0x6000, subindex = 1, type = "int16", scale = 0.5, offset = 1 }]

[[wire]]
from = { slave = 1, entry = "0x7000:01" }
to = { slave = 2, entry = "0x6000:01" }

[[waveform]]
to = { slave = 6, entry = "0x6000:01" }
shape = "constant"
value = 21.0

[[waveform]]
to = { slave = 2, entry = "0x6010:01" }
shape = "square"
frequency = 0.5

[[waveform]]
to = { slave = 3, entry = "0x6000:11" }
shape = "sine"
amplitude = 20
frequency = 0.25

[[plant]]
python = "counter.py:plant"
parameters = { slave = 5 }

[[fault]]
kind = "al-error"
slave = 1
code = 0x001D
at_cycle = 100
"""

PYTHON = """\
from ecatsim import DataType, Device, Entry, Pdo


class Counter(Device):
    vendor, product, order = 1, 2, "Counter"
    tx_pdos = (Pdo(0x1A00, "In", 0, [Entry(0x6000, 1, "", DataType.UNSIGNED16, 16)]),)

    def __init__(self, step=1):
        super().__init__()
        self.increment = int(step)

    def step(self, now):
        self[0x6000, 1] += self.increment


def plant(rig, slave):
    times = []
    rig.devices[slave].times = times
    return times.append


def broken(rig):
    raise KeyError("oops")


def nothing(rig):
    return None


number = 5
"""


def write(folder: Path, text: str) -> Path:
    (folder / "doubler.toml").write_text(SMALL, "utf-8")
    (folder / "counter.py").write_text(PYTHON, "utf-8")
    file = folder / "rig.toml"
    file.write_text(text, "utf-8")
    return file


def load(folder: Path, text: str) -> Rig:
    return rigs.make(str(write(folder, text)))


def test_a_slave_with_exchanged_ports(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    rows = ("", "ports_exchanged = true\nalias = 7\n", "")
    file.write_text("".join(f'[[slave]]\ndevice = "EL2008"\n{row}' for row in rows))
    simulation = Simulation(rigs.make(str(file)))
    try:
        assert simulation.segment.order() == [0, 2, 1]
    finally:
        simulation.close()


def test_slaves_of_every_kind(tmp_path: Path) -> None:
    what = load(tmp_path, RIG)
    assert what.name == "bench"
    names = [device.order for device in what.devices]
    assert names == ["EK1100", "EL2008", "EL1018", "EL3008", "Doubler", "Counter", "Slave 6"]
    assert [device.alias for device in what.devices] == [0, 5, 0, 0, 0, 0, 6]
    assert what.devices[2].serial == 77
    simulation = Simulation(what)
    try:
        for position, word in ((1, 5), (2, 0), (6, 6)):
            assert simulation.segment.sii(position)[8:10] == word.to_bytes(2, "little")
        assert simulation.segment.sii(2)[28:32] == (77).to_bytes(4, "little")
    finally:
        simulation.close()


ESI = """\
[[slave]]
esi = "axis.xml"
type = "AX2"
revision = 0x00020001
alias = 77
"""


def test_a_slave_from_an_esi_file(tmp_path: Path) -> None:
    (tmp_path / "axis.xml").write_text(SAMPLE, "utf-8")
    what = load(tmp_path, ESI)
    assert (what.devices[0].order, what.devices[0].product) == ("AX2", 0x1234)
    simulation = Simulation(what)
    try:
        image = simulation.segment.sii(0)
    finally:
        simulation.close()
    assert image[8:10] == (77).to_bytes(2, "little")
    assert not check_sii(image).problems  # its checksum is that of the alias


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("axis.xml", "none.xml", "rig.toml:2: slave[0].esi: no file | 'none.xml'"),
        ('type = "AX2"', "type = 2", "rig.toml:3: slave[0].type: text | 2"),
        ("type =", "typ =", "rig.toml:3: slave[0].typ: not a key | 'type'"),
        ('"AX2"', '"AX9"', "axis.xml: AX9"),
        ("axis.xml", "rig.toml", "rig.toml:1: XML"),
        (
            "alias = 77",
            "alias = 1.5",
            "rig.toml:5: slave[0].alias: whole number | 1.5",
        ),
    ],
)
def test_mistakes_with_esi_files(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "axis.xml").write_text(SAMPLE, "utf-8")
    with pytest.raises(ConfigError) as error:
        load(tmp_path, ESI.replace(old, new, 1))
    names_at(str(error.value).replace(f"{tmp_path}/", ""), message)


LINKS = """\
[[slave]]
device = "EK1100"
[[slave]]
device = "EL1018"
[[slave]]
device = "Loopback32"
at = { slave = 0, port = 2 }
[[slave]]
device = "Loopback32"
"""


def test_branches(tmp_path: Path) -> None:
    what = load(tmp_path, LINKS)
    assert what.wiring().parents == [None, (0, 1), (0, 2), (2, 1)]
    assert what.wiring().ring_end is None


@pytest.mark.parametrize(
    ("ring", "end"), [("true", (3, 1)), ("{ slave = 3, port = 1 }", (3, 1)), ("false", None)]
)
def test_rings(tmp_path: Path, ring: str, end: tuple[int, int] | None) -> None:
    assert load(tmp_path, f"ring = {ring}\n{LINKS}").wiring().ring_end == end


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("port = 2", "port = 4", "rig.toml:7: slave[2].at.port: 4 | 1 | 3"),
        ("port = 2", "prot = 2", "rig.toml:7: slave[2].at.prot: not a key | 'port'"),
        ("port = 2", "port = 3", "rig.toml:7: slave[2].at: EK1100 (position 0) | port 3"),
        ("port = 2", "port = 1", "rig.toml:7: slave[2].at: port 1 | EK1100 (position 0) | taken"),
        ("slave = 0", "slave = 2", "rig.toml:7: slave[2].at.slave: 2 | 0 | 1"),
        (
            "{ slave = 0, port = 2 }",
            "2",
            "rig.toml:7: slave[2].at: [slave.at] | 2",
        ),
        (
            '"EK1100"',
            '"EK1100"\nat = { slave = 0, port = 1 }',
            "rig.toml:3: slave[0].at: slave 0 | interface",
        ),
        ("[[slave]]", "ring = 1\n[[slave]]", "rig.toml:1: ring: true | false | 1"),
        (
            "[[slave]]",
            "ring = { slave = 9, port = 1 }\n[[slave]]",
            "rig.toml:1: ring.slave: 9 | 0 | 3",
        ),
        (
            "[[slave]]",
            "ring = { slave = 0, port = 1 }\n[[slave]]",
            "rig.toml:1: ring: port 1 | EK1100 (position 0) | EL1018",
        ),
        ("[[slave]]", "ring = { slave = 0 }\n[[slave]]", "rig.toml:1: ring.port: missing"),
    ],
)
def test_mistakes_in_links(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        load(tmp_path, LINKS.replace(old, new, 1))
    names_at(str(error.value).replace(f"{tmp_path}/", ""), message)


def test_slaves_that_are_not_in_the_order_of_the_frames(tmp_path: Path) -> None:
    slaves = ("EK1100", "Loopback32", "EL1018")
    text = "".join(f'[[slave]]\ndevice = "{name}"\n' for name in slaves)
    text = text.replace('"Loopback32"', '"Loopback32"\nat = { slave = 0, port = 2 }')
    text += "at = { slave = 0, port = 1 }\n"
    with pytest.raises(ConfigError) as error:
        load(tmp_path, text)
    said = str(error.value).replace(f"{tmp_path}/", "")
    names_at(said, "rig.toml:5: slave[1].at: order | port 3 | port 1 | port 2 | slave 2")
    assert said.index("port 3") < said.index("port 1") < said.index("port 2")


def test_faults_it_begins_with(tmp_path: Path) -> None:
    simulation = Simulation(load(tmp_path, RIG))
    try:
        (state,) = simulation.faults.list()
        assert str(state.fault) == "al-error slave=1 code=0x001D at_cycle=100"
    finally:
        simulation.close()


def test_a_file_without_slaves_is_an_empty_segment(tmp_path: Path) -> None:
    what = load(tmp_path, "")
    assert (what.name, what.devices) == ("rig", [])


def step(what: Rig, now: float) -> None:
    for plant in what.plants:
        plant(now)
    for device in what.devices:
        device.step(now)


def test_wires_and_waveforms(tmp_path: Path) -> None:
    what = load(tmp_path, RIG)
    _, outputs, inputs, analog, _, counter, scaled = what.devices
    outputs[0x7000, 1] = 1
    step(what, 0.5)
    assert inputs[0x6000, 1] == 1
    assert inputs[0x6010, 1] == 1
    assert scaled[0x6000, 1] == 40  # (21 - 1) / 0.5
    assert analog[0x6000, 0x11] == 32767  # 14 V are more than ±10 V
    assert counter[0x6000, 1] == 3
    step(what, 1.0)
    assert inputs[0x6010, 1] == 0
    times = counter.times  # type: ignore[attr-defined]
    assert (times[0], times[-1]) == (0.5, pytest.approx(1.0))
    step(what, 4.1)
    assert 0 < analog[0x6000, 0x11] < 32767


SHAPES = {
    "constant": "value = 2.5",
    "sine": "amplitude = 5\nfrequency = 0.25\nphase = 0.5\noffset = -1",
    "square": "frequency = 1\nlow = -3\nhigh = 3",
    "ramp": "low = 0\nhigh = 5\nfrequency = 0.1",
    "triangle": "low = 0\nhigh = 5\nfrequency = 0.1",
    "noise": "deviation = 0.5\nmean = 2\nseed = 7",
    "table": "file = 'table.csv'\ncolumn = 'volts'\ntime = 0\nrepeat = true",
}


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_of_waveform(tmp_path: Path, shape: str) -> None:
    (tmp_path / "table.csv").write_text("seconds,volts\n0,1\n10,4\n")
    point = 'to = { slave = 0, entry = "0x6000:11" }\n'
    text = (
        f"[[slave]]\ndevice = 'EL3008'\n[[waveform]]\n{point}shape = '{shape}'\n{SHAPES[shape]}\n"
    )
    what = load(tmp_path, text)
    what.plants[0](4.0)
    what.plants[0](5.0)
    assert what.devices[0].connection(0x6000, 0x11).value != 0


def test_wires_convert_what_they_carry(tmp_path: Path) -> None:
    what = load(
        tmp_path, RIG.replace('entry = "0x6000:01" }\n', 'entry = "0x6000:01" }\noffset = 1\n', 1)
    )
    step(what, 0.0)
    assert what.devices[2][0x6000, 1] == 1


def test_paths_are_relative_to_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rigs"
    folder.mkdir()
    write(folder, RIG)
    monkeypatch.chdir(tmp_path)
    assert len(rigs.make("rigs/rig.toml").devices) == 7


def test_every_slave_is_a_device_of_its_own(tmp_path: Path) -> None:
    first, second = load(tmp_path, '[[slave]]\ndevice = "doubler.toml"\n' * 2).devices
    first[0x7000, 1] = 4
    assert second[0x7000, 1] == 0
    assert isinstance(first, Device)


SLAVE = '[[slave]]\ndevice = "EL1018"\n'
WIRE = 'from = { slave = 1, entry = "0x7000:01" }\nto = { slave = 2, entry = "0x6000:01" }'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "bench"', "name = 3", "rig.toml:1: name: text | 3"),
        ('name = "bench"', "xyz = 1", "rig.toml:1: xyz: not a key | name"),
        ('name = "bench"', "slave = 3", "rig.toml:3: TOML | Cannot"),
        ('"EK1100"', "3", "rig.toml:4: slave[0].device: text | 3"),
        (
            '"EK1100"',
            '"EK1101"',
            "rig.toml:4: slave[0].device: 'EK1101' | EK1100",
        ),
        ("device", "devise", "rig.toml:4: slave[0].devise: not a key | 'device'"),
        (
            "alias = 5",
            "alias = -5",
            "rig.toml:8: slave[1].alias: -5 | 0 | 65535",
        ),
        (
            "alias = 5",
            "alais = 5",
            "rig.toml:8: slave[1].alais: not a key | 'alias'",
        ),
        (
            "serial = 77",
            'serial = "77"',
            "rig.toml:12: slave[2].serial: whole number | '77'",
        ),
        (
            "alias = 5",
            "parameters = { volts = 5 }",
            "rig.toml:7: slave[1].device: EL2008 | 'volts'",
        ),
        (
            "alias = 5",
            "parameters = 5",
            "rig.toml:8: slave[1].parameters: [slave.parameters]",
        ),
        (
            '"doubler.toml"',
            '"doubler.toml"\nparameters = {}',
            "rig.toml:19: slave[4].parameters: library",
        ),
        (
            '"counter.py:Counter"',
            '"counter.py"',
            'rig.toml:21: slave[5].device: class | "counter.py:ClassName"',
        ),
        (
            '"counter.py:Counter"',
            '"missing.py:Counter"',
            "rig.toml:21: slave[5].device: no file | 'missing.py'",
        ),
        (
            '"counter.py:Counter"',
            '"counter.py:number"',
            "counter.py: 5 | class | function",
        ),
        (
            '"counter.py:Counter"',
            '"counter.py:dict"',
            "counter.py: define | 'dict'",
        ),
        (
            "vendor = 0xFFFF",
            "",
            'rig.toml:24: slave[6]: `device = "EL2004"`',
        ),
        (
            "product = 9",
            "",
            "rig.toml:24: slave[6].product: missing | whole number",
        ),
        (
            "index = 0x1A00",
            "index = 0x1C00",
            "rig.toml:29: slave[6].pdo[0].index: 0x1C00 | 0x1600 | 0x1BFF",
        ),
        (
            "scale = 0.5",
            "scale = inf",
            "rig.toml:30: slave[6].pdo[0].entry[0].scale: finite | inf",
        ),
        (
            "scale = 0.5",
            "skale = 0.5",
            "rig.toml:30: slave[6].pdo[0].entry[0].skale: not a key | 'scale'",
        ),
        (
            "[[wire]]",
            "[wire]",
            "rig.toml:32: wire: [[wire]]",
        ),
        (
            "[[wire]]",
            "[[slave.wire]]",
            "rig.toml:32: slave[6].wire: not a key | [[wire]]",
        ),
        ("from =", "form =", "rig.toml:33: wire[0].form: not a key | 'from'"),
        (
            'from = { slave = 1, entry = "0x7000:01" }\n',
            "",
            "rig.toml:32: wire[0].from: missing | table",
        ),
        (
            "{ slave = 1, entry",
            "{ slave = 7, entry",
            "rig.toml:33: wire[0].from.slave: 7 | 0 | 6",
        ),
        (
            '"0x7000:01"',
            "0x7000",
            'rig.toml:33: wire[0].from.entry: "0x6000:01" | 0x7000',
        ),
        (
            '"0x7000:01"',
            '"0x7000:02"',
            "rig.toml:33: wire[0].from.entry: slave 1 (EL2008) | output | 0x7000:02 | "
            "0x7000:01 | 0x7010:01",
        ),
        (
            '{ slave = 2, entry = "0x6010:01" }',
            '{ slave = 4, entry = "0x6000:01" }',
            "rig.toml:42: waveform[1].to.entry: `loopback`",
        ),
        (
            '"constant"',
            '"sinus"',
            "rig.toml:38: waveform[0].shape: 'sinus' | \"constant\"",
        ),
        (
            "value = 21.0",
            "value = 21.0\nfrequency = 1",
            "rig.toml:40: waveform[0].frequency: not a key | to | shape | value",
        ),
        (
            "frequency = 0.5",
            "frequency = -0.5",
            "rig.toml:44: waveform[1].frequency: -0.5 | 0 | 1000000000",
        ),
        (
            "amplitude = 20\n",
            "",
            "rig.toml:46: waveform[2].amplitude: missing | number",
        ),
        (
            '"counter.py:plant"',
            '"counter.py"',
            "rig.toml:53: plant[0].python: file | name",
        ),
        (
            '"counter.py:plant"\nparameters = { slave = 5 }',
            '"counter.py:broken"',
            "counter.py:23: KeyError: 'oops'",
        ),
        (
            '"counter.py:plant"\nparameters = { slave = 5 }',
            '"counter.py:nothing"',
            "rig.toml:53: plant[0].python: nothing | 'counter.py'",
        ),
        (
            "python =",
            "# ",
            'rig.toml:52: plant[0]: `python = "motor.py:Motor"` | `fmu = "motor.fmu"`',
        ),
        (
            'python = "counter.py:plant"\nparameters',
            'fmu = "tank.fmu"\nparameters',
            "rig.toml:54: plant[0].parameters: not a key | fmu | period | start | connect",
        ),
        ('kind = "al-error"', "", "rig.toml:56: fault[0]: kind | missing | drop"),
        ("slave = 1\n", "slave = 7\n", "rig.toml:56: fault[0]: al-error: slave 7"),
        ("slave = 1\n", "", "rig.toml:56: fault[0]: al-error: slave | missing"),
        ("code = 0x001D", "code = inf", "rig.toml:56: fault[0]: al-error: code | inf"),
        ("at_cycle = 100", "at_cycle = -1", "rig.toml:56: fault[0]: al-error: at_cycle | -1"),
        ("at_cycle", "atcycle", "rig.toml:56: fault[0]: al-error: 'atcycle'"),
        ("[[fault]]", "[fault]", "rig.toml:56: fault: [[fault]]"),
        ("python =", "pyton =", "rig.toml:53: plant[0].pyton: not a key | 'python'"),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in RIG
    with pytest.raises(ConfigError) as error:
        load(tmp_path, RIG.replace(old, new, 1))
    names_at(str(error.value).replace(f"{tmp_path}/", ""), message)


def test_mistakes_of_a_device_file_name_that_file(tmp_path: Path) -> None:
    file = write(tmp_path, '[[slave]]\ndevice = "doubler.toml"\n')
    (tmp_path / "doubler.toml").write_text("vendor = 1\nproduct = 'x'\n")
    with pytest.raises(ConfigError) as error:
        rigs.make(str(file))
    names_at(error.value, f"{tmp_path}/doubler.toml:2: product: whole number | 'x'")


def test_more_slaves_than_a_segment_has(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming("rig.toml:1: slave:", 1025, 1024)):
        load(tmp_path, SLAVE * 1025)


def test_wires_of_a_rig_without_slaves(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming("rig.toml:2: wire[0].from.slave:", "no slaves")):
        load(tmp_path, f"[[wire]]\n{WIRE}\n")


def test_names_of_rigs() -> None:
    assert rigs.make("empty").devices == []
    with pytest.raises(UsageError, match=naming("no rig", "'nothing'", "ecatsim rigs")):
        rigs.make("nothing")
    with pytest.raises(ConfigError, match=naming("nothing.toml:", "No such file")):
        rigs.make("nothing.toml")
    with pytest.raises(ConfigError, match=naming("no rig file", "'nothing.py'")):
        rigs.make("nothing.py")


def test_python_rigs_say_where_they_fail(tmp_path: Path) -> None:
    for number, (text, message) in enumerate(
        (
            ("def rig():\n    return 1 / 0\n", "{file}:2: ZeroDivisionError"),
            ("def rig(:\n", "{file}:1: SyntaxError"),
            ("def rigg(): ...\n", "{file}: define | rig()"),
            ("def rig(): ...\n", "{file}: return | rig() | ecatsim.rig.Rig"),
        )
    ):
        file = tmp_path / f"rig{number}.py"
        file.write_text(text)
        with pytest.raises(ConfigError) as error:
            rigs.make(str(file))
        names_at(error.value, message.format(file=file))


@settings(max_examples=100)
@given(st.integers(0, 2**32))
def test_mistakes_never_end_in_anything_but_a_message(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    folder = tmp_path_factory.getbasetemp()
    said = ""
    try:
        simulation = Simulation(load(folder, mutate(RIG, seed)))
    except ConfigError as error:
        said = str(error)
    else:
        simulation.step()
        simulation.close()
    assert re.fullmatch(rf"({re.escape(str(folder))}/(rig\.toml|counter\.py)(:\d+)?: .+)?", said)
