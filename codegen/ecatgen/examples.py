"""The example models of a generated library."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, count
from typing import ClassVar

from ecatd.model.bus import Bus

from . import layout
from .diagram import Diagram
from .ir import Block, Connector, Example, Kind, Point
from .text import modelica_string

CONTROL_WORD, MODE, TARGET_VELOCITY = 0x6040, 0x6060, 0x60FF
MAX_TORQUE = 0x6072
STATUS_WORD, VELOCITY, TORQUE, CURRENT = 0x6041, 0x606C, 0x6077, 0x6078

# The movement of the example, in increments of the encoder: with an encoder of 16 bits, 75
# revolutions, at most 10 in a second, reached in half a second.
DISTANCE, MAX_SPEED, MAX_ACCELERATION, START = 4_915_200, 655_360, 1_310_720, 1

_BETWEEN = 16  # between blocks that stand below each other


def build_examples(bus: Bus, library: str, blocks: Sequence[Block]) -> tuple[Example, ...]:
    """The example models that make sense for the bus."""
    examples = [_all_slaves(bus, library, blocks)]
    drive = next(filter(is_velocity_drive, blocks), None)
    if drive is not None:
        examples.append(_point_to_point(bus, library, drive, blocks))
    return tuple(examples)


def is_velocity_drive(block: Block) -> bool:
    """Whether the process data are enough to run a CiA 402 drive in a velocity mode."""
    return all(_find(block.writes, index) for index in (CONTROL_WORD, TARGET_VELOCITY)) and all(
        _find(block.reads, index) for index in (STATUS_WORD, VELOCITY)
    )


def _find(connectors: Sequence[Connector], index: int) -> Connector | None:
    return next((c for c in connectors if (c.index, c.subindex) == (index, 0)), None)


def _master(diagram: Diagram, bus: Bus, centre: Point) -> None:
    diagram.add(
        "EtherCAT.EtherCATMaster",
        "etherCATMaster",
        centre,
        "Connection to the bus, which paces the model",
        f"bus = {modelica_string(bus.name)}",
        f"sampleTime = {{{bus.cycle_time_us / 1e6!r}}}",
        "waitForBus = true",
        prefix="inner ",
    )


class _Constants:
    """Sources for outputs that an example leaves at zero; only those that are needed."""

    _CLASSES: ClassVar[dict[Kind, tuple[str, str, str]]] = {
        "Boolean": ("Modelica.Blocks.Sources.BooleanConstant", "off", "k = false"),
        "Integer": ("Modelica.Blocks.Sources.IntegerConstant", "zero", "k = 0"),
        "Real": ("Modelica.Blocks.Sources.Constant", "zeroReal", "k = 0"),
    }

    def __init__(self, diagram: Diagram, x: int, y: int, lane: int) -> None:
        self._diagram, self._x, self._y, self._lane = diagram, x, y, lane
        self._names: dict[tuple[Kind, str], str] = {}

    def feed(self, target: str, connector: Connector) -> None:
        """Connects a constant to an input; one constant cannot have several units."""
        key = (connector.kind, connector.unit)
        if key not in self._names:
            y = min(self._y - 40 * len(self._names), self._diagram.place(target).y)
            self._y = y + 40 * len(self._names)
            self._names[key] = self._add(connector.kind, Point(self._x, y))
        # Each source has an upright line of its own.
        lane = self._lane - 4 * list(self._names).index(key)
        self._diagram.connect(f"{self._names[key]}.y", target, connector.kind, lane)

    def _add(self, kind: Kind, centre: Point) -> str:
        class_name, name, modifier = self._CLASSES[kind]
        taken = {component.name for component in self._diagram.components}
        free = chain([name], (f"{name}_{n}" for n in count(2)))
        return self._diagram.add(
            class_name,
            next(name for name in free if name not in taken),
            centre,
            "Value of outputs that are not used",
            modifier,
        )


def _column(diagram: Diagram, library: str, blocks: Sequence[Block], left: int) -> None:
    """Puts blocks below each other, from the height of the master on."""
    top = 90
    for block in blocks:
        half = layout.half_height(block.icon)
        centre = Point(left + layout.half_width(block.icon), top - half)
        diagram.add_block(library, block, centre)
        top -= 2 * half + _BETWEEN


def _columns(diagram: Diagram, library: str, blocks: Sequence[Block]) -> None:
    """Puts blocks right of all others, in columns that are not higher than what is there."""
    box = diagram.box
    most = max(box.b.y - box.a.y, 150)
    column: list[Block] = []
    height = 0
    for block in (*blocks, None):
        size = 0 if block is None else 2 * layout.half_height(block.icon) + _BETWEEN
        if column and (block is None or height + size > most):
            _column(diagram, library, column, diagram.box.b.x)
            column, height = [], 0
        if block is not None:
            column.append(block)
            height += size


def _all_slaves(bus: Bus, library: str, blocks: Sequence[Block]) -> Example:
    diagram = Diagram()
    _master(diagram, bus, Point(-120, 80))
    _column(diagram, library, [block for block in blocks if block.left], 0)
    _columns(diagram, library, [block for block in blocks if not block.left])
    constants = _Constants(diagram, -70, 84, lane=-20)
    for block in blocks:
        for connector in block.left:
            constants.feed(f"{block.instance}.{connector.name}", connector)
    return Example(
        name="AllSlaves",
        description="Read every input of the bus while all outputs are zero",
        paragraphs=(
            "Simulate the model while ecatd serves the bus, and plot the outputs of the blocks. "
            "All outputs of the bus are owned by the model and kept at zero.",
        ),
        components=tuple(diagram.components),
        connections=tuple(diagram.connections),
        variables=(),
        diagram=diagram.box,
        stop_time="10",
        interval="0.001",
    )


def _point_to_point(bus: Bus, library: str, drive: Block, blocks: Sequence[Block]) -> Example:
    diagram = Diagram()
    _master(diagram, bus, Point(-110, 90))
    name = diagram.add_block(library, drive, Point(90, 0))
    diagram.add(
        "Modelica.Blocks.Sources.BooleanConstant",
        "enable",
        Point(-110, 46),
        "The drive shall be in operation",
        "k = true",
    )
    diagram.add(
        "EtherCAT.Drives.StartUp",
        "startUp",
        Point(-50, 40),
        "Sets the mode of the drive and enables it",
        f"position = {drive.position}",
        "mode = EtherCAT.Types.DriveMode.CyclicVelocity",
        "resetFault = true",
    )
    diagram.add(
        "EtherCAT.Sources.PointToPoint",
        "reference",
        Point(-110, -12),
        "Reference speed in increments per second",
        f"distance = {DISTANCE}",
        f"maxSpeed = {MAX_SPEED}",
        f"maxAcceleration = {MAX_ACCELERATION}",
        f"startTime = {START}",
    )
    diagram.add(
        "Modelica.Blocks.Sources.Constant",
        "standstill",
        Point(-110, -50),
        "Speed while the drive is not in operation",
        "k = 0",
    )
    diagram.add(
        "Modelica.Blocks.Logical.Switch", "target", Point(-50, -20), "Reference once enabled"
    )
    diagram.add(
        "EtherCAT.Conversions.RealToInteger",
        "toInteger",
        Point(-14, -20),
        "Value for the process data",
    )
    diagram.connect("enable.y", "startUp.enable", "Boolean")
    diagram.connect("reference.y", "target.u1", "Real")
    diagram.connect_around("startUp.enabled", "target.u2", "Boolean", y=12)
    diagram.connect("standstill.y", "target.u3", "Real")
    diagram.connect("target.y", "toInteger.u", "Real")
    sources = {
        CONTROL_WORD: ("startUp.controlWord", 30),
        MODE: ("startUp.modeOfOperation", 20),
        TARGET_VELOCITY: ("toInteger.y", 10),
        MAX_TORQUE: ("ratedTorque.y", 40),
    }
    if _find(drive.writes, MAX_TORQUE):
        diagram.add(
            "Modelica.Blocks.Sources.IntegerConstant",
            "ratedTorque",
            Point(-14, 80),
            "Largest torque in 1/1000 of the rated one",
            "k = 1000",
        )
    constants = _Constants(diagram, -14, -60, lane=24)
    for connector in drive.writes:
        target = f"{name}.{connector.name}"
        if connector.subindex == 0 and connector.index in sources and connector.kind == "Integer":
            source, x = sources[connector.index]
            diagram.connect(source, target, "Integer", x)
        else:
            constants.feed(target, connector)
    status, velocity = _find(drive.reads, STATUS_WORD), _find(drive.reads, VELOCITY)
    current = _find(drive.reads, CURRENT) or _find(drive.reads, TORQUE)
    assert status is not None  # is_velocity_drive() has found them
    assert velocity is not None
    diagram.connect_around(f"{name}.{status.name}", "startUp.statusWord", "Integer", y=66)
    for n, block in enumerate(block for block in blocks if block.reads and not block.writes):
        diagram.add_block(library, block, Point(190 + 100 * n, 90 - layout.half_height(block.icon)))
    diagram.result("w_ref", "Reference speed in increments/s", "target.y")
    diagram.result("w_m", "Measured speed in increments/s", f"{name}.{velocity.name}")
    if current is not None:
        what = "current" if current.index == CURRENT else "torque"
        diagram.result(
            "i_m", f"Measured {what} in 1/1000 of the rated one", f"{name}.{current.name}"
        )
    return Example(
        name="PointToPointMovement",
        description=f"Move the drive {drive.slave_label} over a distance and back to rest",
        paragraphs=(
            "A point-to-point reference gives the speed of the drive, as in Figures 8 and 9 of the "
            "paper on the DLR EtherCAT library. The start-up state machine sets the mode of "
            "operation (cyclic synchronous velocity) by SDO and enables the drive first.",
            "Plot w_ref, w_m and i_m. Speeds are in increments of the encoder per second: set "
            "distance, maxSpeed and maxAcceleration of the component reference to what suits your "
            "motor before you simulate with real hardware.",
        ),
        components=tuple(diagram.components),
        connections=tuple(diagram.connections),
        variables=tuple(diagram.variables),
        diagram=diagram.box,
        stop_time="10",
        interval="0.001",
    )
