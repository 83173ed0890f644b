"""Rigs with branches and rings: where devices are plugged in, and their order."""

import pytest

from conftest import naming
from ecatd.base.errors import UsageError
from ecatsim.devices.beckhoff import EK1100, EK1122
from ecatsim.esc import Chip
from ecatsim.rig import Rig
from ecatsim.simulation import Simulation
from ecatsim.slave.device import Device


class Box(Device):
    """Two Ethernet ports."""

    vendor, product, order = 1, 1, "Box"


class Terminal(Device):
    """Two E-bus ports."""

    vendor, product, order, chip = 1, 2, "Terminal", Chip(ports=0x0A)


class End(Device):
    """One Ethernet port."""

    vendor, product, order, chip = 1, 3, "End", Chip(ports=0x03)


@pytest.fixture
def parts():
    """A coupler, a junction, terminals and boxes."""
    return EK1100(), EK1122(), [Terminal(), Terminal()], [Box() for _ in range(4)]


def orders(rig):
    """The order on the wire from both interfaces, by position in `rig.devices`."""
    simulation = Simulation(rig)
    try:
        return [simulation.segment.order(interface) for interface in (0, 1)]
    finally:
        simulation.close()


def test_devices_are_a_line_at_ports_that_fit(parts):
    coupler, junction, terminals, boxes = parts
    rig = Rig("line", [boxes[0], coupler, terminals[0], junction, terminals[1], boxes[1]])
    assert rig.wiring().parents == [None, (0, 1), (1, 1), (2, 1), (3, 2), (4, 1)]
    assert orders(rig) == [list(range(6)), []]


def test_branches_put_devices_into_wire_order(parts):
    coupler, junction, terminals, boxes = parts
    rig = Rig("branches", [coupler, *boxes, terminals[0], junction, terminals[1]])
    rig.connect(terminals[0], coupler, 1)
    rig.connect(boxes[3], junction, 3)
    rig.connect(boxes[2], junction, 1)
    assert rig.devices == [
        *(coupler, terminals[0], junction, boxes[3], boxes[2], terminals[1]),
        *boxes[:2],
    ]
    assert rig.wiring().parents == [None, (0, 1), (1, 1), (2, 3), (2, 1), (2, 2), (0, 2), (6, 1)]
    assert orders(rig) == [list(range(8)), []]


def test_what_is_behind_a_device_comes_with_it(parts):
    coupler, _, terminals, boxes = parts
    rig = Rig("moved", [coupler, *terminals, *boxes])
    rig.connect(boxes[0], coupler, 2)
    assert rig.devices == [coupler, *terminals, *boxes]
    assert rig.wiring().parents == [None, (0, 1), (1, 1), (0, 2), (3, 1), (4, 1), (5, 1)]


def test_devices_may_be_added_behind_the_last_one(parts):
    coupler, _, terminals, boxes = parts
    rig = Rig("added", [coupler, terminals[0], boxes[0]])
    rig.connect(boxes[0], coupler, 2)
    rig.devices.append(boxes[1])
    assert rig.wiring().parents[-1] == (2, 1)


def test_rings(parts):
    coupler, _, terminals, boxes = parts
    rig = Rig("ring", [*boxes], ring=True)
    assert rig.wiring().ring_end == (3, 1)
    assert orders(rig) == [[0, 1, 2, 3], []]
    rig = Rig("branch in a ring", [boxes[0], coupler, *terminals, boxes[1]])
    rig.connect(boxes[1], coupler, 2)
    rig.close_ring(boxes[1], 1)
    assert rig.ring
    assert rig.wiring().ring_end == (4, 1)
    assert orders(rig) == [[0, 1, 2, 3, 4], []]


@pytest.mark.parametrize(
    ("device", "parent", "port", "message"),
    [
        (3, 0, 1, "port 1 | EK1100 (position 0) | Terminal (position 1)"),
        (3, 0, 3, "EK1100 (position 0) | port 3 | 0x3B | 0, 1, 2"),
        (3, 0, 7, "EK1100 (position 0) | port 7"),
        (3, 0, 0, "port 0 | EK1100 (position 0) | master"),
        (0, 2, 2, "EK1100 (position 0) | interface"),
        (1, 3, 1, "Box (position 3) | behind | Terminal (position 1)"),
        (1, 1, 1, "loop"),
    ],
)
def test_impossible_links(device, parent, port, message):
    rig = Rig("line", [EK1100(), Terminal(), EK1122(), Box(), Box()])
    before = list(rig.devices)
    with pytest.raises(UsageError, match=naming(*message.split(" | "))):
        rig.connect(rig.devices[device], rig.devices[parent], port)
    assert rig.devices == before


def test_impossible_rigs():
    rig = Rig("end", [Box(), End(), Box()])
    with pytest.raises(UsageError, match=naming("End (position 1)", "port 1", 0)):
        Simulation(rig)
    with pytest.raises(UsageError, match=naming("Box", "device")):
        rig.connect(Box(), rig.devices[0], 1)
    inserted = Rig("inserted", [EK1100(), Terminal(), Box()])
    inserted.connect(inserted.devices[2], inserted.devices[0], 2)
    inserted.devices.insert(1, Terminal())
    with pytest.raises(
        UsageError, match=naming("port 1", "EK1100 (position 0)", "Terminal (position 2)")
    ):
        Simulation(inserted)


def test_impossible_rings():
    rig = Rig("ring", [Box(), EK1100(), Terminal(), End()])
    with pytest.raises(UsageError, match=naming("EK1100 (position 1)", "port 3")):
        rig.close_ring(rig.devices[1], 3)
    with pytest.raises(
        UsageError, match=naming("port 1", "Box (position 0)", "EK1100 (position 1)")
    ):
        rig.close_ring(rig.devices[0], 1)
    with pytest.raises(UsageError, match=naming("Box", "device")):
        rig.close_ring(Box(), 1)
    rig.ring = True
    with pytest.raises(UsageError, match=naming("End (position 3)", "free port")):
        Simulation(rig)
    rig.close_ring(rig.devices[1], 2)
    with pytest.raises(
        UsageError, match=naming("port 2", "EK1100 (position 1)", "second interface")
    ):
        rig.connect(rig.devices[3], rig.devices[1], 2)
    with pytest.raises(UsageError, match=naming("ring", "one slave")):
        Simulation(Rig("nothing", ring=True))
