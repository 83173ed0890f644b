"""`ecatctl xml`: what it writes has the elements of an ESI file, and is read as one."""

from pathlib import Path
from xml.etree import ElementTree

from bus_strategies import buses
from hypothesis import HealthCheck, given, settings

from ecatd.description.bus import Bus
from ecatd.etg.pdo import Pdo
from ecatd.vendor.esi import list_devices, read_device
from ecatd.vendor.esi.writer import bus_document
from ecatdev import sample_buses


def layout(pdos: list[Pdo]) -> list[object]:
    return [
        (
            pdo.index,
            pdo.name,
            [(e.index, e.subindex, e.bit_length, e.name, e.data_type) for e in pdo.entries],
        )
        for pdo in pdos
    ]


def test_an_esi_reader_finds_the_same_devices(tmp_path: Path) -> None:
    bus = sample_buses.troll()
    for slave in bus.slaves:
        for pdo in slave.outputs + slave.inputs:
            for entry in pdo.entries:
                if entry.is_gap:
                    entry.name, entry.subindex = "", 0
    root = ElementTree.fromstring(bus_document(bus, "1"))
    assert root.tag == "EtherCATInfoList"
    assert len(root) == len(bus.slaves)
    for slave, element in zip(bus.slaves, root, strict=True):
        path = tmp_path / f"{slave.position}.xml"
        ElementTree.ElementTree(element).write(path)
        (choice,) = list_devices(path)
        device = read_device(path, choice)
        assert (device.vendor, device.product, device.revision) == (
            slave.vendor,
            slave.product,
            slave.revision,
        )
        assert layout([*device.outputs]) == layout(slave.outputs)
        assert layout([*device.inputs]) == layout(slave.inputs)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(bus=buses)
def test_any_bus_is_well_formed(bus: Bus) -> None:
    root = ElementTree.fromstring(bus_document(bus, "1"))
    assert [item.get("Position") for item in root] == [str(s.position) for s in bus.slaves]
