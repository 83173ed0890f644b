"""Start-up parameters: the keys of `[[slave.startup]]`, and how they are read."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from ecatd.base.addresses import parse_address
from ecatd.base.errors import UsageError
from ecatd.base.toml_file import Key, Table, accepts, one_of, printable, show
from ecatd.description.limits import SIGNAL_NAME_BYTES, UNIT_BYTES
from ecatd.description.object_types import ObjectType
from ecatd.description.physical import nearest_raw
from ecatd.etg.datatypes import (
    STRINGS,
    DataType,
    bit_length,
    decode,
    encode,
    is_real,
    parse_type,
    plain_number,
    type_alias,
)
from ecatd.etg.pdo import Entry

from .placed import Placed, rules_of
from .signals import read_entry

TRANSITIONS = ("IP", "PS", "SO", "OS", "SP")
"""Transitions of the state machine in which start-up parameters are written (ETG.1000.6): I INIT,
P PREOP, S SAFEOP, O OP."""

TRANSITIONS_DOWN = ("OS", "SP")
"""Those to a lower state, which a slave reaches whatever it refuses."""

COMMENT_BYTES = 4 * SIGNAL_NAME_BYTES
DATA_MAX = 1 << 15
"""Most bytes of a start-up parameter."""


@accepts("a type with a fixed length, or of texts")
def _type(table: Table, key: Key) -> str:
    name = table.text(key)
    kind = table.explain(key, lambda: parse_type(name))
    texts = (DataType.VISIBLE_STRING, DataType.UNICODE_STRING, DataType.OCTET_STRING)
    if not bit_length(kind) and kind not in texts:
        table.fail(key, f"'{name}' has no fixed length: write hex = in place of type and value")
    return name


@accepts(f"at most {UNIT_BYTES} bytes")
def _unit(table: Table, key: Key) -> str:
    unit = printable(UNIT_BYTES)(table, key)
    return unit or table.fail(key, 'is empty: write the unit of the value, such as "rad/s"')


@accepts("a number, text, `true` or `false`, in the range of the type")
def _value(table: Table, key: Key) -> str:
    """Reads a number, a text or true and false; returns it as `sdo-write` takes it."""
    if "unit" in table:
        return _physical(table, key)
    value = table.data[key]
    if isinstance(value, bool):
        return str(value).lower()
    kind = None
    if "type" in table:
        kind = table.explain("type", lambda: parse_type(table.text("type")))
    real = kind is not None and is_real(kind)
    if isinstance(value, float) or real:
        _check_finite(table, key)
    if isinstance(value, int | float):
        fits = kind is None or real or (isinstance(value, int) and kind not in STRINGS)
        if not fits:
            wanted = "a text in quotes" if kind in STRINGS else "a whole number"
            name = table.text("type")
            table.fail(key, f"must be {wanted}, since the type is {name}, not {value!r}")
        return repr(value)
    if isinstance(value, str):
        return value
    table.fail(key, f"must be a number, a text in quotes, or true or false, not {table.show(key)}")


def _physical(table: Table, key: Key) -> str:
    """Reads a number with a unit; `Config.to_dict` writes it as a text."""
    value = table.data[key]
    if not isinstance(value, str):
        return repr(table.number(key))
    if not _check_finite(table, key):
        table.fail(key, f"must be a number, since it has a unit, not {table.show(key)}")
    return repr(float(value))


def _check_finite(table: Table, key: Key) -> bool:
    """Refuses NaN and infinity, also in a text; returns whether the value is a number."""
    try:
        finite = math.isfinite(float(table.data[key]))
    except ValueError:
        return False
    except OverflowError:  # a whole number beyond all floating-point numbers
        finite = False
    return finite or table.fail(key, f"must be a finite number, not {show(table.data[key])}")


@accepts(f"1 to {DATA_MAX} bytes")
def _hex(table: Table, key: Key) -> str:
    text = table.text(key)
    try:
        bytes.fromhex(text)
    except ValueError:
        table.fail(key, f'must be hexadecimal bytes such as "05 00", not {table.show(key)}')
    return text


@dataclass(slots=True)
class StartupConfig(Placed):
    """`[[slave.startup]]`: one table for each start-up parameter, in the order of writing.

    ecatd writes them when the slave starts, and again whenever it comes back.
    [What ecatd writes to slaves](configuration.md#what-ecatd-writes-to-slaves) has the details.

    Attributes:
        object: The object; with `complete`, where the data begin.
        type: Data type of the value, as in [`sdo-write`](command-line.md), such as `"uint32"`.
            Default: none; needed for `value`.
        value: The value; with `unit`, a physical one. Default: none; needed, or `hex`.
        unit: Unit of a [physical value](configuration.md#physical-values), such as `"rad/s"`.
            Default: none: the value is raw.
        hex: The value as hexadecimal bytes, such as `"D2 04 00 00"`, in place of `type`, `value`
            and `unit`. Default: none.
        complete: Write the whole object at once (complete access); needs `hex`.
        transition: [When it is written](configuration.md#what-ecatd-writes-to-slaves): on the way
            to PREOP, SAFEOP or OP, or before the slave leaves OP or SAFEOP.
        optional: Use the slave even if it refuses the value.
        comment: Why it is written; for people.
    """

    object: Annotated[str, read_entry]
    type: Annotated[str | None, _type] = None
    value: Annotated[str | None, _value] = None  # as `sdo-write` takes it
    unit: Annotated[str | None, _unit] = None  # of a value that `meanings.raw_parameters` makes raw
    hex: Annotated[str | None, _hex] = None
    complete: Annotated[bool, Table.boolean] = False
    transition: Annotated[str, one_of(TRANSITIONS)] = "PS"
    optional: Annotated[bool, Table.boolean] = False
    comment: Annotated[str, printable(COMMENT_BYTES)] = ""

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the object."""
        address = parse_address(self.object)
        assert address is not None, "checked when the configuration was read"
        return address

    @property
    def data(self) -> bytes:
        """The raw value as the slave gets it.

        Raises:
            UsageError: The value does not fit the type.
        """
        assert self.unit is None, "made raw when it was known which slave it is"
        if self.hex is not None:
            return encode(DataType.OCTET_STRING, self.hex)
        return encode(parse_type(self.type or ""), self.value or "")

    @property
    def text(self) -> str:
        """The value in words, with its unit if it is a physical one."""
        return f"{self.value} {self.unit or ''}".rstrip() if self.hex is None else self.hex

    @property
    def entry(self) -> Entry:
        """The object as an entry without a meaning; padding if `hex` gives its bytes."""
        kind = DataType.PADDING if self.type is None else parse_type(self.type)
        return Entry(*self.address, "", kind, bit_length(kind))

    def raw(self, entry: Entry) -> StartupConfig:
        """Makes a physical value raw.

        Args:
            entry: The object with its meaning.

        Raises:
            UsageError: Nothing says what its unit is, or the value does not fit.
        """
        if self.unit is None:
            return self
        raw = nearest_raw(entry, float(self.value or ""), self.unit)
        return replace(self, value=repr(raw), unit=None)


def read_parameter(row: Table, key: Key) -> StartupConfig:
    """Reads one table of an array of `[[slave.startup]]`, or of a file of `sdo-dump`."""
    table = row.table(key)
    values = table.read(rules_of(StartupConfig), required=["object"])
    if "hex" in values:
        if values.keys() & {"type", "value", "unit"}:
            table.fail("hex", "stands in place of type, value and unit: leave them out")
    elif "value" not in values or "type" not in values:
        missing = "type" if "value" in values else "value"
        table.fail(
            missing,
            'is missing: write a type and a value, such as type = "uint32" and value = 5, or '
            'hex = "05 00 00 00"',
        )
    parameter = StartupConfig(**values, table=table)
    if not parameter.complete and parameter.address[1] > 0xFE:
        table.fail("object", f"{parameter.object}: a subindex is at most 0xFE")
    if parameter.complete and parameter.address[1] > 1:
        table.fail("object", "complete access begins at subindex 00 or 01: write one of these")
    if parameter.unit is not None:
        kind = parse_type(parameter.type or "")
        if not bit_length(kind) or kind == DataType.BOOLEAN:
            table.fail("unit", f"is for numbers, but the type is {parameter.type}: leave it out")
        if parameter.complete:
            table.fail("complete", "needs hex: a whole object has no single type")
        return parameter
    given = "value" if parameter.hex is None else "hex"
    if parameter.complete and given == "value":
        table.fail("complete", "needs hex: a whole object has no single type")
    data = table.explain(given, lambda: parameter.data)
    if not 0 < len(data) <= DATA_MAX:
        table.fail(given, f"has {len(data)} bytes, but must have 1 to {DATA_MAX}")
    if parameter.value is not None and (kind := parse_type(parameter.type or "")) not in STRINGS:
        # However it is written, an equal value is equal text, and is written anew as a number.
        parameter.value = plain_number(kind, parameter.value)
    return parameter


def check_length(data: bytes) -> None:
    """Refuses data that no start-up parameter can have.

    Raises:
        UsageError: It is empty, or too long.
    """
    if not 0 < len(data) <= DATA_MAX:
        raise UsageError(f"it has {len(data)} bytes of data: 1 to {DATA_MAX} can be written")


def comment_of(text: str) -> str:
    """A comment of a command as that of a parameter, without what cannot be printed."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return words.encode()[:COMMENT_BYTES].decode("utf-8", "ignore")


def startup_parameter(
    known: ObjectType,
    address: tuple[int, int],
    data: bytes,
    *,
    complete: bool,
    transition: str,
    comment: str,
) -> StartupConfig:
    """Makes a start-up parameter of the bytes that are written.

    It has a type and a value if they give the same bytes again, else hexadecimal bytes.

    Args:
        known: What is known about the object.
        address: Index and subindex.
        data: The bytes.
        complete: Whether the whole object is written at once.
        transition: When it is written, one of `TRANSITIONS`.
        comment: Why it is written; what cannot be printed is left out.

    Raises:
        UsageError: The configuration cannot have such a parameter; the message says why.
    """
    check_length(data)
    if complete and address[1] > 1:
        raise UsageError("complete access begins at subindex 00 or 01")
    if address[1] > 0xFE:
        raise UsageError("a subindex is at most 0xFE")
    parameter = StartupConfig(
        f"0x{address[0]:04X}:{address[1]:02X}",
        complete=complete,
        transition=transition,
        comment=comment_of(comment),
    )
    kind = known.of(data).data_type
    parameter.type = None if complete or kind in STRINGS else type_alias(kind)
    if parameter.type is not None:
        parameter.value = str(decode(kind, data))
        try:
            if parameter.data == data:
                return parameter
        except UsageError:
            pass
    parameter.type, parameter.value, parameter.hex = None, None, data.hex(" ").upper()
    return parameter
