"""`ecatd` with a bus server that computes on demand: `python -m …masters.busy_daemon FILE`.

FILE is a configuration. The bus server has a thread that computes from SIGUSR1 until SIGUSR2.
Everything else is as in `ecatd`.
"""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path

from ecatd.base.log import Log
from ecatd.config import load_config
from ecatd.server import __main__ as bus_server
from ecatd.server.__main__ import main as serve
from ecatd.service.supervisor import Supervisor

_LEVELS = {"level": "warning"}
_working = threading.Event()
_thread: list[threading.Thread] = []


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


def _serve() -> int:
    signal.signal(signal.SIGUSR1, _begin)
    signal.signal(signal.SIGUSR2, lambda *_: _working.clear())
    return serve()


def main() -> int:
    """Runs the service, and returns its exit status."""
    bus_server.main = _serve  # the service runs it in a copy of this process
    config = load_config(Path(sys.argv[1]))
    log = Log("ecatd", _LEVELS)
    config.log = _LEVELS
    return Supervisor(config, {}, None, log, lambda: (config, {})).run()


if __name__ == "__main__":
    sys.exit(main())
