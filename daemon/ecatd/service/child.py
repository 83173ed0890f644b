"""A child process of the service, as the service sees it: what it receives, and what it answers."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import Callable
from typing import Any

from ecatd.base.supervised_process import HANG_S

from .processes import Process

_KILL_PATIENCE = 5.0


class Child:
    """A child process. `ecatd.base.supervised_process` has the messages of both sides.

    Args:
        name: What it is, for messages.
        process: The process.
        stdin: Writes to its stdin.
        stdout: Reads its stdout.

    Attributes:
        name: As above.
        end: Done when the process has ended; its result is the return code.
        report: Its last answer.
        on_levels: Called with other levels of the log that it has been asked for.
        on_starting: Called when it says that its start goes on.
    """

    def __init__(
        self,
        name: str,
        process: Process,
        stdin: asyncio.WriteTransport,
        stdout: asyncio.StreamReader,
    ) -> None:
        self.name = name
        self.end = asyncio.ensure_future(_end_of(process))
        self.report: dict[str, Any] = {}
        self.on_levels: Callable[[dict[str, str]], None] = lambda levels: None
        self.on_starting: Callable[[], None] = lambda: None
        self._pid = process.pid
        self._stdin, self._stdout = stdin, stdout
        self._asked_at: float | None = None
        self._first: bytes | None = None
        self._listening: asyncio.Task[None] | None = None
        self._change: asyncio.Future[str] | None = None

    @classmethod
    async def of(cls, name: str, process: Process) -> Child:
        """Takes charge of a process that has been started.

        Args:
            name: What it is, for messages.
            process: The process.
        """
        loop = asyncio.get_running_loop()
        stdout = asyncio.StreamReader()
        stdin, _ = await loop.connect_write_pipe(asyncio.BaseProtocol, process.stdin)
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdout), process.stdout)
        return cls(name, process, stdin, stdout)

    def give(self, message: dict[str, Any]) -> None:
        """Sends it the settings for which it waits, or other settings while it runs."""
        self._stdin.write(json.dumps(message).encode() + b"\n")

    async def change(self, settings: dict[str, Any]) -> str:
        """Gives it other settings while it runs, and waits until it uses them.

        Returns:
            Why it does not use them; empty if it does. If it ends meanwhile, this waits for ever.
        """
        self._change = asyncio.get_running_loop().create_future()
        self.give(settings)
        return await self._change

    async def output(self) -> str:
        """Everything that it writes until it ends."""
        return (await self._stdout.read()).decode()

    async def first_line(self) -> tuple[str, str]:
        """Waits for the line that says whether it is ready.

        Returns:
            Its word and its text; two empty ones if it has ended.
        """
        while self._first is None:
            line = await self._stdout.readline()
            if line.startswith(b"starting"):
                self.on_starting()
                continue
            self._first = line
            self._listening = asyncio.create_task(self._listen())
        word, _, text = self._first.decode(errors="replace").strip().partition(" ")
        return word, text

    @property
    def is_ready(self) -> bool:
        """Whether it has said that it is ready, so that it can take other settings."""
        return self._listening is not None and not self._listening.done()

    async def _listen(self) -> None:
        while line := await self._stdout.readline():
            word, _, text = line.decode(errors="replace").partition(" ")
            if word == "alive":
                self._asked_at, self.report = None, json.loads(text)
            elif word == "log":
                self.on_levels(json.loads(text))
            elif word == "changed" and self._change is not None and not self._change.done():
                self._change.set_result(text.strip())

    def ping(self) -> None:
        """Asks whether it works, unless it has not yet answered the last question."""
        if self._asked_at is None:
            self._asked_at = time.monotonic()
            self.give({"ping": 1})

    def forgive(self) -> None:
        """Begins to count its silence anew."""
        if self._asked_at is not None:
            self._asked_at = time.monotonic()

    @property
    def silent_s(self) -> float:
        """Seconds since a question that it has not answered; 0 if there is none."""
        return 0.0 if self._asked_at is None else time.monotonic() - self._asked_at

    def terminate(self) -> None:
        """Asks it to end."""
        self._send(signal.SIGTERM)

    async def kill(self) -> None:
        """Ends it at once, and waits a little: one that waits in a driver may not end at all."""
        self._send(signal.SIGKILL)
        await asyncio.wait((self.end,), timeout=_KILL_PATIENCE)

    async def stop(self, patience_s: float) -> bool:
        """Ends it in order, or after some seconds at once; returns whether it ended in order.

        One that hangs is killed without waiting.
        """
        if self.end.done():
            return True
        if self.silent_s > HANG_S:
            await self.kill()
            return True
        self.terminate()
        try:
            await asyncio.wait_for(asyncio.shield(self.end), patience_s)
        except TimeoutError:
            await self.kill()
            return False
        return True

    def _send(self, number: int) -> None:
        if not self.end.done():  # else its number may be that of another process
            os.kill(self._pid, number)

    def __str__(self) -> str:
        return f"{self.name} (process {self._pid})"


async def _end_of(process: Process) -> int:
    """Waits until a child process has ended; returns its exit status, or -SIGNAL."""
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(process.end, ended.set)
    try:
        await ended.wait()
    finally:
        loop.remove_reader(process.end)
        os.close(process.end)
    return os.waitstatus_to_exitcode(os.waitpid(process.pid, 0)[1])
