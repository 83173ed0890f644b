"""Every call of the C client on a live bus, with the sanitizers of the compiler."""

import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon

HERE = Path(__file__).parent
CLIENT = HERE.parents[1] / "client_c"

pytestmark = [pytest.mark.bus, pytest.mark.long]


def test_no_call_is_left_out() -> None:
    declared = re.findall(
        r"ECAT_API [^;(]*?\b(ecat_\w+)\(", (CLIENT / "include" / "ecat" / "ecat.h").read_text()
    )
    tried = (HERE / "every_call.c").read_text()
    assert len(declared) > 40
    assert [name for name in declared if f"{name}(" not in tried] == []


CONFIG = """
[gateway]
listen = []
[[slave]]
position = 6
[slave.can]
bit_rate = 1000
frames_per_second = 2500
[[slave]]
position = 7
[slave.can]
bit_rate = 500
frames_per_second = 1000
"""


@pytest.mark.parametrize("kind", ["address,undefined", "thread"])
def test_every_call_does_and_refuses_what_it_says(
    kind: str, compiler: str, start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    program = tmp_path / "every_call"
    subprocess.run(
        [
            *(compiler, "-std=c11", "-O1", "-g", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Werror"),
            # gcc says that its thread sanitizer knows no fences; what they order is atomic.
            *(f"-fsanitize={kind}", "-fno-sanitize-recover=all", "-Wno-tsan"),
            *(f"-I{CLIENT / 'include'}", HERE / "every_call.c", *(CLIENT / "src").glob("*.c")),
            *("-lm", "-lpthread", "-o", program),
        ],
        check=True,
    )
    daemon = start_daemon("troll-can", config=CONFIG)
    with subprocess.Popen(
        ["setarch", "-R", program, daemon.bus],  # the sanitizer needs its usual places in memory
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        if running.stdout.readline() == "restart\n":
            daemon.kill_all()
            start_daemon("troll-can", "--bus", daemon.bus, config=CONFIG).bus = daemon.bus
        output, errors = running.communicate()
    assert (running.returncode, output, errors) == (0, "done\n", "")
