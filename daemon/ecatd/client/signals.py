"""Entries of the process image as objects.

The values of the last sample are read where the C client has put them, without calling it.
`client_c/src/entries.h` says what their bits mean. A test compares the two.
"""

from __future__ import annotations

import math
import reprlib
import struct
from operator import index as as_integer
from typing import Any, Protocol

from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.etg.datatypes import is_real, is_signed
from ecatd.etg.scaling import to_physical
from ecatd.shm.contract import Validity

from .connection import Connection
from .structs import QUICK


class _Cell(Protocol):
    """The bits of an entry are in item 0."""

    def __getitem__(self, number: int, /) -> Any: ...


class _Wide:
    """An entry that reaches into a ninth byte."""

    def __init__(self, data: memoryview) -> None:
        self._data = data

    def __getitem__(self, number: int) -> int:
        return int.from_bytes(self._data, "little")


class _Shifted:
    """A floating-point number that does not begin with a byte."""

    def __init__(self, data: memoryview, shift: int, bits: int) -> None:
        self._data, self._shift, self._bits = data, shift, bits

    def __getitem__(self, number: int) -> float:
        word = int.from_bytes(self._data, "little") >> self._shift & (1 << self._bits) - 1
        data = word.to_bytes(self._bits // 8, "little")
        value: float = struct.unpack("<f" if self._bits == 32 else "<d", data)[0]
        return value


class _Closed:
    """An entry of a client that was closed."""

    def __init__(self, bus: str) -> None:
        self._bus = bus

    def __getitem__(self, number: int) -> int:
        raise StateError(f"the client of bus '{self._bus}' is closed; make a new one")


_VALIDITIES = tuple(Validity)

_LETTERS = {8: "B", 16: "H", 32: "I", 64: "Q"}


def letter(entry: Signal) -> str:
    """Returns the type code of an entry in `struct` and numpy; empty if it has none."""
    if entry.bit_offset % 8:
        return ""
    if entry.real:
        return "f" if entry.bit_length == 32 else "d"
    kind = _LETTERS.get(entry.bit_length, "")
    return kind.lower() if entry.signed else kind


class Signal:
    """One PDO entry of the process image.

    Reading does not call the C client: it costs about as much as a property of Python. Writing
    stages a value; nothing leaves the process before `Client.commit`.

    Attributes:
        number: Its handle, as the functions of `ecat.h` want it.
        slave: Position of its slave.
        index: Object index.
        subindex: Object subindex.
        output: Whether it is an output (RxPDO) and not an input (TxPDO).
        data_type: CoE data type (`ecatd.etg.datatypes.DataType`).
        bit_length: Bits in the image, 1 to 64.
        signed: Whether `raw` is a signed integer.
        real: Whether `raw` is a floating-point number.
        domain: Its domain, 0 first.
        bit_offset: Its first bit in the image of the domain.
        scale: `value` = `raw` * scale + offset.
        offset: See scale; in `unit`.
        minimum: Smallest raw value of an output, -inf: as the type allows.
        maximum: Largest raw value of an output, inf: as the type allows.
        pdo: Object index of its PDO.
        pdo_name: Name of its PDO, may be empty.
        name: Its name from SII or the object dictionary.
        unit: Unit of `value`, may be empty.
    """

    __slots__ = (
        "_as_parameter_",
        "_cell",
        "_connection",
        "_high",
        "_low",
        "_mask",
        "_shift",
        "_sign",
        "bit_length",
        "bit_offset",
        "data_type",
        "domain",
        "index",
        "maximum",
        "minimum",
        "name",
        "number",
        "offset",
        "output",
        "pdo",
        "pdo_name",
        "real",
        "scale",
        "signed",
        "slave",
        "subindex",
        "unit",
    )

    def __init__(self, connection: Connection, number: int) -> None:
        self._connection = connection
        self.number = self._as_parameter_ = number
        self.describe()

    def describe(self) -> None:
        """Takes the description of the entry from the daemon: first, and after each restart."""
        info = self._connection.signal(self.number)
        self.slave: int = info.slave
        self.index: int = info.index
        self.subindex: int = info.subindex
        self.output = bool(info.output)
        self.data_type: int = info.type
        self.bit_length: int = info.bit_length
        self.signed = is_signed(info.type)
        self.real = is_real(info.type) and self.bit_length == (64 if info.type == 0x0011 else 32)
        self.domain: int = info.domain
        self.bit_offset: int = info.bit_offset
        self.scale: float = info.scale
        self.offset: float = info.offset
        self.minimum: float = info.minimum
        self.maximum: float = info.maximum
        self.pdo: int = info.pdo
        self.pdo_name: str = info.pdo_name.decode("utf-8", "replace")
        self.name: str = info.name.decode("utf-8", "replace")
        self.unit: str = info.unit.decode("utf-8", "replace")
        # The range that ecat_write_int() accepts: it takes 64 bits as they are.
        unsigned = not (self.signed or self.real)
        self._low = 0 if unsigned else -(1 << 63)
        self._high = (1 << (64 if unsigned and self.bit_length == 64 else 63)) - 1
        self._cell = self._find_cell(self._connection.images[info.domain])

    def _find_cell(self, image: memoryview) -> _Cell:
        first, self._shift = divmod(self.bit_offset, 8)
        self._mask = (1 << self.bit_length) - 1
        self._sign = 1 << (self.bit_length - 1) if self.signed else 0
        kind = letter(self)
        if kind:
            return image[first : first + self.bit_length // 8].cast(kind)  # type: ignore[call-overload, no-any-return]
        span = self._shift + self.bit_length
        if self.real or span > 64:
            data = image[first : first + 9]
            return _Shifted(data, self._shift, self.bit_length) if self.real else _Wide(data)
        bits = next(bits for bits in _LETTERS if span <= bits)
        return image[first : first + bits // 8].cast(_LETTERS[bits])  # type: ignore[call-overload, no-any-return]

    def detach(self) -> None:
        """The client was closed: reading raises `StateError`."""
        self._cell = _Closed(self._connection.bus)

    @property
    def raw(self) -> Any:
        """The raw value of the process data: an int, or a float for REAL32 and REAL64.

        Reading gives the value of the last sample; for an output, the value that was sent. Setting
        stages a value for the next `Client.commit`.

        Raises:
            UsageError: The value is out of the range of the entry, or the entry is an input.
            StateError: The output must be claimed first.
            LeaseError: This client has lost its outputs; claim them again. If the daemon lives,
                `Client.commit` raises this error first.
        """
        return self._cell[0]

    @raw.setter
    def raw(self, value: float) -> None:
        self._stage(value)

    def _stage(self, value: float) -> None:
        connection = self._connection
        try:
            whole = as_integer(value)  # type: ignore[arg-type]
        except TypeError:
            self._stage_real(number_of(value))
            return
        if self._low <= whole <= self._high:
            code = QUICK.ecat_write_int(connection.address, self.number, whole)
            if code < 0:
                connection.fail(code)
        elif self.real:
            self._stage_real(number_of(whole))
        else:  # raises the error about the range; a float could be rounded into the range
            nearest = number_of(whole)
            self._stage_real(math.nextafter(nearest, math.copysign(math.inf, nearest)))

    def _stage_real(self, value: float) -> None:
        connection = self._connection
        connection.check(QUICK.ecat_write(connection.address, self.number, value))

    @property
    def value(self) -> float:
        """The physical value in `unit`: `raw` * scale + offset.

        A value that is set is rounded to a whole raw value if the entry is an integer.
        """
        return to_physical(self.raw, self.scale, self.offset)

    @value.setter
    def value(self, value: float) -> None:
        connection = self._connection
        physical = number_of(value)
        connection.check(QUICK.ecat_write_physical(connection.address, self.number, physical))

    @property
    def validity(self) -> Validity:
        """Whether the value of the last sample can be trusted."""
        code: int = QUICK.ecat_validity(self._connection.address, self.number)
        return _VALIDITIES[code] if code >= 0 else self._connection.fail(code)

    @property
    def address(self) -> str:
        """The address as it is always printed: `0x6060:00`."""
        return f"0x{self.index:04X}:{self.subindex:02X}"

    @property
    def path(self) -> str:
        """The shortest name by which `Client.signal` finds it, such as `0/Statusword`.

        If an entry is mapped twice, only the first has such a name; the other gets address#number.
        """
        names = (self.name, f"{self.pdo_name}/{self.name}", self.address)
        for path in (f"{self.slave}/{name}" for name in names):
            try:
                if self._connection.lookup(path) == self.number:
                    return path
            except EcatError:
                continue
        return f"{self.slave}/{self.address}#{self.number}"

    def __repr__(self) -> str:
        kind = "output" if self.output else "input"
        return f"<{kind} {self.slave}/{self.address} {self.name!r}, {self.bit_length} bit>"


class BitSignal(Signal):
    """An entry that does not fill whole bytes."""

    __slots__ = ()

    @property
    def raw(self) -> Any:  # noqa: D102  as above
        return ((self._cell[0] >> self._shift & self._mask) ^ self._sign) - self._sign

    @raw.setter
    def raw(self, value: float) -> None:
        self._stage(value)


def make(connection: Connection, number: int) -> Signal:
    """The object of an entry."""
    plain = Signal(connection, number)
    return plain if letter(plain) or plain.real else BitSignal(connection, number)


def number_of(value: object) -> float:
    """Converts a value that a program wants to write.

    Raises:
        UsageError: It is not a number.
    """
    try:
        if not isinstance(value, (str, bytes)):
            return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        pass
    raise UsageError(f"{reprlib.repr(value)} is not a number that an output can have")
