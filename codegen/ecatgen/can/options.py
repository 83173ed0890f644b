"""The option `--can SLAVE=FILE[@WHO]`: which file describes the CAN bus behind which terminal."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.description.bus import Bus

from .dbc import read_dbc
from .eds import read_eds
from .messages import CanFile
from .terminals import terminal

NONE = "none"
"""The option without any file: a library forgets those of the run before."""

MOST_SIGNALS = 30_000
"""Most signals of one file: a block of more of them needs much memory, here and in any tool."""

_DEVICE = (".eds", ".dcf")
_NODES = 127
_LIKE = "give it as SLAVE=FILE, such as 6=motor.dbc, 6=motor.dbc@NODE or drive=servo.eds@5"


@dataclass(frozen=True, slots=True)
class Request:
    """The option, taken apart.

    Attributes:
        slave: Position or name of the terminal.
        path: The file.
        who: What follows `@`, or empty.
    """

    slave: int | str
    path: Path
    who: str = ""


def parse_option(text: str) -> Request:
    """Takes the option apart.

    Raises:
        UsageError: It is malformed, or there is no such file.
    """
    slave, equals, rest = text.partition("=")
    slave = slave.strip()
    if not equals or not slave or not rest:
        raise UsageError(f"--can {text}: {_LIKE}")
    path, who = Path(rest), ""
    if not path.exists() and "@" in rest:
        name, _, who = rest.rpartition("@")
        path = Path(name)
    if not path.is_file():
        raise UsageError(f"--can {text}: there is no file {path}")
    if path.suffix.lower() not in (*_DEVICE, ".dbc"):
        raise UsageError(f"--can {text}: {path.name} is no DBC, EDS or DCF file by its name")
    return Request(int(slave) if re.fullmatch(r"[0-9]{1,5}", slave) else slave, path, who.strip())


def read_request(request: Request, bus: Bus) -> CanFile:
    """Reads the file for the terminal.

    Raises:
        UsageError: The file cannot be read, `who` is not in it, or the slave is no CAN terminal.
        StateError: There is no such slave, or the package that reads the file is missing.
    """
    path = request.path
    slave = terminal(bus, request.slave, f"--can {request.slave}={path}")
    try:
        if path.suffix.lower() in _DEVICE:
            node = _node(request)
            messages, left_out = read_eds(path, node)
            source = f"{path.name}, node {node}"
        else:
            nodes = tuple(filter(None, map(str.strip, request.who.split(","))))
            messages, left_out = read_dbc(path, nodes)
            source = f"{path.name}, as {' and '.join(nodes)}" if nodes else path.name
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    if not messages:
        reasons = "; ".join(left_out[:3])
        raise UsageError(
            f"{path}: there is no message that can be used{': ' if reasons else ''}{reasons}"
        )
    signals = sum(len(message.signals) for message in messages)
    if signals > MOST_SIGNALS:
        raise UsageError(
            f"{path}: the model would have {signals} signals of it, but at most {MOST_SIGNALS} are "
            f"possible: name the nodes that the model is ({request.slave}={path}@NODE), or leave "
            "out messages of the file"
        )
    return CanFile(
        slave.position,
        slave.given_name,
        slave.vendor,
        slave.product,
        source,
        messages,
        left_out,
    )


def _node(request: Request) -> int:
    try:
        node = int(request.who, 0)
    except ValueError:
        node = 0
    if not 1 <= node <= _NODES:
        said = f"'{request.who}' is none" if request.who else "none is given"
        raise UsageError(
            f"{request.path}: the node ID of the device is missing ({said}): write "
            f"{request.slave}={request.path}@5 for node 5; 1 to {_NODES} are possible"
        )
    return node
