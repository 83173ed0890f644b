"""Real masters on devices made from SII images and ESI files. This file is a rig file as well."""

import sys
import tempfile
from pathlib import Path

import pytest
from masters import cycle, open_pysoem, run, to_op
from test_simulator_kickcat import master_kickcat
from test_simulator_masters import master_scan

from ecatsim.files.esi import device_from_esi
from ecatsim.files.sii_image import device_from_sii
from ecatsim.rig import Rig
from ecatsim.rigs.library import make

HERE = Path(__file__)
sys.path.insert(0, str(HERE.parents[1] / "unit"))

from esi_sample import SAMPLE  # noqa: E402

pytestmark = pytest.mark.bus


def rig():
    """Coupler and terminals from the SII images of others, and devices from an ESI file."""
    library = [device for device in make("troll").devices if device.order in TERMINALS]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.xml"
        path.write_text(SAMPLE, encoding="utf-8")
        axis = device_from_esi(path, type="AX2", revision=0x00020001)
        inputs = device_from_esi(path, product=0x00005678)
    copies = [device_from_sii(device.sii_image(), device.order) for device in library]
    made = Rig("files", [*copies, axis, inputs])
    outputs = next(device for device in copies if device.order == "EL2008")
    made.connect_entries((outputs, 0x7010, 1), (inputs, 0x6000, 1))
    made.connect_entries((axis, 0x607A, 0), (axis, 0x2100, 2))
    return made


TERMINALS = ("EK1100", "EL1018", "EL2008", "EL3008")


def test_pysoem_brings_them_to_op():
    found = run(HERE, master_scan)
    assert found["slaves"] == [
        ["EK1100", 2, 0x044C2C52, 0x00120000, 0, 0],
        ["EL1018", 2, 0x03FA3052, 0x00110000, 0, 1],
        ["EL2008", 2, 0x07D83052, 0x00100000, 1, 0],
        ["EL3008", 2, 0x0BC03052, 0x00140000, 0, 32],
        ["EL3008", 2, 0x0BC03052, 0x00140000, 0, 32],
        ["AX2", 0xFFFF, 0x1234, 0x00020001, 6, 4],
        ["DI4", 0xFFFF, 0x5678, 1, 0, 1],
    ]


@pytest.mark.long
def test_kickcat_brings_them_to_op():
    found = run(HERE, master_kickcat)
    state, slaves = found["states"]
    assert (state & 0x0F, slaves) == (8, 7), "terminals return the acknowledge bit as well"
    assert [size for size, _ in found["data"]] == [0, 0, 1, 0, 0, 6, 0]


def master_values():
    master = open_pysoem()
    to_op(master)
    outputs, axis, inputs = (master.slaves[i] for i in (2, 5, 6))
    outputs.output = b"\x02"
    axis.output = b"\x0f\x00" + b"\x85\xff\xff\xff"
    cycle(master, 20)
    return {
        "inputs": [axis.input.hex(), inputs.input.hex()],
        "default": axis.sdo_read(0x2000, 3, 2).hex(),
        "text": axis.sdo_read(0x1008, 0, 20).decode(),
        "mapped": axis.sdo_read(0x6040, 0, 2).hex(),
        "names": [o.name.decode() for o in axis.od if o.index in (0x2000, 0x6040)],
    }


def test_dictionary_and_wires():
    found = run(HERE, master_values)
    assert found["inputs"] == ["00000085", "01"]
    assert (found["default"], found["text"], found["mapped"]) == ("feff", "Axis 2", "0f00")
    assert found["names"] == ["Settings", "Controlword"]
