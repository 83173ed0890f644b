"""Says for each key of the configuration where its value comes from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ecatd.base.toml_file import path_text
from ecatd.base.toml_places import Path as KeyPath

from .config import Config

DEFAULT, COMMAND_LINE = "default", "command line"


def flatten(values: dict[str, Any]) -> dict[str, Any]:
    """All keys of nested tables on one level, such as `dc.slave[1].shift_us`.

    Args:
        values: Tables as from TOML or `Config.to_dict`. Keys with None and empty arrays are left
            out.
    """
    return {path_text(path): value for path, value in _leaves((), values)}


def find_origins(config: Config) -> dict[str, str]:
    """File and line of each key and table, by its name as `flatten` makes it.

    The file alone stands for the name "": the origin of what it does not have.

    Args:
        config: A configuration as `load_config` has read it.
    """
    document = config.table.document
    places = document.places.items()
    found = {path_text(path): f"{document.source}:{place.line}" for path, place in places}
    return {"": document.source, **found}


def _leaves(path: KeyPath, value: Any) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves((*path, key), item)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        for number, item in enumerate(value):
            yield from _leaves((*path, number), item)
    elif value not in (None, []):
        yield path, value
