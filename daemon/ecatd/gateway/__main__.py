"""The process of the gateway. Its first argument is the name of its bus.

It has no capabilities, may write only into the folders of its sockets, and the bus does not depend
on it. It gets its settings from the bus server.

Usually it is a child of `ecatd`, which tells it when the bus is in OP and asks whether it works
(see `ecatd.base.supervised_process`). With `--alone` it is a service of its own, which reports to
the service manager.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path

from ecatd.base.errors import EcatError
from ecatd.base.landlock import restrict
from ecatd.base.log import Log
from ecatd.base.notify import notify
from ecatd.base.paths import gateway_dir, user_dir
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
from ecatd.config import GatewayConfig
from ecatd.linux.systemd_services import other_version
from ecatd.operations.endpoints import LOCAL, Endpoint
from ecatd.shm.statistics import read

_OOM_SCORE = 500
"""The bus does not need the gateway, so the kernel ends it first if there is no memory left."""
_RUNTIME = "(rx: (worker_threads: 2), acc: (handover: rx), net: (handover: rx), tx: (handover: rx))"
"""Zenoh works in two threads. By default five hand a request from one to the next, which takes a
third more processor time."""
_SWITCH_S = 0.0002
"""Seconds after which a thread lets another one go on: a stream must not miss a cycle."""
_FILES_MAX = 1 << 14
"""A session of the network has three sockets."""


async def _serve(bus: str, log: Log, *, alone: bool) -> None:
    from .gateway import Gateway  # loaded already

    stop = stop_signals(*((signal.SIGINT,) if alone else ()))
    gateway = Gateway(bus, user_dir(), log, stop.set)
    try:
        config = await gateway.connect()
        # There are no other threads yet: they would keep the processors that they had.
        leave_processor(config.realtime.cpu)
        # An attacker who takes this process over can make files in these folders only.
        if not restrict(_folders(bus, config.gateway)):
            log.debug("this kernel has no Landlock: the gateway may write what its user may")
        await gateway.start()
        # Before the first values are published, which takes a while on a large bus.
        if alone:
            notify("READY=1", f"STATUS=serves bus '{bus}'")
        else:
            report("ready")
        await work_until(stop, (feed_watchdog if alone else answer_pings)(gateway.report))
    finally:
        await gateway.stop()


def _folders(bus: str, config: GatewayConfig) -> list[Path]:
    """Returns the folders of the gateway's Unix sockets, as far as they exist."""
    paths = [Path(config.metrics[5:])] if config.metrics.startswith("unix:") else []
    listen = map(Endpoint.of, config.listen)
    paths += [Path(item.address) for item in listen if item.protocol == LOCAL]
    folders = [gateway_dir(user_dir(), bus), *(path.parent for path in paths)]
    return [folder for folder in folders if folder.is_dir()]


def _other_version(bus: str) -> str:
    """A possible cause of an error, if the bus server has another version; else empty.

    After an upgrade, the gateway may not understand a bus server that still runs.
    """
    with suppress(EcatError):
        if advice := other_version(bus, read(bus).version):
            return f"; {advice.text}: {advice.remedy}"
    return ""


def main() -> int:
    """Runs the gateway; returns the exit code, which says why it ended."""
    bus, alone = sys.argv[1], "--alone" in sys.argv[2:]
    set_title(("ecatd.gateway", *sys.argv[1:]))
    leave_signals_to_the_service()
    offer_to_oom_killer(_OOM_SCORE)
    drop_rights()  # before there are other threads: each thread has its own rights
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(_FILES_MAX, most), most))
    os.environ.setdefault("ZENOH_RUNTIME", _RUNTIME)
    sys.setswitchinterval(_SWITCH_S)
    from . import gateway  # noqa: F401  it is loaded while the bus is brought up

    if not alone:
        die_with_parent(read_settings()["parent"])
    log = Log("ecatd", bus=bus).of("gateway")
    work = _serve(bus, log, alone=alone)
    return run(work, "the gateway", log, lambda: _other_version(bus))


if __name__ == "__main__":
    status = main()
    sys.stderr.flush()
    os._exit(status)  # threads of Zenoh would keep this process alive
