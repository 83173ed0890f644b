"""Configurations that do not fit their bus: each mistake is named with file, line and key."""

from pathlib import Path

import pytest

from conftest import names, names_at, without_notes
from ecatd.base.errors import StateError
from ecatd.config import load_config, read_config
from ecatd.config.origins import find_origins, texts
from ecatd.config.profiles import load_profiles
from ecatd.config.resolve import check_slaves, misfits
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

HEAD = "[[slave]]\nposition = 0\nname = 'press'\n"
"""Three lines in front of each of the mistakes."""


def pdo(index: int, manager: int, *objects: int, bits: int = 16) -> Pdo:
    kinds = {16: DataType.INTEGER16, 4: DataType.BIT4, 128: DataType.OCTET_STRING}
    return Pdo(index, "", manager, [Entry(number, 0, "", kinds[bits], bits) for number in objects])


def made_bus() -> Bus:
    """A drive, a sensor without a clock, an optional slave, and a coupler."""
    drive = Slave(0, "D", 1, 2, 3, dc_bits=64, coe=True, watchdog_ms=100)
    drive.outputs = [pdo(0x1600, 2, 0x6040, 0x6060, 0x60FF), pdo(0x1601, 2, 0x2000, bits=128)]
    drive.inputs = [pdo(0x1A00, 3, 0x6041, 0x606C)]
    sensor = Slave(1, "S", 1, 3, 3, inputs=[pdo(0x1A00, 3, 0x6000), pdo(0x1A01, 3, 0x6010, bits=4)])
    spare = Slave(2, "O", 1, 4, 3, dc_bits=32, group="slave 2", outputs=[pdo(0x1600, 2, 0x7000)])
    return Bus("b", 1000, [drive, sensor, spare, Slave(3, "K", 1, 5, 3)])


def copy(more: str = "", source: str = "0x6000:00", target: str = "0x60FF:00") -> str:
    return (
        f"[[copy]]\nslave = 'press'\nentry = '{target}'\nfrom_slave = 1\nfrom_entry = '{source}'\n"
        f"{more}"
    )


UNITS = (
    "[[signal]]\nslave = 0\nentry = '0x60FF:00'\nunit = 'rpm'\n"
    "[[signal]]\nslave = 1\nentry = '0x6000:00'\nunit = 'V'\n"
)

LATE = "[[domain]]\nslaves = [1, 2]\n[[domain]]\ndivider = 100\nslaves = ['press']\n"
TOLD = "[[slave]]\nposition = 1\n[[slave.{}]]\n"

MISFITS = [
    (LATE, "7: domain[1].divider: domain 1 | 100 ms | slave 0 (press, D) | watchdog_ms"),
    (
        TOLD.format("startup") + "object = '0x2000:00'\ntype = 'uint8'\nvalue = 1\n",
        "6: slave[1].startup[0]: slave 1 (S) | CoE | remove",
    ),
    (
        TOLD.format("pdo") + "index = 0x1A00\nentries = []\n",
        "6: slave[1].pdo[0]: slave 1 (S) | CoE | remove",
    ),
    (
        TOLD.format("module") + "slot = 1\nident = 8\n",
        "6: slave[1].module[0]: slave 1 (S) | CoE | remove",
    ),
    ("[[slave]]\nposition = 4\n", "5: slave[1].position: no slave 4 | 'b' | 4 slaves | 0 to 3"),
    (
        "[[domain]]\n[[domain]]\ndivider = 2\nslaves = [1, '5-7']\n",
        "7: domain[1].slaves: no slaves 5-7 | 0 to 3",
    ),
    (
        "[[domain]]\n[[domain]]\nname = 'slow'\nslaves = [3]\n",
        "7: domain[1].slaves: domain 1 (slow) | nothing | remove",
    ),
    ("[[outputs.safe]]\nslave = 4\n", "5: outputs.safe[0].slave: slave 4"),
    ("[[outputs.safe]]\nslave = 1\n", "5: outputs.safe[0].slave: slave 1 (S) | no outputs"),
    (
        "[[outputs.safe]]\nslave = 0\nentry = '0x7000:00'\nvalue = 1\n",
        "6: outputs.safe[0].entry: slave 0 (press, D) | 0x7000:00 | ecatctl pdos 0",
    ),
    (
        "[[outputs.safe]]\nslave = 0\nentry = '0x60FF:00'\nvalue = 40000\n",
        "7: outputs.safe[0].value: 40000 | 0x60FF:00 | slave 0 (press, D) | 32767",
    ),
    (
        "[[outputs.safe]]\nslave = 2\nvalue = 'quick_stop'\n",
        "6: outputs.safe[0].value: quick_stop | slave 2 (O) | 0x6040:00",
    ),
    ("[[signal]]\nslave = 9\nentry = '0x6000:00'\n", "5: signal[0].slave: slave 9"),
    (
        "[[signal]]\nslave = 1\nentry = '0x6001:00'\n",
        "6: signal[0].entry: slave 1 (S) | 0x6001:00 | ecatctl pdos 1",
    ),
    (
        "[[signal]]\nslave = 1\nentry = '0x6000:00'\nmaximum = 3\n",
        "7: signal[0].maximum: 0x6000:00 | slave 1 (S) | input | leave",
    ),
    (
        "[[signal]]\nslave = 0\nentry = '0x60FF:00'\nminimum = 40_000.0\n",
        "7: signal[0].minimum: 0x60FF:00 | slave 0 (press, D) | 40000 | correct",
    ),
    (
        "[[signal]]\nslave = 0\nentry = '0x60FF:00'\nminimum = 5.0\n",
        "7: signal[0].minimum: 0x60FF:00 | slave 0 (press, D) | [[outputs.safe]]",
    ),
    (
        "[[signal]]\nslave = 0\nentry = '0x60FF:00'\nminimum = 5.0\n"
        "[[outputs.safe]]\nslave = 0\nentry = '0x60FF:00'\nvalue = 4\n",
        "11: outputs.safe[0].value: 0x60FF:00 | slave 0 (press, D) | 4",
    ),
    (
        "[[signal]]\nslave = 0\nentry = '0x2000:00'\nname = 'x'\n",
        "6: signal[0].entry: 0x2000:00 | slave 0 (press, D) | 128 bits | remove",
    ),
    (copy().replace("'press'", "6"), "5: copy[0].slave: slave 6"),
    (copy().replace("_slave = 1", "_slave = 6"), "7: copy[0].from_slave: slave 6"),
    (copy(source="0x6001:00"), "8: copy[0].from_entry: slave 1 (S) | 0x6001:00 | ecatctl pdos 1"),
    (copy(target="0x6041:00"), "6: copy[0].entry: slave 0 (press, D) | 0x6041:00 | input"),
    (copy(target="0x2000:00"), "6: copy[0].entry: 0x2000:00 | slave 0 (press, D) | 128 | remove"),
    (copy(source="0x6010:00"), "4: copy[0]: 0x6010:00 | 0x60FF:00 | BIT4 | correct"),
    (copy() + UNITS, "4: copy[0].factor: slave 1 (S) | slave 0 (press, D) | rpm | V | factor ="),
    (
        f"{copy(target='0x6040:00')}[[outputs.safe]]\nslave = 0\nvalue = 'disable'\n",
        "6: copy[0].entry: 0x6040:00 | slave 0 (press, D) | [[outputs.safe]] | remove",
    ),
    ("[[dc.slave]]\nslave = 8\n", "5: dc.slave[0].slave: slave 8"),
    ("[dc]\nenabled = true\nreference = 8\n", "6: dc.reference: slave 8"),
    ("[dc]\nenabled = true\nreference = 1\n", "6: dc.reference: slave 1 (S) | 0, 2"),
    (
        "[[slave]]\nposition = 2\nvendor = 1\nproduct = 4\noptional = true\n"
        "[dc]\nenabled = true\nreference = 2\n",
        "11: dc.reference: slave 2 (O) | optional",
    ),
    ("[[dc.slave]]\nslave = 1\n", "5: dc.slave[0].slave: slave 1 (S) | clock | 0, 2"),
    (
        "[[dc.slave]]\nslave = 2\nsync1_us = 3e6\n",
        "4: dc.slave[0].sync0_us: slave 2 (O) | 32 bits | SYNC",
    ),
    (
        "[[slave.startup]]\nobject = '0x2001:00'\ntype = 'int16'\nvalue = 1\nunit = 'rpm'\n",
        "7: slave[0].startup[0].value: slave 0 (press, D) | 0x2001:00 | rpm",
    ),
]


@pytest.mark.parametrize(("text", "message"), MISFITS)
def test_a_mistake_is_named_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    place, tokens = message.split(": ", 2)[:2], message.split(": ", 2)[2]
    file = tmp_path / "ecat0.toml"
    file.write_text(HEAD + text)
    config = load_config(file)
    # Another process gets the configuration without the file.
    handed_on = read_config(config.to_dict(), origins=texts(find_origins(config)))
    for read in (config, handed_on):
        said, *_ = misfits(read, made_bus(), load_profiles())
        said = without_notes(said)
        assert said.startswith(f"{file}:{place[0]}: {place[1]}: "), said
        names(said, *tokens.split(" | "))
        assert "\n" not in said


def test_an_exchange_within_the_watchdog_fits(tmp_path: Path) -> None:
    file = tmp_path / "ecat0.toml"
    file.write_text(f"{HEAD}watchdog_ms = 100.1\n{LATE}")
    assert not misfits(load_config(file), made_bus(), load_profiles())
    file.write_text(f"{HEAD}watchdog_ms = 0\n{LATE}")
    assert not misfits(load_config(file), made_bus(), load_profiles())
    file.write_text(f"cycle_time_us = 2000\n{HEAD}watchdog_ms = 2")
    (short,) = misfits(load_config(file), made_bus(), load_profiles())
    names_at(short, f"{file}:5: slave[0].watchdog_ms: every 2 ms | waits 2 ms | slave 0 (press, D)")
    file.write_text(f"{HEAD}vendor = 1\nproduct = 2\n")
    bus = made_bus()
    bus.slaves[0].watchdog_ms = 0
    (off,) = misfits(load_config(file), bus, load_profiles())
    names_at(off, f"{file}:1: slave[0].watchdog_ms: watchdog_ms = 100 | watchdog_ms = 0")


def test_all_mistakes_are_listed(tmp_path: Path) -> None:
    apart = ("domain", "[dc]", "position = 1")
    texts = [UNITS, *(text for text, _ in MISFITS if not any(word in text for word in apart))]
    chosen = [text for text in texts if text.startswith(("[[outputs", "[[slave.s", "[[slave]"))]
    file = tmp_path / "ecat0.toml"
    file.write_text(HEAD + "".join(sorted(chosen, key=lambda text: "startup" not in text)))
    found = misfits(load_config(file), made_bus(), load_profiles())
    assert len(found) == len(chosen), found
    assert len({text.split(": ")[0] for text in found}) == len(chosen)


def test_the_first_mistake_is_raised(tmp_path: Path) -> None:
    file = tmp_path / "ecat0.toml"
    file.write_text(f"{HEAD}[[signal]]\nslave = 7\nentry = '0x6000:00'\n{copy(source='0x1:0')}")
    with pytest.raises(StateError) as refused:
        check_slaves(load_config(file), made_bus())
    assert str(refused.value).startswith(f"{file}:5: signal[0].slave: ")
