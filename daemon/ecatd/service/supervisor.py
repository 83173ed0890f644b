"""Starts the processes of the daemon, watches them, and ends them in order.

Simulator (if any), bus server and gateway start in this order, and stop in the reverse order. The
daemon is ready when the bus is in OP and the gateway answers. If the bus server or the simulator
ends, the daemon ends. If the gateway ends, it is started again, and the bus is not affected.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ecatd.log import Log
from ecatd.model.config import Config
from ecatd.model.config.reload import reload
from ecatd.model.errors import EcatError, StateError
from ecatd.paths import make_dir
from ecatd.process import offer_to_oom_killer

from .notify import notify

_GATEWAY_PAUSE = 1.0
_OOM_SCORE = -500
"""Under systemd: below the gateway, but above the bus server, which stops the drives if this
process is killed."""
_KEYS_MAX = 8
"""Keys of the configuration in one message."""

_PYTHON = (sys.executable, "-P", "-m")
"""-P: Python does not look for modules in the current directory."""
_STOP_PATIENCE = 15.0
"""Seconds that a child has to clean up, beside those in which drives are brought to a stop, and
those that a slave may take to answer over its mailbox."""


class _EndedError(EcatError):
    """A child has ended with this exit status and has told why."""

    def __init__(self, status: int) -> None:
        super().__init__("")
        self.status = status


class Supervisor:
    """The processes of one bus.

    Args:
        config: The configuration, which is handed to the children.
        origins: Where its values come from, by key (`model.config.origins`).
        rig: The rig to simulate, or None.
        log: Where events are told.
        log_level: For the children.
        read: Reads the configuration and its origins anew, for SIGHUP.
        describe: Only print what bus it is.
    """

    def __init__(
        self,
        config: Config,
        origins: dict[str, str],
        rig: str | None,
        log: Log,
        log_level: str,
        read: Callable[[], tuple[Config, dict[str, str]]],
        *,
        describe: bool = False,
    ) -> None:
        self._config = config
        self._origins = origins
        self._rig = rig
        self._log = log
        self._level = log_level
        self._describe = describe
        self._read = read
        self._stop = asyncio.Event()
        self._reload = asyncio.Event()
        self._children: list[asyncio.subprocess.Process] = []

    async def run(self) -> int:
        """Runs until SIGTERM, SIGINT or SIGQUIT; returns the exit status."""
        _leave(self._config.realtime.cpu)
        offer_to_oom_killer(_OOM_SCORE)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT):
            loop.add_signal_handler(number, self._stop.set)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)
        status = 0
        try:
            await self._run()
        except _EndedError as ended:
            status = ended.status
        finally:
            notify("STOPPING=1")
            await self._end()
        return status

    async def _run(self) -> None:
        settings: dict[str, Any] = {
            "describe": self._describe,
            "config": self._config.to_dict(),
            "origins": self._origins,
            "interface": self._config.interface,
            "second_interface": self._config.second_interface,
            "runtime_dir": "" if self._describe else str(make_dir()),
            "namespace_of": 0,
            "parent": os.getpid(),
            "log_level": self._level,
        }
        fatal = []
        if self._rig:
            simulator, ready = await self._start_simulator(self._rig)
            settings["interface"] = ready["interface"]
            settings["second_interface"] = ready.get("second", "")
            if self._config.second_interface and not settings["second_interface"]:
                self._log.warning(
                    f"second_interface = '{self._config.second_interface}' does nothing: rig "
                    f"'{self._rig}' is no ring, so there is no cable redundancy (write "
                    f"ring = true into its rig file)"
                )
            settings["namespace_of"] = ready["pid"]
            fatal.append(simulator)
        server = await self._start_python("ecatd.bus")
        _give(server, settings)
        if self._describe:
            await self._print_description(server)
            return
        fatal.append(server)
        # It loads while the bus comes up, and is told to begin when the bus is there.
        gateway = await self._start_python("ecatd.gateway")
        in_op = await self._ready(server)
        _give(gateway, settings)
        await self._ready(gateway)
        # Not before: whoever reads that the bus is in OP may ask for it.
        self._log.info(in_op)
        notify("READY=1", f"STATUS={in_op}")
        await self._watch(fatal, gateway, settings)

    async def _print_description(self, server: asyncio.subprocess.Process) -> None:
        assert server.stdout is not None
        description = await self._or_stop(server.stdout.read())
        if status := await server.wait():
            raise _EndedError(_status(status))
        sys.stdout.write(description.decode())

    async def _start_simulator(self, rig: str) -> tuple[asyncio.subprocess.Process, dict[str, Any]]:
        read, write = os.pipe()
        child = await asyncio.create_subprocess_exec(
            *_PYTHON,
            "ecatsim",
            "run",
            rig,
            "--ready-fd",
            str(write),
            "--die-with-parent",
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            pass_fds=(write,),
            start_new_session=True,
        )
        os.close(write)
        self._children.append(child)
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(read, "rb")
        )
        line = await self._or_stop(reader.readline())
        if not line:
            raise _EndedError(await child.wait() or 70)
        return child, json.loads(line)

    async def _start_python(self, module: str) -> asyncio.subprocess.Process:
        # A session of its own: Ctrl-C reaches only this process, which ends the others in order.
        child = await asyncio.create_subprocess_exec(
            *_PYTHON,
            module,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,
        )
        self._children.append(child)
        return child

    async def _ready(self, child: asyncio.subprocess.Process) -> str:
        """Waits until a child is ready; what it says then.

        Raises:
            _EndedError: It has ended; the service manager has been told why.
        """
        assert child.stdout is not None
        line = await self._or_stop(child.stdout.readline())
        word, _, text = line.decode().strip().partition(" ")
        if word != "ready":
            status = _status(await child.wait())
            notify(f"STATUS=bus '{self._config.bus}' has not started: {text or 'see the log'}")
            raise _EndedError(status)
        return text

    async def _or_stop(self, work: Any) -> bytes:
        """The line that a child writes when it is ready; a signal meanwhile ends the daemon."""
        line = asyncio.ensure_future(work)
        stop = asyncio.ensure_future(self._stop.wait())
        await asyncio.wait((line, stop), return_when=asyncio.FIRST_COMPLETED)
        if not line.done():
            line.cancel()
            raise _EndedError(0)
        stop.cancel()
        result: bytes = line.result()
        return result

    async def _watch(
        self,
        fatal: list[asyncio.subprocess.Process],
        gateway: asyncio.subprocess.Process,
        settings: dict[str, Any],
    ) -> None:
        stop = asyncio.ensure_future(self._stop.wait())
        again = asyncio.ensure_future(self._reload.wait())
        ends = {asyncio.ensure_future(child.wait()): child for child in fatal}
        gateway_end, ended_by_us = asyncio.ensure_future(gateway.wait()), False
        while True:
            done, _ = await asyncio.wait(
                (stop, again, gateway_end, *ends), return_when=asyncio.FIRST_COMPLETED
            )
            if stop in done:
                again.cancel()
                return
            if again in done:
                self._reload.clear()
                again = asyncio.ensure_future(self._reload.wait())
                if self._use_anew(settings, fatal[-1]):
                    # It is started again below, with what has changed.
                    ended_by_us = True
                    with suppress(ProcessLookupError):  # it has ended already
                        gateway.terminate()
            for end in done & set(ends):
                child = ends[end]
                what = "the bus server" if child is fatal[-1] else "the simulator"
                self._log.error(
                    f"{what} has ended unexpectedly ({_cause(end.result())}); start ecatd again"
                )
                raise _EndedError(_status(end.result()) or StateError.exit_code)
            if gateway_end in done:
                # It also ends with the bus server, and that may be seen first.
                others, _ = await asyncio.wait(
                    (stop, *ends), timeout=_GATEWAY_PAUSE, return_when=asyncio.FIRST_COMPLETED
                )
                if others:
                    continue
                if gateway_end.result() != 0 and not ended_by_us:
                    self._log.warning(
                        f"the gateway has ended ({_cause(gateway_end.result())}); starting it again"
                    )
                self._children.remove(gateway)
                gateway = await self._start_python("ecatd.gateway")
                _give(gateway, settings)
                gateway_end, ended_by_us = asyncio.ensure_future(gateway.wait()), False

    def _use_anew(self, settings: dict[str, Any], server: asyncio.subprocess.Process) -> bool:
        """Reads the configuration anew and uses what can change; returns whether anything did."""
        try:
            wanted, origins = self._read()
        except EcatError as error:
            self._log.error(f"the configuration stays as it was: {error}")
            return False
        found = reload(self._config, wanted)
        if found.later:
            self._log.warning(f"used after a restart of ecatd: {_keys(found.later)}")
        if not found.used:
            self._log.info("configuration read again: nothing can change without a restart")
            return False
        self._config, self._origins = found.config, origins
        settings |= {"config": found.config.to_dict(), "origins": origins}
        _give(server, settings)
        self._log.info(f"configuration read again; changed: {_keys(found.used)}")
        return True

    async def _end(self) -> None:
        """Ends the children, the last one first, each given time to clean up."""
        for child in reversed(self._children):
            if child.returncode is not None:
                continue
            child.terminate()
            patience = _STOP_PATIENCE + self._config.outputs.stop_patience
            patience += (
                max((item.mailbox_timeout_ms or 0 for item in self._config.slave), default=0) / 1e3
            )
            try:
                await asyncio.wait_for(child.wait(), patience)
            except TimeoutError:
                self._log.error(f"process {child.pid} does not end; it is killed")
                child.kill()
                await child.wait()


def _keys(keys: list[str]) -> str:
    more = len(keys) - _KEYS_MAX
    return ", ".join(keys[:_KEYS_MAX]) + (f" and {more} more" if more > 0 else "")


def _give(child: asyncio.subprocess.Process, settings: dict[str, Any]) -> None:
    """Has a child begin, which waits for its settings, or change them while it runs."""
    assert child.stdin is not None
    child.stdin.write(json.dumps(settings).encode() + b"\n")


def _leave(cpu: int) -> None:
    """Leaves the processor of the engine to it: this process and its children use the others.

    A program that computes there between two cycles takes the engine's data out of the caches, and
    a system call of it that takes long makes the engine wait.
    """
    others = os.sched_getaffinity(0) - {cpu}
    if others:
        os.sched_setaffinity(0, others)


def _status(returncode: int) -> int:
    """The exit status to pass on: a signal is a defect of ours."""
    return returncode if returncode >= 0 else EcatError.exit_code


def _cause(returncode: int) -> str:
    return f"status {returncode}" if returncode >= 0 else f"signal {-returncode}"
