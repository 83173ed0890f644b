"""`ecatd` with a bus server that computes on demand: `python -m …masters.busy_daemon FILE`.

FILE is a configuration. The service starts this module again, without FILE, as its bus server. This
bus server has a thread that computes from SIGUSR1 until SIGUSR2. Everything else is as in `ecatd`.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
from pathlib import Path

from ecatd.base.log import Log
from ecatd.config import load_config
from ecatd.server.__main__ import main as serve
from ecatd.service.child import Child
from ecatd.service.supervisor import Supervisor

_LEVELS = {"level": "warning"}
_working = threading.Event()
_thread: list[threading.Thread] = []


class _Service(Supervisor):
    async def _start(self, name: str, *command: str, fd: int | None = None) -> Child:
        ours = ("benchmarks.masters.busy_daemon",) if command == ("ecatd.server",) else command
        return await super()._start(name, *ours, fd=fd)


def _compute() -> None:
    """Computes forever. Like any busy program, it never releases the interpreter by itself."""
    while True:
        _working.wait()
        sum(i * i for i in range(1000))


def _begin(*_: object) -> None:
    if not _thread:
        _thread.append(threading.Thread(target=_compute, daemon=True))
        _thread[0].start()
    _working.set()


def main() -> int:
    """Runs the service or the bus server, and returns its exit status."""
    if sys.argv[1:]:
        config = load_config(Path(sys.argv[1]))
        log = Log("ecatd", _LEVELS)
        config.log = _LEVELS
        service = _Service(config, {}, None, log, lambda: (config, {}))
        return asyncio.run(service.run())
    signal.signal(signal.SIGUSR1, _begin)
    signal.signal(signal.SIGUSR2, lambda *_: _working.clear())
    return serve()


if __name__ == "__main__":
    sys.exit(main())
