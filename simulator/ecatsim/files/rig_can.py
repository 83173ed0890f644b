"""Reads `[[can]]` of a rig file: CAN buses, their terminals and their nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ecatd.base.toml_file import Key, Table
from ecatd.etg.can_terminals import DATA_MAX, EXTENDED_MAX

from ..can.bus import CanBus
from ..can.node import CanNode
from ..can.nodes import library
from ..can.traffic import Traffic
from ..devices.can_terminals import CanTerminal
from ..rig import Rig

MakeFromFile = Callable[[Table, str, dict[str, Any]], object]
"""Makes what "file.py:Name" names: table, text and parameters."""

_OWN = ("name", "traffic", "checks", "echo")


def read(table: Table, rig: Rig, from_file: MakeFromFile) -> None:
    """Adds the buses of a rig file.

    Args:
        table: The outermost table.
        rig: The rig, which has its devices already.
        from_file: Makes a node of a Python file.

    Raises:
        ConfigError: A table is wrong.
    """
    plugged: set[int] = set()
    for row in table.tables("can"):
        row.only(("name", "bit_rate", "terminals", "node"))
        bus = CanBus(1000 * row.integer("bit_rate", 5, 1000), row.text("name", ""))
        for position in row.array("terminals", _integer):
            device = rig.devices[position] if 0 <= position < len(rig.devices) else None
            if not isinstance(device, CanTerminal):
                row.fail("terminals", f"slave {position} is no terminal with a CAN bus")
            if position in plugged:
                row.fail("terminals", f"slave {position} is on another bus already")
            plugged.add(position)
            device.plug(bus)
        for node in row.tables("node"):
            made = _node(node, from_file)
            if "bit_rate" in node:
                made.bit_rate = 1000 * node.integer("bit_rate", 5, 1000)
            node.explain(None, lambda bus=bus, made=made: bus.add(made))  # type: ignore[misc]
        rig.can.append(bus)


def _integer(table: Table, key: Key) -> int:
    return table.integer(key, 0, 0xFFFF)


def _node(table: Table, from_file: MakeFromFile) -> CanNode:
    if "device" not in table:
        table.only((*_OWN, "bit_rate"))
        return CanNode(
            table.text("name", "node"),
            traffic=[_traffic(row) for row in table.tables("traffic")],
            checks=[_traffic(row) for row in table.tables("checks")],
            echo=table.integer("echo", 0, EXTENDED_MAX, 0),
        )
    table.only(("device", "parameters", "bit_rate"))
    text = table.text("device")
    given = table.table("parameters", None)
    parameters = {} if given is None else given.data
    if ".py" not in text:
        node: CanNode = table.explain("device", lambda: library.make(text, **parameters))
        return node
    made = from_file(table, text, parameters)
    if not isinstance(made, CanNode):
        table.fail("device", f"'{text}' does not make an ecatsim.can.CanNode")
    return made


def _traffic(table: Table) -> Traffic:
    table.only(("id", "span", "extended", "length", "rate", "count", "delay", "remote"))
    identifier = table.integer("id", 0, EXTENDED_MAX)
    result: Traffic = table.explain(
        None,
        lambda: Traffic(
            identifier,
            table.integer("span", 1, EXTENDED_MAX, 1),
            table.boolean("extended", False),
            table.integer("length", 0, DATA_MAX, DATA_MAX),
            table.number("rate", 0.0, low=0.0, high=1e6),
            table.integer("count", 0, 1 << 62, 0),
            table.number("delay", 0.0, low=0.0, high=1e6),
            table.boolean("remote", False),
        ),
    )
    return result
