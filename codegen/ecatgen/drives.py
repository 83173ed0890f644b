"""Builds blocks in SI units around the blocks of drives with the device profile CiA 402."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from . import placement
from .drive_units import UnsuitableError, parameters
from .ir import Block, Connection, Connector, Drive, DriveLine, Point
from .labels import label
from .text import NOTHING, Code

# The connectors of EtherCAT.Drives.CiA402 by object, with their x positions in the diagram: first
# the outputs to the slave, then the inputs from it. See PartialDrive.
_PINS_Y = -35
_TO_SLAVE = {
    0x6060: (Code("modeOfOperation"), -140),
    0x6040: (Code("controlWord"), -129),
    0x6072: (Code("maxTorque"), -118),
    0x6071: (Code("targetTorque"), -107),
    0x60FF: (Code("targetVelocity"), -96),
    0x607A: (Code("targetPosition"), -85),
}
_VALID = (Code("valid"), 74)
_FROM_SLAVE = {
    0x6064: (Code("positionActualValue"), 85),
    0x6077: (Code("torqueActualValue"), 96),
    0x6041: (Code("statusWord"), 107),
    0x6061: (Code("modeOfOperationDisplay"), 118),
    0x606C: (Code("velocityActualValue"), 129),
    0x6078: (Code("currentActualValue"), 140),
}
_FLAGS = {
    0x6061: (Code("useModeDisplay"), Code("ECAT_DRIVE_HAS_MODE_DISPLAY")),
    0x6064: (Code("usePosition"), Code("ECAT_DRIVE_HAS_POSITION")),
    0x606C: (Code("useVelocity"), Code("ECAT_DRIVE_HAS_VELOCITY")),
    0x6077: (Code("useTorque"), Code("ECAT_DRIVE_HAS_TORQUE")),
    0x6078: (Code("useCurrent"), Code("ECAT_DRIVE_HAS_CURRENT")),
}
_CONTROL_WORD, _STATUS_WORD, _MODE = 0x6040, 0x6041, 0x6060
_MODES = Code("EtherCAT.Types.DriveMode.%s")
_BOOLEAN, _INTEGER, _REAL = map(Code, ("{255, 0, 255}", "{255, 127, 0}", "{0, 0, 127}"))
_TO_PHYSICAL = Code("EtherCAT.Drives.Utilities.ToPhysical")
_TO_RAW = Code("EtherCAT.Drives.Utilities.ToRaw")
_CONVERSION = Code("%sConversion")
_OF_SLAVE, _OF_DRIVE = Code("slave.%s"), Code("cia402.%s")
_CONVERSION_Y, _HALF, _PORT = -51, 5, 6  # position and size of the blocks between pins and slave
_TOP = -72  # upper edge of the slave in the diagram
_NARROW = 640  # icons up to this width are drawn twice as large as usual


@dataclass(frozen=True, slots=True)
class _Kind:
    """A quantity that a drive can control.

    Attributes:
        modes: Elements of EtherCAT.Types.DriveMode.
        target: Index of the object with the target value.
        actual: Indices of the objects with the actual value; the drive must map one of them.
        what: Name of the target in messages.
    """

    modes: tuple[Code, Code]
    target: int
    actual: tuple[int, ...]
    what: str


_KINDS = (
    _Kind(
        (Code("CyclicVelocity"), Code("ProfileVelocity")),
        0x60FF,
        (0x606C, 0x6064),
        "target velocity 0x60FF",
    ),
    _Kind(
        (Code("CyclicPosition"), Code("ProfilePosition")),
        0x607A,
        (0x6064,),
        "target position 0x607A",
    ),
    _Kind(
        (Code("CyclicTorque"), Code("ProfileTorque")),
        0x6071,
        (0x6077, 0x6078),
        "target torque 0x6071",
    ),
)


def build_drives(blocks: Iterable[Block]) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
    """Builds a drive for each slave that maps all objects that at least one of the modes needs.

    Returns:
        The drives, and a sentence for each drive whose units do not fit a block in SI units.
    """
    drives, notes = [], []
    for block in blocks:
        try:
            drive = _drive(block)
        except UnsuitableError as error:
            notes.append(
                f"slave {block.position} {block.name}: has no block in SI units in Drives: {error}"
            )
            continue
        if drive is not None:
            drives.append(drive)
    return tuple(drives), tuple(notes)


def _drive(block: Block) -> Drive | None:
    writes, reads = _by_object(block.left), _by_object(block.right)
    kinds = [
        kind
        for kind in _KINDS
        if kind.target in writes and any(index in reads for index in kind.actual)
    ]
    if _CONTROL_WORD not in writes or _STATUS_WORD not in reads or not kinds:
        return None
    scale = 5 if block.icon.b.x - block.icon.a.x <= _NARROW else 10
    centre = Point(0, _TOP - placement.half_height(block.icon, scale))
    slave = placement.in_diagram(block.icon, centre, scale)
    return Drive(
        name=block.name,
        instance=block.instance,
        title=label(block.name),
        description=f"{block.slave_label}, slave {block.position}, in SI units",
        block=block,
        mode=_MODES % kinds[0].modes[0],
        modes=tuple(mode for kind in kinds for mode in kind.modes),
        modifiers=(
            Code("final position = slave.slaveData.position"),
            Code("final slaveName = slave.slaveData.name"),
            _final(Code("modeInProcessData"), _MODE in writes),
            *(_final(flag, index in reads) for index, (flag, _) in _FLAGS.items()),
        ),
        parameters=tuple(parameters([*writes.values(), *reads.values()])),
        mode_object=0 if _MODE in writes else _MODE,
        entries=Code(" | ").join(flag for index, (_, flag) in _FLAGS.items() if index in reads)
        or Code("0"),
        missing=tuple(
            (
                Code(" and ").join(Code("mode <> %s") % (_MODES % mode) for mode in kind.modes),
                kind.what,
            )
            for kind in _KINDS
            if kind not in kinds
        ),
        writes=tuple(_line(c, *_TO_SLAVE[i], _TO_PHYSICAL, 270) for i, c in writes.items()),
        reads=tuple(_line(c, *_FROM_SLAVE[i], _TO_RAW, 90) for i, c in reads.items()),
        unused=tuple(c for c in block.writes if c not in writes.values()),
        slave_extent=slave,
        connections=tuple(_lines(block, centre, scale)),
        diagram=placement.extent(
            min(-220, slave.a.x - 20), min(-160, slave.a.y - 20), max(220, slave.b.x + 20), 130
        ),
    )


def _by_object(connectors: Sequence[Connector]) -> dict[int, Connector]:
    """Returns the connectors that CiA402 can use: integers of the first axis, raw or scaled.

    The keys are the indices of the objects.
    """
    known = _TO_SLAVE.keys() | _FROM_SLAVE.keys()
    return {
        c.index: c
        for c in connectors
        if c.index in known and c.subindex == 0 and c.raw_kind == "Integer"
    }


def _line(connector: Connector, pin: Code, x: int, class_name: Code, rotation: int) -> DriveLine:
    scaled = connector.kind == "Real"
    return DriveLine(
        drive=pin,
        slave=connector.name,
        conversion=_CONVERSION % pin if scaled else NOTHING,
        class_name=class_name if scaled else NOTHING,
        size=placement.extent(-_HALF, -_HALF, _HALF, _HALF),
        origin=Point(x, _CONVERSION_Y),
        rotation=rotation,
        scale=connector.scale,
        offset=connector.offset,
    )


def _lines(block: Block, centre: Point, scale: int) -> Iterator[Connection]:
    """Draws the lines between the state machine and the slave below it."""
    writes, reads = _by_object(block.left), _by_object(block.right)
    for row, c in enumerate(block.left):
        if writes.get(c.index) == c:
            pin, x = _TO_SLAVE[c.index]
            end = placement.port_point(block.icon, row, centre, left=True, scale=scale)
            source, begin = _OF_DRIVE % pin, Point(x, _PINS_Y)
            color = _INTEGER
            if c.kind == "Real":
                there = Point(x, _CONVERSION_Y + _PORT)
                yield Connection(source, Code("%sConversion.u") % pin, (begin, there), _INTEGER)
                source, begin = Code("%sConversion.y") % pin, Point(x, _CONVERSION_Y - _PORT)
                color = _REAL
            yield Connection(source, _OF_SLAVE % c.name, (begin, Point(x, end.y), end), color)
    start = placement.valid_point(block.icon, centre, scale)
    yield _upward(_OF_SLAVE % _VALID[0], start, _OF_DRIVE % _VALID[0], _VALID[1], _PINS_Y, _BOOLEAN)
    for row, c in enumerate(block.right):
        if reads.get(c.index) == c:
            start = placement.port_point(block.icon, row, centre, left=False, scale=scale)
            pin, x = _FROM_SLAVE[c.index]
            source, target = _OF_SLAVE % c.name, _OF_DRIVE % pin
            if c.kind == "Integer":
                yield _upward(source, start, target, x, _PINS_Y, _INTEGER)
                continue
            y = _CONVERSION_Y - _PORT
            yield _upward(source, start, Code("%sConversion.u") % pin, x, y, _REAL)
            points = (Point(x, _CONVERSION_Y + _PORT), Point(x, _PINS_Y))
            yield Connection(Code("%sConversion.y") % pin, target, points, _INTEGER)


def _upward(source: Code, start: Point, target: Code, x: int, y: int, color: Code) -> Connection:
    return Connection(source, target, (start, Point(x, start.y), Point(x, y)), color)


def _final(name: Code, value: bool) -> Code:
    return Code("final %s = %s") % (name, Code("true" if value else "false"))
