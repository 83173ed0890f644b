"""Slaves that never come to an end keep nobody but those waiting who ask them."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error, wait_for
from rigs.endless import DRIP

pytestmark = [pytest.mark.bus, pytest.mark.long]

RIG = Path(__file__).parents[1] / "rigs" / "endless.py"


def test_r24_slaves_that_never_come_to_an_end(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    bus = start_daemon(str(RIG))
    # The third slave has sent the list of its PDOs byte by byte.
    names(bus.log, "slave 2", "0x1C13:00", "without end", "mailbox_timeout_ms")
    wait_for(lambda: [row["text"] for row in bus.slave_rows("state")] == ["OP"] * 3, bus)

    command = [sys.executable, "-m", "ecatd.cli", "--timeout", "100", "sdo-read", "0", hex(DRIP)]
    with subprocess.Popen(command, env=bus.env, stderr=subprocess.PIPE, text=True) as reader:
        for _ in range(5):
            assert bus.ctl_json("sdo-read", "1", "0x1018", "1")["value"]
        error = reader.communicate()[1]
    assert reader.returncode == 4
    names(one_line_error(error, "ecatctl"), "slave 0", "0x5001:00", "without end")
    assert bus.ctl_json("sdo-read", "0", "0x1018", "1")["value"] == 0xFFFF
    refused = bus.ctl("sdos", "0", check=False)
    names(one_line_error(refused.stderr, "ecatctl"), "slave 0", "fragment without data", "--esi")

    file = tmp_path / "busy"
    file.write_bytes(bytes(100))
    writing = ("foe-write", "0", str(file), "--yes")
    with subprocess.Popen(
        [sys.executable, "-m", "ecatd.cli", *writing],
        env=bus.env,
        stderr=subprocess.PIPE,
        text=True,
    ) as transfer:
        # Between two answers that the slave is busy, others get their turn.
        wait_for(lambda: "file 'busy' begins" in bus.log, bus)
        assert bus.ctl_json("sdo-read", "0", "0x1018", "1")["value"] == 0xFFFF
        bus.ctl(*writing, "--cancel")
        error = transfer.communicate()[1]
    assert transfer.returncode == 7
    names(error, "busy", "cancelled")
    degraded = bus.ctl("check", check=False).stdout  # only because of the start
    names(degraded, "slave 2")
    assert "slave 0" not in degraded
