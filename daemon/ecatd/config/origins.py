"""Says for each key of the configuration where its value comes from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ecatd.base.toml_file import path_text
from ecatd.base.toml_places import Path as KeyPath

from .config import Config

DEFAULT, COMMAND_LINE = "default", "command line"
"""The texts of values that are in no file."""


class Origin(NamedTuple):
    """Where a value comes from; its text is for people.

    Attributes:
        file: The file; empty for the command line.
        line: The line in it; 0 for the whole file.
        changed: Whether the file was changed afterwards, so that the line may be another one now.
    """

    file: str = ""
    line: int = 0
    changed: bool = False

    def __str__(self) -> str:
        if not self.file:
            return COMMAND_LINE
        line = f":{self.line}" if self.line else ""
        return f"{self.file}{line}{' (before it was changed)' if self.changed else ''}"

    def of_earlier_file(self) -> Origin:
        """The same in a file that was changed."""
        return self._replace(changed=bool(self.file))


Origins = Mapping[str, Origin]
"""The origin of each key and table that is written anywhere, by its name as `flatten` makes it. The
file alone stands for the name "": the origin of what it does not have."""


def texts(origins: Origins) -> dict[str, str]:
    """Origins for another process, which shows them."""
    return {key: str(origin) for key, origin in origins.items()}


def flatten(values: dict[str, Any]) -> dict[str, Any]:
    """All keys of nested tables on one level, such as `dc.slave[1].shift_us`.

    Args:
        values: Tables as from TOML or `Config.to_dict`. Keys with None and empty arrays are left
            out.
    """
    return {path_text(path): value for path, value in _leaves((), values)}


def find_origins(config: Config) -> dict[str, Origin]:
    """The origins of a configuration as `load_config` has read it."""
    document = config.table.document
    places = document.places.items()
    found = {path_text(path): Origin(document.source, place.line) for path, place in places}
    return {"": Origin(document.source), **found}


def _leaves(path: KeyPath, value: Any) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves((*path, key), item)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        for number, item in enumerate(value):
            yield from _leaves((*path, number), item)
    elif value not in (None, []):
        yield path, value
