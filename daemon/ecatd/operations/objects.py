"""Operations about the objects of a slave: SDOs, and the object dictionary."""

from __future__ import annotations

from typing import NotRequired

from ecatd.base.errors import UsageError

from .fields import ClientName, Index, SlaveReference, Subindex
from .operation import Cost, Map, Operation

DATA_MAX = 32 * 1024
"""Bytes of the value of an object."""


class Sdo(Map):
    """The value of an object, as it was uploaded or downloaded.

    Attributes:
        data: Its bytes, little endian.
        name: Name of the object; may be empty.
        data_type: Its CoE data type index; where nobody knows it, an unsigned type of that size, or
            OCTET_STRING.
        unit: Unit of the physical value. It, `scale` and `offset` are there if they are known.
        scale: Physical value = value * scale + offset.
        offset: See `scale`; in `unit`.
    """

    data: bytes
    name: str
    data_type: int
    unit: NotRequired[str]
    scale: NotRequired[float]
    offset: NotRequired[float]


class Objects(Map):
    """The objects of a slave.

    Attributes:
        objects: The index of each.
    """

    objects: list[int]


class ObjectEntry(Map):
    """An entry of an object.

    Attributes:
        subindex: Its subindex.
        name: Its name.
        data_type: Its CoE data type index.
        bit_length: Its length in bits.
        access: Its access rights, bits as in ETG.1000.6.
        unit: Unit code (ETG.1004), 0 for none.
        default: Its value as the device is delivered, as SDO data; None: not known.
        minimum: Its smallest value, as SDO data; None: not known.
        maximum: Its largest one.
    """

    subindex: int
    name: str
    data_type: int
    bit_length: int
    access: int
    unit: int
    default: bytes | None
    minimum: bytes | None
    maximum: bytes | None


class ObjectDescription(Map):
    """What an object is.

    Attributes:
        index: Its index.
        name: Its name.
        code: Its kind: 7 a variable, 8 an array, 9 a record, or another number of the slave.
        data_type: Its CoE data type index; of a record that of its structure.
        entries: Its entries.
    """

    index: int
    name: str
    code: int
    data_type: int
    entries: list[ObjectEntry]


class SdoRead(Operation[Sdo]):
    """Uploads an object.

    Attributes:
        slave: Position or name.
        index: Object index.
        subindex: Object subindex.
        complete: Whether to use complete access.
    """

    op = "sdo_read"
    key = "ro/sdo/{slave}/{index}/{subindex}"
    cost = Cost.MAILBOX
    slave: SlaveReference
    index: Index
    subindex: Subindex = 0
    complete: bool = False


class SdoWrite(Operation[Sdo]):
    """Downloads an object; has either `data` or `value`.

    Attributes:
        slave: Position or name.
        index: Object index.
        data: Bytes, little endian.
        subindex: Object subindex.
        complete: Whether to use complete access.
        value: The value as a user types it; the daemon finds out the type of the object.
        by: The name that the client gives itself, for the log.
    """

    op = "sdo_write"
    key = "rw/sdo/{slave}/{index}/{subindex}"
    cost = Cost.MAILBOX
    slave: SlaveReference
    index: Index
    data: bytes | None = None
    subindex: Subindex = 0
    complete: bool = False
    value: str | None = None
    by: ClientName = ""

    def _check(self) -> None:
        if (self.data is None) == (self.value is None):
            raise UsageError(f"{self.op} needs either 'data' or 'value'")
        if self.data is not None:
            check_data(self.data)


class ListObjects(Operation[Objects]):
    """Asks which objects a slave has. The daemon asks the slave each time.

    Attributes:
        slave: Position or name.
    """

    op = "list_objects"
    key = "ro/objects/{slave}"
    cost = Cost.MAILBOX
    slave: SlaveReference


class DescribeObject(Operation[ObjectDescription]):
    """Asks for names, types and access rights of an object. The daemon keeps them.

    Attributes:
        slave: Position or name.
        index: Object index.
    """

    op = "describe_object"
    key = "ro/objects/{slave}/{index}"
    cost = Cost.MAILBOX
    slave: SlaveReference
    index: Index


def check_data(data: bytes) -> None:
    """Checks the length of data to download.

    Raises:
        UsageError: There are no data, or too many bytes.
    """
    if not 1 <= len(data) <= DATA_MAX:
        raise UsageError(f"'data' of sdo_write has {len(data)} bytes; 1 to {DATA_MAX} are allowed")
