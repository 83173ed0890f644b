"""`ecatd` with a bus server that can be told to compute: `python -m …masters.busy_service FILE`.

FILE is a configuration. The bus server is `busy_bus`, everything else is as the command `ecatd`
has it.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from ecatd.log import Log
from ecatd.model.config import load_config
from ecatd.service.supervisor import Supervisor

LEVEL = "warning"


class _Service(Supervisor):
    async def _start_python(self, module: str) -> asyncio.subprocess.Process:
        ours = "benchmarks.masters.busy_bus" if module == "ecatd.bus" else module
        return await super()._start_python(ours)


if __name__ == "__main__":
    config = load_config(Path(sys.argv[1]))
    sys.exit(asyncio.run(_Service(config, None, Log("ecatd", LEVEL), LEVEL).run()))
