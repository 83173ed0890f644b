"""How a child process of the service hears from it and answers.

The service writes lines of JSON to the child's stdin: the settings first, later `{"ping": 1}`, or
settings that have changed. The child writes lines of a word and a text to its stdout: `ready` once
it serves, `failed` and why, `alive` with a JSON document as the answer to a ping, `changed` when it
has taken other settings, or with the reason why it has not, and `log` with the levels of the log
when a request has changed them.
`ecatd.service.child` is the other side.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Awaitable, Callable
from typing import Any

from ecatd.model.errors import EcatError

_LINE_MAX = 1 << 26
"""Bytes of the settings, at most."""

HANG_S = 10.0
"""Seconds without an answer after which a process counts as hung. A process that waits for a busy
processor or a slow slave answers much earlier."""


def read_settings() -> dict[str, Any]:
    """Reads the settings, the first line of stdin. The next one comes after `ready`.

    Ends this process if the service was killed before.
    """
    try:
        settings: dict[str, Any] = json.loads(sys.stdin.buffer.readline())
    except ValueError:
        sys.exit(0)
    return settings


def tell(word: str, text: str = "") -> None:
    """Writes a line to the service. If the service has been killed, this does nothing."""
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), f"{word} {text}\n".encode())


async def answer_pings(
    alive: Callable[[], Awaitable[dict[str, Any]]],
    change: Callable[[dict[str, Any]], Awaitable[None]] | None = None,
) -> None:
    """Answers the service until its end of the pipe is closed.

    Args:
        alive: Makes sure that this process does its work, and returns what the service is to know.
            While it waits, the service gets no answer, and takes the process for hung.
        change: Takes settings that have changed; raises `EcatError` if it cannot use them, and
            then changes nothing.
    """
    reader = asyncio.StreamReader(limit=_LINE_MAX)
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := await reader.readline():
        message = json.loads(line)
        if "ping" in message:
            tell("alive", json.dumps(await alive()))
        elif change is not None:
            try:
                await change(message)
            except EcatError as error:
                tell("changed", str(error))
            else:
                tell("changed")
