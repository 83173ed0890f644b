"""The process of the flight recorder. Its first argument is the name of its bus.

`ecatd` starts it beside the gateway, and starts another one if it ends. It has no capabilities, may
write only into its folder, runs when nobody else wants the processor, and has a limit of memory.
The bus does not depend on it.
"""

from __future__ import annotations

import os
import resource
import sys
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING

from ecatd.base.landlock import restrict
from ecatd.base.log import Log
from ecatd.base.paths import user_dir
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
    read_settings,
    report,
    run,
    stop_signals,
    work_until,
)

if TYPE_CHECKING:
    from .recorder import Recorder

_OOM_SCORE = 700
"""The kernel ends it before the gateway if there is no memory left."""
_NICE = 19
_MEMORY, _PER_MIB = 768 << 20, 12 << 20
"""Most bytes of memory, and more of them for each MiB of frames."""


async def _serve(bus: str, log: Log) -> None:
    from .recorder import Recorder

    stop = stop_signals()
    recorder = Recorder(bus, user_dir(), log, stop)
    try:
        config = await recorder.connect()
        leave_processor(config.realtime.cpu)
        _limit_memory(config.flight_recorder.memory_mb)
        if find_spec("mcap") is None:
            log.warning(
                "the flight recorder needs the package mcap, so there are no incidents: "
                "pip install 'ecatd[record]'"
            )
        else:
            _open(recorder, log)
            await recorder.start()
        report("ready")
        await work_until(stop, answer_pings(recorder.report))
    finally:
        await recorder.close()


def _open(recorder: Recorder, log: Log) -> None:
    """Makes the folder, and lets this process write nowhere else."""
    with suppress(OSError):  # the log has it
        recorder.check_folder()
    with suppress(OSError):  # there is no such folder
        if not restrict([recorder.folder]):
            log.debug("this kernel has no Landlock: the recorder may write what its user may")


def _limit_memory(memory_mb: int) -> None:
    most = _MEMORY + memory_mb * _PER_MIB
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))


def main() -> int:
    """Runs the recorder; returns the exit code, which says why it ended."""
    bus = sys.argv[1]
    set_title(("ecatd.recorder", bus))
    leave_signals_to_the_service()
    offer_to_oom_killer(_OOM_SCORE)
    drop_rights()
    os.nice(_NICE)
    die_with_parent(read_settings()["parent"])
    log = Log("ecatd", bus=bus).of("recorder")
    return run(_serve(bus, log), "the flight recorder", log)


if __name__ == "__main__":
    sys.exit(main())
