"""Names, types and units of recorded values: those that the library and the FMU of the bus have."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from ecatd.description.bus import Bus
from ecatd.etg.pdo import Entry

from .. import names
from ..blocks import build_blocks
from ..connectors import kind_of, unit_modifiers
from ..fmu.build import instance_names
from ..ir import Block, Connector, Kind
from ..text import Code

CYCLE, VALID = "cycle", "valid"
"""Names of what stands beside the values: number of the cycle, and whether a slave took part."""
_OWN = (
    *("fileName", "startTime", "smoothness", "duration", "triggerTime", "cycleTime"),
    *("reals", "held", "Modelica"),
)
"""Names that the block uses for other things."""
_ADDRESS = re.compile(r" \(0x[0-9A-Fa-f]+:[0-9A-Fa-f]+\)$")


@dataclass(frozen=True, slots=True)
class RecordedEntry:
    """An entry whose values were recorded.

    Attributes:
        path: SLAVE/ENTRY, SLAVE being its position.
        slave: Position of the slave.
        output: Whether it is an output of the bus; None if the recording does not say it.
        index: Object index; 0 if the recording does not say it.
        subindex: Object subindex.
        unit: Unit of the values, or empty.
        scale: Physical value = raw value * scale + offset; the values are physical.
        offset: See `scale`.
    """

    path: str
    slave: int
    output: bool | None = None
    index: int = 0
    subindex: int = 0
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Variable:
    """A recorded value as a variable.

    Attributes:
        instance: Usual name of the block of its slave.
        member: Name of its connector there.
        kind: Modelica type: `Boolean`, `Integer` or `Real`.
        modifiers: Modifications of its connector: quantity and units.
        description: What it is.
        unit: Unit as people write it, or empty.
        name: Name that the user has chosen, or empty.
    """

    instance: str
    member: str
    kind: Kind
    modifiers: tuple[Code, ...]
    description: str
    unit: str
    name: str = ""

    @property
    def fmi_name(self) -> str:
        """Its name in the FMU of the bus."""
        return self.name or ".".join(filter(None, (self.instance, self.member)))


def cycle_variable() -> Variable:
    """The number of the cycle, as `EtherCAT.EtherCATMaster` has it."""
    return Variable(CYCLE, "", "Integer", (), "Number of the bus cycle, modulo 2^31", "")


def valid_variable(instance: str, slave: int) -> Variable:
    """Whether a slave took part, as the block of the slave has it."""
    text = f"= true, if slave {slave} took part in this cycle; otherwise its values are held"
    return Variable(instance, VALID, "Boolean", (), text, "")


def variables(entries: Iterable[RecordedEntry], bus: Bus | None) -> list[Variable]:
    """A variable for each entry.

    Args:
        entries: The entries, in the order of the bus.
        bus: The bus; None if it is not known. Then names come from the paths, and all are Real.
    """
    known = dict(_known(bus)) if bus is not None else {}
    others: dict[str, names.Namespace] = {}
    found = []
    for entry in entries:
        key = (entry.slave, bool(entry.output), entry.index, entry.subindex)
        place = known.pop(key, None)  # an entry that is mapped twice has one connector
        if place is not None:
            found.append(_described(entry, *place))
            continue
        instance = f"slave{entry.slave}"
        space = others.setdefault(instance, names.Namespace([VALID]))
        text = _ADDRESS.sub("", entry.path.partition("/")[2])
        member = space.take(names.component_name(text, f"entry {entry.path}"))
        unit = unit_modifiers(Entry(1, 0, "", 0, 0, unit=entry.unit))
        found.append(Variable(instance, member, "Real", tuple(unit), entry.path, entry.unit))
    return found


_Place = tuple[str, Block, Connector, Entry]


def _known(bus: Bus) -> Iterator[tuple[tuple[int, bool, int, int], _Place]]:
    blocks = build_blocks(bus.slaves, "")
    for block, instance, slave in zip(blocks, instance_names(blocks), bus.slaves, strict=True):
        for outputs, connectors in ((True, block.writes), (False, block.reads)):
            entries = {
                (entry.index, entry.subindex): entry
                for _, entry, _ in reversed([*slave.entries(outputs=outputs)])
            }
            for item in connectors:
                entry = entries[item.index, item.subindex]
                key = (slave.position, outputs, item.index, item.subindex)
                yield key, (instance, block, item, entry)


def _described(
    recorded: RecordedEntry, instance: str, block: Block, connector: Connector, entry: Entry
) -> Variable:
    meaning = (recorded.unit, recorded.scale, recorded.offset)
    if meaning != (entry.unit, entry.scale, entry.offset):  # what stands beside the values counts
        unit, scale, offset = meaning
        entry = replace(entry, unit=unit, scale=scale, offset=offset, display_unit="", quantity="")
    what = "output" if recorded.output else "input"
    return Variable(
        instance=instance,
        member=connector.name,
        kind=kind_of(entry),
        modifiers=tuple(unit_modifiers(entry)),
        description=f"{block.description}: {connector.description}, {what}",
        unit=recorded.unit,
    )


def modelica_names(found: Sequence[Variable]) -> list[Code]:
    """Names in one block: that of the slave and that of the connector, joined in camel case."""
    space = names.Namespace(_OWN)
    return [
        space.take(item.name or f"{item.instance}{item.member[:1].upper()}{item.member[1:]}")
        for item in found
    ]
