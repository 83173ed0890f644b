"""What a slave keeps of its PDOs when it refuses others."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from test_simulator_topology import FIRST, run

from conftest import names
from ecatd.base.errors import EcatError
from ecatd.base.timeouts import Timeout
from ecatd.config import Config, load_config
from ecatd.etg.al import AlState
from ecatd.master.master import Master
from ecatd.server.start import mapping
from ecatd.server.start.scanned import identify_slaves

pytestmark = pytest.mark.bus

AXIS = 1


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    file = tmp_path / "rig.toml"
    file.write_text('name = "axis"\n[[slave]]\ndevice = "EK1100"\n[[slave]]\ndevice = "CiA402"\n')
    return file


def master_that_writes(*tables: str) -> Any:
    """Configures the slave with its own PDOs, then with those of each table, then with its own."""
    master, found = Master([FIRST]), []
    try:
        master.scan(Timeout(5.0))
        master.al_states.wait_for(AlState.PREOP, Timeout(5.0))
        scanned = identify_slaves(master)
        for table in ("", *tables, ""):
            with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
                file.write(f"[[slave]]\nposition = {AXIS}\n{table}" if table else "")
                file.flush()
                config = load_config(Path(file.name)) if table else Config()
                try:
                    mapping.configure_slaves(master, scanned, config)
                    refused = [*scanned[AXIS].refused, *scanned[AXIS].settled]
                except EcatError as error:
                    refused = [str(error)]
            pdos = (*scanned[AXIS].slave.outputs, *scanned[AXIS].slave.inputs)
            shown = [[pdo.index, *(entry.index for entry in pdo.entries)] for pdo in pdos]
            found.append([refused, shown])
    finally:
        master.close()
    return found


@pytest.mark.parametrize(
    ("entry", "tokens"),
    [
        ("object = '0x7777:00', bits = 16", ["slave 1", "0x7777:00", "0x1A00", "0x6041"]),
        ("object = '0x6041:00', bits = 32", ["slave 1", "0x6041:00", "16", "32", "0x1A00"]),
        ("object = '0x6060:00', bits = 8", ["slave 1", "entry 2", "0x6060:00", "0x6041"]),
    ],
)
def test_a_refused_mapping_leaves_the_slave_as_it_was(
    rig: Path, entry: str, tokens: list[str]
) -> None:
    entries = f"[{{ object = '0x6064:00', bits = 32 }}, {{ {entry} }}]"
    table = f"[[slave.pdo]]\nindex = 0x1A00\nentries = {entries}\n"
    first, refused, last = run(rig, master_that_writes, table)
    names(*refused[0], *tokens)
    assert last == first
    assert first[0] == []
    assert any(pdo[0] >= 0x1A00 and len(pdo) > 1 for pdo in first[1])


def test_a_slave_that_names_no_pdo_anywhere_is_told(rig: Path) -> None:
    rig.write_text(
        'name = "silent"\n[[slave]]\ndevice = "EK1100"\n[[slave]]\n'
        'vendor = 0xFFFF\nproduct = 1\nname = "ClipX"\nmailbox = {}\n'
    )
    first, last = run(rig, master_that_writes)
    assert first == last
    names(*first[0], "slave 1 (ClipX)", "no process data", "EEPROM", "[[slave.pdo]]")
    assert first[1] == []


def test_a_slave_without_its_usual_pdos_is_named(rig: Path) -> None:
    """So somebody has left it who has begun to write its PDOs, and no more."""
    first, _, last = run(rig, master_that_writes, "pdos = ['0x1600']\n")
    assert first[0] == []
    names(*last[0], "slave 1", "inputs", "0x1A00", "[[slave]]")
