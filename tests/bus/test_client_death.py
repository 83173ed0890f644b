"""Clients die at random points while they own outputs: `death/dying.c` tells how, and what holds.

`ECAT_DEATHS=1000` (`make death`) has so many of them; without it a quick selection.
"""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.client import Reason
from ecatd.shm.statistics import read

pytestmark = [pytest.mark.bus, pytest.mark.long]

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
DEATHS = int(os.environ.get("ECAT_DEATHS", "150"))
CONFIG = """
[gateway]
listen = []
[outputs]
lease_max_ms = 30000
[[outputs.safe]]
slave = 0
entry = "0x7000:01"
value = 0x11
[[outputs.safe]]
slave = 0
entry = "0x7000:02"
value = "hold"
"""


def build(folder: Path, *sources: Path) -> Path:
    """A program with the client in it, so that it may look behind the interface."""
    client = ROOT / "client_c"
    program = folder / sources[0].stem
    subprocess.run(
        [
            *("gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-g", "-Wall", "-Wextra", "-Werror"),
            *(f"-I{client / 'include'}", f"-I{client / 'src'}"),
            *sources,
            *((client / "src").glob("*.c")),
            *("-o", program, "-lpthread", "-lm"),
        ],
        check=True,
    )
    return program


@pytest.mark.timeout(600 + DEATHS)
def test_r15_outputs_of_clients_that_die_are_safe_in_time(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    sources = [HERE / "death" / f"{name}.c" for name in ("dying", "victim", "watch")]
    program = build(tmp_path, *sources)
    daemon = start_daemon("line:4", config=CONFIG)
    before = read(daemon.bus)
    seed = os.environ.get("ECAT_SEED", "1")
    run = subprocess.run(
        [program, daemon.bus, str(DEATHS), seed], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr + daemon.log
    reached = json.loads(run.stdout)
    print(json.dumps(reached, indent=1))
    lost = read(daemon.bus) - before
    print(lost.counters)
    # What was measured depends on the cycles that the watcher did not miss.
    assert reached["measured"] > DEATHS / 20
    assert reached["resumed"] > DEATHS / 20
    assert reached[f"reason_{Reason.DIED.value}"] > DEATHS / 20
    for phase in ("claim", "sample", "write", "commit", "release"):
        assert reached[f"in_{phase}"] > 0
    # No frame is lost; those that are late were late because of other work of this machine.
    assert lost.counters["lost"] == lost.counters["late"]
    assert reached["malformed"] == 0
    assert daemon.stop() == 0
