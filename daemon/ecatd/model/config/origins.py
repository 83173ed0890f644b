"""Says for each key of the configuration where its value comes from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..toml_file import path_text, read_toml
from ..toml_places import Path as KeyPath

DEFAULT, COMMAND_LINE = "default", "command line"


def flatten(values: dict[str, Any]) -> dict[str, Any]:
    """All keys of nested tables on one level, such as `dc.slave[1].shift_us`.

    Args:
        values: Tables as from TOML or `Config.to_dict`. Keys with None and empty arrays are left
            out.
    """
    return {path_text(path): value for path, value in _leaves((), values)}


def find_origins(file: Path) -> dict[str, str]:
    """File and line of each key and table in a file, by its name as `flatten` makes it.

    The file alone stands for the name "": the origin of what it does not have.

    Raises:
        ConfigError: The file cannot be read, or is no valid TOML.
    """
    places = read_toml(file).document.places
    found = {path_text(path): f"{file}:{place.line}" for path, place in places.items()}
    return {"": str(file), **found}


def _leaves(path: KeyPath, value: Any) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves((*path, key), item)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        for number, item in enumerate(value):
            yield from _leaves((*path, number), item)
    elif value not in (None, []):
        yield path, value
