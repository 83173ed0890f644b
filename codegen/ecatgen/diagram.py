"""Collects the components and connections of an example model, with their places."""

from __future__ import annotations

from dataclasses import dataclass, field

from . import layout
from .ir import Block, Component, Connection, Extent, Kind, Point, Variable

_COLORS: dict[Kind, str] = {
    "Boolean": "{255, 0, 255}",
    "Integer": "{255, 127, 0}",
    "Real": "{0, 0, 127}",
}
_SOURCE_PORTS = {"y": Point(11, 0)}
# Where the connectors of the library blocks are, from the centre, in units of a diagram.
_PORTS = {
    "EtherCAT.Drives.StartUp": {
        "enable": Point(-12, 6),
        "statusWord": Point(-12, -6),
        "controlWord": Point(11, 8),
        "modeOfOperation": Point(11, 3),
        "enabled": Point(11, -3),
    },
    "EtherCAT.Sources.PointToPoint": _SOURCE_PORTS,
    "EtherCAT.Conversions.RealToInteger": {"u": Point(-12, 0), "y": Point(11, 0)},
    "Modelica.Blocks.Logical.Switch": {
        "u1": Point(-12, 8),
        "u2": Point(-12, 0),
        "u3": Point(-12, -8),
        "y": Point(11, 0),
    },
    "Modelica.Blocks.Sources.Constant": _SOURCE_PORTS,
    "Modelica.Blocks.Sources.IntegerConstant": _SOURCE_PORTS,
    "Modelica.Blocks.Sources.BooleanConstant": _SOURCE_PORTS,
    "EtherCAT.EtherCATMaster": {},
}


@dataclass
class Diagram:
    """An example model in the making."""

    components: list[Component] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    variables: list[Variable] = field(default_factory=list)
    _ports: dict[str, Point] = field(default_factory=dict)

    def add(
        self,
        class_name: str,
        name: str,
        centre: Point,
        description: str,
        *modifiers: str,
        prefix: str = "",
    ) -> str:
        """Adds a component of a library, and returns its name."""
        for port, offset in _PORTS[class_name].items():
            self._ports[f"{name}.{port}"] = Point(centre.x + offset.x, centre.y + offset.y)
        place = layout.extent(centre.x - 10, centre.y - 10, centre.x + 10, centre.y + 10)
        self.components.append(Component(class_name, name, modifiers, description, place, prefix))
        return name

    def add_block(self, library: str, block: Block, centre: Point) -> str:
        """Adds the block of a slave, and returns the name of the component."""
        for left, connectors in ((True, block.left), (False, block.right)):
            for row, connector in enumerate(connectors):
                self._ports[f"{block.instance}.{connector.name}"] = layout.port_point(
                    block.icon, row, centre, left=left
                )
        self.components.append(
            Component(
                f"{library}.{block.name}",
                block.instance,
                (),
                block.description,
                layout.in_diagram(block.icon, centre),
            )
        )
        return block.instance

    def connect(self, source: str, target: str, kind: Kind, x: int | None = None) -> None:
        """Connects two connectors by a line whose vertical part is at `x`."""
        points = layout.route(self._ports[source], self._ports[target], x)
        self.connections.append(Connection(source, target, points, _COLORS[kind]))

    def connect_around(self, source: str, target: str, kind: Kind, y: int) -> None:
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
        """Where lines to a connector end."""
        return self._ports[connector]

    def result(self, name: str, description: str, expression: str) -> None:
        """Gives a result a name of its own."""
        self.variables.append(Variable(name, description, expression))

    @property
    def box(self) -> Extent:
        """The extent of everything."""
        corners = [p for c in self.components for p in (c.extent.a, c.extent.b)]
        corners += [p for c in self.connections for p in c.points]
        return layout.extent(
            min(p.x for p in corners) - 20,
            min(p.y for p in corners) - 20,
            max(p.x for p in corners) + 20,
            max(p.y for p in corners) + 20,
        )
