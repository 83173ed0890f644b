"""All errors that this project raises on purpose.

```
EcatError                 70  a defect in ecatd, if nothing more precise fits
├── UsageError             2  a wrong argument, key or value
│   └── ConfigError        2  a wrong configuration file
├── UnreachableError       3  the daemon (or the bus interface) is not there
├── NoAnswerError          4  no answer in time
├── SdoAbortError          5  the slave refused an SDO request
├── NotPermittedError      6  the system or the daemon does not allow it
└── StateError             7  wrong AL state, no such slave, no such object, bus not as expected
    ├── OwnedError         7  another client owns the outputs
    ├── LeaseError         7  this client has lost its outputs: it must claim them again
    └── BusyError          7  too many requests are waiting already
```

The number is the exit status of the command line. Error replies over Zenoh and the control socket
contain `name`, which stays the same in all versions; `EcatError.from_reply` makes an error of the
same class from such a reply. Every message says what happened and, if possible, what to do next.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

JOIN = "become a member of the group 'ecat' ('sudo usermod -aG ecat $USER', then log in again)"
"""Advice for messages if a daemon runs, but this user may not use it."""
LOOPBACK = "tcp/127.0.0.1:7447"
"""Where the gateway listens by default: all users of the machine may read there."""


class EcatError(Exception):
    """Base of all errors of this project.

    Attributes:
        name: Stable name used in error replies and in `--json` output.
        exit_code: Exit status of the command line for this error.
    """

    name: ClassVar[str] = "internal"
    exit_code: ClassVar[int] = 70

    def to_reply(self) -> dict[str, Any]:
        """The error as a map for msgpack or JSON: `name`, `message` and the keys of the class."""
        return {"name": self.name, "message": str(self)}

    @staticmethod
    def from_reply(reply: Mapping[str, Any]) -> EcatError:
        """Makes an error from a map of `to_reply`; an unknown name gives a plain `EcatError`."""
        name, message = reply.get("name"), str(reply.get("message", "unknown error"))
        if name == SdoAbortError.name:
            return SdoAbortError(int(reply.get("code", 0)), message, str(reply.get("text", "")))
        if name == ConfigError.name and "file" in reply:
            return ConfigError(str(reply["problem"]), str(reply["file"]), int(reply["line"]))
        return _BY_NAME.get(str(name), EcatError)(message)


class UsageError(EcatError):
    """A wrong argument, or a value that does not fit its type."""

    name = "usage"
    exit_code = 2


class ConfigError(UsageError):
    """A configuration file that cannot be used; the message begins with file, line and key.

    Attributes:
        file: The file, if the error is about a key of it; else empty.
        problem: The message without file and line.
    """

    name = "config"

    def __init__(self, problem: str, file: str = "", line: int = 0) -> None:
        place = f"{file}:{line}: " if line else f"{file}: " if file else ""
        super().__init__(f"{place}{problem}")
        self.file, self.problem, self._line = file, problem, line

    def to_reply(self) -> dict[str, Any]:
        """Adds `file`, `line` and `problem` if the error is about a key of a file."""
        places = {"file": self.file, "line": self._line, "problem": self.problem}
        return super().to_reply() | (places if self.file else {})


class UnreachableError(EcatError):
    """The daemon does not run, or its network interface does not exist."""

    name = "unreachable"
    exit_code = 3


class NoAnswerError(EcatError):
    """No answer in time."""

    name = "timeout"
    exit_code = 4


class SdoAbortError(EcatError):
    """A slave refused an SDO request.

    `ecatd.etg.error_codes.abort_error` makes one with the text of its code.

    Attributes:
        code: The 32-bit abort code (ETG.1000.6, table "SDO abort codes").
        text: What the standard says about it; may be empty.
    """

    name = "sdo_abort"
    exit_code = 5

    def __init__(self, code: int, message: str = "", text: str = "") -> None:
        super().__init__(message or f"SDO abort 0x{code:08X}: {text}".removesuffix(": "))
        self.code = code
        self.text = text

    def to_reply(self) -> dict[str, Any]:
        """Adds `code` and `text`."""
        return super().to_reply() | {"code": self.code, "text": self.text}


class NotPermittedError(EcatError):
    """The system or the daemon does not permit it; the message says which right is missing."""

    name = "permission"
    exit_code = 6


class StateError(EcatError):
    """Wrong AL state, no such slave or object, or a bus that is not the expected one."""

    name = "state"
    exit_code = 7


class OwnedError(StateError):
    """Another client owns the outputs; the message names it."""

    name = "owned"


class LeaseError(StateError):
    """This client has lost its outputs, now at their safe values: it must claim them again."""

    name = "lease"


class BusyError(StateError):
    """Too many requests are waiting already; the client may try again later."""

    name = "busy"


_BY_NAME: dict[str, type[EcatError]] = {
    cls.name: cls
    for cls in (
        EcatError,
        UsageError,
        ConfigError,
        UnreachableError,
        NoAnswerError,
        NotPermittedError,
        StateError,
        OwnedError,
        LeaseError,
        BusyError,
    )
}


def error_class(exit_code: int) -> type[EcatError]:
    """The most general error class with the exit status of a program of this project."""
    return next((cls for cls in _BY_NAME.values() if cls.exit_code == exit_code), EcatError)
