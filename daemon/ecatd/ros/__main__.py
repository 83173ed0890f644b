"""The process that ROS 2 sees. Its first argument is the name of its bus.

It reads the shared memory, and makes no requests: it has no capabilities, writes no file (so it
cannot claim outputs, either), and the bus does not depend on it.

Usually it is a child of `ecatd`, which gives it its configuration. With `--alone FILE` it is a
service of its own, which reads that file, waits for the bus, and stays when the bus has ended.
"""

from __future__ import annotations

import asyncio
import os
import resource
import signal
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ecatd.base.landlock import restrict
from ecatd.base.log import Log
from ecatd.base.notify import notify
from ecatd.base.process import (
    die_with_parent,
    drop_rights,
    leave_processor,
    leave_signals_to_the_service,
    offer_to_oom_killer,
    set_title,
)
from ecatd.base.supervised_process import (
    answer_pings,
    feed_watchdog,
    read_settings,
    report,
    run,
    stop_signals,
    work_until,
)
from ecatd.config import Config, load_config, read_config

_OOM_SCORE = 600
"""The kernel ends it before the gateway if there is no memory left."""
_MEMORY = 512 << 20
_NEEDED = "ROS 2 sees nothing of the bus without the package xxhash: pip install 'ecatd[ros]'"


async def _serve(config: Config, log: Log, *, alone: bool) -> None:
    stop = stop_signals(*((signal.SIGINT,) if alone else ()))
    publishing = asyncio.create_task(_publish(config, log))
    publishing.add_done_callback(lambda _: stop.set())
    if alone:
        notify("READY=1", f"STATUS=publishes bus '{config.bus}' for ROS 2")
    else:
        report("ready")
    try:
        await work_until(stop, (feed_watchdog if alone else answer_pings)(_alive))
    finally:
        publishing.cancel()
        with suppress(asyncio.CancelledError):
            await publishing  # raises what has ended it


async def _publish(config: Config, log: Log) -> None:
    if find_spec("xxhash") is None:
        log.warning(_NEEDED)
        await asyncio.Event().wait()
    from .node import Node

    await Node(config.bus, config.ros, log).run()


async def _alive() -> dict[str, Any]:
    return {}


def main() -> int:
    """Runs the process; returns the exit code, which says why it ended."""
    bus = sys.argv[1]
    alone = Path(sys.argv[3]) if sys.argv[2:3] == ["--alone"] else None
    set_title(("ecatd.ros", *sys.argv[1:]))
    leave_signals_to_the_service()
    offer_to_oom_killer(_OOM_SCORE)
    drop_rights()
    if alone is None:
        settings = read_settings()
        die_with_parent(settings["parent"])
        config = read_config(settings["config"])
    else:
        config = load_config(alone)
        config.bus = bus
    leave_processor(config.realtime.cpu)
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, most))
    log = Log("ecatd", bus=bus).of("ros")
    log.levels = config.log
    if not restrict([]):
        log.debug("this kernel has no Landlock: this process may write what its user may")
    return run(_serve(config, log, alone=alone is not None), "the node of ROS 2", log)


if __name__ == "__main__":
    status = main()
    sys.stderr.flush()
    os._exit(status)  # threads of Zenoh would keep this process alive
