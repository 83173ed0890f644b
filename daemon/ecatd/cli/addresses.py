"""Arguments that are addresses: objects of a slave. `base/addresses.py` has the notation."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ecatd.base.addresses import (
    INDEX_MOST,
    SUBINDEX_MOST,
    address_text,
    parse_address,
    parse_number,
)
from ecatd.base.errors import UsageError

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

HELP = "the object: an index such as 0x6060, 0x6060:00 with a subindex, or the name of an entry"


def object_(text: str) -> tuple[int, int | None] | str:
    """Converts an object: index and, behind a colon, subindex; or the name of an entry."""
    if address := parse_address(text):
        return address
    if not text[:1].isdigit():
        return text
    try:
        return parse_number(text, "index", INDEX_MOST), None
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def subindex(text: str) -> int:
    """Converts a subindex that is an argument of its own."""
    try:
        return parse_number(text, "subindex", SUBINDEX_MOST)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def find_object(
    remote: Remote, slave: int | str, named: tuple[int, int | None] | str, subindex: int | None
) -> tuple[int, int | None]:
    """Index and subindex of an object that the user has named.

    Args:
        remote: The daemon, which is asked only for names.
        slave: Position or name of the slave.
        named: What `object_` has made of the argument.
        subindex: The subindex that is an argument of its own; None if there is none.

    Returns:
        Index and subindex; the latter is None if the user has given none.

    Raises:
        UsageError: The slave has no such entry, or several; or there are two subindices.
    """
    index, own = _named(remote, slave, named) if isinstance(named, str) else named
    if own is not None and subindex is not None:
        raise UsageError(
            f"{address_text(index, own)} has a subindex already: leave the other one out"
        )
    return index, subindex if own is None else own


def _named(remote: Remote, slave: int | str, name: str) -> tuple[int, int]:
    found = remote.describe().find(slave)
    fitting = {
        (entry.index, entry.subindex)
        for pdo in (*found.outputs, *found.inputs)
        for entry in pdo.entries
        if not entry.is_gap and entry.name.lower() == name.lower()
    }
    if len(fitting) > 1:
        several = ", ".join(address_text(*item) for item in sorted(fitting))
        raise UsageError(f"{found.label} has several entries '{name}': {several}; choose one")
    if not fitting:
        raise UsageError(
            f"{found.label} has no entry '{name}' in its process data, which `ecatctl pdos "
            f"{found.position}` lists; give the index of other objects, such as 0x6060"
        )
    return fitting.pop()
