"""Controls a simulator from another process."""

from __future__ import annotations

import json
import os
import socket
import struct
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ecatd.base.errors import (
    EcatError,
    NoAnswerError,
    NotPermittedError,
    UnreachableError,
    UsageError,
)
from ecatd.base.timeouts import Timeout

from ..clocks import Clock
from ..faults import FAULTS, Fault, FaultState
from ..faults.methods import FaultMethods
from ..slave.objects import Value
from . import sockets
from .status import Status

SCHEMA = 1
_PATIENCE = Timeout(10.0)
_CHUNK = 1 << 16


class Simulator:
    """A connection to a simulator in another process, `ecatsim run`, of the same user.

        with Simulator() as simulator:
            simulator.faults.al_error(2, code=0x001D, at_cycle=1000)
            print(simulator.status().slaves[2].state)

    Args:
        name: Name of the simulator; None takes `$ECATSIM_NAME`, or else the only one that runs.

    Attributes:
        name: Name of the simulator.
        faults: Adds and lists faults, with one method for each kind.

    Raises:
        UnreachableError: No simulator (with that name) is running.
        UsageError: Several simulators are running and no name was given.
        NotPermittedError: The simulator belongs to another user.
        NoAnswerError: The simulator does not answer.
    """

    def __init__(self, name: str | None = None) -> None:
        self.name = name or os.environ.get(sockets.NAME_VARIABLE) or _only_one()
        self._socket = _connect(self.name)
        self._received = bytearray()
        self._late = False
        self.faults = RemoteFaults(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connection; the simulator keeps running."""
        self._socket.close()

    def request(self, command: str, **arguments: object) -> dict[str, Any]:
        """Sends a request and returns its result; the methods below are more convenient.

        Raises:
            EcatError: The simulator refused the request; the class of the error says why.
            UnreachableError: The simulator has ended.
            NoAnswerError: The simulator does not answer in time.
        """
        message = {"schema": SCHEMA, "command": command, "arguments": arguments}
        if self._late:  # the late answer to an earlier request may still arrive
            self._socket.close()
            self._socket = _connect(self.name)
            self._received.clear()
            self._late = False
        try:
            self._socket.sendall(json.dumps(message).encode() + b"\n")
            reply = json.loads(self._line())
        except TimeoutError:
            self._late = True
            raise NoAnswerError(
                f"simulator '{self.name}' does not answer within {_PATIENCE}"
            ) from None
        except (OSError, ValueError):
            raise UnreachableError(f"simulator '{self.name}' has ended") from None
        if "error" in reply:
            raise EcatError.from_reply(reply["error"])
        result: dict[str, Any] = reply["result"]
        return result

    def status(self) -> Status:
        """Returns the status of the rig, its counters and its slaves."""
        return Status.from_reply(self.request("status"))

    def get(self, slave: int, index: int, subindex: int = 0) -> Value:
        """Reads an entry of the object dictionary of a slave; bytes are hexadecimal digits.

        Raises:
            StateError: There is no such object or entry.
        """
        reply = self.request("get", slave=slave, object=f"0x{index:04X}:{subindex:02X}")
        value: Value = reply["value"]
        return value

    def set(self, slave: int, index: int, subindex: int, value: Value) -> None:
        """Writes an entry of the object dictionary of a slave, even one read-only for a master.

        Raises:
            StateError: There is no such entry.
            UsageError: The value does not fit its type.
        """
        text = value.hex() if isinstance(value, bytes) else str(value)
        self.request("set", slave=slave, object=f"0x{index:04X}:{subindex:02X}", value=text)

    def registers(self, slave: int, address: int, count: int) -> bytes:
        """Reads registers of a slave controller as its device sees them, without side effects."""
        reply = self.request("registers", slave=slave, address=address, count=count)
        return bytes.fromhex(reply["data"])

    def clocks(self) -> list[Clock]:
        """Returns the distributed clocks of all slaves, all read at the same moment."""
        return [Clock(**clock) for clock in self.request("clocks")["clocks"]]

    def can(self) -> list[dict[str, Any]]:
        """Returns the CAN buses behind terminals, with their nodes and counters."""
        buses: list[dict[str, Any]] = self.request("can")["buses"]
        return buses

    def stop(self) -> None:
        """Ends the simulator, as SIGTERM does."""
        self.request("stop")

    def _line(self) -> bytes:
        while b"\n" not in self._received:
            piece = self._socket.recv(_CHUNK)
            if not piece:
                raise ConnectionResetError
            self._received += piece
        line, _, rest = bytes(self._received).partition(b"\n")
        self._received = bytearray(rest)
        return line


class RemoteFaults(FaultMethods):
    """The faults of a simulator in another process; see `ecatsim.faults.Faults`."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator

    def add(self, fault: Fault) -> int:
        """Adds a fault and returns its number; a fault without a cycle strikes at once."""
        values = fault.relative_to(Path.cwd()).to_values()  # the simulator may run elsewhere
        return int(self._simulator.request(fault.kind, **values)["id"])

    def clear(self, identifier: int | None = None) -> int:
        """Removes one fault, or all, so that they no longer strike; returns how many there were."""
        return int(self._simulator.request("clear", id=identifier or 0)["cleared"])

    def list(self) -> list[FaultState]:
        """Returns all faults that may strike, and the last finished ones, oldest first."""
        return [
            FaultState(
                id=item["id"],
                fault=FAULTS[item["kind"]].from_values(item["parameters"]),
                struck=item["struck"],
                last_cycle=item["last_cycle"],
                done=item["done"],
                error=item["error"],
            )
            for item in self._simulator.request("faults")["faults"]
        ]


def running() -> list[str]:
    """Returns the names of this user's running simulators."""
    found = []
    for name in sockets.names():
        try:
            _connect(name).close()
        except NoAnswerError:
            pass  # it runs, but is too busy to answer
        except EcatError:
            continue  # it was killed, or belongs to another user
        found.append(name)
    return found


def _only_one() -> str:
    there = running()
    if len(there) == 1:
        return there[0]
    if there:
        raise UsageError(f"{len(there)} simulators are running; name one of {', '.join(there)}")
    raise UnreachableError(
        f"no simulator is running (looked in {sockets.folder()}): start one with `ecatsim run RIG`"
    )


def _connect(name: str) -> socket.socket:
    path = sockets.path_of(name)
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    # The limit is set by SO_SNDTIMEO: with a timeout of Python, `connect` would fail at once while
    # many clients wait to be accepted.
    seconds = int(_PATIENCE.seconds)
    wait = struct.pack("@ll", seconds, int((_PATIENCE.seconds - seconds) * 1e6))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, wait)
    try:
        connection.connect(str(path))
    except BlockingIOError:
        connection.close()
        raise NoAnswerError(f"simulator '{name}' does not answer within {_PATIENCE}") from None
    except PermissionError:
        connection.close()
        raise NotPermittedError(f"{path} belongs to another user") from None
    except OSError:
        connection.close()
        raise UnreachableError(
            f"no simulator '{name}' is running; `ecatsim ctl list` shows which are"
        ) from None
    connection.settimeout(_PATIENCE.seconds)
    return connection
