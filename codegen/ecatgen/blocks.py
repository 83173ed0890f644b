"""Builds the block of each slave of the bus description."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from ecatd.description.bus import Slave, display_name
from ecatd.etg.datatypes import type_name
from ecatd.etg.pdo import Entry, Pdo

from . import can_blocks, names, placement
from .can.messages import CanFile
from .connectors import address_code, connectors, is_drawn
from .ir import Block, Skipped
from .labels import label
from .symbols import slave_kind, symbol
from .text import Code

_MAX_BITS = 64  # most bits of one entry in the shared memory

EXAMPLE_COMPONENTS = (
    *("etherCATMaster", "enable", "reference", "angle", "off", "zero", "zeroReal"),
    *("w_ref", "w_m", "i_m", "phi_ref", "phi_m"),
)
"""Names that the example models use themselves, so no block instance can have them."""

# Names in a generated library that are not those of blocks.
_PACKAGES = ("UsersGuide", "Examples", "Drives", "Channels", "fingerprint", "generateCommand")

# Names that the blocks and their base class use, so no connector can have them.
_RESERVED = (
    *("domainID", "slaveData", "hwName", "fingerprint", "generateCommand", "etherCATMaster"),
    *("domain", "slave", "slaveConfiguration", "committed", "Modelica", "EtherCAT"),
    *("valid", "alState", "alStatusCode", "sampled"),
)


def build_blocks(
    slaves: Iterable[Slave], library: str, can: Iterable[CanFile] = ()
) -> tuple[Block, ...]:
    """Builds the blocks of all slaves, in their order on the bus.

    A class has the name that the configuration gives its slave, else that of the type of the slave.
    Slaves of one type are numbered from the second one on, so that adding slaves of other types
    does not change the names.

    Args:
        slaves: The slaves.
        library: Name of the library.
        can: The messages of CAN buses behind slaves.
    """
    files = list(can)
    namespace = names.Namespace(
        {*names.FOREIGN_LIBRARIES, *names.FILES, *_PACKAGES, library},
        suffix="Slave",
    )
    instances = names.Namespace(EXAMPLE_COMPONENTS, suffix="Slave")
    blocks = []
    for slave in slaves:
        text = slave.given_name or slave.name
        name = namespace.take(names.class_name(text, f"Slave{slave.product:08X}"))
        instance = instances.take(names.instance_name(name))
        behind = [file for file in files if file.position == slave.position]
        blocks.append(_block(slave, name, instance, behind))
    return tuple(blocks)


def renamed(blocks: Sequence[Block]) -> tuple[str, ...]:
    """Returns a sentence for each slave whose block does not have the name in the configuration.

    Capital letters, `-` and `_` are not compared: they follow the conventions of Modelica.
    """
    return tuple(
        f"slave {block.position}: its name {block.given_name} becomes {block.name}, since "
        f"{_hindrance(block, blocks)}"
        for block in blocks
        if block.given_name and _letters(block.given_name) != _letters(block.name)
    )


def _hindrance(block: Block, blocks: Iterable[Block]) -> str:
    """Why a block does not have the name that the configuration gives its slave."""
    wanted = names.class_name(block.given_name, "")
    other = next((item for item in blocks if item.name == wanted and item is not block), None)
    if other is None:
        return "no class of the library can have it"
    return f"the class of slave {other.position} ({other.slave_label}) is {other.name} already"


def _letters(name: str) -> str:
    return re.sub("[-_]", "", name).casefold()


def _block(slave: Slave, name: Code, instance: Code, files: Sequence[CanFile]) -> Block:
    skipped: list[Skipped] = []
    writes = [] if files else list(_usable(slave, skipped, outputs=True))
    reads = [] if files else list(_usable(slave, skipped, outputs=False))
    connector_names = names.connector_names(
        [
            (pdo.name, entry.name, f"object {entry.index:04X} {entry.subindex:02X}")
            for pdo, entry in writes + reads
        ],
        _RESERVED,
    )
    messages = can_blocks.plan(files, _RESERVED)
    title = f"{label(name)}, slave {slave.position}"
    output_labels = [label(n) for n in connector_names[: len(writes)]]
    input_labels = [
        label(n) if is_drawn(entry, outputs=False) else ""
        for n, (_, entry) in zip(connector_names[len(writes) :], reads, strict=True)
    ]
    can_labels = {
        sent: {name: label(name) for *_, name in messages.of(sent=sent)} for sent in (True, False)
    }
    icon = placement.icon(
        title,
        [*output_labels, *can_labels[True].values()],
        [*filter(None, input_labels), *can_labels[False].values()],
    )
    outputs = connectors(writes, connector_names[: len(writes)], output_labels, icon, outputs=True)
    inputs = connectors(reads, connector_names[len(writes) :], input_labels, icon, outputs=False)
    can = can_blocks.build(messages, can_labels[True] | can_labels[False], icon)
    sent, received = can.signals(sent=True), can.signals(sent=False)
    left = (*outputs, *sent)
    right = (*(c for c in inputs if c.placement), *received)
    slave_label = display_name(slave.given_name, slave.name or f"product 0x{slave.product:08X}")
    kind = slave_kind(slave, {c.kind for c in left}, {c.kind for c in right})
    if can.messages:
        kind = "CAN terminal"
    return Block(
        name=name,
        instance=instance,
        position=slave.position,
        kind=kind,
        description=f"{slave_label}, slave {slave.position}",
        title=title,
        slave_name=slave.name,
        slave_label=slave_label,
        given_name=slave.given_name,
        vendor=slave.vendor,
        product=slave.product,
        revision=slave.revision,
        profiles=tuple(map(str, slave.profiles)),
        reads=inputs,
        writes=outputs,
        skipped=tuple(skipped),
        can=can,
        left=left,
        right=right,
        variables=tuple(c for c in inputs if not c.placement),
        explained=tuple(c for c in (*outputs, *inputs, *sent, *received) if c.note or c.values),
        icon=icon,
        symbol=symbol(kind, placement.symbol_corner(icon)),
        name_extent=placement.above(icon),
        title_extent=placement.title(icon),
        valid_extent=placement.valid_label(),
        rule=placement.rule(icon),
    )


def _usable(slave: Slave, skipped: list[Skipped], *, outputs: bool) -> Iterator[tuple[Pdo, Entry]]:
    seen = set()
    for pdo, entry, _ in slave.entries(outputs=outputs):
        address = (entry.index, entry.subindex)
        reason = ""
        if entry.bit_length > _MAX_BITS:
            reason = f"more than {_MAX_BITS} bits"
        elif address in seen:
            reason = "mapped twice; the first one has the connector"
        seen.add(address)
        if reason:
            skipped.append(
                Skipped(
                    address=address_code(entry),
                    entry_name=entry.name,
                    type_name=type_name(entry.data_type),
                    bit_length=entry.bit_length,
                    reason=reason,
                )
            )
        else:
            yield pdo, entry
