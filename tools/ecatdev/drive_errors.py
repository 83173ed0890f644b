"""Writes the error codes of drives for the C client.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_errors

`ecatd.etg` has the codes and their texts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from ecatd.etg.drives import ERROR_TEXTS
from ecatd.etg.error_codes import ERROR_CLASSES

FILE = Path(__file__).parents[2] / "client_c" / "src" / "drive_errors.h"

_HEAD = """\
/* Error codes of drives (object 0x603F) and their classes, made from daemon/ecatd/etg by
 * `PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_errors`. */
#ifndef ECAT_DRIVE_ERRORS_H
#define ECAT_DRIVE_ERRORS_H

typedef struct drive_error {
  int code;
  const char *text;
} drive_error;
"""


def header() -> str:
    """Returns the header."""
    parts = (*_table("ERRORS", 4, ERROR_TEXTS), "", *_table("CLASSES", 2, ERROR_CLASSES))
    return "\n".join((_HEAD, *parts, "", "#endif", ""))


def _table(name: str, digits: int, texts: Mapping[int, str]) -> Iterator[str]:
    yield f"static const drive_error {name}[] = {{"
    for code, text in sorted(texts.items()):
        yield f'    {{0x{code:0{digits}X}, "{text}"}},'
    yield "};"


if __name__ == "__main__":
    FILE.write_text(header())
