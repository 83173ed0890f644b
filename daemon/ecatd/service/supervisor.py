"""Starts the processes of the daemon, watches them, and ends them in order.

Simulator (if any), bus server and gateway start in this order, and stop in the reverse order. The
daemon is ready when the bus is in OP and the gateway answers. If the bus server or the simulator
ends, the daemon ends. If the gateway ends, it is started again, and the bus is not affected.
As a service of systemd, the gateway has a unit of its own, and is not started here.

A process that does not answer for ten seconds hangs, and is killed. If it is the bus server, its
engine brings the drives to a stop before (`BusServer.attend`). If this process itself hangs, the
service manager notices it (`WatchdogSec=` of the unit). If a start fails, this process waits before
it ends and the service manager tries again, longer after each failure (`failed_starts.py`).
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from ecatd.base.errors import ConfigError, EcatError, StateError, UsageError
from ecatd.base.log import Log
from ecatd.base.notify import is_managed, notify
from ecatd.base.paths import make_dir, remove_dir, user_dir
from ecatd.base.process import leave_processor, offer_to_oom_killer
from ecatd.base.sanitized_output import print_output
from ecatd.base.supervised_process import HANG_S
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.config.origins import Origins, texts
from ecatd.config.reload import reload
from ecatd.shm.files import check_free, make_folder

from .child import Child
from .failed_starts import FailedStarts, not_started
from .processes import Process, fork, module_main, simulate, spawn

T = TypeVar("T")

SIMULATOR, SERVER, GATEWAY = "the simulator", "the bus server", "the gateway"
RECORDER, ROS = "the flight recorder", "the node of ROS 2"
"""Names of the processes, for messages."""
_MODULES = {GATEWAY: "ecatd.gateway", RECORDER: "ecatd.recorder", ROS: "ecatd.ros"}
"""The processes that the bus does not need."""
_OF_ROS = ("bus", "log", "realtime", "gateway", "ros")
"""The tables of the configuration that the node of ROS 2 gets."""
_STEP_LEAST_US, _STEP_MOST_US = 1000, 10_000
"""Limits of the simulator; within them it makes one step for each cycle of the bus."""
_GATEWAY_PAUSE = 1.0
"""Seconds before the gateway is started again."""
_GATEWAY_START = 60.0
"""Seconds in which it has to become ready then."""
_PERIOD = 1.0
"""Seconds between two questions to a child whether it works."""
_STOOD_STILL = 3.0
"""If a pause of `_PERIOD` takes this many seconds, the machine or the service stood still."""
_STOP_MARGIN = 1.0
"""Seconds in addition to those in which the engine of a hung bus server stops the drives."""
_OOM_SCORE = -500
"""Under systemd: below the gateway, but above the bus server, which stops the drives if this
process is killed."""
_KEYS_MAX = 8
"""Keys of the configuration in one message."""
STOP_PATIENCE_S = 15.0
"""Seconds that a child has to clean up. The time to stop drives and the time-out of mailboxes are
added. `TimeoutStopSec=` and `TimeoutAbortSec=` of the units are longer than all three."""
_START_GOES_ON_S = 60
"""Seconds that a start gets from the service manager each time the bus server says that it works
on it. That can take longer than `TimeoutStartSec=`, and a bus server that hangs says nothing."""


class _EndedError(EcatError):
    """A child has ended with this exit status and has reported why: for `describe`, in `output`."""

    def __init__(self, status: int, output: str = "") -> None:
        super().__init__("")
        self.status, self.output = status, output


class Supervisor:
    """The processes of one bus.

    Args:
        config: The configuration, which the children get, too.
        origins: Where its values come from, by key (`ecatd.config.origins`).
        rig: The rig to simulate, or None.
        log: The log for events.
        read: Reads the configuration and its origins anew, for SIGHUP.
        describe: Only print the bus description.
        gateway: Start a gateway, too.
        replay: A recording whose values the inputs of the rig have, or None.
    """

    def __init__(
        self,
        config: Config,
        origins: Origins,
        rig: str | None,
        log: Log,
        read: Callable[[], tuple[Config, Origins]],
        *,
        describe: bool = False,
        gateway: bool = True,
        replay: Path | None = None,
    ) -> None:
        self._replay = replay
        self._config = config
        self._origins = origins
        self._rig = rig
        self._log = log
        self._describe = describe
        self._with_gateway = gateway
        self._read = read
        self._stop = asyncio.Event()
        self._reload = asyncio.Event()
        self._settings: dict[str, Any] = {}
        self._children: list[Child] = []
        self._failed_starts = FailedStarts(user_dir() / config.bus, log)
        self._failure = "see the log"
        self._is_ready = False

    def run(self) -> int:
        """Runs until SIGTERM, SIGINT or SIGQUIT; returns the exit status.

        Raises:
            StateError: The system has not the memory for the processes.
        """
        leave_processor(self._config.realtime.cpu)
        offer_to_oom_killer(_OOM_SCORE)
        try:
            processes = self._fork()
        except OSError as error:
            raise StateError(
                f"the processes of ecatd cannot be started: {error.strerror}"
            ) from error
        return asyncio.run(self._supervise(processes))

    def _fork(self) -> dict[str, Process]:
        """Starts the processes of a start, which wait until they are told to begin."""
        processes: dict[str, Process] = {}

        def start(name: str, command: tuple[str, ...], run: Callable[[], int]) -> None:
            processes[name] = fork(command, run, processes.values())

        if self._rig:
            start(SIMULATOR, ("ecatsim", "run", self._rig), lambda: simulate(self._simulation()))
        start(SERVER, ("ecatd.server",), module_main("ecatd.server.__main__"))
        for name in () if self._describe else self._others():
            start(name, self._command(name), module_main(f"{_MODULES[name]}.__main__"))
        return processes

    def _others(self) -> list[str]:
        """The processes of this start that the bus does not need."""
        config = self._config
        wanted = {
            GATEWAY: self._with_gateway,
            RECORDER: bool(config.flight_recorder.folder),
            ROS: self._with_gateway and bool(config.ros.connect),
        }
        return [name for name, is_wanted in wanted.items() if is_wanted]

    def _command(self, name: str) -> tuple[str, ...]:
        """The module and arguments of a process that the bus does not need."""
        return (_MODULES[name], self._config.bus)

    def _simulation(self) -> list[str]:
        """The arguments of `ecatsim`."""
        step_us = min(max(self._config.cycle_time_us, _STEP_LEAST_US), _STEP_MOST_US)
        replay = [] if self._replay is None else ["--replay", str(self._replay)]
        rig = self._rig or ""
        return ["run", rig, "--die-with-parent", "--step-time-us", str(step_us), *replay]

    async def _supervise(self, processes: dict[str, Process]) -> int:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT):
            loop.add_signal_handler(number, self._stop.set)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)
        status = wait_s = 0
        self._children = [await Child.of(*item) for item in processes.items()]
        try:
            await self._run()
        except _EndedError as ended:
            status = ended.status
            if self._describe:
                with suppress(StateError):  # the status says what has failed
                    print_output(ended.output)
            wait_s = self._wait_s(status)
        except EcatError as error:  # before there is a child
            self._log.error(str(error))
            self._report_failure(str(error))
            if self._describe:
                with suppress(StateError):
                    print_output(json.dumps({"error": error.to_reply()}) + "\n")
            status = error.exit_code
            wait_s = self._wait_s(status)
        finally:
            if not wait_s:
                notify("STOPPING=1")
            await self._end()
        stopped = wait_s and await self._failed_starts.wait(wait_s, self._stop, self._reload)
        return 0 if stopped else status

    def _wait_s(self, status: int) -> int:
        """Seconds to wait before this process ends, for a service manager that starts it again."""
        never_again = (0, UsageError.exit_code)
        if self._is_ready or self._describe or status in never_again or not is_managed():
            return 0
        self._reload.clear()
        return self._failed_starts.announce(self._failure)

    def _report_failure(self, reason: str) -> None:
        """Reports to the service manager why this start has failed."""
        self._failure = reason
        notify(f"STATUS={not_started(self._config.bus, reason)}")

    async def _run(self) -> None:
        if not self._describe:
            check_free(self._config.bus)
        settings = self._settings = {
            "describe": self._describe,
            "config": self._config.to_dict(),
            "origins": texts(self._origins),
            "interface": self._config.interface,
            "second_interface": self._config.second_interface,
            "runtime_dir": "" if self._describe else str(make_dir(self._config.bus, user_dir())),
            "memory_dir": "" if self._describe else str(make_folder(self._log.warning)),
            "namespace_of": 0,
            "warnings": [],
            "parent": os.getpid(),
            "log": self._config.log,
        }
        fatal = []
        if self._rig:
            simulator, ready = await self._start_simulator()
            settings["interface"] = ready["interface"]
            settings["second_interface"] = ready.get("second", "")
            if self._config.second_interface and not settings["second_interface"]:
                self._log.warning(
                    f"second_interface = '{self._config.second_interface}' has no effect: rig "
                    f"'{self._rig}' is not a ring, so there is no cable redundancy (write ring = "
                    "true into its rig file)"
                )
            settings["namespace_of"] = ready["pid"]
            settings["warnings"] = ready["warnings"]
            fatal.append(simulator)
        server = self._child(SERVER)
        server.give(settings)
        if self._describe:
            await self._print_description(server)
            return
        server.on_levels = self._take_levels
        server.on_starting = _extend_start
        fatal.append(server)
        # The gateway loads while the bus comes up, and begins when the bus is there.
        gateway = self._child(GATEWAY) if self._with_gateway else None
        begin = await self._ready(server)
        others = [self._child(name) for name in self._others() if name != GATEWAY]
        for child in others:
            child.give(self._settings_of(child.name))
        if gateway is not None:
            gateway.give(self._settings_of(GATEWAY))
            while not await self._gets_ready(gateway):
                gateway = await self._replace(gateway)
        # Not earlier: a program that reads that the bus is in OP may ask the gateway about it.
        self._is_ready = True
        self._failed_starts.forget()
        self._log.info(begin, "in_op")
        notify("READY=1", f"STATUS={begin}")
        await self._watch(fatal, [*([gateway] if gateway else ()), *others], begin)

    def _settings_of(self, name: str) -> dict[str, Any]:
        """What a process that the bus does not need is given; most ask the bus server."""
        settings: dict[str, Any] = {"parent": os.getpid()}
        if name == ROS:
            given = self._config.to_dict()
            settings["config"] = {key: given[key] for key in _OF_ROS if key in given}
        return settings

    def _child(self, name: str) -> Child:
        return next(child for child in self._children if child.name == name)

    async def _print_description(self, server: Child) -> None:
        output = await self._or_stop(server.output())
        if await server.end:
            raise await self._ended(server, output)
        print_output(output)

    async def _start_simulator(self) -> tuple[Child, dict[str, Any]]:
        child = self._child(SIMULATOR)
        child.give({})
        line = await self._or_stop(child.output())
        ready = json.loads(line or "{}")
        if "error" in ready:
            self._report_failure(ready["error"]["message"])
        if "error" in ready or not ready:
            raise await self._ended(child, line)
        return child, ready

    async def _ready(self, child: Child) -> str:
        """Waits until a child is ready; returns its text.

        Raises:
            _EndedError: It has ended; the service manager knows why.
        """
        word, text = await self._or_stop(child.first_line())
        if word != "ready":
            if text:
                self._report_failure(text)
            raise await self._ended(child)
        self._log.debug(f"{child} is ready")
        return text

    async def _ended(self, child: Child, output: str = "") -> _EndedError:
        """The error of a child that has ended; it has reported why, unless a signal ended it."""
        status = await child.end
        if status <= 0 and not self._is_ready:
            self._report_failure(self._report_end(child, status))
        return _EndedError(_status(status) or StateError.exit_code, output)

    def _report_end(self, child: Child, status: int) -> str:
        text = f"{child.name} has ended unexpectedly ({_cause(status)})"
        self._log.error(f"{text}; {_again()}", "ended")
        return text

    async def _gets_ready(self, gateway: Child) -> bool:
        """Waits until the gateway is ready; returns False if it was killed. Raises as `_ready`."""
        try:
            word, _ = await asyncio.wait_for(self._or_stop(gateway.first_line()), _GATEWAY_START)
        except TimeoutError:
            await self._kill(gateway)
            return False
        if not word and (status := await gateway.end) < 0:
            self._report_other(gateway, status)
            return False
        await self._ready(gateway)
        return True

    def _report_other(self, child: Child, status: int) -> None:
        text = f"{child.name} has ended ({_cause(status)}); ecatd starts it again"
        _tell_of(child.name, text, self._log.warning)

    async def _or_stop(self, work: Awaitable[T]) -> T:
        """Waits for a child that starts; a signal meanwhile ends the daemon."""
        result = asyncio.ensure_future(work)
        stop = asyncio.ensure_future(self._stop.wait())
        await asyncio.wait((result, stop), return_when=asyncio.FIRST_COMPLETED)
        if not result.done():
            result.cancel()
            raise _EndedError(0)
        stop.cancel()
        return result.result()

    async def _watch(self, fatal: list[Child], others: list[Child], begin: str) -> None:
        server = fatal[-1]
        stop = asyncio.create_task(self._stop.wait())
        tasks = [
            asyncio.create_task(self._watch_server(server, begin)),
            asyncio.create_task(self._reload_on_request(server)),
        ]
        tasks += [asyncio.create_task(self._keep(child)) for child in others]
        ends = {child.end: child for child in fatal}
        await asyncio.wait((stop, *tasks, *ends), return_when=asyncio.FIRST_COMPLETED)
        stop.cancel()
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        if self._stop.is_set():
            return
        for task in tasks:
            if not task.cancelled():
                task.result()  # raises
        child = next(ends[end] for end in ends if end.done())
        self._report_end(child, child.end.result())
        raise await self._ended(child)

    async def _watch_server(self, server: Child, begin: str) -> None:
        """Asks the bus server every second, and reports the bus to the service manager.

        Raises:
            _EndedError: It no longer works.
        """
        cycle, moved_at = -1, time.monotonic()
        patience = max(HANG_S, 3e-6 * self._config.cycle_time_us)
        while server.silent_s <= HANG_S:
            await _ask(server)
            now = time.monotonic()
            if server.report.get("cycle") != cycle or server.silent_s:
                cycle, moved_at = server.report.get("cycle", -1), now
            elif now - moved_at > patience:
                self._fail(f"the engine has stood still for {Timeout(patience)}, in cycle {cycle}")
            _feed(server.report.get("status") or begin)
        text = f"{server} has not answered for {Timeout(HANG_S)}"
        end = time.monotonic() + self._config.outputs.longest_stop + _STOP_MARGIN
        self._log.error(
            f"{text}; ecatd gives its engine the time to stop the drives, and then kills it", "hung"
        )
        while time.monotonic() < end:
            _feed(text)
            await asyncio.sleep(min(_PERIOD, end - time.monotonic()))
        self._fail(f"{text} and is killed")

    def _fail(self, text: str) -> None:
        notify(f"STATUS={text}")
        self._log.error(f"{text}; {_again()}; please report this defect in ecatd", "hung")
        raise _EndedError(StateError.exit_code)

    async def _keep(self, child: Child) -> None:
        """Keeps a process running that the bus does not need: starts another one when it ends."""
        while True:
            hung = asyncio.create_task(_until_hung(child))
            try:
                await asyncio.wait((child.end, hung), return_when=asyncio.FIRST_COMPLETED)
            finally:
                hung.cancel()
            if not child.end.done():
                await self._kill(child)
            elif status := child.end.result():  # status 0: it ends to use other settings
                self._report_other(child, status)
            child = await self._replace(child)

    async def _replace(self, child: Child) -> Child:
        """Starts another one; tries until the system has the memory for it."""
        name = child.name
        self._children.remove(child)
        reported = False
        while True:
            # It also ends with the bus server. The pause gives `_watch_server` the time to notice
            # that.
            await asyncio.sleep(_GATEWAY_PAUSE)
            try:
                process = spawn(*self._command(name))
            except OSError as error:
                if not reported:
                    text = f"{name} cannot be started: {error.strerror}; ecatd tries it again"
                    _tell_of(name, text, self._log.error)
                reported = True
            else:
                child = await Child.of(name, process)
                self._children.append(child)
                self._log.debug(f"{child} has been started")
                child.give(self._settings_of(name))
                return child

    async def _kill(self, child: Child) -> None:
        hung = f"has not answered for {Timeout(HANG_S)}"
        what = hung if child.is_ready else f"is not ready after {Timeout(_GATEWAY_START)}"
        text = f"{child} {what}; ecatd kills it and starts it again, while the bus goes on"
        _tell_of(child.name, text, self._log.warning)
        await child.kill()

    async def _reload_on_request(self, server: Child) -> None:
        """Reads the configuration at each SIGHUP, and uses the changes that need no restart."""
        while await self._reload.wait():
            self._reload.clear()
            try:
                await self._use_anew(server)
            except EcatError as error:
                self._log.error(f"the configuration stays as it was: {error}", "configuration")

    async def _use_anew(self, server: Child) -> None:
        """Reads the configuration again; the bus server uses the changes that need no restart.

        Raises:
            EcatError: The configuration is wrong, or does not fit the bus; nothing has changed.
        """
        wanted, origins = self._read()
        found = reload(self._config, wanted)
        origins = found.origins(self._origins, origins)
        new = {"log": wanted.log, "config": found.config.to_dict(), "origins": texts(origins)}
        settings = {**self._settings, **new}
        if settings != self._settings and (why := await server.change(settings)):
            later = f" (the file also has {_keys(found.later)}, which is used after a restart only)"
            raise ConfigError(why + later * bool(found.later))
        if self._settings["log"] != self._config.log:
            self._log.notice("the levels of the log are those of the configuration again")
        self._settings, self._config, self._origins = settings, found.config, origins
        self._log.levels = wanted.log
        if found.later:
            self._log.warning(f"used after a restart of ecatd: {_keys(found.later)}")
        if found.used:
            text = f"configuration read again; changed: {_keys(found.used)}"
            self._log.info(text, "configuration")
        else:
            what = "can change without a restart" if found.later else "has changed"
            self._log.info(f"configuration read again: nothing {what}")

    def _take_levels(self, levels: dict[str, str]) -> None:
        """Takes the levels of the log that a request has set, until the next SIGHUP."""
        self._settings["log"] = self._log.levels = levels

    async def _end(self) -> None:
        """Ends the children, and gives each time to clean up.

        All but the simulator are asked at once: safe outputs wait for no other process.
        """
        mailboxes = max((item.mailbox_timeout_ms or 0 for item in self._config.slave), default=0)
        seconds = STOP_PATIENCE_S + self._config.outputs.longest_stop + mailboxes / 1e3
        patience = Timeout(seconds, "stop_timeout_s in [[outputs.safe]]")

        async def end(child: Child) -> None:
            self._log.debug(f"{child} is asked to end")
            if not await child.stop(patience.seconds):
                self._log.error(f"{child} did not end within {patience} and was killed")

        simulators = [item for item in self._children if item.name == SIMULATOR]
        await asyncio.gather(*(end(item) for item in self._children if item not in simulators))
        await asyncio.gather(*map(end, simulators))
        if folder := self._settings.get("runtime_dir"):
            remove_dir(Path(folder), self._config.bus)


def _tell_of(name: str, text: str, tell: Callable[[str, str], None]) -> None:
    """Writes to the log about a process that the bus does not need."""
    if name == GATEWAY:
        tell(text, "gateway")
    elif name == RECORDER:
        tell(text, "recorder")
    else:
        tell(text, "ros")


async def _until_hung(child: Child) -> None:
    """Asks a child that starts every second; returns when it has not answered for long."""
    try:
        await asyncio.wait_for(child.first_line(), _GATEWAY_START)
    except TimeoutError:
        return
    while child.silent_s <= HANG_S:
        await _ask(child)


async def _ask(child: Child) -> None:
    """Asks a child whether it works, and waits a second."""
    child.ping()
    begin = time.monotonic()
    await asyncio.sleep(_PERIOD)
    if time.monotonic() - begin > _STOOD_STILL:
        child.forgive()  # the whole machine stood still, also this process


def _feed(status: str) -> None:
    """Reports to the service manager that this process works, and the state of the bus."""
    notify("WATCHDOG=1", f"STATUS={status}", wait=False)


def _extend_start() -> None:
    """Asks the service manager for more time, for a start that goes on."""
    notify(f"EXTEND_TIMEOUT_USEC={_START_GOES_ON_S * 1_000_000}", wait=False)


def _again() -> str:
    """What happens next when the bus has ended by itself."""
    return "the service manager starts ecatd again" if is_managed() else "start ecatd again"


def _keys(keys: list[str]) -> str:
    more = len(keys) - _KEYS_MAX
    return ", ".join(keys[:_KEYS_MAX]) + (f" and {more} more" if more > 0 else "")


def _status(returncode: int) -> int:
    """The exit status to pass on: a signal is a defect in ecatd."""
    return returncode if returncode >= 0 else EcatError.exit_code


def _cause(returncode: int) -> str:
    return f"status {returncode}" if returncode >= 0 else f"signal {-returncode}"
