"""Requests about the objects of a slave: SDOs, and the object dictionary."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .operation import Request

DATA_MAX = 32 * 1024
"""Bytes of the value of an object."""


class SdoRead(Request):
    """Uploads an object.

    Attributes:
        slave: Position or name.
        index: Object index.
        subindex: Object subindex.
        complete: Whether to use complete access.
    """

    op = "sdo_read"
    key = "ro/sdo/{slave}/{index}/{subindex}"
    slave: int | str
    index: int
    subindex: int = 0
    complete: bool = False


class SdoWrite(Request):
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
    slave: int | str
    index: int
    data: bytes | None = None
    subindex: int = 0
    complete: bool = False
    value: str | None = None
    by: str = ""

    def _check(self) -> None:
        if (self.data is None) == (self.value is None):
            raise UsageError(f"{self.op} needs either 'data' or 'value'")


class ListObjects(Request):
    """Asks which objects a slave has. The daemon asks the slave each time.

    Attributes:
        slave: Position or name.
    """

    op = "list_objects"
    key = "ro/objects/{slave}"
    slave: int | str


class DescribeObject(Request):
    """Asks for names, types and access rights of an object. The daemon keeps them.

    Attributes:
        slave: Position or name.
        index: Object index.
    """

    op = "describe_object"
    key = "ro/objects/{slave}/{index}"
    slave: int | str
    index: int


def check_data(data: bytes) -> None:
    """Checks the length of data to download.

    Raises:
        UsageError: There are no data, or too many bytes.
    """
    if not 1 <= len(data) <= DATA_MAX:
        raise UsageError(f"'data' of sdo_write has {len(data)} bytes; 1 to {DATA_MAX} are allowed")
