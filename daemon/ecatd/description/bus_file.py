"""The bus description as a JSON file, the saved scan.

```
ecatctl scan -o bus.json           dump
ecatctl generate … --from bus.json     load
```

Every PDO entry has its own line, and attributes with default values are left out, so that people
can read and compare files. The same description always gives the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any

from ecatd.base.errors import UsageError
from ecatd.base.files import read_text
from ecatd.etg.pdo import Entry, Pdo

from .bus import SCHEMA, Bus, Domain, Slave
from .bus_reader import read_bus

_LISTS = ("outputs", "inputs", "entries")
_DEFAULTS = {
    kind: {
        item.name: item.default if item.default_factory is MISSING else item.default_factory()
        for item in fields(kind)
        if item.name not in _LISTS
    }
    for kind in (Domain, Slave, Pdo, Entry)
}


def dump(bus: Bus, version: str = "", warnings: Sequence[str] = ()) -> str:
    """Writes the description as JSON.

    Args:
        bus: The description.
        version: Version of the program that has scanned the bus; left out if empty.
        warnings: What is wrong with the files of the rig that was scanned; left out if empty.
    """
    head: dict[str, Any] = {"schema": SCHEMA} | ({"version": version} if version else {})
    head |= {"warnings": [*warnings]} if warnings else {}
    head |= {"fingerprint": f"{bus.fingerprint:016x}", "name": bus.name}
    lines = [f"{_inside(head | {'cycle_time_us': bus.cycle_time_us})}"]
    lines.append(f'"domains": {_list([_map(domain) for domain in bus.domains], 1)}')
    lines.append(f'"slaves": {_list([_slave(slave) for slave in bus.slaves], 1)}')
    return "{" + ",\n".join(lines) + "}\n"


def load(path: Path) -> Bus:
    """Reads a description from a file.

    Raises:
        UsageError: The file cannot be read, or is not a valid description.
    """
    return parse(read_text(path), str(path))


def parse(text: str, source: str) -> Bus:
    """Reads a description from a text.

    Args:
        text: JSON as `dump` writes it, possibly edited.
        source: Where it comes from, for messages.

    Raises:
        UsageError: The text is not JSON, or not a valid description.
    """
    try:
        data = json.loads(text, object_pairs_hook=_unique, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        raise UsageError(f"{source}:{error.lineno}: is not valid JSON: {error.msg}") from None
    except RecursionError:
        raise UsageError(f"{source}: is nested too deeply for a bus description") from None
    except ValueError as error:
        raise UsageError(f"{source}: is not valid JSON: {error}") from None
    return read_bus(data, source)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key '{twice}' occurs twice in one map")
    return result


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not a number in JSON")


def _inside(values: dict[str, Any]) -> str:
    """Keys and values as JSON, without the braces around them."""
    return json.dumps(values, default=asdict)[1:-1]


def _list(items: list[str], depth: int) -> str:
    if not items:
        return "[]"
    indent = "\n" + " " * depth
    return f"[{indent}{f',{indent}'.join(items)}]"


def _map(item: Domain | Entry) -> str:
    return "{" + _values(item) + "}"


def _values(item: Domain | Slave | Pdo | Entry) -> str:
    """Writes the attributes of an item that have no default, or differ from it."""
    return _inside(
        {
            name: value
            for name, default in _DEFAULTS[type(item)].items()
            if (value := getattr(item, name)) != default or default is MISSING
        }
    )


def _slave(slave: Slave) -> str:
    parts = [_values(slave)]
    for name, pdos in (("outputs", slave.outputs), ("inputs", slave.inputs)):
        if pdos:
            parts.append(f'"{name}": {_list([_pdo(pdo) for pdo in pdos], 3)}')
    return "{" + ",\n  ".join(parts) + "}"


def _pdo(pdo: Pdo) -> str:
    entries = _list([_map(entry) for entry in pdo.entries], 5)
    return "{" + _values(pdo) + f',\n    "entries": {entries}' + "}"
