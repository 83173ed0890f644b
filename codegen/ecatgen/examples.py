"""Builds the example models of a generated library."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, count
from typing import ClassVar

from ecatd.description.bus import Bus

from . import placement
from .diagram import Diagram
from .ir import Block, Connector, Drive, Example, Kind, Point
from .text import Code, code, modelica_string

# The movement of the examples: 75 revolutions of the motor at up to 10 revolutions per second,
# reached within half a second. The motor is that of the simulated rig `troll`.
DISTANCE, MAX_SPEED, MAX_ACCELERATION, START = 471.24, 62.832, 125.66, 1
_MOTOR = {
    Code("encoderResolution"): 65536,
    Code("ratedTorque"): 0.4,
    Code("ratedCurrent"): 5,
}
_BETWEEN = 16  # vertical distance between blocks of one column
_CAUTION = (
    "Before you simulate with real hardware, set encoderResolution, ratedTorque and ratedCurrent "
    "of the drive to what the motor has, and distance, maxSpeed and maxAcceleration of the "
    "reference to what suits the motor and what is attached to it."
)


def build_examples(
    bus: Bus, library: Code, blocks: Sequence[Block], drives: Sequence[Drive]
) -> tuple[Example, ...]:
    """Builds the example models that suit the bus; some of them need a drive with their mode."""
    examples = [_all_slaves(bus, library, blocks)]
    for mode, example in (
        ("CyclicVelocity", _point_to_point),
        ("CyclicPosition", _relative_position),
    ):
        drive = next((drive for drive in drives if mode in drive.modes), None)
        if drive is not None:
            examples.append(example(bus, library, drive))
    return tuple(examples)


def _master(diagram: Diagram, bus: Bus, centre: Point) -> None:
    diagram.add(
        Code("EtherCAT.EtherCATMaster"),
        Code("etherCATMaster"),
        centre,
        "Connection to the bus, which paces the model",
        Code("bus = %s") % modelica_string(bus.name),
        Code("sampleTime = {%s}") % code(bus.cycle_time_us / 1e6),
        Code("waitForBus = true"),
        prefix=Code("inner "),
    )


class _Constants:
    """Constant sources for the outputs that an example leaves at zero; added only if needed."""

    _CLASSES: ClassVar[dict[Kind, tuple[Code, Code, Code]]] = {
        "Boolean": (
            Code("Modelica.Blocks.Sources.BooleanConstant"),
            Code("off"),
            Code("k = false"),
        ),
        "Integer": (
            Code("Modelica.Blocks.Sources.IntegerConstant"),
            Code("zero"),
            Code("k = 0"),
        ),
        "Real": (
            Code("Modelica.Blocks.Sources.Constant"),
            Code("zeroReal"),
            Code("k = 0"),
        ),
    }

    def __init__(self, diagram: Diagram, x: int, y: int, lane: int) -> None:
        self._diagram, self._x, self._y, self._lane = diagram, x, y, lane
        self._names: dict[tuple[Kind, str], Code] = {}

    def feed(self, target: Code, connector: Connector) -> None:
        """Connects a constant to an input; each type and unit has a source of its own."""
        key = (connector.kind, connector.unit)
        if key not in self._names:
            y = min(self._y - 40 * len(self._names), self._diagram.place(target).y)
            self._y = y + 40 * len(self._names)
            self._names[key] = self._add(connector.kind, Point(self._x, y))
        # Each source has a vertical lane of its own.
        lane = self._lane - 4 * list(self._names).index(key)
        self._diagram.connect(Code("%s.y") % self._names[key], target, connector.kind, lane)

    def _add(self, kind: Kind, centre: Point) -> Code:
        class_name, name, modifier = self._CLASSES[kind]
        taken = {component.name for component in self._diagram.components}
        free = chain([name], (Code("%s_%d") % (name, n) for n in count(2)))
        return self._diagram.add(
            class_name,
            next(name for name in free if name not in taken),
            centre,
            "Value of outputs that are not used",
            modifier,
        )


def _column(diagram: Diagram, library: Code, blocks: Sequence[Block], left: int) -> None:
    """Puts blocks below each other, beginning at the height of the master."""
    top = 90
    for block in blocks:
        half = placement.half_height(block.icon)
        centre = Point(left + placement.half_width(block.icon), top - half)
        diagram.add_block(library, block, centre)
        top -= 2 * half + _BETWEEN


def _columns(diagram: Diagram, library: Code, blocks: Sequence[Block]) -> None:
    """Puts blocks to the right of all others, in columns no taller than the diagram is so far."""
    box = diagram.box
    most = max(box.b.y - box.a.y, 150)
    column: list[Block] = []
    height = 0
    for block in (*blocks, None):
        size = 0 if block is None else 2 * placement.half_height(block.icon) + _BETWEEN
        if column and (block is None or height + size > most):
            _column(diagram, library, column, diagram.box.b.x)
            column, height = [], 0
        if block is not None:
            column.append(block)
            height += size


def _all_slaves(bus: Bus, library: Code, blocks: Sequence[Block]) -> Example:
    diagram = Diagram()
    _master(diagram, bus, Point(-120, 80))
    _column(diagram, library, [block for block in blocks if block.left], 0)
    _columns(diagram, library, [block for block in blocks if not block.left])
    constants = _Constants(diagram, -70, 84, lane=-20)
    for block in blocks:
        for connector in block.left:
            constants.feed(Code("%s.%s") % (block.instance, connector.name), connector)
    return Example(
        name=Code("AllSlaves"),
        description="Read every input of the bus while all outputs are zero",
        paragraphs=(
            "Simulate the model while ecatd runs the bus, and plot the outputs of the blocks. "
            "All outputs of the bus are owned by the model and kept at zero.",
        ),
        components=tuple(diagram.components),
        connections=tuple(diagram.connections),
        variables=(),
        diagram=diagram.box,
        stop_time=Code("10"),
        interval=Code("0.001"),
    )


def _drive_parts(bus: Bus, library: Code, drive: Drive, mode: Code) -> Diagram:
    """Returns a diagram with master, enabled drive and a reference speed without a connection."""
    diagram = Diagram()
    _master(diagram, bus, Point(-80, 70))
    known = {parameter.name for parameter in drive.parameters}
    motor = (Code("%s = %s") % (name, value) for name, value in _MOTOR.items() if name not in known)
    mode = Code("mode = EtherCAT.Types.DriveMode.%s") % mode
    diagram.add_drive(library, drive, Point(50, 0), mode, *motor)
    diagram.add(
        Code("Modelica.Blocks.Sources.BooleanConstant"),
        Code("enable"),
        Point(-80, 15),
        "The drive shall be in operation",
        Code("k = true"),
    )
    diagram.add(
        Code("EtherCAT.Sources.PointToPoint"),
        Code("reference"),
        Point(-80, -30),
        "Reference speed",
        Code("distance = %s") % DISTANCE,
        Code("maxSpeed = %s") % MAX_SPEED,
        Code("maxAcceleration = %s") % MAX_ACCELERATION,
        Code("startTime = %s") % START,
    )
    diagram.connect(Code("enable.y"), Code("%s.enable") % drive.instance, "Boolean")
    return diagram


def _point_to_point(bus: Bus, library: Code, drive: Drive) -> Example:
    diagram = _drive_parts(bus, library, drive, Code("CyclicVelocity"))
    diagram.connect(Code("reference.y"), Code("%s.w_ref") % drive.instance, "Real", x=0)
    diagram.result(Code("w_ref"), "rad/s", "Reference speed", Code("reference.y"))
    diagram.result(Code("w_m"), "rad/s", "Measured speed", Code("%s.w") % drive.instance)
    diagram.result(Code("i_m"), "A", "Measured current", Code("%s.i") % drive.instance)
    return _drive_example(
        diagram,
        Code("PointToPointMovement"),
        f"Move the drive {drive.block.slave_label} over a distance and back to rest",
        "A point-to-point reference gives the speed of the drive, as in Figures 8 and 9 of the "
        "paper on the DLR EtherCAT library. The drive is enabled by itself, in the mode cyclic "
        "synchronous velocity. Plot w_ref, w_m and i_m.",
    )


def _relative_position(bus: Bus, library: Code, drive: Drive) -> Example:
    diagram = _drive_parts(bus, library, drive, Code("CyclicPosition"))
    diagram.add(
        Code("Modelica.Blocks.Continuous.Integrator"),
        Code("angle"),
        Point(-30, -30),
        "Angle to turn by",
    )
    diagram.connect(Code("reference.y"), Code("angle.u"), "Real")
    diagram.connect(Code("angle.y"), Code("%s.phi_ref") % drive.instance, "Real", x=0)
    diagram.result(Code("phi_ref"), "rad", "Angle to turn by", Code("angle.y"))
    diagram.result(Code("phi_m"), "rad", "Measured angle", Code("%s.phi") % drive.instance)
    return _drive_example(
        diagram,
        Code("RelativePosition"),
        f"Turn the drive {drive.block.slave_label} by an angle from wherever it is",
        "The reference is an angle. Wherever the drive is at the start, it does not jump: its "
        "target follows the actual angle until it is enabled, and the reference counts from there. "
        "Plot phi_ref and phi_m.",
    )


def _drive_example(diagram: Diagram, name: Code, description: str, text: str) -> Example:
    return Example(
        name=name,
        description=description,
        paragraphs=(text, _CAUTION),
        components=tuple(diagram.components),
        connections=tuple(diagram.connections),
        variables=tuple(diagram.variables),
        diagram=diagram.box,
        stop_time=Code("10"),
        interval=Code("0.001"),
    )
