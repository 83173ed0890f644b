"""The process of the bus server: `python -m ecatd.server`, started by the service.

Its settings (see `ecatd.base.supervised_process`) are:

- `config`: the configuration;
- `origins`: where each key of the configuration is written, for messages;
- `interface`, `second_interface`: the interfaces, which may be those of a simulator instead of
  those of the configuration;
- `runtime_dir`: the folder with the folder of the bus;
- `memory_dir`: the folder of the shared memory. Both depend on the user, and a namespace hides who
  that is, so the service finds them out;
- `namespace_of`: process ID of a simulator whose network namespace is entered, or 0;
- `parent`: process ID of the service;
- `log`: the levels of the log in force;
- `describe`: whether the process only writes the bus description to stdout
  (`ecatd.description.bus_file`), and ends.

The process reports that it is ready when the bus is in OP, with a line about the bus. The service
logs this line once the gateway answers, too.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import traceback
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import EcatError
from ecatd.base.log import Log
from ecatd.base.paths import control_socket
from ecatd.base.process import (
    CAP_NET_ADMIN,
    OF_ROOT,
    die_with_parent,
    drop_rights,
    leave_signals_to_the_service,
    lower,
)
from ecatd.base.supervised_process import (
    answer_pings,
    read_settings,
    report,
    report_starting,
    stop_signals,
)
from ecatd.config import Config, read_config

if TYPE_CHECKING:
    from .server import BusServer
    from .start.bring_up import BringUp


async def _serve(settings: dict[str, Any], log: Log) -> None:
    # Not imported earlier, since entering a namespace needs a process without other threads.
    from .control import ControlSocket, LogLines
    from .server import BusServer, use_audit_file

    config, up = _read(settings, log)
    control = ControlSocket(control_socket(Path(settings["runtime_dir"]), config.bus), log)
    log.pass_on(LogLines(control.publish).note)
    use_audit_file(log, config)
    stop = stop_signals()
    starting = asyncio.create_task(
        BusServer.start(
            *(up, Path(settings["memory_dir"]), config, _in_force(settings), log, control.publish),
            lambda levels: report("log", json.dumps(dict(levels))),
        )
    )
    stopping = asyncio.create_task(stop.wait())
    busy = asyncio.create_task(report_starting())
    try:
        await asyncio.wait((starting, stopping), return_when=asyncio.FIRST_COMPLETED)
        busy.cancel()
        if starting.done():
            server = starting.result()
            await control.open(server)
            report("ready", server.begin)
            await _run_until(
                stopping, server.monitor(), server.attend(), _answer_service(server, log)
            )
    finally:
        up.abort()
        await asyncio.wait((starting,))
        await control.close()
        # An error of the start was raised above already, or was caused by the abort.
        if not starting.cancelled() and starting.exception() is None:
            await starting.result().stop()
        stopping.cancel()


async def _run_until(stopping: asyncio.Task[Any], *work: Coroutine[Any, Any, None]) -> None:
    """Runs coroutines until `stopping` is done, or one of them ends or fails; raises its error.

    One of them ends because of a defect, or because the service has ended.
    """
    tasks = [asyncio.create_task(item) for item in work]
    await asyncio.wait((stopping, *tasks), return_when=asyncio.FIRST_COMPLETED)
    ended = [task for task in tasks if task.done()]
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)
    for task in ended:
        task.result()


async def _answer_service(server: BusServer, log: Log) -> None:
    async def change(settings: dict[str, Any]) -> None:
        config = read_config(settings["config"], origins=settings["origins"])
        await server.reconfigure(config, _in_force(settings))
        log.levels = settings["log"]

    await answer_pings(server.report, change)


def _in_force(settings: dict[str, Any]) -> dict[str, Any]:
    return {key: settings[key] for key in ("config", "origins")}


def _read(settings: dict[str, Any], log: Log) -> tuple[Config, BringUp]:
    """Reads the configuration of a start, and makes what carries it out."""
    from .start.bring_up import BringUp

    config = read_config(settings["config"], origins=settings["origins"])
    config.second_interface = settings["second_interface"]
    return config, BringUp(config, settings["interface"], log)


def _describe(settings: dict[str, Any], log: Log) -> None:
    from ecatd.description.bus_file import dump

    _, up = _read(settings, log)
    signal.signal(signal.SIGTERM, lambda *_: up.abort())
    sys.stdout.write(dump(up.describe(), warnings=settings["warnings"]))


def main() -> int:
    """Runs the bus server; returns the exit code, which says why it ended."""
    leave_signals_to_the_service()
    settings = read_settings()
    log = Log("ecatd", settings["log"], settings["config"]["bus"])
    try:
        if settings["namespace_of"]:
            from ecatd.base.network_namespace import join

            join(settings["namespace_of"])
        die_with_parent(settings["parent"])
        drop_rights(OF_ROOT)
        lower(CAP_NET_ADMIN)
        if settings["describe"]:
            _describe(settings, log)
        else:
            asyncio.run(_serve(settings, log))
    except EcatError as error:
        log.error(str(error), "failed")
        if settings["describe"]:
            print(json.dumps({"error": error.to_reply()}))
        else:
            report("failed", str(error))
        return error.exit_code
    except Exception as error:
        log.error(f"defect in the bus server: {error!r}")
        log.debug(traceback.format_exc())
        return EcatError.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
