"""The exit statuses of commands that show a bus on which nothing answers.

They print what they know in any case. With `--json` stdout has this document only, so the messages
of this module go to stderr.
"""

from __future__ import annotations

import sys

from ecatd.base.errors import EcatError, NoAnswerError, UnreachableError
from ecatd.base.plain_output import error_text
from ecatd.operations.health import Health, required
from ecatd.shm.statistics import Snapshot

from .source import Source

_NO_SLAVE = (
    "check cable and power of the first slave; `ecatctl info` shows whether the interface is up"
)


def check_slaves(health: Health) -> int:
    """Says on stderr if no slave answers. Absent optional slaves do not count.

    Args:
        health: The health of the bus.

    Returns:
        The exit status of the command.
    """
    expected = required(health.rows)
    if not expected or any(row["al_state"] for row in expected):
        return 0
    dead = "; ".join(fault.text for fault in health.faults if fault.blinds)
    why = f", since no frame comes back: {dead}" if dead else f": {_NO_SLAVE}"
    return _say(UnreachableError(f"no slave answers{why}"))


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
        try:
            return check_slaves(source.remote().health())
        except EcatError:  # then it is not known that they are optional
            return _say(UnreachableError(f"no slave answers: {_NO_SLAVE}"))
    return 0


def _say(error: EcatError) -> int:
    print(f"ecatctl: {error_text(error)}", file=sys.stderr)
    return error.exit_code
