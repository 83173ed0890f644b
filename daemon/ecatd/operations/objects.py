"""Operations about the objects of a slave: SDOs, and the object dictionary."""

from __future__ import annotations

from typing import NotRequired

from ecatd.base.errors import UsageError

from .fields import ClientName, Index, SlaveReference, Subindex
from .operation import Cost, Map, Operation

DATA_MAX = 32 * 1024
"""Bytes of the value of an object."""


class Sdo(Map):
    """The value of an object, as it was uploaded or downloaded."""

    data: bytes  #: Its bytes, little endian.
    name: str  #: Name of the object; may be empty.
    #: Its CoE data type index; where nobody knows it, an unsigned type of that size, or
    #: OCTET_STRING.
    data_type: int
    #: Unit of the physical value. It, `scale` and `offset` are there if they are known.
    unit: NotRequired[str]
    scale: NotRequired[float]  #: Physical value = value * scale + offset.
    offset: NotRequired[float]  #: See `scale`; in `unit`.


class Objects(Map):
    """The objects of a slave."""

    objects: list[int]  #: The index of each.


class ObjectEntry(Map):
    """An entry of an object."""

    subindex: int  #: Its subindex.
    name: str  #: Its name.
    data_type: int  #: Its CoE data type index.
    bit_length: int  #: Its length in bits.
    access: int  #: Its access rights, bits as in ETG.1000.6.
    unit: int  #: Unit code (ETG.1004), 0 for none.
    default: bytes | None  #: Its value as the device is delivered, as SDO data; None: not known.
    minimum: bytes | None  #: Its smallest value, as SDO data; None: not known.
    maximum: bytes | None  #: Its largest one.


class ObjectDescription(Map):
    """What an object is."""

    index: int  #: Its index.
    name: str  #: Its name.
    code: int  #: Its kind: 7 a variable, 8 an array, 9 a record, or another number of the slave.
    data_type: int  #: Its CoE data type index; of a record that of its structure.
    entries: list[ObjectEntry]  #: Its entries.


class SdoRead(Operation[Sdo]):
    """Uploads an object."""

    op = "sdo_read"
    key = "ro/sdo/{slave}/{index}/{subindex}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    index: Index  #: Object index.
    subindex: Subindex = 0  #: Object subindex.
    complete: bool = False  #: Whether to use complete access.


class SdoWrite(Operation[Sdo]):
    """Downloads an object; has either `data` or `value`."""

    op = "sdo_write"
    key = "rw/sdo/{slave}/{index}/{subindex}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    index: Index  #: Object index.
    data: bytes | None = None  #: Bytes, little endian.
    subindex: Subindex = 0  #: Object subindex.
    complete: bool = False  #: Whether to use complete access.
    #: The value as a user types it; the daemon finds out the type of the object.
    value: str | None = None
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        if (self.data is None) == (self.value is None):
            raise UsageError(f"{self.op} needs either 'data' or 'value'")
        if self.data is not None:
            check_data(self.data)


class ListObjects(Operation[Objects]):
    """Asks which objects a slave has. The daemon asks the slave each time."""

    op = "list_objects"
    key = "ro/objects/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.


class DescribeObject(Operation[ObjectDescription]):
    """Asks for names, types and access rights of an object. The daemon keeps them."""

    op = "describe_object"
    key = "ro/objects/{slave}/{index}"
    cost = Cost.MAILBOX
    slave: SlaveReference  #: Position or name.
    index: Index  #: Object index.


def check_data(data: bytes) -> None:
    """Checks the length of data to download.

    Raises:
        UsageError: There are no data, or too many bytes.
    """
    if not 1 <= len(data) <= DATA_MAX:
        raise UsageError(f"'data' of sdo_write has {len(data)} bytes; 1 to {DATA_MAX} are allowed")
