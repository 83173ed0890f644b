"""The daemon `ecatd` on the simulated segment."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from ecatd.base.errors import StateError

from ..bench import Bench
from ..machine import ROOT
from ..segment.peers import SIMULATOR, end, on

_PATIENCE = 60.0


class Daemon:
    """A running `ecatd`, with all slaves in OP.

    Args:
        bench: Folder and processors. The engine gets the processor of the master, if the master has
            one of its own.
        realtime: Keys of `[realtime]`.
        more: Further text of the configuration file.

    Attributes:
        bus: Name of the bus.
        environment: Environment variables for programs that use this daemon.
        seconds: Time from the command until the daemon was ready, with all slaves in OP.

    Raises:
        StateError: The daemon does not start.
    """

    def __init__(
        self, bench: Bench, *, realtime: Mapping[str, Any] = MappingProxyType({}), more: str = ""
    ) -> None:
        self.bus = bench.bus
        file, address = bench.folder / "ecatd.toml", bench.folder / "notify"
        cpu = bench.cpu if len(bench.processors.master) == 1 else -1
        keys = "".join(f"{key} = {json.dumps(x)}\n" for key, x in {"cpu": cpu, **realtime}.items())
        file.write_text(
            f'bus = "{self.bus}"\ninterface = "{SIMULATOR.near}"\n[realtime]\n{keys}'
            f"[gateway]\nlisten = []\n{more}"
        )
        self.environment = {
            **os.environ,
            "ECATD_RUNTIME_DIR": str(bench.folder / "run"),
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
            [sys.executable, "-m", "benchmarks.masters.busy_daemon", str(file)],
            env=self.environment,
            preexec_fn=on(bench.processors.rest),
        )
        self._wait(begin + _PATIENCE)
        self.seconds = time.monotonic() - begin

    def _wait(self, deadline: float) -> None:
        """Waits for the message READY=1, as systemd does."""
        while True:
            try:
                if b"READY=1" in self._messages.recv(4096):
                    return
            except TimeoutError:
                if self._process.poll() is not None or time.monotonic() > deadline:
                    self.close()
                    raise StateError("ecatd does not start") from None

    @property
    def processes(self) -> list[int]:
        """Process IDs of the bus server and the gateway."""
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        return list(map(int, children.read_text().split()))

    @property
    def gateway(self) -> int:
        """Process ID of the gateway."""
        return next(pid for pid in self.processes if pid != self.bus_server)

    @property
    def bus_server(self) -> int:
        """Process ID of the bus server."""
        for pid in self.processes:
            if b"ecatd.server" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return pid
        raise StateError("ecatd has no bus server")

    def close(self) -> None:
        """Ends the daemon."""
        end(self._process, _PATIENCE)
        self._messages.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
