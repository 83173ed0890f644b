"""An FMU behind analog terminals, and a real master (pysoem) that controls it.

The FMU is a motor of first order, compiled here. The master runs as a command inside
`ecatsim run`; this file is the rig as well, with the FMU that the environment names.
"""

import json
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from masters import PATIENCE, new_master

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'fmu')")

from ecatsim.devices.library import make
from ecatsim.plants.fmu import Connection, add_fmu
from ecatsim.rig import Rig

pytestmark = [pytest.mark.bus, pytest.mark.long, pytest.mark.unprivileged]

HERE = Path(__file__)
SAFEOP, OP = 4, 8
FULL_SCALE = 32767
TARGET = 60.0  # rad/s; 100 rad/s are 10 V


def rig():
    output, inputs = make("EL4004"), make("EL3102")
    result = Rig("motor", [make("EK1100"), output, inputs])
    plant = add_fmu(
        result,
        os.environ["MOTOR_FMU"],
        [
            Connection("voltage", (output, 0x7000, 1)),
            Connection("speed", (inputs, 0x6000, 0x11), scale=0.1),
        ],
        start={"gain": 20.0, "lag": 0.1, "fail_at": float(os.environ.get("FAIL_AT", "1e9"))},
    )
    close, step, spent = plant.close, plant._step, []

    def measured():
        begin = time.thread_time()
        step()
        spent.append(time.thread_time() - begin)

    def report():
        if cost := os.environ.get("COST"):
            Path(cost).write_text(json.dumps([plant.cost.steps, sum(spent) / len(spent)]))
        close()

    plant._step, plant.close = measured, report
    return result


def master_pi_control():
    """A PI controller at 1 kHz brings the speed to the target, and keeps it there."""

    master = new_master()
    master.open("ecat-master")
    assert master.config_init() == 3
    for slave in master.slaves:
        slave._fpwr(0x0420, b"\x00\x00")
    master.config_map()
    assert master.state_check(SAFEOP, 2_000_000) == SAFEOP
    output, inputs = master.slaves[1], master.slaves[2]
    master.state, integral, speeds, requested = OP, 0.0, [], False
    end, settled = time.monotonic() + PATIENCE, 0
    while settled < 200 and time.monotonic() < end:
        master.send_processdata()
        master.receive_processdata(10_000)
        if not requested:
            master.write_state()
            requested = True
        (raw,) = struct.unpack_from("<h", inputs.input, 2)
        speeds.append(raw / FULL_SCALE * 100)
        error = TARGET - speeds[-1]
        settled = settled + 1 if abs(error) < 0.02 * TARGET else 0
        integral += error * 0.001
        volts = min(max(0.1 * error + 0.5 * integral, 0.0), 10.0)
        output.output = struct.pack("<4h", round(volts / 10 * FULL_SCALE), 0, 0, 0)
        time.sleep(0.001)
    return speeds


def run(fmu, **environment):
    code = (
        f"import sys, json; sys.path.insert(0, {str(HERE.parent)!r}); import {HERE.stem} as t; "
        "print('found', json.dumps(t.master_pi_control()))"
    )
    return subprocess.run(
        [sys.executable, "-m", "ecatsim", "run", str(HERE), "--", sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"MOTOR_FMU": str(fmu)} | environment,
    )


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmu(request, tmp_path_factory):
    sys.path.insert(0, str(HERE.parents[1] / "unit"))
    from motor_fmu import make_fmu

    return make_fmu(tmp_path_factory.mktemp("fmu"), request.param)


def test_a_master_controls_the_speed_of_an_fmu(fmu, tmp_path):
    result = run(fmu, COST=str(tmp_path / "cost.json"), TMPDIR=str(tmp_path))
    assert result.returncode == 0, result.stderr + result.stdout
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("found ")]
    speeds = json.loads(line.removeprefix("found "))
    assert speeds[0] == pytest.approx(0.0, abs=1.0)
    assert speeds[-200:] == pytest.approx([TARGET] * 200, rel=0.02)
    steps, mean = json.loads((tmp_path / "cost.json").read_text())
    assert steps > 200
    assert mean < 0.001, "a step takes less of a processor than it lasts"
    assert [item.name for item in tmp_path.iterdir()] == ["cost.json"], "nothing stays behind"


def test_an_fmu_that_fails_ends_the_simulation_with_a_sentence(fmu):
    result = run(fmu, FAIL_AT="0.2")
    assert result.returncode != 0
    lines = [line for line in result.stderr.splitlines() if line.startswith("ecatsim: ")]
    assert len(lines) == 1
    assert "0.2 s" in lines[0]
    assert "ecatsim/plants" not in result.stderr, "no traceback of ours"
