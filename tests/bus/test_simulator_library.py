"""Every device of the library on one segment, in OP with two real masters: pysoem and kickcat.

Masters run as commands inside `ecatsim run`; this file is the rig as well.
"""

import struct
import time
from pathlib import Path

import pytest
from masters import cycle, open_pysoem, run, to_op
from test_simulator_kickcat import master_kickcat

from ecatsim.devices.library import library, make
from ecatsim.rig import Rig

pytestmark = pytest.mark.bus

HERE = Path(__file__)


# SOEM asks drives 0 to 7 of a slave with SoE, and pysoem takes each refusal for its own failure.
DEVICES = [item for item in library() if item.name != "SoeDrive"]


def rig():
    """These devices; outputs are wired to inputs of the same kind."""
    devices = {item.name: make(item.name) for item in DEVICES}
    result = Rig("library", list(devices.values()))
    result.connect_entries((devices["EL2004"], 0x7030, 1), (devices["EL1008"], 0x6020, 1))
    result.connect_entries((devices["EL4008"], 0x7070, 1), (devices["EL3102"], 0x6010, 0x11))
    result.connect_entries(
        (devices["EL4004"], 0x7000, 1), (devices["AnalogIO"], 0x6000, 4), scale=-0.5
    )
    result.connect_entries((devices["DigitalIO"], 0x7000, 8), (devices["DigitalIO"], 0x6000, 1))
    return result


def master_all_in_op():
    master = open_pysoem()
    found = [
        [slave.name, slave.man, slave.id, slave.rev, len(slave.output), len(slave.input)]
        for slave in master.slaves
    ]
    to_op(master)
    slaves = {slave.name: slave for slave in master.slaves}
    slaves["EL2004"].output = b"\x08"
    slaves["EL4004"].output = struct.pack("<4h", 32767, 0, 0, 0)
    slaves["EL4008"].output = struct.pack("<8h", *[0] * 7, 16384)
    slaves["DigitalIO"].output = b"\x80"
    end = time.monotonic() + 120
    while time.monotonic() < end:
        cycle(master)
        values = {
            "EL1008": slaves["EL1008"].input[0],
            "EL3102": struct.unpack_from("<h", slaves["EL3102"].input, 6)[0],
            "AnalogIO": struct.unpack_from("<h", slaves["AnalogIO"].input, 6)[0],
            "DigitalIO": slaves["DigitalIO"].input[0],
        }
        if all(values.values()):
            break
    return [found, values]


def test_pysoem_finds_every_device_as_the_library_lists_it_and_reaches_op():
    found, values = run(HERE, master_all_in_op)
    assert [row[1:] for row in found] == [
        [item.vendor, item.product, item.revision, item.output_size, item.input_size]
        for item in DEVICES
    ]
    assert [row[0] for row in found] == [make(item.name).order for item in DEVICES]
    assert values == {"EL1008": 4, "EL3102": 16384, "AnalogIO": -16384, "DigitalIO": 1}


@pytest.mark.long
def test_kickcat_brings_every_device_to_op():
    found = run(HERE, master_kickcat)["data"]
    assert [(size, len(data) // 2) for size, data in found] == [
        (item.output_size, item.input_size) for item in DEVICES
    ]


def master_branches():
    master = open_pysoem()
    links = []
    for slave in master.slaves:
        (status,) = struct.unpack("<H", slave._fprd(0x0110, 2))
        links.append([port for port in range(4) if status >> 4 + port & 1])
    to_op(master)
    slaves = master.slaves
    slaves[5].output = b"\x0a"
    slaves[8].output = struct.pack("<4h", 16384, 0, 0, 0)
    end = time.monotonic() + 120
    while time.monotonic() < end:
        cycle(master)
        values = [slaves[6].input[0], struct.unpack_from("<h", slaves[9].input, 2)[0]]
        if all(values):
            break
    return [[slave.name for slave in slaves], links, values]


def test_the_rig_branches():
    """Frames visit the branch at port 3 of the junction, then that at port 1, then the E-bus."""
    names, links, values = run("branches", master_branches)
    assert names == [
        *("EK1100", "EL2008", "EL1008", "EK1122"),
        *("EK1100", "EL2004", "EL1018"),
        *("EK1100", "EL4004", "EL3102"),
        "EL2008",
    ]
    line, end = [0, 1], [0]
    assert links == [line, line, line, [0, 1, 2, 3], line, line, end, line, line, end, end]
    assert values == [0x0A, 16384]
