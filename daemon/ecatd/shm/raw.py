"""Single tables of the shared memory, field by field, with no checks but that they exist."""

from __future__ import annotations

from typing import Any

from ecatd.base.errors import UsageError

from . import contract as shm
from .reader import Reader, SlotReader, opened

_OUT = {
    "out_header": "ecat_out_header",
    "doorbells": "ecat_out_doorbell",
    "slots": "ecat_out_slot",
    "requests": "ecat_out_request",
    "images": "ecat_out_image",
}
NAMES = ("header", *shm.TABLES, "pages", *_OUT)


def read_raw(bus: str, table: str) -> list[Any]:
    """All rows of a table, as ctypes structs of `ecatd.shm.contract`.

    Args:
        bus: Name of the bus; its daemon need not live.
        table: One of `NAMES`: those of the daemon's shared memory, `pages` of the domains, and
            those of the clients' shared memory, where each slot has some `requests` and `images`.

    Raises:
        UsageError: There is no such table.
        EcatError: It cannot be read, as `contents.contents`.
    """
    if table not in NAMES:
        raise UsageError(f"'{table}' is not a table: use one of {', '.join(NAMES)}")
    with opened(bus) as shared:
        head = shared.header(leftover=True)
        if table == "header":
            return [head]
        if table == "pages":
            return [shared.page(domain).head for domain in shared.table(head, "domains")]
        if table in shm.TABLES:
            return shared.table(head, table)
        return _of_clients(shared, head, table)


def _of_clients(shared: Reader, head: Any, table: str) -> list[Any]:
    with shared.slots(head) as out:
        if table == "out_header":
            return [out.header]
        rows = [row for slot in range(out.header.slot_count) for row in _of_slot(out, table, slot)]
        if None in rows or not rows:
            raise shared.damaged(f"table {table} is cut short")
        return rows


def _of_slot(out: SlotReader, table: str, slot: int) -> list[Any]:
    if table == "requests":
        return out.requests(slot)
    if table == "images":
        return out.images(slot)
    return [out.doorbell(slot) if table == "doorbells" else out.slot(slot)]


def plain(row: Any) -> dict[str, Any]:
    """A struct as a map: numbers, texts, and bytes as hexadecimal digits."""
    made: dict[str, Any] = {}
    for field in shm.fields_of(type(row).__name__):
        if field.type == "char":
            data = bytes(row)[field.value : field.value + field.size]
            made[field.name] = _text(data.rstrip(b"\0"))
        elif field.type.startswith("ecat_"):
            made[field.name] = plain(getattr(row, field.name))
        elif field.count > 1:
            made[field.name] = list(getattr(row, field.name))
        else:
            made[field.name] = getattr(row, field.name)
    return made


def _text(data: bytes) -> str:
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return f"hex {data.hex()}"
    return text if text.isprintable() else f"hex {data.hex()}"
