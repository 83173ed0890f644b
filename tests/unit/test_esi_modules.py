"""Modules in the slots of a device, as ESI files describe them (ETG.5001)."""

from pathlib import Path

import pytest

from conftest import names, names_at
from ecatd.esi import EsiDevice, choose, list_devices, module_problems, plug, read_device
from ecatd.esi.check import pdo_problems
from ecatd.esi.configure import add_esi
from ecatd.model.bus import Bus, Module, Slave
from ecatd.model.config import Config, ModuleConfig, SlaveConfig
from ecatd.model.config.writer import write_config
from ecatd.model.errors import ConfigError
from ecatsim.files.esi import device_from_esi
from esi_island import ISLAND

DI, AO, AXIS = 0x0101, 0x0202, 0x0303


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "island.xml"
    path.write_text(ISLAND)
    return path


def island(file: Path, kind: str = "Island") -> EsiDevice:
    return read_device(file, choose(list_devices(file), file, type=kind))


def test_slots_and_their_modules(file: Path) -> None:
    device = island(file)
    assert [slot.name for slot in device.slots] == ["I/O", "I/O", "Axis"]
    assert [module.type for module in device.modules] == ["DI2", "AO1", "Axis"]
    plain = island(file, "Plain")
    assert (plain.slots, plain.modules) == ([], [])


def test_modules_bring_their_pdos_and_objects(file: Path) -> None:
    device = plug(island(file), [DI, AO, AXIS])
    assert [pdo.index for pdo in device.inputs] == [0x1AFF, 0x1A00]
    assert [entry.index for entry in device.inputs[1].entries] == [0x6000, 0x6000, 0]
    output, control = device.outputs
    assert (output.index, output.entries[0].index, output.excludes) == (0x1601, 0x7010, [0x1609])
    # Its PDO does not depend on the slot; its object is behind two slots with 0x10 objects each.
    assert (control.index, control.entries[0].index) == (0x1700, 0x6060)
    (command,) = device.commands
    assert (command.index, command.data) == (0x8010, b"\x05\0")
    assert [item.index for item in device.objects] == [0x8010]
    assert island(file).outputs == []


def test_modules_that_do_not_fit_their_slots(file: Path) -> None:
    device = island(file)
    assert list(module_problems(device, [DI, 0, AXIS])) == []
    (problem,) = module_problems(device, [AXIS])
    names(problem, "slot 1", "Axis (0x00000303)", "DI2 (0x00000101)", "AO1 (0x00000202)")
    (problem,) = module_problems(device, [0, 0x0999])
    names(problem, "slot 2", "0x00000999", "DI2 (0x00000101)")
    (problem,) = module_problems(device, [0, 0, 0, DI])
    names(problem, "slot 4", "3 slots")


def test_an_index_beyond_the_last_one(file: Path) -> None:
    file.write_text(ISLAND.replace('SlotIndexIncrement="#x10"', 'SlotIndexIncrement="#xA000"'))
    device = plug(island(file), [0, DI])
    (said,) = device.findings.texts
    names_at(said, f"{file}:26: <Index> | 0x6000 | 0x10000 | slot | this PDO is left out")
    assert [pdo.index for pdo in device.inputs] == [0x1AFF]


def test_the_pdos_of_modules_may_be_assigned(file: Path) -> None:
    settings = SlaveConfig(0, module=[ModuleConfig(1, DI), ModuleConfig(2, AO)])
    settings.pdos = [0x1601, 0x1AFF, 0x1A00]
    assert list(pdo_problems(settings, island(file))) == []
    settings.pdos = [0x1600, 0x1AFF]
    (problem,) = pdo_problems(settings, island(file))
    names(problem, "0x1600", "0x1601")


def test_a_configuration_has_what_the_modules_bring(file: Path) -> None:
    slave = Slave(0, "", 0xFFFF, 0x77, 1, coe=True)
    slave.modules = [Module(DI), Module(AO), Module(0x55)]
    config = Config()
    notes = add_esi(config, Bus("ecat0", 1000, [slave]), {0: island(file)})
    text = write_config(config, Bus("ecat0", 1000, [slave]), "1.0", notes)
    names(text, 'type = "DI2"', 'type = "AO1"', "slot = 3", "0x00000055", "slot 3")
    names(text, 'object = "0x8010:00"', "value = 5", 'comment = "range"', "0x1601")


def test_a_device_with_modules_is_simulated(file: Path) -> None:
    device = device_from_esi(file, "Island", modules=["DI2", "", 0x0303])
    assert device.modules == [DI, 0, AXIS]
    assert [pdo.index for pdo in device.tx_pdos] == [0x1AFF, 0x1A00]
    assert device.dictionary[0xF050, 3].value == AXIS
    for wrong, tokens in (
        (["AI9"], ["AI9", "DI2", "0x00000108"]),
        ([0x0303], ["slot 1", "0x00000303"]),
    ):
        with pytest.raises(ConfigError) as error:
            device_from_esi(file, "Island", modules=wrong)
        names(error.value, "Island", *tokens)


@pytest.mark.parametrize(
    ("tables", "kept"), [([DI, AO], True), ([DI, AXIS], False), ([], True)], ids=str
)
def test_pdos_of_other_modules_are_not_kept(tables: list[int], kept: bool) -> None:
    slave = Slave(0, "", 0xFFFF, 0x77, 1, coe=True, modules=[Module(DI), Module(AO)])
    modules = [ModuleConfig(slot, ident) for slot, ident in enumerate(tables, 1)]
    config = Config(slave=[SlaveConfig(0, module=modules, pdos=[0x1A00])])
    text = write_config(config, Bus("ecat0", 1000, [slave]), "1.0")
    assert ("\npdos = [0x1A00]" in text) == kept
    assert text.count("[[slave.module]]") == 2
    alone = write_config(Config(), Bus("ecat0", 1000, [slave]), "1.0")
    assert "\npdos" not in alone, "the slave assigns them by itself"
