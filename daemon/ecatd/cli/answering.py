"""The exit statuses of commands that show a bus on which nothing answers.

They print what they know in any case. With `--json` stdout has this document only, so the messages
of this module go to stderr.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from ecatd.model.errors import EcatError, NoAnswerError, UnreachableError
from ecatd.plain_output import error_text
from ecatd.stats import Snapshot

from .source import Source

_ABSENT = "absent"


def check_slaves(rows: Iterable[Mapping[str, Any]]) -> int:
    """Says on stderr if no slave answers. Absent optional slaves do not count.

    Args:
        rows: AL states, as `Remote.states` returns them.

    Returns:
        The exit status of the command.
    """
    expected = [row for row in rows if row.get("recovery") != _ABSENT]
    if not expected or any(row["al_state"] for row in expected):
        return 0
    return _say(
        UnreachableError(
            "no slave answers: check cable and power of the first slave; `ecatctl info` shows "
            "whether the interface is up"
        )
    )


def check_cycle(snapshot: Snapshot, source: Source) -> int:
    """Says on stderr if the cycle stands still, or no slave answers; returns the exit status."""
    if snapshot.silence:
        return _say(
            NoAnswerError(
                f"no cycle of bus '{snapshot.bus}' for {snapshot.silence:.1f} s: its bus server "
                "was stopped or hangs; ecatd ends a bus server that hangs for 10 s"
            )
        )
    if snapshot.slaves_expected and not snapshot.slaves_found:
        rows: list[dict[str, Any]] = [{"al_state": 0}]
        with suppress(EcatError):  # then it is not known that they are optional
            rows = source.remote().states()
        return check_slaves(rows)
    return 0


def _say(error: EcatError) -> int:
    print(f"ecatctl: {error_text(error)}", file=sys.stderr)
    return error.exit_code
