"""Runs our programs as `python -m` does, each in a process forked from one that has loaded them.

Most of the processor time of a command is loading its modules, and the tests run a thousand
commands and hundreds of daemons. The process has arguments, environment, folder and streams of its
own, and ends as any other: exit handlers run, and an exception shows its traceback.
"""

import atexit
import contextlib
import gc
import importlib
import json
import os
import pkgutil
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

PACKAGES = ("ecatd.cli", "ecatd.service", "ecatsim.cli")
OTHERS = (
    *("ecatd.client.remote", "zenoh", "jinja2"),
    *("ecatd.server.control", "ecatd.gateway.gateway", "ecatsim.rigs.library"),
)
"""What they load beside the modules of their package."""
_AT_THE_START = ("PYTHON", "LC_", "LANG", "MALLOC_", "LD_")
"""Variables that a process reads when it starts, and not later."""
_STREAMS = (0, 1, 2)
_NUMBER = 32
"""Bytes of a process ID or an exit status in the pipe."""
_launcher: list[tuple[socket.socket, subprocess.Popen[bytes]]] = []
_lock = threading.Lock()


class Process:
    """A process that was started here, with what tests use of `subprocess.Popen`.

    Attributes:
        pid: Its process ID.
        returncode: Its exit status; None until `poll` or `wait` has seen its end.
    """

    def __init__(
        self, module: str, *arguments: str, env: Mapping[str, str], streams: list[int]
    ) -> None:
        request = {
            "module": module,
            "arguments": arguments,
            "env": dict(env),
            "folder": str(Path.cwd()),
        }
        self._reports, write = os.pipe()
        try:
            socket.send_fds(_start(), [json.dumps(request).encode()], [*streams, write])
        finally:
            os.close(write)
        self.pid = int(os.read(self._reports, _NUMBER))
        self.returncode: int | None = None

    def poll(self) -> int | None:
        return self._look(0)

    def wait(self, timeout: float | None = None) -> int:
        status = self._look(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0)
        return status

    def _look(self, timeout: float | None) -> int | None:
        if self.returncode is None and select.select([self._reports], [], [], timeout)[0]:
            self.returncode = int(os.read(self._reports, _NUMBER))
            os.close(self._reports)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def run(module: str, *arguments: str, env: Mapping[str, str]) -> tuple[int, str, str]:
    """Runs a command to its end: exit status, stdout and stderr."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        streams = [0, output.fileno(), errors.fileno()]
        status = Process(module, *arguments, env=env, streams=streams).wait()
        output.seek(0)
        errors.seek(0)
        return status, _text(output.read()), _text(errors.read())


def can_run(env: Mapping[str, str]) -> bool:
    """Whether a process with this environment begins as the launcher did."""
    return _at_the_start(env) == _BEGUN


def _at_the_start(env: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in env.items() if key.startswith(_AT_THE_START)}


_BEGUN = _at_the_start(os.environ)


def _text(output: bytes) -> str:
    """As `text=True` of `subprocess` reads it."""
    return output.decode().replace("\r\n", "\n").replace("\r", "\n")


def _start() -> socket.socket:
    """Where the launcher takes requests; it ends when this process does."""
    with _lock:
        if not _launcher:
            ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            command = [sys.executable, __file__, str(its.fileno())]
            others = {key: os.environ[key] for key in {*os.environ} - {*_at_the_start(os.environ)}}
            process = subprocess.Popen(command, env=others | _BEGUN, pass_fds=[its.fileno()])
            _launcher.append((ours, process))
            atexit.register(_end, ours, process)
            its.close()
        return _launcher[0][0]


def _end(requests: socket.socket, process: "subprocess.Popen[bytes]") -> None:
    requests.close()
    process.wait()


def _serve(requests: socket.socket) -> None:
    for package in PACKAGES:
        for module in pkgutil.iter_modules(importlib.import_module(package).__path__):
            if module.name != "__main__":
                importlib.import_module(f"{package}.{module.name}")
    for other in OTHERS:
        importlib.import_module(other)
    gc.freeze()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    watched = select.poll()
    watched.register(requests, select.POLLIN)
    running: dict[int, tuple[int, int]] = {}  # process ID and `end` by pidfd
    while True:
        for ready, _ in watched.poll():
            if ready in running:
                watched.unregister(ready)
                pid, end = running.pop(ready)
                os.close(ready)
                _report(end, os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
                os.close(end)
                continue
            message, descriptors, _, _ = socket.recv_fds(requests, 1 << 20, 4)
            if not message:
                return
            *streams, end = descriptors
            pid = os.fork()
            if pid == 0:
                requests.close()
                os.close(end)
                for handle, (_, other) in running.items():
                    os.close(handle)
                    os.close(other)
                _run(json.loads(message), streams)
            for stream in streams:
                os.close(stream)
            _report(end, pid)
            handle = os.pidfd_open(pid)
            running[handle] = pid, end
            watched.register(handle, select.POLLIN)


def _run(request: dict[str, Any], descriptors: list[int]) -> NoReturn:
    """Runs a program in a child."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for stream, descriptor in zip(_STREAMS, descriptors, strict=True):
        os.dup2(descriptor, stream)
    for descriptor in descriptors:
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["folder"])
    sys.argv[1:] = request["arguments"]
    sys.path[0] = request["folder"]
    status = 0
    try:
        runpy.run_module(request["module"], run_name="__main__", alter_sys=True)
    except SystemExit as error:
        status = _status(error.code)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        status = 1
    # What an interpreter does when it ends, but for taking apart all that was loaded.
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _report(end: int, number: int) -> None:
    with contextlib.suppress(BrokenPipeError):  # a test that was ended asks no more
        os.write(end, str(number).encode().ljust(_NUMBER))


def _status(code: object) -> int:
    """The exit status of `sys.exit(code)`."""
    if code is None or isinstance(code, int):
        return (code or 0) & 0xFF
    print(code, file=sys.stderr)
    return 1


if __name__ == "__main__":
    _serve(socket.socket(fileno=int(sys.argv[1])))
