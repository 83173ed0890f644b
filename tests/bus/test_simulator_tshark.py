"""tshark reads along: every frame of a start-up is what its dissector knows.

This file is a rig file as well.
"""

import collections
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from masters import INIT, OP, SAFEOP, cycle, open_pysoem, recording, run, to_op
from test_simulator_kickcat import master_kickcat
from test_simulator_masters import Sample

from ecatsim import Mailbox, Rig

pytestmark = [
    pytest.mark.bus,
    pytest.mark.long,
    pytest.mark.skipif(not shutil.which("tshark"), reason="tshark is not installed"),
]

HERE = Path(__file__)
FOE, COE = 0x08, 0x04
WARNING = 0x600000
MESSAGE = ("-e", "_ws.expert.message")


class WithFiles(Sample):
    """Takes and gives files."""

    order = "WithFiles"
    mailbox = Mailbox(coe_details=0x2F, protocols=COE | FOE)


def rig():
    return Rig("files", [WithFiles(), WithFiles()])


def tshark(file, *arguments):
    """Lines that tshark prints about a recording."""
    result = subprocess.run(
        ["tshark", "-r", file, *arguments], capture_output=True, text=True, check=True
    )
    return result.stdout.splitlines()


def commands(file):
    """How often each command was sent."""
    fields = tshark(file, "-T", "fields", "-e", "ecat.cmd")
    return collections.Counter(int(cmd, 16) for line in fields for cmd in line.split(","))


def check(file, least):
    """Nothing but EtherCAT, and nothing that the dissector complains about."""
    assert tshark(file, "-Y", "_ws.malformed || _ws.short") == []
    said = tshark(file, "-Y", f"_ws.expert.severity >= {WARNING}", *("-T", "fields"), *MESSAGE)
    # SOEM sends from 01:01:01:01:01:01, and what a slave does not change stays as it is.
    assert {text for text in said if "Source MAC must not be a group address" not in text} == set()
    assert len(tshark(file, "-Y", "ecatf")) == len(tshark(file)) > least


def master_recorded(file):
    """A whole life with SOEM: scan, PREOP, SDOs, clocks, SAFEOP, OP, cycles, and down again."""
    with recording(file):
        master = open_pysoem(lambda master: master.config_dc())
        to_op(master)
        for slave in master.slaves:
            if slave.name == "Gold EtherCAT GCON Drive":
                slave.sdo_read(0x1008, 0, 100)
                _ = [entry.name for entry in slave.od[0].entries]
        cycle(master, 50)
        for state in (SAFEOP, INIT):
            master.state = state
            master.write_state()
            while master.read_state() != state:
                time.sleep(0.001)
        master.close()


@pytest.mark.parametrize(("rig_name", "least"), [("troll", 1000), ("line:8", 500)])
def test_soem(tmp_path, rig_name, least):
    file = tmp_path / "soem.pcap"
    run(rig_name, master_recorded, str(file))
    check(file, least)
    assert commands(file)[12] > 50, "LRW"
    assert commands(file)[14] > 50, "FRMW, by which clocks are kept together"
    if rig_name == "troll":
        assert len(tshark(file, "-Y", "ecat_mailbox.coe.sdoreq")) > 50, "mailboxes are understood"
        assert tshark(file, "-Y", "ecat_mailbox.coe.sdoinfoopcode"), "and SDO information"


def master_recorded_files(file):
    """A file of several segments there and back, and one that is not there."""
    with recording(file):
        master = open_pysoem()
        first = master.slaves[0]
        data = bytes(range(256)) * 3
        first.foe_write("firmware.bin", 0, data)
        same = first.foe_read("firmware.bin", 0, 1000) == data
        return [same, bool(first.foe_read("nothing", 0, 100))]


def test_files(tmp_path):
    file = tmp_path / "files.pcap"
    assert run(HERE, master_recorded_files, str(file)) == [True, False]
    check(file, 500)
    foe = tshark(file, "-Y", "ecat_mailbox.foe && ecat.cnt == 1")
    for what, least in (("FoE WRQ", 1), ("FoE RRQ", 2), ("FoE DATA", 14), ("FoE ERR", 1)):
        assert len([line for line in foe if what in line]) >= least, what


def master_recorded_kickcat(file):
    with recording(file):
        return master_kickcat()["states"]


@pytest.mark.parametrize("rig_name", ["troll", "line:8"])
def test_kickcat(tmp_path, rig_name):
    file = tmp_path / "kickcat.pcap"
    assert run(rig_name, master_recorded_kickcat, str(file)) == [OP, 8]
    check(file, 500)
