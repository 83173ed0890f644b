"""Blocks and FMUs that were generated for another meaning of a value do not start."""

import math
import random
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from plant_calls import ERROR, STEPS, Model, compile_program, run, sentence, served

import player
from conftest import Daemon, names
from ecatd.config import SignalConfig, load_config
from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import Profiles
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatdev import sample_buses
from ecatgen import generate
from ecatgen.fmu import generate_fmu

pytestmark = pytest.mark.long

VOLT = 10 / 32767  # of the EL3008 at 4, by its profile
Change = Callable[[Entry], None]


def raw(entry: Entry) -> None:
    entry.unit, entry.scale, entry.offset = "", 1.0, 0.0


def millivolts(entry: Entry) -> None:
    entry.unit, entry.scale = "mV", 1000 * VOLT


def shifted(entry: Entry) -> None:
    entry.offset = -2.5


def nudged(entry: Entry) -> None:
    entry.scale = math.nextafter(VOLT, 1)


def only_scaled(entry: Entry) -> None:
    entry.unit, entry.scale, entry.offset = "", 0.5, 1.0


def changed(change: Change | None) -> Bus:
    """The reference plant, on which the first value of slave 4 means something else."""
    bus = sample_buses.troll()
    if change is not None:
        (entry,) = [
            entry
            for _, entry, _ in bus.slaves[4].entries(outputs=False)
            if (entry.index, entry.subindex) == (0x6000, 0x11)
        ]
        assert (entry.unit, entry.scale, entry.offset) == ("V", VOLT, 0.0)
        change(entry)
    assert bus.fingerprint == sample_buses.troll().fingerprint
    return bus


WORDS = {
    None: f"values in V (raw value * {VOLT!r})",
    raw: "raw values",
    millivolts: f"values in mV (raw value * {1000 * VOLT!r})",
    shifted: f"values in V (raw value * {VOLT!r} - 2.5)",
    nudged: f"values in V (raw value * {math.nextafter(VOLT, 1)!r})",
    only_scaled: "values without a unit (raw value * 0.5 + 1)",
}
PAIRS = [
    *((change, None) for change in WORDS if change is not None),
    *((None, change) for change in (raw, nudged)),
]


def refusal(
    name: str, here: Change | None, product: str, made_for: Change | None, options: str = ""
) -> str:
    """What is said."""
    return (
        f"entry 0x6000:11 (Value) of slave 4 (EL3008) of bus '{name}' has {WORDS[here]}, but "
        f"{product} was generated for {WORDS[made_for]}; regenerate it with: "
        f"ecatctl generate Plant DIR{options} --bus {name}"
    )


@pytest.mark.parametrize(("here", "made_for"), PAIRS)
def test_a_block(
    here: Change | None, made_for: Change | None, compiler: str, tmp_path: Path
) -> None:
    generate(changed(made_for), "Plant", tmp_path / "out")
    program = compile_program(compiler, STEPS, tmp_path / "out", tmp_path)
    arguments = ("0", str(ERROR), str(ERROR), "0")
    with served(changed(here)) as name:
        said = sentence(run(program, name, *arguments))
    assert said == "EtherCAT: " + refusal(name, here, "this library", made_for)
    with served(changed(made_for)) as name:
        model = Model(program, name, *arguments)
        try:
            assert model.opened().end() == (0, "")
        finally:
            model.close()


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(("here", "made_for"), [PAIRS[0], PAIRS[-1]])
def test_an_fmu(here: Change | None, made_for: Change | None, fmi: int, tmp_path: Path) -> None:
    model = player.Model(generate_fmu(changed(made_for), "Plant", tmp_path, fmi).fmu)
    with served(changed(here)) as name, player.Player(model) as instance:
        instance.set("bus", name)
        with pytest.raises(Exception, match="InitializationMode"):
            instance.start()
        (said,) = instance.errors()
        options = " --fmu" if fmi == 2 else " --fmu --fmi 3"
        assert said == refusal(name, here, "this FMU", made_for, options)
    with served(changed(made_for)) as name, model.play(bus=name) as instance:
        assert instance.errors() == []


def test_a_bus_that_comes_back_with_another_meaning(compiler: str, tmp_path: Path) -> None:
    """Whoever goes on without a bus looks again when there is one."""
    generate(changed(None), "Plant", tmp_path / "out")
    program = compile_program(compiler, STEPS, tmp_path / "out", tmp_path)
    bus = changed(None)
    with served(bus) as name:
        model = Model(program, name, "0", str(ERROR), "3", "0").opened()
        try:
            assert model.step().connected
        except BaseException:
            model.close()
            raise
    try:
        assert not model.until(lambda step: not step.connected).connected
        with served(changed(millivolts), name):
            with pytest.raises(AssertionError):
                model.until(lambda step: step.connected)
            status, said = model.end()
        assert status == 1
        last = said.splitlines()[-1]
        assert last == "EtherCAT: " + refusal(name, millivolts, "this library", None)
    finally:
        model.close()


SIGNAL = """
[[signal]]
slave = 4
entry = "0x6000:11"
unit = "{unit}"
scale = {scale}
"""


@pytest.mark.bus
def test_a_configuration_that_was_changed_after_generation(
    compiler: str, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """Before, Python and the model had different numbers, and nobody said so."""
    before = start_daemon("troll", config=SIGNAL.format(unit="m", scale=0.25))
    before.ctl("generate", "Plant", str(tmp_path / "out"))
    before.ctl("generate", "Plant", str(tmp_path), "--fmu")
    program = compile_program(compiler, STEPS, tmp_path / "out", tmp_path)
    model = player.Model(tmp_path / "Plant.fmu")
    with before.client() as client:
        fingerprint = client.fingerprint
    with model.play(bus=before.bus, readOnly=True) as instance:
        assert instance.errors() == []
    assert before.stop() == 0
    after = start_daemon("troll", config=SIGNAL.format(unit="m", scale=0.5))
    with after.client() as client:
        assert client.fingerprint == fingerprint
        assert client.signal("4/0x6000:11").scale == 0.5
    said = sentence(run(program, after.bus, "0", str(ERROR), str(ERROR), "0"))
    meanings = ("0x6000:11", "slave 4 (EL3008)", "raw value * 0.5", "raw value * 0.25")
    names(said, *meanings, "ecatctl generate Plant")
    assert said.index("0.5") < said.index("generated for") < said.index("0.25")
    with player.Player(model) as instance:
        instance.set("bus", after.bus)
        with pytest.raises(Exception, match="InitializationMode"):
            instance.start()
        (error,) = instance.errors()
        names(error, *meanings, "ecatctl generate Plant")
        assert error.index("0.5") < error.index("generated for") < error.index("0.25")


BY_HAND = """
#include "ecat_modelica.h"
int main(int argc, char **argv) {
  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 0, 1, 1, 0, 0, 0, "");
  void *domain = ecatm_domain_open(master, 1, "");
  void *slave = ecatm_slave_open(domain, 4, "", 2, 0x0BC03052, 0, "EL3008", "", "again", "");
  void *raw = ecatm_pdo_open(slave, 0x6000, 0x11, 0, 3, 16, 1, 0, "");
  void *own = ecatm_pdo_open(slave, 0x6000, 0x11, 0, 3, 16, 0.5, 3, "m");
  int cycle = ecatm_wait(master, 0);
  printf("%d %g\\n", ecatm_read_integer(raw, 0, cycle), ecatm_read_real(own, 0, cycle));
  ecatm_pdo_close(own);
  ecatm_pdo_close(raw);
  ecatm_slave_close(slave);
  ecatm_domain_close(domain);
  ecatm_master_close(master);
  return 0;
}
"""


def test_blocks_that_were_written_by_hand_have_a_meaning_of_their_own(
    compiler: str, tmp_path: Path
) -> None:
    generate(changed(None), "Plant", tmp_path / "out")
    program = compile_program(compiler, BY_HAND, tmp_path / "out", tmp_path)
    for here in (None, millivolts):
        with served(changed(here)) as name:
            result = run(program, name)
        assert (result.returncode, result.stdout) == (0, "0 3\n")
        (told,) = result.stderr.splitlines()  # nobody exchanges the shared memory
        names(told, "EtherCAT: ", "slave 4 (EL3008)", f"'{name}'", "answer")


# --- numbers stay what they are -------------------------------------------------------------------


def doubles(seed: int) -> Iterator[float]:
    """Finite numbers with all their bits, other than 0."""
    source = random.Random(seed)
    while True:
        (number,) = struct.unpack("<d", source.randbytes(8))
        if math.isfinite(number) and number != 0:
            yield number


def test_numbers_are_the_same_from_the_configuration_to_the_model(
    compiler: str, tmp_path: Path
) -> None:
    """TOML, JSON, shared memory, C and FMU: scale and offset keep every bit."""
    numbers = doubles(5)
    entries = [Entry(0x6000 + n, 0, f"e{n}", DataType.INTEGER32, 32) for n in range(60)]
    bus = Bus("b", 1000, [Slave(0, "Many", 1, 2, 3, inputs=[Pdo(0x1A00, "", 0, entries)])])
    wanted = [(next(numbers), next(numbers)) for _ in entries]
    toml = tmp_path / "ecat.toml"
    toml.write_text(
        "".join(
            f'[[signal]]\nslave = 0\nentry = "0x{entry.index:04X}:00"\nunit = "V"\n'
            f"scale = {scale!r}\noffset = {offset!r}\n"
            for entry, (scale, offset) in zip(entries, wanted, strict=True)
        )
    )
    rules: list[SignalConfig] = load_config(toml).signal
    give_meanings(bus, Profiles(), rules)
    made = [entry for _, entry, _ in bus.slaves[0].entries(outputs=False)]
    assert [(entry.scale, entry.offset) for entry in made] == wanted
    (tmp_path / "bus.json").write_text(bus_file.dump(bus))
    again = bus_file.load(tmp_path / "bus.json")
    generate(again, "Plant", tmp_path / "out")
    text = (tmp_path / "out" / "Plant" / "Many.mo").read_text()
    found = re.findall(r', 32, (\S+), (\S+), "V"\)', text)
    assert [(float(scale), float(offset)) for scale, offset in found] == wanted
    program = compile_program(
        compiler,
        '#include "Plant.h"\nint main(int argc, char **argv) {\n  static Plant plant;\n'
        '  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 0, 1, 1, 0, 0, 0, "");\n'
        "  Plant_open(&plant, master, 1);\n  Plant_close(&plant);\n"
        "  ecatm_master_close(master);\n  return 0;\n}\n",
        *(tmp_path / "out", tmp_path),
    )
    models = [player.Model(generate_fmu(again, f"Plant{fmi}", tmp_path, fmi).fmu) for fmi in (2, 3)]
    with served(bus) as name:
        assert run(program, name).stderr == ""
        for model in models:
            with model.play(bus=name) as instance:
                assert instance.errors() == []
