"""Operations about registers of slave controllers, and their error counters."""

from __future__ import annotations

from ecatd.base.errors import UsageError
from ecatd.description.cables import LinkVerdict
from ecatd.etg.port_errors import PortErrors

from .fields import ByteCount, ClientName, Register, SlaveReference
from .operation import Cost, Map, Operation

_REGISTERS_END, _REGISTER_BYTES_MAX = 0x1000, 256


class Data(Map):
    """Bytes."""

    #: As read: of registers after a write those that they have then, of a file empty at its end.
    data: bytes


class SlaveCounters(Map):
    """The error counters of a slave."""

    position: int  #: Its position.
    ports: list[PortErrors]  #: Those of its ports, by number.
    processing: int  #: Errors of the processing unit: frames that are not EtherCAT, or malformed.
    pdi: int  #: Errors of the process data interface.
    since: float | None  #: Unix time at which ecatd cleared them; None if it has not.


class Errors(Map):
    """Error counters, and what follows from them."""

    slaves: list[SlaveCounters]  #: Those of each slave that answers.
    links: list[LinkVerdict]  #: What is known of each cable: each link of the bus once.


class ReadRegister(Operation[Data]):
    """Reads registers of the ESC of a slave."""

    op = "read_register"
    key = "ro/register/{slave}/{address}"
    cost = Cost.FRAMES
    slave: SlaveReference  #: Position or name.
    address: Register  #: Address of the first register.
    size: ByteCount = 2  #: How many bytes, 1 to 256.

    def _check(self) -> None:
        check_registers(self.address, self.size)


class WriteRegister(Operation[Data]):
    """Writes registers of the ESC of a slave."""

    op = "write_register"
    key = "rw/register/{slave}/{address}"
    cost = Cost.FRAMES
    disturbs_files = True
    slave: SlaveReference  #: Position or name.
    address: Register  #: Address of the first register.
    data: bytes  #: The bytes, 1 to 256.
    by: ClientName = ""  #: The name that the client gives itself, for the log.

    def _check(self) -> None:
        check_registers(self.address, len(self.data))


class ReadErrors(Operation[Errors]):
    """Asks for the error counters of all slaves, and for a verdict on each link between them."""

    op = "read_errors"
    key = "ro/errors"
    cost = Cost.FRAMES


class ResetErrors(Operation[Errors]):
    """Clears the error counters of one slave, or of all slaves."""

    op = "reset_errors"
    key = "rw/errors/{slave}"
    cost = Cost.FRAMES
    slave: SlaveReference | None = None  #: Position or name, or None for all slaves.
    by: ClientName = ""  #: The name that the client gives itself, for the log.


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
