"""A capture of a whole bus: what `ecatsim pcap` says of it, and a rig that is the same bus."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, one_line_error
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 4000
RIG = """
name = "machine"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL2008"
[[slave]]
device = "CiA402"
"""


def pcap(*arguments: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ecatsim", "pcap", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    return done


def process_data(daemon: Daemon) -> list[Any]:
    slaves = daemon.ctl_json("pdos")["slaves"]
    return [(slave["outputs"], slave["inputs"]) for slave in slaves]


def test_a_rig_of_a_capture_is_the_same_bus(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig, file, copy = tmp_path / "m.toml", tmp_path / "m.pcapng", tmp_path / "copy.toml"
    rig.write_text(RIG)
    daemon = start_daemon(str(rig))
    daemon.ctl("sdo-read", "2", "0x5555", check=False)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.drop(count=3, every=2)
        while any(fault.struck < 3 for fault in simulator.faults.list()):
            pass
    with daemon.client() as client:
        client.wait(20)
    daemon.ctl("capture", "-o", str(file))
    found = json.loads(pcap(str(file), "-o", str(copy), "--json").stdout)
    assert found["slave_count"] == 3
    assert [slave["name"] for slave in found["slaves"]] == ["EK1100", "EL2008", "CiA402"]
    sizes = [(slave["output_bytes"], slave["input_bytes"]) for slave in found["slaves"]]
    before = daemon.slave_rows()
    original = process_data(daemon)
    for slave in found["slaves"]:
        states = [item["state"] for item in slave["states"]]
        assert states[-1] == "OP"
        assert "PREOP" in states
    assert sizes[:2] == [(0, 0), (1, 0)]
    (area,) = found["process_data"]
    assert area["bytes"] == sum(map(sum, sizes))
    assert area["lost"] >= 3
    names("\n".join(found["faults"]), "did not come back", "slave 2 (CiA402)", "0x5555:00")
    assert daemon.stop() == 0
    text = pcap(str(file)).stdout
    names(text, "EK1100", "EL2008", "CiA402", "process data:", "faults:")
    again = start_daemon(str(copy))
    assert process_data(again) == original
    keys = ("vendor", "product", "revision", "name")
    rows = [
        [{key: row[key] for key in keys} for row in rows] for rows in (before, again.slave_rows())
    ]
    assert rows[0] == rows[1]
    assert again.stop() == 0
    refused = pcap(str(rig), status=2)
    assert "this is not a capture" in one_line_error(refused.stderr, "ecatsim")
