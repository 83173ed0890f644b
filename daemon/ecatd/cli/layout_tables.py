"""The layout of the shared memory as tables in Markdown, for `docs/shared-memory.md`."""

from __future__ import annotations

import re

from ecatd.shm import contract as shm

# A comment ends with the writer of the field, or of all fields of a struct. Fields without a writer
# are written once, by the control side before clients connect.
_WRITER = re.compile(r"; (engine|relay|control)\b")
_OF_CLIENTS = ("ecat_out_doorbell", "ecat_out_slot", "ecat_out_image", "ecat_out_request")


def layout_lines() -> list[str]:
    """Constants, enumerations and structs, in the order of their definition."""
    lines = [
        "### Constants",
        "",
        *_table(("constant", "value", "meaning"), _constants()),
    ]
    lines += ["", "### Enumerations"]
    for line in shm.DEFINITION:
        if line.kind == "enum":
            lines += ["", f"`{line.of}`: {_text(line.comment)}", ""]
            lines += _table(("value", "name", "meaning"), _enumerators(line.of))
    lines += ["", "### Structs"]
    for line in shm.DEFINITION:
        if line.kind == "struct":
            lines += ["", f"`{line.of}`, {line.size} bytes: {_text(line.comment)}", ""]
            lines += _table(("offset", "type", "field", "written by", "meaning"), _fields(line))
    return lines


def _constants() -> list[tuple[str, ...]]:
    return [
        (f"`{line.name}`", _number(line.value), _text(line.comment))
        for line in shm.DEFINITION
        if line.kind == "const"
    ]


def _enumerators(name: str) -> list[tuple[str, ...]]:
    return [
        (str(line.value), f"`{line.name}`", _text(line.comment))
        for line in shm.DEFINITION
        if line.kind == "value" and line.of == name
    ]


def _fields(struct: shm.Line) -> list[tuple[str, ...]]:
    whole = _WRITER.search(struct.comment)
    usual = whole[1] if whole else "client" if struct.of in _OF_CLIENTS else "once"
    return [
        (
            str(field.value),
            field.type + (f"[{field.count}]" if field.count > 1 else ""),
            f"`{field.name}`",
            found[1] if (found := _WRITER.search(field.comment)) else usual,
            _text(_WRITER.sub("", field.comment)),
        )
        for field in shm.fields_of(struct.of)
    ]


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    lines = [head, tuple("---" for _ in head), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def _text(comment: str) -> str:
    """Escapes characters that Markdown would take for a column or a tag."""
    return comment.replace("|", "\\|").replace("<", "&lt;")


def _number(value: int) -> str:
    return f"0x{value:X}" if value > 0xFFFF else str(value)
