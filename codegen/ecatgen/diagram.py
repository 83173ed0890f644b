"""Collects the components and connections of an example model, with their places."""

from __future__ import annotations

from dataclasses import dataclass, field

from . import placement
from .ir import Block, Component, Connection, Drive, Extent, Kind, Point, Variable
from .text import NOTHING, Code

_COLORS: dict[Kind, Code] = {
    "Boolean": Code("{255, 0, 255}"),
    "Integer": Code("{255, 127, 0}"),
    "Real": Code("{0, 0, 127}"),
}
_SOURCE_PORTS = {"y": Point(11, 0)}
# A drive (EtherCAT.Interfaces.PartialDrive) is drawn larger, so that its connectors lie on the
# grid.
_DRIVE_HALF = 25
_DRIVE_PORTS = {
    "enable": Point(-28, 15),
    "phi_ref": Point(-28, -6),
    "w_ref": Point(-28, -13),
}
# Positions of the connectors of library blocks, from the centre, in units of the diagram.
_PORTS = {
    "EtherCAT.Sources.PointToPoint": _SOURCE_PORTS,
    "Modelica.Blocks.Continuous.Integrator": {"u": Point(-12, 0), "y": Point(11, 0)},
    "Modelica.Blocks.Sources.Constant": _SOURCE_PORTS,
    "Modelica.Blocks.Sources.IntegerConstant": _SOURCE_PORTS,
    "Modelica.Blocks.Sources.BooleanConstant": _SOURCE_PORTS,
    "EtherCAT.EtherCATMaster": {},
}


@dataclass
class Diagram:
    """An example model that is being built."""

    components: list[Component] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    variables: list[Variable] = field(default_factory=list)
    _ports: dict[str, Point] = field(default_factory=dict)

    def add(
        self,
        class_name: Code,
        name: Code,
        centre: Point,
        description: str,
        *modifiers: Code,
        prefix: Code = NOTHING,
    ) -> Code:
        """Adds a component of a library class and returns its name."""
        for port, offset in _PORTS[class_name].items():
            self._ports[f"{name}.{port}"] = Point(centre.x + offset.x, centre.y + offset.y)
        place = placement.extent(centre.x - 10, centre.y - 10, centre.x + 10, centre.y + 10)
        self.components.append(Component(class_name, name, modifiers, description, place, prefix))
        return name

    def add_block(self, library: Code, block: Block, centre: Point) -> Code:
        """Adds the block of a slave and returns the name of the component."""
        for left, connectors in ((True, block.left), (False, block.right)):
            for row, connector in enumerate(connectors):
                self._ports[f"{block.instance}.{connector.name}"] = placement.port_point(
                    block.icon, row, centre, left=left
                )
        self.components.append(
            Component(
                Code("%s.%s") % (library, block.name),
                block.instance,
                (),
                block.description,
                placement.in_diagram(block.icon, centre),
            )
        )
        return block.instance

    def add_drive(self, library: Code, drive: Drive, centre: Point, *modifiers: Code) -> Code:
        """Adds the block of a drive in SI units and returns the name of the component."""
        for port, offset in _DRIVE_PORTS.items():
            self._ports[f"{drive.instance}.{port}"] = Point(
                centre.x + offset.x, centre.y + offset.y
            )
        half = _DRIVE_HALF
        place = placement.extent(centre.x - half, centre.y - half, centre.x + half, centre.y + half)
        name = Code("%s.Drives.%s") % (library, drive.name)
        self.components.append(Component(name, drive.instance, modifiers, drive.description, place))
        return drive.instance

    def connect(self, source: Code, target: Code, kind: Kind, x: int | None = None) -> None:
        """Connects two connectors by a line whose vertical part is at `x`."""
        points = placement.route(self._ports[source], self._ports[target], x)
        self.connections.append(Connection(source, target, points, _COLORS[kind]))

    def connect_around(self, source: Code, target: Code, kind: Kind, y: int) -> None:
        """Connects an output on the right to an input on the left, by a line at height `y`."""
        start, end = self._ports[source], self._ports[target]
        points = (
            start,
            Point(start.x + 6, start.y),
            Point(start.x + 6, y),
            Point(end.x - 6, y),
            Point(end.x - 6, end.y),
            end,
        )
        self.connections.append(Connection(source, target, points, _COLORS[kind]))

    def place(self, connector: str) -> Point:
        """Returns the point at which lines meet a connector."""
        return self._ports[connector]

    def result(self, name: Code, unit: str, description: str, expression: Code) -> None:
        """Adds a variable that gives a result a short name."""
        self.variables.append(Variable(name, unit, description, expression))

    @property
    def box(self) -> Extent:
        """The extent of all components and lines, with a margin of 20 units."""
        corners = [p for c in self.components for p in (c.extent.a, c.extent.b)]
        corners += [p for c in self.connections for p in c.points]
        return placement.extent(
            min(p.x for p in corners) - 20,
            min(p.y for p in corners) - 20,
            max(p.x for p in corners) + 20,
            max(p.y for p in corners) + 20,
        )
