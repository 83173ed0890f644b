"""Leases, and safe values of outputs without an owner: `[outputs]`, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.addresses import parse_address
from ecatd.base.toml_file import Key, Table, accepts, integer, number, one_of, show

from .placed import Placed, read
from .references import slave_reference
from .signals import ADDRESS, read_entry

STOPS = ("quick_stop", "disable")
"""Safe values that stop a drive before its controlword becomes 0."""

STOP_TIMEOUT_S = 2.0
"""Seconds in which a drive must stop, unless its table says otherwise."""

_WORDS = ("zero", "hold", *STOPS)


@accepts(f"{one_of(_WORDS).accepted}, or a finite number")
def _value(row: Table, key: Key) -> str | int | float:
    """Reads a word or a raw number; a number written without a fraction gives an int."""
    value = row.data[key]
    if type(value) is str:
        if value not in _WORDS:
            known = ", ".join(f'"{word}"' for word in _WORDS)
            row.fail(key, f"is {show(value)}, but must be one of {known}, or a number")
        return value
    if type(value) not in (int, float):
        row.fail(key, 'must be a number, or a word such as "hold"')
    return row.integer(key, -(1 << 63), (1 << 64) - 1) if type(value) is int else row.number(key)


@accepts(f'{ADDRESS}, or `""`')
def _entry(row: Table, key: Key) -> str:
    """Reads the address of an entry, or an empty text for all outputs of the slave."""
    return read_entry(row, key) if row.data[key] != "" else ""


@dataclass(slots=True)
class SafeConfig(Placed):
    """`[[outputs.safe]]`: one table for each slave or entry whose safe value is not zero.

    [Safe outputs](configuration.md#safe-outputs) says when outputs get these values.

    Attributes:
        slave: Position of the slave, or its name.
        value: `"zero"`, `"hold"` (keep what was last sent), a raw number, which needs `entry`, or
            for a CiA 402 drive `"quick_stop"` or `"disable"`.
        entry: The entry; `""`: all outputs of the slave. With `"quick_stop"` and `"disable"`, a
            controlword stands for all objects of its axis.
        stop_timeout_s: With `"quick_stop"` and `"disable"`: time in which the drive must stop;
            afterwards its controlword is 0 in any case. Default: `STOP_TIMEOUT_S`.
    """

    slave: Annotated[int, slave_reference]
    value: Annotated[str | int | float, _value] = "zero"
    entry: Annotated[str, _entry] = ""
    stop_timeout_s: Annotated[float | None, number(0.01, 30)] = None

    @property
    def address(self) -> tuple[int, int] | None:
        """Index and subindex of `entry`, or None for the whole slave."""
        return parse_address(self.entry)

    @property
    def stop_timeout(self) -> float:
        """Seconds in which a drive must stop."""
        return STOP_TIMEOUT_S if self.stop_timeout_s is None else self.stop_timeout_s


@dataclass(slots=True)
class OutputsConfig(Placed):
    """`[outputs]`: when outputs take their safe values, and which.

    Attributes:
        lease_cycles: Default lease: base cycles without a sign of life of a client until its
            outputs become safe. A client may ask for a longer one, up to `lease_max_ms`.
        lease_max_ms: Longest lease that a client can ask for.
        wkc_limit: Number of exchanges in a row with a wrong working counter after which each client
            that owns outputs in that domain loses all its outputs. It loses those in other domains,
            too, because one commit holds all outputs of a client. 0: never.
        safe: Safe values other than zero.
    """

    lease_cycles: Annotated[int, integer(1, 1_000_000)] = 5
    lease_max_ms: Annotated[int, integer(1, 60_000)] = 500
    wkc_limit: Annotated[int, integer(0, 1_000_000)] = 0
    safe: Annotated[list[SafeConfig], _safe] = field(default_factory=list)

    @property
    def longest_stop(self) -> float:
        """Longest time in seconds until all drives have stopped, or their time is over."""
        return max((rule.stop_timeout for rule in self.safe if rule.value in STOPS), default=0.0)


def _safe(table: Table, key: Key) -> list[SafeConfig]:
    return [_safe_row(row) for row in table.tables(key)]


def _safe_row(row: Table) -> SafeConfig:
    safe = read(SafeConfig, row)
    if not isinstance(safe.value, str) and not safe.entry:
        row.fail("value", "is a number, which needs an entry: write the one that is meant")
    if safe.stop_timeout_s is not None and safe.value not in STOPS:
        row.fail(
            "stop_timeout_s",
            'is for value = "quick_stop" and "disable": nothing else takes time',
        )
    return safe
