"""The layout of the shared memory as tables in Markdown, for `docs/shared-memory.md`."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.shm import contract as shm

_OF_CLIENTS = (
    *("ecat_out_doorbell", "ecat_out_slot", "ecat_out_image", "ecat_out_request"),
    *("ecat_out_can", "ecat_out_can_frame"),
)


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
            if counters := shm.counters(line.of):
                lines += ["", "These fields are counters:", ""]
                rows = [(f"`{item.name}`", item.unit, item.severity) for item in counters]
                lines += _table(("counter", "unit", "severity"), rows)
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


def _fields(struct: shm.LayoutItem) -> list[tuple[str, ...]]:
    """Fields without a writer are written once, by the control side before clients connect."""
    _, whole = shm.parted(struct.comment)
    usual = whole or ("client" if struct.of in _OF_CLIENTS else "once")
    return [
        (
            str(field.value),
            field.type + (f"[{field.count}]" if field.count > 1 else ""),
            f"`{field.name}`",
            writer or usual,
            _text(meaning),
        )
        for field in shm.fields_of(struct.of)
        for meaning, writer in (shm.parted(field.comment),)
    ]


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    lines = [head, tuple("---" for _ in head), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def _text(comment: str) -> str:
    """Escapes characters that Markdown would take for a column or a tag."""
    return comment.replace("|", "\\|").replace("<", "&lt;")


def _number(value: int) -> str:
    return f"0x{value:X}" if value > 0xFFFF else str(value)
