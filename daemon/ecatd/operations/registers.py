"""Operations about registers of slave controllers, and their error counters."""

from __future__ import annotations

from ecatd.base.errors import UsageError
from ecatd.etg.port_errors import PortErrors

from .fields import ByteCount, ClientName, Register, SlaveReference
from .operation import Cost, Map, Operation

_REGISTERS_END, _REGISTER_BYTES_MAX = 0x1000, 256


class Data(Map):
    """Bytes.

    Attributes:
        data: As read: of registers after a write those that they have then, of a file empty at its
            end.
    """

    data: bytes


class SlaveCounters(Map):
    """The error counters of a slave.

    Attributes:
        position: Its position.
        ports: Those of its ports, by number.
        processing: Errors of the processing unit: frames that are not EtherCAT, or malformed.
        pdi: Errors of the process data interface.
        since: Unix time at which ecatd cleared them; None if it has not.
    """

    position: int
    ports: list[PortErrors]
    processing: int
    pdi: int
    since: float | None


class Errors(Map):
    """Error counters.

    Attributes:
        slaves: Those of each slave that answers.
    """

    slaves: list[SlaveCounters]


class ReadRegister(Operation[Data]):
    """Reads registers of the ESC of a slave.

    Attributes:
        slave: Position or name.
        address: Address of the first register.
        size: How many bytes, 1 to 256.
    """

    op = "read_register"
    key = "ro/register/{slave}/{address}"
    cost = Cost.FRAMES
    slave: SlaveReference
    address: Register
    size: ByteCount = 2

    def _check(self) -> None:
        check_registers(self.address, self.size)


class WriteRegister(Operation[Data]):
    """Writes registers of the ESC of a slave.

    Attributes:
        slave: Position or name.
        address: Address of the first register.
        data: The bytes, 1 to 256.
        by: The name that the client gives itself, for the log.
    """

    op = "write_register"
    key = "rw/register/{slave}/{address}"
    cost = Cost.FRAMES
    disturbs_files = True
    slave: SlaveReference
    address: Register
    data: bytes
    by: ClientName = ""

    def _check(self) -> None:
        check_registers(self.address, len(self.data))


class ReadErrors(Operation[Errors]):
    """Asks for the error counters of all slaves, and for the links between them."""

    op = "read_errors"
    key = "ro/errors"
    cost = Cost.FRAMES


class ResetErrors(Operation[Errors]):
    """Clears the error counters of one slave, or of all slaves.

    Attributes:
        slave: Position or name, or None for all slaves.
        by: The name that the client gives itself, for the log.
    """

    op = "reset_errors"
    key = "rw/errors/{slave}"
    cost = Cost.FRAMES
    slave: SlaveReference | None = None
    by: ClientName = ""


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
