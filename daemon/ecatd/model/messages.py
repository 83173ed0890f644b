"""Requests about the bus, and their validation.

A client sends a request to the gateway over Zenoh (`queries.py`), and the gateway sends it to the
bus server as a map in msgpack. Gateway and bus server both check it with `parse_request`, since
neither trusts its client.

Each kind of request has a name, `op`, and its Zenoh key below the bus, `key`. A key begins with
`ro`, or with `rw` if the request changes something, and names the kind and then the slave, so that
access control can distinguish all three. Fields in braces stand in the key.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar, NamedTuple, dataclass_transform

from .al import AlState
from .errors import UsageError
from .log_levels import LEVELS, PARTS

_BY_MAX = 200
_NOT_PLAIN = re.compile(r"[^\w .,@:/()-]")
_FILE_NAME_MAX, _DIGEST_DIGITS, _NAME_SHOWN = 255, 64, 40
FILE_MAX = 64 << 20
"""Bytes of a file that is transferred."""
TRANSFER_MAX = 1 << 53
"""Highest number of a transfer."""
FILE_PART = 32 * 1024
"""Bytes of a file in one request or answer."""
SII_WORDS_MAX = 64
"""Words of an EEPROM that one request writes: that takes up to half a second."""

KINDS: dict[str, type[Request]] = {}
"""The kinds of requests, by `op`."""


class Field(NamedTuple):
    """A field of a request.

    Attributes:
        kind: Its type, for messages.
        types: Names of the types that it may have.
        needed: Whether it is required.
    """

    kind: str
    types: frozenset[str]
    needed: bool


@dataclass_transform(frozen_default=True, eq_default=True)
class Request:
    """A request; each subclass is a kind of request, and its annotations are the fields.

    It works like a dataclass, but without `dataclasses`: loading that module takes as long as
    loading all other modules of a command.
    """

    op: ClassVar[str]
    key: ClassVar[str]
    fields: ClassVar[dict[str, Field]]

    def __init_subclass__(cls) -> None:
        cls.fields = {
            name: Field(kind, frozenset(kind.split(" | ")), not hasattr(cls, name))
            for name, kind in cls.__annotations__.items()
        }
        KINDS[cls.op] = cls

    def __init__(self, *args: Any, **values: Any) -> None:
        values.update(zip(self.fields, args, strict=False))
        missing = [name for name in self.fields if name not in values and self.fields[name].needed]
        if missing:
            raise UsageError(f"{self.op} needs {', '.join(missing)}")
        self.__dict__.update(values)
        self._check()

    def _check(self) -> None:
        """Checks the fields beyond their types.

        Raises:
            UsageError: The fields contradict each other.
        """

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and repr(self) == repr(other)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({to_map(self)})"


class Describe(Request):
    """Asks for the bus description, which is long and does not change while the daemon runs."""

    op = "describe"
    key = "ro/slaves"


class ReadInfo(Request):
    """Asks about the daemon: version, interface, start, cycle, and present links and recovery."""

    op = "info"
    key = "ro/info"


class ReadConfig(Request):
    """Asks for the configuration in force, and for the origins of its values."""

    op = "config"
    key = "ro/config"


class ReadStates(Request):
    """Asks for the AL states of all slaves, which are read for this request."""

    op = "states"
    key = "ro/state"


class Rescan(Request):
    """Asks which devices are on the wire now."""

    op = "rescan"
    key = "ro/wire"


class SetState(Request):
    """Asks to bring one slave or all slaves to an AL state.

    Attributes:
        state: Name of the state.
        slave: Position or name, or None for all slaves.
        by: The name that the client gives itself, for the log.
    """

    op = "set_state"
    key = "rw/state/{slave}"
    state: str
    slave: int | str | None = None
    by: str = ""


class ReadLogLevels(Request):
    """Asks for the levels of the log in force, and for those of the configuration."""

    op = "log_levels"
    key = "ro/log"


class SetLogLevel(Request):
    """Asks for another level of the log, until the configuration is read again.

    Attributes:
        level: One of `LEVELS`.
        part: One of `PARTS`, or None for all of them.
        by: The name that the client gives itself, for the log.
    """

    op = "set_log_level"
    key = "rw/log/{part}"
    level: str
    part: str | None = None
    by: str = ""

    def _check(self) -> None:
        if self.level not in LEVELS:
            raise UsageError(f"{self.level!r} is not a level: use {', '.join(LEVELS)}")
        if self.part is not None and self.part not in PARTS:
            raise UsageError(f"{self.part!r} is not a part of the log: use {', '.join(PARTS)}")


class SdoRead(Request):
    """Uploads an object.

    Attributes:
        slave: Position or name; see `Bus.find`.
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
        slave: Position or name; see `Bus.find`.
        index: Object index.
        data: Bytes, little endian.
        subindex: Object subindex.
        complete: Whether to use complete access.
        value: The value as a user types it (`model.datatypes.encode`); the daemon finds out the
            type of the object.
        by: The name that the client gives itself, for the log; empty for a model or program that
            does it repeatedly.
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
        slave: Position or name; see `Bus.find`.
    """

    op = "list_objects"
    key = "ro/objects/{slave}"
    slave: int | str


class DescribeObject(Request):
    """Asks for names, types and access rights of an object. The daemon keeps them.

    Attributes:
        slave: Position or name; see `Bus.find`.
        index: Object index.
    """

    op = "describe_object"
    key = "ro/objects/{slave}/{index}"
    slave: int | str
    index: int


class ReadRegister(Request):
    """Reads registers of the ESC of a slave.

    Attributes:
        slave: Position or name; see `Bus.find`.
        address: Address of the first register.
        size: How many bytes.
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
        slave: Position or name; see `Bus.find`.
        address: Address of the first register.
        data: The bytes.
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


class ReadSii(Request):
    """Reads a part of the EEPROM of a slave (SII).

    Attributes:
        slave: Position or name; see `Bus.find`.
        word: Address of the first word.
        count: How many words.
    """

    op = "read_sii"
    key = "ro/sii/{slave}"
    slave: int | str
    word: int = 0
    count: int = 64


class WriteSii(Request):
    """Writes a part of the EEPROM of a slave (SII).

    Attributes:
        slave: Position or name; see `Bus.find`.
        word: Address of the first word.
        data: The words, little endian.
        by: The name that the client gives itself, for the log.
    """

    op = "write_sii"
    key = "rw/sii/{slave}"
    slave: int | str
    word: int
    data: bytes
    by: str = ""

    def _check(self) -> None:
        if len(self.data) % 2 or not 2 <= len(self.data) <= 2 * SII_WORDS_MAX:
            raise UsageError(
                f"'data' of {self.op} has {len(self.data)} bytes: 1 to {SII_WORDS_MAX} words of 2 "
                "bytes are allowed"
            )


class StartFoe(Request):
    """Starts to transfer a file (FoE). The daemon goes on without the client, and keeps the file.

    A file that is written is sent to the daemon first, by `PutFoe`. If the same file is on its way
    to the slave already, the answer is about that transfer.

    Attributes:
        slave: Position or name; see `Bus.find`.
        file: Name of the file, as the slave knows it.
        write: Whether to write the file to the slave, and not to read it.
        size: For writing: its size in bytes.
        digest: For writing: its SHA-256, in hex.
        password: Password of the slave for it, 0 for none.
        boot: Whether to bring the slave to BOOT before, and back afterwards.
        by: The name that the client gives itself, for the log.
    """

    op = "start_foe"
    key = "rw/foe/{slave}"
    slave: int | str
    file: str
    write: bool = False
    size: int = 0
    digest: str = ""
    password: int = 0
    boot: bool = False
    by: str = ""

    def _check(self) -> None:
        try:
            length = len(self.file.encode("latin-1"))
        except UnicodeEncodeError:
            length = 0
        if not 1 <= length <= _FILE_NAME_MAX or not self.file.isprintable():
            raise UsageError(
                f"{self.file[:_NAME_SHOWN]!r} is not a valid name of a file: a slave takes 1 to "
                f"{_FILE_NAME_MAX} printable letters of Latin-1, and this has {len(self.file)}"
            )
        if self.write and len(self.digest) != _DIGEST_DIGITS:
            raise UsageError(f"'digest' of {self.op} must be the SHA-256 of the file in hex")


class PutFoe(Request):
    """Sends a part of a file that is to be written; the slave gets it when all parts are there.

    Attributes:
        transfer: Number of the transfer.
        offset: Where the part begins: how much of the file the daemon has.
        data: The part.
    """

    op = "put_foe"
    key = "rw/foe/{transfer}/put"
    transfer: int
    offset: int
    data: bytes


class TakeFoe(Request):
    """Asks for a part of a file that has been read.

    Attributes:
        transfer: Number of the transfer, a secret of the client that has started it.
        offset: Where the part begins.
    """

    op = "take_foe"
    key = "ro/foe/{transfer}/{offset}"
    transfer: int
    offset: int


class ReadFoe(Request):
    """Asks how far a transfer is.

    Attributes:
        transfer: Its number.
    """

    op = "read_foe"
    key = "ro/foe/{transfer}"
    transfer: int


class CancelFoe(Request):
    """Ends a transfer. What the slave does with a part of a file depends on the slave.

    Attributes:
        transfer: Its number.
        by: The name that the client gives itself, for the log.
    """

    op = "cancel_foe"
    key = "rw/foe/{transfer}/cancel"
    transfer: int
    by: str = ""


class ReadIdn(Request):
    """Reads an IDN of a drive (SoE).

    Attributes:
        slave: Position or name; see `Bus.find`.
        idn: The IDN, as `parse_idn` makes it.
        drive: Number of the drive in the slave.
    """

    op = "read_idn"
    key = "ro/idn/{slave}/{drive}/{idn}"
    slave: int | str
    idn: int
    drive: int = 0


class WriteIdn(Request):
    """Writes the value of an IDN of a drive (SoE).

    Attributes:
        slave: Position or name; see `Bus.find`.
        idn: The IDN, as `parse_idn` makes it.
        data: The bytes of the value, little endian; of a list without its lengths.
        drive: Number of the drive in the slave.
        by: The name that the client gives itself, for the log.
    """

    op = "write_idn"
    key = "rw/idn/{slave}/{drive}/{idn}"
    slave: int | str
    idn: int
    data: bytes
    drive: int = 0
    by: str = ""

    def _check(self) -> None:
        if len(self.data) > DATA_MAX:
            raise UsageError(f"'data' of {self.op} has more than {DATA_MAX} bytes")


class ReadEvents(Request):
    """Asks for the last events.

    Attributes:
        since: Number of the first one; 0 for all that are kept.
    """

    op = "read_events"
    key = "ro/events"
    since: int = 0


RINGS = ("cycle", "control")
"""Kinds of frames: those of the cyclic exchange, and all others."""


class ReadFrames(Request):
    """Asks for the last frames that were sent and received.

    Attributes:
        ring: Which ones, of `RINGS`.
        position: Where to begin: 0 for the oldest, or `position` of the last answer.
    """

    op = "read_frames"
    key = "ro/frames/{ring}"
    ring: str
    position: int = 0


_RANGES = {
    "slave": (0, 65535),
    "index": (0, 0xFFFF),
    "idn": (0, 0xFFFF),
    "drive": (0, 7),
    "subindex": (0, 0xFF),
    "address": (0, 0xFFFF),
    "size": (0, FILE_MAX),
    "offset": (0, FILE_MAX),
    "transfer": (1, TRANSFER_MAX),
    "password": (0, 0xFFFFFFFF),
    "position": (0, 1 << 62),
    "since": (0, 1 << 62),
    "word": (0, 0x3FFFF),
    "count": (1, 256),
}
DATA_MAX = 32 * 1024
"""Bytes of the value of an object."""
_REGISTERS_END, _REGISTER_BYTES_MAX = 0x1000, 256


def to_map(request: Request) -> dict[str, Any]:
    """The request as a map, with its `op`."""
    return {"op": request.op} | {name: getattr(request, name) for name in request.fields}


def on_behalf(request: Request, who: str) -> Request:
    """The same request with the name of the user who asks, if it has such a field.

    The name that the client gives itself follows in brackets, without characters that could be
    mistaken for something else in a line of the log.
    """
    if "by" not in request.fields:
        return request
    values = {name: getattr(request, name) for name in request.fields}
    said = _NOT_PLAIN.sub("", values["by"])
    return type(request)(**{**values, "by": (f"{who} [{said}]" if said else who)[:_BY_MAX]})


def whose(by: str) -> str:
    """The user in a text of `on_behalf`, without the name that the client gives itself."""
    return by.partition(" [")[0]


def parse_request(data: Any) -> Request:
    """Makes a request from a map, and checks it.

    Raises:
        UsageError: The operation is unknown, or a key is unknown, missing, of the wrong type or
            out of range; the message names the key.
    """
    if not isinstance(data, dict):
        raise UsageError("a request is a map with string keys")
    values = dict(data)
    op = values.pop("op", None)
    if not isinstance(op, str) or op not in KINDS:
        raise UsageError(f"op {op!r} is not a request: use {', '.join(KINDS)}")
    kind = KINDS[op]
    known = kind.fields
    for key, value in values.items():
        if key not in known:
            raise UsageError(f"'{key}' is not a key of {op}: use {', '.join(known) or 'none'}")
        _check_field(op, key, value, known[key])
    return kind(**values)


def check_data(data: bytes) -> None:
    """Checks the length of data to download.

    Raises:
        UsageError: There are no data, or too many bytes.
    """
    if not 1 <= len(data) <= DATA_MAX:
        raise UsageError(f"'data' of sdo_write has {len(data)} bytes; 1 to {DATA_MAX} are allowed")


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


def _check_field(op: str, key: str, value: Any, wanted: Field) -> None:
    # Types are compared by name: bool is a subclass of int, but true is no slave number.
    found = "None" if value is None else type(value).__name__
    if found not in wanted.types:
        raise UsageError(f"'{key}' of {op} must be {wanted.kind}, not {found}")
    if key in _RANGES and isinstance(value, int):
        low, high = _RANGES[key]
        if not low <= value <= high:
            raise UsageError(f"'{key}' of {op} is {value}, but must be from {low} to {high}")
    if key == "data" and value is not None and op == SdoWrite.op:
        check_data(value)
    if key == "by" and (len(value) > _BY_MAX or not value.isprintable()):
        raise UsageError(f"'by' of {op} must be up to {_BY_MAX} printable characters")
    if key == "state":
        AlState.parse(value)
    if key == "ring" and value not in RINGS:
        raise UsageError(f"'ring' of {op} is {value!r}, but must be {' or '.join(RINGS)}")
