"""The process of the bus server: `python -m ecatd.bus`, started by the service.

It reads its settings as a line of JSON from stdin: `config`, `interface` and `second_interface`
(which may be those of a simulator instead of those of the configuration), `runtime_dir`,
`namespace_of` (process number of a simulator whose network namespace to enter, or 0), `parent` and
`log_level`. When the bus is in OP, it writes `ready` and a line about it to stdout, which the
service logs once the gateway answers, too. A later line on stdin has the same settings with a
configuration that has changed. If the start fails, it writes `failed` and why. With
`describe` it writes the bus description instead (`ecatd.model.bus_file`), and ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.log import Log
from ecatd.model.config import read_config
from ecatd.model.errors import EcatError
from ecatd.paths import control_socket
from ecatd.process import die_with_parent, leave_signals_to_the_service, read_settings

if TYPE_CHECKING:
    from .server import BusServer

_LINE_MAX = 1 << 26
"""Bytes of the settings, at most."""


async def _serve(settings: dict[str, Any], log: Log) -> None:
    # Imported here: entering a namespace needs a process that has no threads yet.
    from .control import ControlSocket
    from .server import BusServer

    config = read_config(settings["config"])
    config.second_interface = settings["second_interface"]
    control = ControlSocket(control_socket(Path(settings["runtime_dir"]), config.bus), log)
    server = BusServer(config, settings["interface"], log, control.publish)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGQUIT):
        loop.add_signal_handler(number, stop.set)
    reader = asyncio.StreamReader(limit=_LINE_MAX)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    starting = asyncio.create_task(server.start())
    stopping = asyncio.create_task(stop.wait())
    try:
        await asyncio.wait((starting, stopping), return_when=asyncio.FIRST_COMPLETED)
        if starting.done():
            starting.result()
            await control.open(server)
            _tell_service(f"ready {server.summary}")
            monitor = asyncio.create_task(server.monitor())
            changes = asyncio.create_task(_change(server, reader))
            await stopping
            changes.cancel()
            monitor.cancel()
    finally:
        server.abort()
        await asyncio.wait((starting,))
        if not starting.cancelled():
            starting.exception()  # raised above already, or caused by the abort
        await control.close()
        await server.stop()
        stopping.cancel()


async def _change(server: BusServer, reader: asyncio.StreamReader) -> None:
    """Takes over what changes in the configuration while the bus runs."""
    while line := await reader.readline():
        server.reconfigure(read_config(json.loads(line)["config"]))


def _tell_service(line: str) -> None:
    """Writes a line to the service. If it has ended, its death ends this process in order, too."""
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), f"{line}\n".encode())


def _describe(settings: dict[str, Any], log: Log) -> None:
    from ecatd.model.bus_file import dump

    from .description import describe

    config = read_config(settings["config"])
    config.second_interface = settings["second_interface"]
    sys.stdout.write(dump(describe(config, settings["interface"], log)))


def main() -> int:
    """Runs the bus server; the exit code says why it ended."""
    leave_signals_to_the_service()
    settings = read_settings()
    log = Log("ecatd", settings["log_level"])
    try:
        if settings["namespace_of"]:
            from ecatd.network_namespace import join

            join(settings["namespace_of"])
        die_with_parent(settings["parent"])
        if settings["describe"]:
            _describe(settings, log)
        else:
            asyncio.run(_serve(settings, log))
    except EcatError as error:
        log.error(str(error))
        if not settings["describe"]:
            _tell_service(f"failed {error}")
        return error.exit_code
    except Exception as error:
        log.error(f"defect in the bus server: {error!r}")
        log.debug(traceback.format_exc())
        return EcatError.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
