"""Start-up parameters of drives with SoE: the keys of `[[slave.idn]]`, and how they are read."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ecatd.base.errors import UsageError
from ecatd.base.toml_file import Key, Table, accepts, integer, one_of, printable
from ecatd.etg.idns import (
    TELEGRAM_LISTS,
    Attribute,
    idn_text,
    parse_idn,
    split_list,
    telegram_index,
)

from .placed import Placed, read
from .startup import COMMENT_BYTES, DATA_MAX, TRANSITIONS, check_length, comment_of

DRIVES = 8
"""Most drives in one slave (ETG.1000.6)."""


@accepts('an IDN, such as `"S-0-0036"`')
def _idn(table: Table, key: Key) -> str:
    text = table.text(key)
    return idn_text(table.explain(key, lambda: parse_idn(text)))


@accepts("a number, or a text in quotes: a text, or a list as `1, 2, 3`")
def _value(table: Table, key: Key) -> str:
    value = table.data[key]
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        table.fail(key, f"must be a number, or a text in quotes, not {table.show(key)}")
    if isinstance(value, float) and not math.isfinite(value):
        table.fail(key, f"must be a finite number, not {table.show(key)}")
    return repr(value)


@accepts(f"1 to {DATA_MAX} bytes")
def _hex(table: Table, key: Key) -> str:
    text = table.text(key)
    try:
        data = bytes.fromhex(text)
    except ValueError:
        table.fail(key, f'must be hexadecimal bytes such as "05 00", not {table.show(key)}')
    if not 0 < len(data) <= DATA_MAX:
        table.fail(key, f"has {len(data)} bytes, but must have 1 to {DATA_MAX}")
    return text


@dataclass(slots=True)
class IdnConfig(Placed):
    """`[[slave.idn]]`: one table for each IDN that a drive with SoE gets, in the order of writing.

    ecatd writes them when the slave starts, and again whenever it comes back.
    [Drives with SoE](soe-drives.md) has the details.

    Attributes:
        idn: The IDN.
        value: The value as in [`soe-write`](command-line.md), such as `100`, or
            `"S-0-0051, S-0-0040"`. Default: none; needed, or `hex`.
        hex: The value as hexadecimal bytes, in place of `value`, as ESI and ENI files have it: a
            list or text begins with its two lengths. Default: none.
        drive: The drive of the slave.
        transition: [When it is written](configuration.md#what-ecatd-writes-to-slaves): on the way
            to PREOP, SAFEOP or OP, or before the slave leaves OP or SAFEOP.
        optional: Use the slave even if the drive refuses the value.
        comment: Why it is written; for people.
    """

    idn: Annotated[str, _idn]
    value: Annotated[str | None, _value] = None  # as `soe-write` takes it
    hex: Annotated[str | None, _hex] = None
    drive: Annotated[int, integer(0, DRIVES - 1)] = 0
    transition: Annotated[str, one_of(TRANSITIONS)] = "PS"
    optional: Annotated[bool, Table.boolean] = False
    comment: Annotated[str, printable(COMMENT_BYTES)] = ""

    @property
    def number(self) -> int:
        """The number of the IDN."""
        return parse_idn(self.idn)

    @property
    def telegram(self) -> int | None:
        """Index of the PDO of the telegram whose list this is; None for other IDNs."""
        number = self.number
        return telegram_index(number, self.drive) if number in TELEGRAM_LISTS else None

    def data(self, attribute: Attribute) -> bytes:
        """The bytes of the value, without the lengths of a list.

        Args:
            attribute: What kind of value the IDN has, as the drive says.

        Raises:
            UsageError: The value is not of this kind.
        """
        if self.hex is None:
            return attribute.encode(self.value or "")
        data = bytes.fromhex(self.hex)
        return split_list(data) if attribute.is_list else data

    def __str__(self) -> str:
        drive = f" of drive {self.drive}" if self.drive else ""
        return f"{self.idn}{drive} = {self.value if self.hex is None else self.hex}"


def read_idn_parameter(table: Table, key: Key) -> IdnConfig:
    """Reads one table of `[[slave.idn]]`."""
    row = table.table(key)
    parameter = read(IdnConfig, row)
    if parameter.hex is not None and parameter.value is not None:
        row.fail("hex", "stands in place of value: leave one of them out")
    if parameter.hex is None and parameter.value is None:
        row.fail("value", 'is missing: write a value, such as value = 5, or hex = "05 00"')
    return parameter


def startup_idn(
    number: int, drive: int, data: bytes, *, transition: str, comment: str
) -> IdnConfig:
    """Makes a start-up parameter of an `<InitCmd>` that ESI and ENI files have for an IDN.

    Args:
        number: The IDN.
        drive: The drive.
        data: The bytes that are written; a list begins with its two lengths.
        transition: When it is written, one of `TRANSITIONS`.
        comment: Why it is written; what cannot be printed is left out.

    Raises:
        UsageError: The configuration cannot have such a parameter; the message says why.
    """
    check_length(data)
    if drive >= DRIVES:
        raise UsageError(f"it is for drive {drive}: a slave has drives 0 to {DRIVES - 1}")
    parameter = IdnConfig(
        idn_text(number),
        hex=data.hex(" ").upper(),
        drive=drive,
        transition=transition,
        comment=comment_of(comment),
    )
    if number in TELEGRAM_LISTS:
        try:
            listed = split_list(data)
        except UsageError:
            return parameter
        if listed and len(listed) % 2 == 0:
            parts = (listed[at : at + 2] for at in range(0, len(listed), 2))
            parameter.value = ", ".join(idn_text(int.from_bytes(p, "little")) for p in parts)
            parameter.hex = None
    return parameter
