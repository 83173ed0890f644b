"""Writes what is known of events: the catalog of the journal, and the table for users.

    PYTHONPATH=tools .venv/bin/python -m ecatdev.event_pages

`ecatd.operations.events` has all kinds.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from ecatd.base.log import message_id
from ecatd.operations.events import KINDS, Kind

from .page_parts import head, row

_ROOT = Path(__file__).parents[2]
CATALOG = _ROOT / "systemd" / "ecatd.catalog"
PAGE = _ROOT / "docs" / "troubleshooting.md"
_BEGIN, _END = "<!-- events -->\n\n", "\n\n<!-- /events -->"

_NO_BREAK = "\N{NO-BREAK SPACE}"
"""Stands in commands while lines are broken, so that a command can be copied from one line."""

_HEAD = """\
# Explanations for `journalctl -x`; install as /usr/lib/systemd/catalog/ecatd.catalog, then run
# `journalctl --update-catalog`. It is made from daemon/ecatd/operations/events.py by
# `PYTHONPATH=tools .venv/bin/python -m ecatdev.event_pages`.
"""


def catalog() -> str:
    """Returns the catalog of the journal."""
    return "\n".join([_HEAD, *(_entry(kind) for kind in KINDS.values() if kind.logged)])


def _entry(kind: Kind) -> str:
    where = "Bus @ECAT_BUS@" + ", slave @ECAT_SLAVE@" * ("slave" in kind.facts)
    plain = re.sub(r"\[([^]\[]+)\]\([^)]+\)", r"\1", kind.advice)
    whole = re.sub(r"`([^`]+)`", lambda code: code[1].replace(" ", _NO_BREAK), plain)
    text = whole.format(bus="@ECAT_BUS@", slave="@ECAT_SLAVE@")
    wrapped = textwrap.wrap(text, 100, break_long_words=False, break_on_hyphens=False)
    lines = [line.replace(_NO_BREAK, " ") for line in wrapped]
    first = [f"-- {message_id(kind.name)}", f"Subject: {kind.subject}", "Defined-By: ecatd", ""]
    return "\n".join([*first, f"{where}.", *lines, ""])


def table() -> Iterator[str]:
    """Yields the lines of the table for users."""
    yield from head("event", "where", "severity", "what has happened, and what to do")
    for kind in KINDS.values():
        where = "log" if not kind.published else "both" if kind.logged else "Zenoh"
        advice = kind.advice.format(bus="BUS", slave="SLAVE")
        yield row(f"`{kind.name}`", where, kind.severity, f"{kind.subject}. {advice}")


def page() -> str:
    """Returns the page for users, with this table."""
    before, _, rest = PAGE.read_text().partition(_BEGIN)
    return before + _BEGIN + "\n".join(table()) + _END + rest.partition(_END)[2]


if __name__ == "__main__":
    CATALOG.write_text(catalog())
    PAGE.write_text(page())
