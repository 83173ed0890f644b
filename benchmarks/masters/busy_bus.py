"""The bus server of ecatd, with a thread that computes from SIGUSR1 until SIGUSR2."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType

from ecatd.bus.__main__ import main

_working = threading.Event()


def _compute() -> None:
    """Never gives the interpreter away by itself, as a program does that has a lot to do."""
    while True:
        _working.wait()
        sum(i * i for i in range(1000))


def _on_signal(number: int, frame: FrameType | None) -> None:
    del frame
    if number == signal.SIGUSR2:
        _working.clear()
        return
    if not any(thread.name == _compute.__name__ for thread in threading.enumerate()):
        threading.Thread(target=_compute, name=_compute.__name__, daemon=True).start()
    _working.set()


if __name__ == "__main__":
    for number in (signal.SIGUSR1, signal.SIGUSR2):
        signal.signal(number, _on_signal)
    sys.exit(main())
