"""Drives with the device profile CiA 402: a block with SI units around the block of the slave."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from . import layout
from .ir import Block, Connection, Connector, Drive, DriveLine, Point
from .labels import label

# The connectors of EtherCAT.Drives.CiA402 by object, and where they are in the diagram: from left
# to right those that lead to the slave, then those that come from it. See PartialDrive.
_PINS_Y = -35
_TO_SLAVE = {
    0x6060: ("modeOfOperation", -140),
    0x6040: ("controlWord", -129),
    0x6072: ("maxTorque", -118),
    0x6071: ("targetTorque", -107),
    0x60FF: ("targetVelocity", -96),
    0x607A: ("targetPosition", -85),
}
_VALID = ("valid", 74)
_FROM_SLAVE = {
    0x6064: ("positionActualValue", 85),
    0x6077: ("torqueActualValue", 96),
    0x6041: ("statusWord", 107),
    0x6061: ("modeOfOperationDisplay", 118),
    0x606C: ("velocityActualValue", 129),
    0x6078: ("currentActualValue", 140),
}
_FLAGS = {
    0x6061: ("useModeDisplay", "ECATM_HAS_MODE_DISPLAY"),
    0x6064: ("usePosition", "ECATM_HAS_POSITION"),
    0x606C: ("useVelocity", "ECATM_HAS_VELOCITY"),
    0x6077: ("useTorque", "ECATM_HAS_TORQUE"),
    0x6078: ("useCurrent", "ECATM_HAS_CURRENT"),
}
_CONTROL_WORD, _STATUS_WORD, _MODE = 0x6040, 0x6041, 0x6060
_TYPES = "EtherCAT.Types.DriveMode"
_BOOLEAN, _INTEGER = "{255, 0, 255}", "{255, 127, 0}"
_TOP = -72  # of the slave in the diagram
_NARROW = 640  # icons up to this width are drawn twice as large as usual


@dataclass(frozen=True, slots=True)
class _Kind:
    """A quantity that a drive can be asked for.

    Attributes:
        modes: Elements of EtherCAT.Types.DriveMode.
        target: Object of the target.
        actual: Objects one of which is needed.
        what: How a message names the target.
    """

    modes: tuple[str, str]
    target: int
    actual: tuple[int, ...]
    what: str


_KINDS = (
    _Kind(
        ("CyclicVelocity", "ProfileVelocity"), 0x60FF, (0x606C, 0x6064), "target velocity 0x60FF"
    ),
    _Kind(("CyclicPosition", "ProfilePosition"), 0x607A, (0x6064,), "target position 0x607A"),
    _Kind(("CyclicTorque", "ProfileTorque"), 0x6071, (0x6077, 0x6078), "target torque 0x6071"),
)


def build_drives(blocks: Iterable[Block]) -> tuple[Drive, ...]:
    """The drives among the slaves: those that map what one of the modes needs."""
    return tuple(drive for block in blocks if (drive := _drive(block)) is not None)


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
    centre = Point(0, _TOP - layout.half_height(block.icon, scale))
    slave = layout.in_diagram(block.icon, centre, scale)
    return Drive(
        name=block.name,
        instance=block.instance,
        title=label(block.name),
        description=f"{block.slave_label}, slave {block.position}, in SI units",
        block=block,
        mode=f"{_TYPES}.{kinds[0].modes[0]}",
        modes=tuple(mode for kind in kinds for mode in kind.modes),
        modifiers=(
            "final position = slave.slaveData.position",
            f"final modeInProcessData = {_boolean(_MODE in writes)}",
            *(f"final {flag} = {_boolean(index in reads)}" for index, (flag, _) in _FLAGS.items()),
        ),
        mode_object=0 if _MODE in writes else _MODE,
        entries=" | ".join(flag for index, (_, flag) in _FLAGS.items() if index in reads) or "0",
        missing=tuple(
            (" and ".join(f"mode <> {_TYPES}.{mode}" for mode in kind.modes), kind.what)
            for kind in _KINDS
            if kind not in kinds
        ),
        writes=tuple(DriveLine(_TO_SLAVE[i][0], c.name) for i, c in writes.items()),
        reads=tuple(DriveLine(_FROM_SLAVE[i][0], c.name) for i, c in reads.items()),
        unused=tuple(c for c in block.writes if c not in writes.values()),
        slave_extent=slave,
        connections=tuple(_lines(block, centre, scale)),
        diagram=layout.extent(
            min(-220, slave.a.x - 20), min(-160, slave.a.y - 20), max(220, slave.b.x + 20), 130
        ),
    )


def _by_object(connectors: Sequence[Connector]) -> dict[int, Connector]:
    """What CiA402 can be connected with: raw values of the first axis."""
    known = _TO_SLAVE.keys() | _FROM_SLAVE.keys()
    return {
        c.index: c
        for c in connectors
        if c.index in known and c.subindex == 0 and c.kind == "Integer"
    }


def _lines(block: Block, centre: Point, scale: int) -> Iterator[Connection]:
    """The lines between the state machine and the slave below it."""
    writes, reads = _by_object(block.left), _by_object(block.right)
    for row, c in enumerate(block.left):
        if writes.get(c.index) == c:
            pin, x = _TO_SLAVE[c.index]
            end = layout.port_point(block.icon, row, centre, left=True, scale=scale)
            points = (Point(x, _PINS_Y), Point(x, end.y), end)
            yield Connection(f"cia402.{pin}", f"slave.{c.name}", points, _INTEGER)
    start = layout.valid_point(block.icon, centre, scale)
    yield _upward(_VALID[0], start, _VALID, _BOOLEAN)
    for row, c in enumerate(block.right):
        if reads.get(c.index) == c:
            start = layout.port_point(block.icon, row, centre, left=False, scale=scale)
            yield _upward(c.name, start, _FROM_SLAVE[c.index], _INTEGER)


def _upward(source: str, start: Point, pin: tuple[str, int], color: str) -> Connection:
    name, x = pin
    points = (start, Point(x, start.y), Point(x, _PINS_Y))
    return Connection(f"slave.{source}", f"cia402.{name}", points, color)


def _boolean(value: bool) -> str:
    return "true" if value else "false"
