"""Leases, and safe values of outputs without an owner: `[outputs]`, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..pdo import parse_address
from ..toml_file import Key, Rules, Table, integer, number, show
from .placed import Placed
from .signals import read_entry
from .slave_reference import slave_reference

STOPS = ("quick_stop", "disable")
"""Safe values that stop a drive before its controlword becomes 0."""

STOP_TIMEOUT_S = 2.0

_WORDS = ("zero", "hold", *STOPS)


@dataclass(slots=True)
class SafeConfig(Placed):
    """`[[outputs.safe]]`: the safe value of a slave's outputs, or of one of its entries.

    Attributes:
        slave: Position.
        value: "zero", "hold" (keep the value that was sent last), a raw number, which needs
            `entry`, or for a CiA 402 drive "quick_stop" or "disable".
        entry: Address such as "0x60FF:00"; empty for all outputs of the slave. With "quick_stop"
            and "disable", a controlword stands for all objects of its axis.
        stop_timeout_s: With "quick_stop" and "disable": seconds in which the drive must stop;
            afterwards its controlword is 0 in any case. None: `STOP_TIMEOUT_S`.
    """

    slave: int
    value: str | int | float = "zero"
    entry: str = ""
    stop_timeout_s: float | None = None

    @property
    def address(self) -> tuple[int, int] | None:
        """Index and subindex of `entry`, or None for the whole slave."""
        return parse_address(self.entry)

    @property
    def patience(self) -> float:
        """Seconds in which a drive must stop."""
        return STOP_TIMEOUT_S if self.stop_timeout_s is None else self.stop_timeout_s


@dataclass(slots=True)
class OutputsConfig:
    """`[outputs]`: when outputs take their safe values, and which.

    Attributes:
        lease_cycles: Cycles without a heartbeat of their client after which outputs take their safe
            values, unless the client asks for a longer lease.
        lease_max_ms: Longest lease that a client can ask for, in milliseconds.
        wkc_limit: Number of exchanges of a domain in a row with a wrong working counter after which
            each client with outputs in this domain loses all its outputs; 0: never.
        safe: Safe values other than zero.
    """

    lease_cycles: int = 5
    lease_max_ms: int = 500
    wkc_limit: int = 0
    safe: list[SafeConfig] = field(default_factory=list)

    @property
    def stop_patience(self) -> float:
        """Longest time in seconds until all drives have stopped, or their time is over."""
        return max((rule.patience for rule in self.safe if rule.value in STOPS), default=0.0)


def read_outputs(top: Table, key: Key) -> OutputsConfig:
    """Reads `[outputs]` with its `[[outputs.safe]]`."""
    return OutputsConfig(**top.table(key).read(_OUTPUTS))


def _safe(row: Table) -> SafeConfig:
    safe = SafeConfig(**row.read(_SAFE, required=["slave"]), table=row)
    if not isinstance(safe.value, str) and not safe.entry:
        row.fail("value", "is a number, which needs an entry: write the one that is meant")
    if safe.stop_timeout_s is not None and safe.value not in STOPS:
        row.fail(
            "stop_timeout_s",
            'is for value = "quick_stop" and "disable": nothing else takes time',
        )
    return safe


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


def _entry(row: Table, key: Key) -> str:
    """Reads the address of an entry, or an empty text for all outputs of the slave."""
    return read_entry(row, key) if row.data[key] != "" else ""


_SAFE: Rules = {
    "slave": slave_reference,
    "value": _value,
    "entry": _entry,
    "stop_timeout_s": number(0.01, 30),
}
_OUTPUTS: Rules = {
    "lease_cycles": integer(1, 1_000_000),
    "lease_max_ms": integer(1, 60_000),
    "wkc_limit": integer(0, 1_000_000),
    "safe": lambda table, key: [_safe(row) for row in table.tables(key)],
}
