"""Every error this project raises on purpose.

```
EcatError                 70  a defect of ours, if nothing more precise fits
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

The number is the exit code of the command line. `name` is the stable name that travels in error
replies over Zenoh and the control socket; `EcatError.from_reply` turns such a reply back into
the same class. Every message says what happened and, where there is one, what to do next.
"""

from __future__ import annotations

from typing import Any, ClassVar

from .abort_codes import abort_text

START = "start it with 'systemctl start ecatd', or without hardware: 'ecatd --simulate troll'"
"""Advice if no daemon is running."""

JOIN = "become a member of the group 'ecat' ('sudo usermod -aG ecat $USER', then log in again)"
"""Advice if a daemon is running, but this user may not use it."""


class EcatError(Exception):
    """Base of all errors of this project.

    Attributes:
        name: Stable name used in error replies and in `--json` output.
        exit_code: Exit status of the command line for this error.
    """

    name: ClassVar[str] = "internal"
    exit_code: ClassVar[int] = 70

    def to_reply(self) -> dict[str, Any]:
        """The error as a map for msgpack or JSON: `name`, `message` and what the class adds."""
        return {"name": self.name, "message": str(self)}

    @staticmethod
    def from_reply(reply: dict[str, Any]) -> EcatError:
        """The error that `to_reply` described; an unknown name becomes a plain `EcatError`."""
        name, message = reply.get("name"), str(reply.get("message", "unknown error"))
        if name == SdoAbortError.name:
            return SdoAbortError(int(reply.get("code", 0)), message)
        return _BY_NAME.get(str(name), EcatError)(message)


class UsageError(EcatError):
    """A wrong argument, or a value that does not fit its type."""

    name = "usage"
    exit_code = 2


class ConfigError(UsageError):
    """A configuration file that cannot be used; the message starts with file, line and key."""

    name = "config"


class UnreachableError(EcatError):
    """The daemon, or the interface it should use, is not there."""

    name = "unreachable"
    exit_code = 3


class NoAnswerError(EcatError):
    """No answer in time."""

    name = "timeout"
    exit_code = 4


class SdoAbortError(EcatError):
    """A slave refused an SDO request.

    Attributes:
        code: The 32-bit abort code (ETG.1000.6, table "SDO abort codes").
    """

    name = "sdo_abort"
    exit_code = 5

    def __init__(self, code: int, message: str | None = None) -> None:
        super().__init__(message or f"SDO abort 0x{code:08X}: {abort_text(code)}")
        self.code = code

    def to_reply(self) -> dict[str, Any]:
        """Adds `code` and the standard text of it as `text`."""
        return super().to_reply() | {"code": self.code, "text": abort_text(self.code)}


class NotPermittedError(EcatError):
    """The system or the daemon does not allow it; the message says which right is missing."""

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
    """This client has lost its outputs, which are at their safe values: it must claim again."""

    name = "lease"


class BusyError(StateError):
    """Too many requests are waiting already; the same one later may be carried out."""

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
    """The error that a program of ours has ended with, the most general one of its status."""
    return next((cls for cls in _BY_NAME.values() if cls.exit_code == exit_code), EcatError)
