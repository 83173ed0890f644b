"""Reads FMUs from rig files: `[[plant]]` with `fmu`, and the connections of its variables."""

from __future__ import annotations

from ecatd.base.toml_file import Table

from ..plants.fmu import Connection, add_fmu
from ..rig import Rig

_KEYS = ("fmu", "period", "start", "connect")


def add(table: Table, rig: Rig) -> None:
    """Adds the FMU of a table `[[plant]]`.

    Raises:
        ConfigError: The table or the FMU cannot be used.
        StateError: The FMU could not be started.
    """
    table.only(_KEYS)
    connections = [_connection(row, rig) for row in table.tables("connect")]
    if not connections:
        table.fail("connect", "is missing: without connections the FMU has no effect")
    period = table.number("period", 0.001, low=1e-6, high=3600.0)
    start = _start(table)
    path = table.file("fmu")
    table.explain("fmu", lambda: add_fmu(rig, path, connections, start, period))


def _connection(row: Table, rig: Rig) -> Connection:
    row.only(("variable", "slave", "entry", "scale", "offset"))
    if not rig.devices:
        row.fail("slave", "there are no slaves to connect")
    slave = row.integer("slave", 0, len(rig.devices) - 1)
    return Connection(
        row.text("variable"),
        (rig.devices[slave], *row.address("entry")),
        row.number("scale", 1.0),
        row.number("offset", 0.0),
    )


def _start(table: Table) -> dict[str, float | int | bool | str]:
    if "start" not in table:
        return {}
    values = table.table("start")
    for name, value in values.data.items():
        if not isinstance(value, bool | int | float):
            values.fail(name, f"must be a number, true or false, not {values.show(name)}")
    return dict(values.data)
