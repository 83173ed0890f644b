"""The process of the gateway: `python -m ecatd.gateway`, started by the service.

Its settings, those of `ecatd.bus.__main__` and the origins of the configuration, come when the bus
is in OP (see `ecatd.service_link`); it is ready when it answers. It has no capabilities, may
write only into the folder of its bus, and the bus does not depend on it.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

from ecatd.landlock import restrict
from ecatd.log import Log
from ecatd.model.config import read_config
from ecatd.model.errors import EcatError
from ecatd.process import (
    die_with_parent,
    drop_rights,
    leave_signals_to_the_service,
    offer_to_oom_killer,
)
from ecatd.service_link import answer_pings, read_settings, tell

_OOM_SCORE = 500
"""The bus does not need the gateway, so it is the first to go if there is no memory left."""


async def _serve(settings: dict[str, Any], log: Log) -> None:
    from .gateway import Gateway  # loaded already

    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGQUIT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    config, runtime_dir = read_config(settings["config"]), Path(settings["runtime_dir"])
    gateway = Gateway(config, settings["origins"], runtime_dir, log, stop.set)
    try:
        await gateway.start()
        tell("ready")

        def change(settings: dict[str, Any]) -> None:
            log.levels = settings["log"]
            gateway.reconfigure(read_config(settings["config"]), settings["origins"])

        answering = asyncio.create_task(answer_pings(gateway.report, change))
        answering.add_done_callback(lambda _: stop.set())  # the service was killed
        await stop.wait()
        answering.cancel()
    finally:
        await gateway.stop()


def _folders(settings: dict[str, Any]) -> list[Path]:
    """The folders of its Unix sockets."""
    config = read_config(settings["config"])
    addresses = [config.gateway.metrics, *config.gateway.listen]
    paths = [Path(address.partition(":")[2]) for address in addresses if address[:5] == "unix:"]
    paths += [Path(text[16:]) for text in addresses if text.startswith("unixsock-stream/")]
    folders = [Path(settings["runtime_dir"]) / config.bus, *(path.parent for path in paths)]
    return [folder for folder in folders if folder.is_dir()]


def main() -> int:
    """Runs the gateway; the exit code says why it ended."""
    leave_signals_to_the_service()
    offer_to_oom_killer(_OOM_SCORE)
    drop_rights()  # before any thread, of which each has rights of its own
    from . import gateway  # noqa: F401  it loads while the bus comes up

    settings = read_settings()
    die_with_parent(settings["parent"])
    log = Log("ecatd", settings["log"], settings["config"]["bus"]).of("gateway")
    # It has no threads yet. Whoever gets it under control can make sockets in its folder: no more.
    if not restrict(_folders(settings)):
        log.debug("this kernel has no Landlock: the gateway may write what its user may")
    try:
        asyncio.run(_serve(settings, log))
    except EcatError as error:
        log.error(f"gateway: {error}")
        return error.exit_code
    except Exception as error:
        log.error(f"defect in the gateway: {error!r}")
        log.debug(traceback.format_exc())
        return EcatError.exit_code
    return 0


if __name__ == "__main__":
    status = main()
    sys.stderr.flush()
    os._exit(status)  # threads of Zenoh would keep this process alive
