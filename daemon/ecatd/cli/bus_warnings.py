"""What commands say on stderr: of a bus no answer, no cycle, outdated facts; of files mistakes.

They print what they know in any case, and with `--json` stdout has this document only. The exit
status says that nothing answers.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError, NoAnswerError, UnreachableError
from ecatd.base.sanitized_output import error_text
from ecatd.description.bus import Bus
from ecatd.operations.bus import SlaveAlState
from ecatd.operations.health import Health, outdated, required

from .output import date_text, first_of

if TYPE_CHECKING:
    from ecatd.shm.statistics import Snapshot

    from .source import Source

_NAMED_MAX, _WARNED_MAX = 8, 10
_NO_SLAVE = (
    "check the cable and the power of the first slave; `ecatctl info` shows whether the "
    "interface is up"
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
    why = f", because no frame comes back: {dead}" if dead else f": {_NO_SLAVE}"
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


def warn_outdated(
    bus: Bus, rows: Sequence[SlaveAlState], quiet: Collection[int] = ()
) -> list[dict[str, Any]]:
    """Says it in one line on stderr, with what to do next.

    Args:
        bus: The description.
        rows: The AL states of all slaves, as `ReadStates` is answered.
        quiet: Positions of slaves about which the line says nothing.

    Returns:
        The field `outdated` for `--json`: `position` and `text` of each of these slaves, and when
        ecatd read it, `read_at`, in Unix seconds, or None if it has never been there.
    """
    found = outdated(bus.slaves, rows)
    when = {row["position"]: row["read_at"] for row in rows}
    alike: dict[str, list[int]] = {}
    for position, why in found.items():
        if position not in quiet:
            alike.setdefault(why, []).append(position)
    if alike:
        causes = "; ".join(f"{_labels(bus, who)}: {why}" for why, who in alike.items())
        moments = [when[position] for who in alike.values() for position in who]
        print(
            f"ecatctl: warning: {causes}; {_of_when(moments)}. `ecatctl check` says what is wrong, "
            "and a restart of ecatd reads all slaves again",
            file=sys.stderr,
        )
    return [{"position": n, "text": why, "read_at": when[n]} for n, why in found.items()]


def _labels(bus: Bus, positions: Sequence[int]) -> str:
    labels = [bus.slaves[position].label for position in positions]
    return ", ".join(first_of(labels, _NAMED_MAX))


def _of_when(moments: Sequence[float | None]) -> str:
    whom = "it" if len(moments) == 1 else "them"
    first = min((moment for moment in moments if moment), default=None)
    if first is None:  # it was missing from the start on
        return f"what is used of {whom} is from the file `description` of [expected]"
    return f"what is used of {whom} is what ecatd read at {date_text(first)}"


def warn(texts: Sequence[str]) -> None:
    """Writes the first warnings to stderr, and the number of further ones."""
    for text in first_of(texts, _WARNED_MAX):
        print(f"ecatctl: warning: {text}", file=sys.stderr)
