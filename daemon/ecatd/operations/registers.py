"""Requests about registers of slave controllers, and their error counters."""

from __future__ import annotations

from ecatd.base.errors import UsageError

from .operation import Request

_REGISTERS_END, _REGISTER_BYTES_MAX = 0x1000, 256


class ReadRegister(Request):
    """Reads registers of the ESC of a slave.

    Attributes:
        slave: Position or name.
        address: Address of the first register.
        size: How many bytes, 1 to 256.
    """

    op = "read_register"
    key = "ro/register/{slave}/{address}"
    slave: int | str
    address: int
    size: int = 2

    def _check(self) -> None:
        check_registers(self.address, self.size)


class WriteRegister(Request):
    """Writes registers of the ESC of a slave.

    Attributes:
        slave: Position or name.
        address: Address of the first register.
        data: The bytes, 1 to 256.
        by: The name that the client gives itself, for the log.
    """

    op = "write_register"
    key = "rw/register/{slave}/{address}"
    slave: int | str
    address: int
    data: bytes
    by: str = ""

    def _check(self) -> None:
        check_registers(self.address, len(self.data))


class ReadErrors(Request):
    """Asks for the error counters of all slaves, and for the links between them."""

    op = "read_errors"
    key = "ro/errors"


class ResetErrors(Request):
    """Clears the error counters of one slave, or of all slaves.

    Attributes:
        slave: Position or name, or None for all slaves.
        by: The name that the client gives itself, for the log.
    """

    op = "reset_errors"
    key = "rw/errors/{slave}"
    slave: int | str | None = None
    by: str = ""


def check_registers(address: int, size: int) -> None:
    """Checks which registers are read or written.

    Raises:
        UsageError: Some of them are not registers, or they are too many.
    """
    if not 1 <= size <= _REGISTER_BYTES_MAX:
        raise UsageError(f"{size} bytes of registers: 1 to {_REGISTER_BYTES_MAX} are allowed")
    if address + size > _REGISTERS_END:
        raise UsageError(
            f"registers end before 0x{_REGISTERS_END:04X}, but 0x{address:04X} and {size} bytes "
            "go beyond: there are process data and mailboxes, and reading these takes data away "
            "from the daemon"
        )
