"""The daemon `ecatd` on the simulated segment."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from ecatd.model.errors import StateError

from ..machine import ROOT, Processors
from ..segment.peers import SIMULATOR, on

_PATIENCE = 60.0


class Daemon:
    """An `ecatd`, ready to serve.

    Args:
        folder: For its files.
        processors: Where its threads run; if the master has one, that is the engine's.
        busy_receive: Whether its engine polls the socket.
        more: What else stands in its configuration.

    Attributes:
        bus: The name of its bus.
        seconds: From the command to the message that it is ready, with all slaves in OP.

    Raises:
        StateError: It does not start.
    """

    def __init__(
        self, folder: Path, processors: Processors, *, busy_receive: bool = False, more: str = ""
    ) -> None:
        self.bus = f"bench{os.getpid()}"
        file, address = folder / "ecatd.toml", folder / "notify"
        file.write_text(
            f'bus = "{self.bus}"\ninterface = "{SIMULATOR.near}"\n[realtime]\n'
            f"cpu = {_own(processors)}\nbusy_receive = {str(busy_receive).lower()}\n"
            f"[gateway]\nlisten = []\n{more}"
        )
        self.environment = {
            **os.environ,
            "ECATD_RUNTIME_DIR": str(folder / "run"),
            "NOTIFY_SOCKET": str(address),
            # The service does not look for modules in the working directory.
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        }
        address.unlink(missing_ok=True)
        self._messages = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._messages.bind(str(address))
        self._messages.settimeout(0.2)
        begin = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.masters.busy_service", str(file)],
            env=self.environment,
            preexec_fn=on(processors.rest),
        )
        self._wait(begin + _PATIENCE)
        self.seconds = time.monotonic() - begin

    def _wait(self, end: float) -> None:
        """Waits for the message that systemd would wait for."""
        while True:
            try:
                if b"READY=1" in self._messages.recv(4096):
                    return
            except TimeoutError:
                if self._process.poll() is not None or time.monotonic() > end:
                    self.close()
                    raise StateError("ecatd does not start") from None

    @property
    def processes(self) -> list[int]:
        """Its bus server and its gateway."""
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        return list(map(int, children.read_text().split()))

    @property
    def bus_server(self) -> int:
        """The process of its bus server."""
        for pid in self.processes:
            if b"busy_bus" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return pid
        raise StateError("ecatd has no bus server")

    def close(self) -> None:
        """Ends it."""
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._messages.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _own(processors: Processors) -> int:
    """The processor of the engine, -1 if it has none of its own."""
    return min(processors.master) if len(processors.master) == 1 else -1
