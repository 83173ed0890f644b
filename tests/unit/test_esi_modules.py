"""Modules in the slots of a device, as ESI files describe them (ETG.5001)."""

from pathlib import Path

import pytest

from conftest import names, names_at
from ecatd.base.errors import ConfigError
from ecatd.config import Config, ModuleConfig, SlaveConfig
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Module, Slave
from ecatd.vendor.esi import EsiDevice, choose, list_devices, module_problems, plug, read_device
from ecatd.vendor.esi.check import pdo_problems
from ecatd.vendor.esi.configure import add_esi
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
    names_at(said, f"{file}:26: <Index> | 0x6000 | 0x10000 | slot | PDO | left out")
    assert [pdo.index for pdo in device.inputs] == [0x1AFF]


OUTPUT_INDEX = '<Index DependOnSlot="1">#x1600</Index>'
_AXIS = '\n<Module><Type ModuleIdent="#x0303"'
_CHOICE = (
    '<RxPdo><Index DependOnSlot="1">#x1608</Index><Exclude>#x1600</Exclude><Name>Other</Name>'
    "</RxPdo></Module>"
)
"""A second PDO of the module AO1."""


@pytest.mark.parametrize("exclude", ["<Exclude>", '<Exclude DependOnSlot="1">'])
def test_an_exclusion_within_a_module_moves_with_its_pdos(file: Path, exclude: str) -> None:
    choice = _CHOICE.replace("<Exclude>", exclude)
    file.write_text(ISLAND.replace("</Module>" + _AXIS, choice + _AXIS))
    device = plug(island(file), [AO, AO])
    assert {pdo.index: pdo.excludes for pdo in device.outputs} == {
        0x1600: [0x1608],
        0x1608: [0x1600],
        0x1601: [0x1609],
        0x1609: [0x1601],
    }
    settings = SlaveConfig(0, module=[ModuleConfig(1, AO), ModuleConfig(2, AO)])
    settings.pdos = [0x1600, 0x1609, 0x1AFF]
    assert list(pdo_problems(settings, island(file))) == []
    settings.pdos = [0x1600, 0x1601, 0x1609, 0x1AFF]
    (problem,) = pdo_problems(settings, island(file))
    names(problem, "0x1601", "0x1609")


def test_the_pdo_of_one_module_excludes_that_of_another_one(file: Path) -> None:
    file.write_text(
        ISLAND.replace("<Index>#x1700</Index>", "<Index>#x1700</Index><Exclude>#x1601</Exclude>")
    )
    device = plug(island(file), [DI, AO, AXIS])
    (said,) = device.findings.texts
    names_at(said, f"{file}:43: PDO 0x1700 excludes 0x1601 | by default | both are used")
    assert len(plug(island(file), [AO, 0, AXIS]).findings) == 0, "slot 1 has 0x1600"
    settings = SlaveConfig(0, module=[ModuleConfig(2, AO), ModuleConfig(3, AXIS)])
    settings.pdos = [0x1601, 0x1700, 0x1AFF]
    (problem,) = pdo_problems(settings, island(file))
    names(problem, "0x1601", "0x1700", "exclude each other")


@pytest.mark.parametrize("says", ["0x1600", "0x1700"])
def test_one_of_two_pdos_that_exclude_each_other_stands_for_a_mandatory_one(
    file: Path, says: str
) -> None:
    text = ISLAND.replace('<Exclude DependOnSlot="1">#x1608</Exclude>', "")
    text = text.replace('<RxPdo Sm="2"><Index Dep', '<RxPdo Mandatory="1"><Index Dep')
    index, other = OUTPUT_INDEX, "#x1700"
    if says == "0x1700":
        index, other = "<Index>#x1700</Index>", "#x1600"
    file.write_text(text.replace(index, f"{index}<Exclude>{other}</Exclude>"))
    settings = SlaveConfig(0, module=[ModuleConfig(1, AO), ModuleConfig(3, AXIS)])
    settings.pdos = [0x1700, 0x1AFF]
    assert list(pdo_problems(settings, island(file))) == []
    device = device_from_esi(file, "Island", modules=["AO1", "", "Axis"])
    device.dictionary[0x1C12, 0].write(b"\0")
    for index in (0x1600, 0x1700):
        device.dictionary[0x1C12, 1].write(index.to_bytes(2, "little"))
        device.dictionary[0x1C12, 0].write(b"\1")
        device.dictionary[0x1C12, 0].write(b"\0")


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
