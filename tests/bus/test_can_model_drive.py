"""A model leads a CANopen drive behind a terminal, with the PDOs of its EDS file."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "contract"))

from can_client import Others
from plant_calls import CONTINUE, compile_program

from conftest import Daemon
from ecatsim.can.nodes.drive import EDS

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 2000
NODE, SLAVE = 5, 6
CONFIG = """
[gateway]
listen = []
[[slave]]
position = 6
name = "axes"
[slave.can]
bit_rate = 1000
frames_per_second = 2500
[[slave.can.safe]]
id = 0
data = "02 05"
"""

PROGRAM = """
#include "Plant.h"
int main(int argc, char **argv) {
  static Plant plant;
  Plant_Axes *can = &plant.axes;
  static const int start[8] = {1, 5}, none[8] = {0};
  double time;
  int cycle, speed, word, status, n = 0;
  void *master = ecatm_master_open(argv[1], 1, 0.002, 1, atof(argv[2]), 1, atoi(argv[3]), 0, 0, 0,
                                   "");
  void *nmt, *sync;
  (void)argc;
  Plant_open(&plant, master, 1);
  nmt = ecatm_can_open(can->slave, 0, 0, 0, 1, 2, ECAT_SESSION_ON_TRIGGER, 0, 0, 0);
  sync = ecatm_can_open(can->slave, 0x80, 0, 0, 1, 0, ECAT_SESSION_EACH_SAMPLE, 0, 0, 0);
  printf("open\\n");
  fflush(stdout);
  while (scanf("%lf %d", &time, &speed) == 2) {
    cycle = ecatm_wait(master, time);
    Plant_read(&plant, time, cycle);
    ecatm_can_write_frame(nmt, time, cycle, start);
    ecatm_can_send(nmt, time, cycle, ++n / 100); /* again, until it has come */
    ecatm_can_write_frame(sync, time, cycle, none);
    ecatm_can_send(sync, time, cycle, 0);
    status = can->node5TPDO1Statusword;
    word = status & 8 ? 0x80 : (status & 0x4F) == 0x40 ? 6 : (status & 0x6F) == 0x21 ? 7 : 15;
    can->node5RPDO1Controlword = can->node5RPDO2Controlword = word;
    can->node5RPDO3Controlword = can->node5RPDO4Controlword = word;
    can->node5RPDO1ModesOfOperation = 3;
    can->node5RPDO3TargetVelocity = speed;
    Plant_write(&plant, time, cycle);
    printf("%d %d %d %d %d\\n", can->valid, can->node5TPDO1Valid, can->node5TPDO3Valid, status,
           can->node5TPDO3VelocityActualValue);
    fflush(stdout);
  }
  Plant_close(&plant);
  ecatm_master_close(master);
  return 0;
}
"""
"""Arguments: bus, lease, whenFailed. Each line of its input has a time and a speed."""


class Model:
    """The program, one sample after the other."""

    def __init__(self, program: Path, bus: str) -> None:
        self.process = subprocess.Popen(
            [str(program), bus, "5.0", str(CONTINUE)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "open\n"
        self._time = 0.0

    def step(self, speed: int) -> tuple[int, ...]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._time += 0.002
        self.process.stdin.write(f"{self._time:.6f} {speed}\n")
        self.process.stdin.flush()
        return tuple(map(int, self.process.stdout.readline().split()))

    def until(self, speed: int, condition: Callable[[tuple[int, ...]], bool]) -> tuple[int, ...]:
        deadline = time.monotonic() + 120
        while not condition(step := self.step(speed)):
            assert time.monotonic() < deadline, step
        return step

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def machine(
    start_daemon: Callable[..., Daemon], tmp_path: Path, compiler: str
) -> tuple[Daemon, Path]:
    daemon = start_daemon("troll-can", config=CONFIG)
    daemon.ctl("generate", "Plant", str(tmp_path), "--can", f"axes={EDS}@{NODE}")
    return daemon, compile_program(compiler, PROGRAM, tmp_path, tmp_path)


ENABLED = 0x27


def is_enabled(step: tuple[int, ...]) -> bool:
    return bool(step[1]) and step[3] & 0x6F == ENABLED


@pytest.mark.parametrize("end", ["kill", "stop"])
def test_a_model_turns_the_motor_and_its_end_stops_it(
    machine: tuple[Daemon, Path], end: str
) -> None:
    daemon, program = machine
    model = Model(program, daemon.bus)
    others = Others(daemon.bus, SLAVE)
    try:
        model.until(0, is_enabled)
        step = model.until(60_000, lambda step: bool(step[2]) and abs(step[4] - 60_000) < 600)
        assert step[0]
        model.process.send_signal(signal.SIGKILL if end == "kill" else signal.SIGSTOP)
        others.wait(lambda: [f for f in others.frames(0) if f.safe and f.data == b"\2\5"])
        if end == "stop":
            model.process.send_signal(signal.SIGCONT)
            model.until(0, lambda step: is_enabled(step) and abs(step[4]) < 600)
    finally:
        others.close()
        model.close()
