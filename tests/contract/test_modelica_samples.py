"""Domains of a model, outputs that leave together, and errors that leave nothing behind."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from plant_calls import compile_program, run, served

from conftest import Daemon
from ecatdev import sample_buses
from ecatgen import generate

RIG = str(Path(__file__).parents[1] / "rigs" / "data_types.py")

Build = Callable[..., Path]


@pytest.fixture
def build(tmp_path: Path, compiler: str) -> Build:
    """Compiles a program for the library in a folder."""

    def build(source: str, out: Path, *flags: str) -> Path:
        return compile_program(compiler, source, out, tmp_path, *flags)

    return build


TWO_DOMAINS = """
#include "Plant.h"
#include "ecat/ecat.h"
static ecat_t *bus;
static int input;
/* Waits until the slave has converted its input again, however busy the machine is. */
static void new_value(void) {
  int64_t before = 0, now = 0;
  int n;
  ecat_sample(bus);
  ecat_read_int(bus, input, &before);
  for (n = 0, now = before; n < 10000 && now == before; n++) {
    ecat_wait(bus, 1, 1.0);
    ecat_sample(bus);
    ecat_read_int(bus, input, &now);
  }
}
/* Two blocks of one slave, whose input is a sine; each is read in a domain of its own. */
int main(int argc, char **argv) {
  static Plant_EL3008 one, two;
  double last = -100;
  int tick, cycle = 0, together = 0, changes = 0;
  int first = atoi(argv[2]), second = atoi(argv[3]); /* sample times in ms */
  void *master = ecatm_master_open(argv[1], atoi(argv[4]), 0.001 * first, 2, 0.1, 1, 1, 0, 0, 0,
                                   "");
  if (ecat_open(&bus, argv[1]) != 0) return 11;
  input = ecat_lookup(bus, "4/0x6070:11", ECAT_INPUT);
  if (input < 0) return 12;
  Plant_EL3008_open(&one, master, 1);
  Plant_EL3008_open(&two, master, 2);
  for (tick = 0; tick < 400; tick++) {
    double time = 0.001 * tick;
    if (tick % first == 0) {
      cycle = ecatm_wait(master, time);
      Plant_EL3008_read(&one, time, cycle);
      new_value();
    }
    if (tick % second == 0) {
      Plant_EL3008_read(&two, time, cycle);
      changes += two.aiStandardChannel8Value != last;
      last = two.aiStandardChannel8Value;
      if (tick % first != 0) new_value();
    }
    if (tick % first == 0 && tick % second == 0) {
      together++;
      if (one.aiStandardChannel8Value != two.aiStandardChannel8Value) return 10;
    }
  }
  printf("%d %d\\n", together, changes);
  Plant_EL3008_close(&one);
  Plant_EL3008_close(&two);
  ecatm_master_close(master);
  ecat_close(bus);
  return argc != 5;
}
"""


@pytest.fixture(scope="module")
def two_domains(tmp_path_factory: pytest.TempPathFactory, compiler: str, troll: Daemon) -> Path:
    folder = tmp_path_factory.mktemp("two_domains")
    troll.ctl("generate", "Plant", str(folder / "out"))
    return compile_program(compiler, TWO_DOMAINS, folder / "out", folder)


@pytest.mark.bus
@pytest.mark.parametrize("wait_for_bus", [0, 1])
@pytest.mark.parametrize(("first", "second", "together"), [(1, 4, 100), (2, 3, 67), (4, 1, 100)])
def test_reads_of_a_time_see_one_cycle_in_all_domains_of_the_model(
    two_domains: Path, troll: Daemon, first: int, second: int, together: int, wait_for_bus: int
) -> None:
    result = run(two_domains, troll.bus, *map(str, (first, second, wait_for_bus)))
    assert (result.returncode, result.stderr) == (0, "")
    common, changes = map(int, result.stdout.split())
    assert common == together
    assert changes > 0.5 * 400 / second  # also where there is no sample of the other domain


TOGETHER = """
#include "Plant.h"
#include <unistd.h>
int main(int argc, char **argv) {
  static Plant plant;
  int n, cycle, both = atoi(argv[2]);
  void *master = ecatm_master_open(argv[1], 1, 0.002, 1, 30, 1, 2, 0, 0, 0, "");
  Plant_open(&plant, master, 1);
  for (n = 1; n < 200; n++) {
    double time = 0.002 * n;
    cycle = ecatm_wait(master, time);
    Plant_read(&plant, time, cycle);
    plant.dataTypes.outputsUNSIGNED16 = plant.dataTypes_2.outputsUNSIGNED16 = n;
    Plant_DataTypes_write(&plant.dataTypes, time, cycle);
    usleep(3000);
    if (both || n < 100) Plant_DataTypes_2_write(&plant.dataTypes_2, time, cycle);
  }
  for (n = 0; n < 2000 && plant.dataTypes_2.inputsUNSIGNED16 != 7; n++) {
    double time = 0.4 + 0.002 * n;
    cycle = ecatm_wait(master, time);
    Plant_read(&plant, time, cycle);
    plant.dataTypes.outputsUNSIGNED16 = plant.dataTypes_2.outputsUNSIGNED16 = 7;
    Plant_DataTypes_write(&plant.dataTypes, time, cycle);
    if (both) Plant_DataTypes_2_write(&plant.dataTypes_2, time, cycle);
  }
  Plant_close(&plant);
  ecatm_master_close(master);
  return argc != 3 || n == 2000;
}
"""
OWNED, FIRST = 0x7000, 14
"""The UNSIGNED16 of the rig."""


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared(RIG)


@pytest.fixture(scope="module")
def two_slaves(tmp_path_factory: pytest.TempPathFactory, compiler: str, daemon: Daemon) -> Path:
    folder = tmp_path_factory.mktemp("two_slaves")
    daemon.ctl("generate", "Plant", str(folder / "out"))
    return compile_program(compiler, TOGETHER, folder / "out", folder)


@pytest.mark.bus
def test_outputs_of_all_slaves_leave_together(two_slaves: Path, daemon: Daemon) -> None:
    over = threading.Event()
    seen: set[tuple[float, float]] = set()

    def watch() -> None:
        with daemon.client() as client:
            outputs = [client.signal(slave, OWNED, FIRST, 1) for slave in (0, 1)]
            while not over.is_set():
                client.sample()
                first, second = (output.raw for output in outputs)
                seen.add((first, second))

    watcher = threading.Thread(target=watch)
    watcher.start()
    result = run(two_slaves, daemon.bus, "1")
    over.set()
    watcher.join()
    assert (result.returncode, result.stderr) == (0, "")
    assert len(seen) > 20
    # The first sample claims one slave after the other.
    assert [pair for pair in seen if pair[0] != pair[1] and max(pair) > 1] == []


@pytest.mark.bus
def test_a_slave_that_is_not_written_any_more_holds_up_no_other(
    two_slaves: Path, daemon: Daemon
) -> None:
    result = run(two_slaves, daemon.bus, "0")
    assert (result.returncode, result.stderr) == (0, "")


MODELICA_UTILITIES = """
#ifndef MODELICA_UTILITIES_H
#define MODELICA_UTILITIES_H
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
static jmp_buf tool;
static char said[1000];
static __attribute__((unused)) void ModelicaFormatMessage(const char *format, ...) {
  (void)format;
}
static __attribute__((unused, noreturn)) void ModelicaFormatError(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(said, sizeof said, format, arguments);
  va_end(arguments);
  longjmp(tool, 1);
}
static __attribute__((unused, noreturn)) void ModelicaError(const char *text) {
  ModelicaFormatError("%s", text);
}
static __attribute__((unused)) char *ModelicaAllocateString(size_t size) {
  return (char *)calloc(size + 1, 1);
}
#endif
"""
"""As a Modelica tool has them: an error is a jump past all functions to the tool, which destroys
what was constructed, and may go on to simulate something else."""

JUMPS = """
#include "Plant.h"
static void *master, *domain, *slave, *wrong, *input, *output;

static int fails(const char *bus, int step) {
  master = domain = slave = wrong = input = output = NULL;
  if (setjmp(tool)) return 1;
  master = ecatm_master_open(step == 0 ? "nobody" : bus, 0, 0.001, 1, 0.1, 1, 1, 0, 0, 0, "");
  domain = ecatm_domain_open(master, step == 1 ? 2 : 1, "");
  slave = ecatm_slave_open(domain, 0, "", 154, 198948, 0, "ELMO", "", "generate", "");
  if (step == 2)
    wrong = ecatm_slave_open(domain, 1, "", 154, 198948, 0, "ELMO", "", "generate", "");
  input = ecatm_pdo_open(slave, step == 3 ? 0x1234 : 0x606C, 0, 0, 4, 32, step == 4 ? 0 : 1, 0, "");
  output = ecatm_pdo_open(slave, 0x6040, 0, 1, 6, step == 5 ? 32 : 16, 1, 0, "");
  return 0;
}

int main(int argc, char **argv) {
  int step;
  for (step = 0; argc == 2 && step <= 6; step++) {
    if (fails(argv[1], step) != (step < 6)) return 10 + step;
    if (step < 6) puts(said);
    ecatm_pdo_close(output);
    ecatm_master_close(master);
    ecatm_pdo_close(input);
    ecatm_slave_close(wrong);
    ecatm_domain_close(domain);
    ecatm_slave_close(slave);
  }
  return 0;
}
"""


def test_an_error_that_jumps_to_the_tool_leaves_nothing_behind(
    build: Build, tmp_path: Path
) -> None:
    tool = tmp_path / "tool"
    tool.mkdir()
    (tool / "ModelicaUtilities.h").write_text(MODELICA_UTILITIES)
    generate(sample_buses.troll(), "Plant", tmp_path / "out")
    sanitize = ("-fsanitize=address,undefined", "-static-libasan", f"-I{tool}", "-Wno-clobbered")
    program = build(JUMPS, tmp_path / "out", *sanitize)
    with served(sample_buses.troll()) as name:
        result = run(program, name)
    assert (result.returncode, result.stderr) == (0, "")
    expected = (
        *("no ecatd serves bus", "there is no domain 2", "slave 1 of bus", "no input 0x1234:00"),
        *("cannot be scaled by 0", "was generated for 32 bits"),
    )
    for line, text in zip(result.stdout.splitlines(), expected, strict=True):
        assert text in line
