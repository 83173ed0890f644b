"""Blocks, SDO blocks, start-up lists and FMUs find their slave by its name."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from conftest import Daemon, names, run_module, wait_for
from player import BEAR, Model

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
"""The program samples every millisecond, and so does its bus."""

RIG = 'name = "axes"\n' + '[[slave]]\ndevice = "CiA402"\n' * 2
SLAVE = '[[slave]]\nposition = {}\nname = "{}"\nvendor = 0xffff\nproduct = 0x402\n'
PROGRAM = """
#include "Plant.h"
static const int rows[] = {0x6083, 0, 7, 4711};
static void *master;
static double now = 0;
static int sample(void) { return ecatm_wait(master, now += 0.001); }
int main(int argc, char **argv) {
  static Plant plant;
  int n, state = ECATM_SDO_BUSY, cycle;
  void *list, *object;
  master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 30, 1, 1, 0, 0, 0, "");
  list = ecatm_sdo_list_open(master, 0, "left", rows, 1, 4, "");
  object = ecatm_sdo_open(master, 0, "left", 0x6083, 0, 7, 1, 1, 0, 1, 0, "", "");
  Plant_open(&plant, master, 1);
  plant.left.targetVelocity = 11;
  plant.right.targetVelocity = 22;
  for (n = 0; n < 20; n++) {
    cycle = sample();
    Plant_read(&plant, now, cycle);
    Plant_write(&plant, now, cycle);
  }
  while (state == ECATM_SDO_BUSY)
    state = ecatm_sdo_list_write(list, now, sample(), 1);
  printf("%d ", state);
  state = ECATM_SDO_BUSY;
  while (state == ECATM_SDO_BUSY)
    state = ecatm_sdo_read(object, now, sample(), 1);
  printf("%d %d\\n", state, ecatm_sdo_integer(object, state));
  fflush(stdout);
  getchar();
  return 0;
}
"""


def config(*given: str) -> str:
    """A configuration that gives the slaves these names, in the order of the wire."""
    slaves = (SLAVE.format(position, name) for position, name in enumerate(given))
    return "[gateway]\nlisten = []\n" + "".join(slaves)


@pytest.fixture
def plant(tmp_path: Path) -> Path:
    """The library and the FMU of a bus whose slaves are `left` and `right`, and the rig."""
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "made.toml").write_text(config("left", "right"))
    source = ("--from", str(tmp_path / "rig.toml"), "--config", str(tmp_path / "made.toml"))
    for kind in ((), ("--fmu",)):
        done = run_module("ecatd.cli", "generate", "Plant", str(tmp_path / "out"), *source, *kind)
        assert done.returncode == 0, done.stderr
    return tmp_path


@pytest.fixture
def program(plant: Path, compiler: str) -> Path:
    """A program with the calls of the blocks."""
    out, made = plant / "out", plant / "program"
    (plant / "program.c").write_text(PROGRAM)
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    folders = (
        *(resources / "Include", resources / "Source" / "standalone"),
        out / "Plant" / "Resources" / "Source",
    )
    subprocess.run(
        [
            *(compiler, "-Wall", "-Wextra", "-Werror", *(f"-I{folder}" for folder in folders)),
            *(str(plant / "program.c"), str(archive), "-lm", "-o", str(made)),
        ],
        check=True,
    )
    return made


@contextmanager
def running(program: Path, bus: str) -> Iterator[str]:
    """Runs it; yields what it says once its outputs are on the bus."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([program, bus], text=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        yield process.stdout.readline().strip() or process.stderr.read()
        process.communicate("\n")


def velocities(daemon: Daemon) -> list[int]:
    """What the bus sends to the slaves, in the order of the wire."""
    with daemon.client() as client:
        client.sample()
        return [int(client.signal(f"{n}/0x60FF:00").raw) for n in (0, 1)]


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_wherever_the_slave_is(
    order: tuple[str, str], plant: Path, program: Path, start_daemon: Callable[..., Daemon]
) -> None:
    daemon = start_daemon(str(plant / "rig.toml"), config=config(*order))
    expected = [{"left": 11, "right": 22}[name] for name in order]
    with running(program, daemon.bus) as said:
        assert said == "2 2 4711"
        wait_for(lambda: velocities(daemon) == expected, daemon)
    for name in order:
        found = daemon.ctl("sdo-read", name, "0x6083").stdout
        assert ("4711" in found) == (name == "left")
    with Model(plant / "out" / "Plant.fmu").play(bus=daemon.bus, **BEAR) as player:
        player.set("left.targetVelocity", 11)
        player.set("right.targetVelocity", 22)
        player.step()
        player.step()
        assert velocities(daemon) == expected


@pytest.mark.long
def test_where_no_slave_has_the_name(
    plant: Path, program: Path, start_daemon: Callable[..., Daemon]
) -> None:
    daemon = start_daemon(str(plant / "rig.toml"), config=config("left", "middle"))
    with running(program, daemon.bus) as said:
        (line,) = said.splitlines()
        names(line, "'right'", "ecatctl slaves", "ecatctl generate Plant")
