"""The calls that blocks make, made from C: what is checked at the start, and how samples go.

`<library>.h` has for each block functions with the same calls, in the same order, as the block.
"""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from plant_calls import compile_program, run, sentence, served

from conftest import Daemon, names
from ecatdev import sample_buses
from ecatgen import generate

OPEN = """
#include "Plant.h"
int main(int argc, char **argv) {
  static Plant plant;
  double sample_time = argc > 3 ? atof(argv[3]) : 0.001;
  void *master = ecatm_master_open(argv[1], argc > 3, sample_time, 1, 0.1, 1, 1, 0, 0, 0, "");
  Plant_open(&plant, master, argc > 2 ? atoi(argv[2]) : 1);
  ecatm_master_close(master); /* first, as some tools do; memory checkers see the rest */
  Plant_close(&plant);
  puts("opened and closed");
  return 0;
}
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library for the reference plant, as it was described by hand."""
    folder = tmp_path_factory.mktemp("out")
    generate(sample_buses.troll(), "Plant", folder)
    return folder


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> Path:
    """The library for the live bus."""
    folder = tmp_path_factory.mktemp("live")
    troll.ctl("generate", "Plant", str(folder))
    return folder


@pytest.fixture
def build(tmp_path: Path, compiler: str) -> Callable[..., Path]:
    """Compiles a C program against the files of a generated library."""

    def compile_(source: str, out: Path, *flags: str) -> Path:
        return compile_program(compiler, source, out, tmp_path, *flags)

    return compile_


@pytest.fixture(scope="module")
def opener(tmp_path_factory: pytest.TempPathFactory, compiler: str, out: Path) -> Path:
    """A program that opens and closes all blocks: arguments bus, domain, sample time."""
    folder = tmp_path_factory.mktemp("opener")
    return compile_program(compiler, OPEN, out, folder, "-std=c89", "-pedantic-errors")


def test_the_bus_that_the_library_was_generated_for(opener: Path) -> None:
    with served(sample_buses.troll()) as name:
        result = run(opener, name)
    assert (result.returncode, result.stdout, result.stderr) == (0, "opened and closed\n", "")


def test_objects_may_be_destroyed_in_any_order(build: Callable[..., Path], out: Path) -> None:
    program = build(OPEN, out, "-fsanitize=address,undefined", "-static-libasan")
    with served(sample_buses.troll()) as name:
        result = run(program, name)
    assert (result.returncode, result.stderr) == (0, "")


def test_no_bus(opener: Path) -> None:
    names(
        sentence(run(opener, "nobody")), "not running", "'nobody'", "systemctl start ecatd@nobody'"
    )


def test_another_slave(opener: Path) -> None:
    bus = sample_buses.troll()
    bus.slaves[2].name, bus.slaves[2].product = "EL2008", 0x07D83052
    with served(bus) as name:
        line = sentence(run(opener, name))
    there, _, here = line.partition("EL1018")
    names(there, "slave 2", f"'{name}'", "EL2008", "0x00000002", "0x07D83052", "0x00100000")
    names(here, "0x00000002", "0x03FA3052", "0x00100000")
    assert line.endswith(f": ecatctl generate Plant DIR --bus {name}")


def test_another_revision(opener: Path) -> None:
    bus = sample_buses.troll()
    bus.slaves[4].revision = 0x00150000
    with served(bus) as name:
        names(sentence(run(opener, name)), "slave 4", "0x00150000")


def test_a_bus_with_fewer_slaves(opener: Path) -> None:
    bus = sample_buses.troll()
    del bus.slaves[7]
    with served(bus) as name:
        line = sentence(run(opener, name))
    names(line, f"'{name}'", "slave 7", "7 slaves", "EL6751")
    assert line.endswith(f": ecatctl generate Plant DIR --bus {name}")


def test_an_entry_that_is_not_mapped_any_more(opener: Path) -> None:
    bus = sample_buses.troll()
    bus.slaves[0].inputs.pop()
    with served(bus) as name:
        line = sentence(run(opener, name))
    names(line, "slave 0 (Gold EtherCAT GCON Drive)", "input 0x6078:00", "ecatctl generate Plant")


@pytest.mark.parametrize(("data_type", "bits"), [(6, 16), (2, 8)])
def test_an_entry_of_another_type(opener: Path, data_type: int, bits: int) -> None:
    bus = sample_buses.troll()
    value = bus.slaves[4].inputs[0].entries[-1]
    value.data_type, value.bit_length = data_type, bits
    bus.slaves.append(replace(bus.slaves[7], position=8))  # the fingerprint counts no types
    with served(bus) as name:
        line = sentence(run(opener, name))
    there, _, here = line.partition("generated for")
    names(there, "0x6000:11 (Value)", "slave 4 (EL3008)", f"'{name}'")
    names(there, f"{bits} bits", f"0x{data_type:04X}")
    names(here, "16 bits", "0x0003", "ecatctl generate Plant")


def test_other_slaves_may_come_and_unused_entries_may_change(opener: Path) -> None:
    bus = sample_buses.troll()
    bus.slaves[1].inputs = sample_buses.troll().slaves[2].inputs  # of no interest to the block
    with served(bus) as name:
        assert run(opener, name).returncode == 0


def test_a_domain_that_the_model_does_not_have(opener: Path) -> None:
    with served(sample_buses.troll()) as name:
        line = sentence(run(opener, name, "2"))
    names(line, "domain 2", "sampleTime", "length 1", "domainID")


@pytest.mark.parametrize(
    ("sample_time", "fits"),
    [("0.001", True), ("0.003", True), ("0.0015", False), ("0.0005", False), ("0", False)],
)
def test_a_model_that_waits_needs_whole_cycles(opener: Path, sample_time: str, fits: bool) -> None:
    with served(sample_buses.troll()) as name:
        result = run(opener, name, "1", sample_time)
    assert (result.returncode == 0) == fits
    if not fits:
        names(result.stderr, "sample time", f"{sample_time} s", "0.001 s")


START = """
#include "Plant.h"
int main(int argc, char **argv) {
  static Plant plant;
  int n, cycle, last = 0;
  void *master = ecatm_master_open(argv[argc - 1], 1, 0.002, 1, 30, 1, 2, 0, 0, 0, "");
  Plant_open(&plant, master, 1);
  for (n = 0; n < 1000; n++) {
    double time = 0.002 * n;
    cycle = ecatm_wait(master, time);
    Plant_read(&plant, time, cycle);
"""
END = """
    Plant_write(&plant, time, cycle);
    last = cycle;
  }
  Plant_close(&plant);
  ecatm_master_close(master);
  return last == 0;
}
"""

ONE_CYCLE_PER_TIME = """
    if (n > 0 && cycle - last < 2) return 10; /* two bus cycles make one sample */
    usleep(3000);
    if (ecatm_wait(master, time + 1e-12) != cycle) return 11;
    if (ecatm_read_real(plant.el3008.input_6000_11, time, cycle) !=
        plant.el3008.aiStandardChannel1Value) return 12; /* a sine: differs between cycles */
"""

OUTPUTS = """
    plant.el2008.channel1Output = n >= 20;
    plant.el2008.channel2Output = n >= 20 && n < 500;
    printf("%d %d %d\\n", n, plant.el1018.channel1Input, plant.el1018.channel2Input);
    Plant_write(&plant, time, cycle);
"""

NOT_COMMITTED = """
    if (n >= 20) {
      ecatm_write_boolean(plant.el2008.output_7000_01, time, cycle, 1);
      Plant_GoldGCONDrive_write(&plant.goldGCONDrive, time, cycle);
      if (plant.el1018.channel1Input) return 13;
      last = cycle;
      continue;
    }
"""


@pytest.mark.bus
def test_all_reads_of_a_time_see_one_cycle(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    program = build("#include <unistd.h>" + START + ONE_CYCLE_PER_TIME + END, live)
    result = run(program, troll.bus)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.bus
def test_writes_reach_the_slaves_and_may_be_repeated(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    result = run(build(START + OUTPUTS + END, live), troll.bus)
    assert result.returncode == 0, result.stderr
    rows = [line.split() for line in result.stdout.splitlines()]
    assert rows[15][1:] == ["0", "0"]
    assert rows[490][1:] == ["1", "1"]
    assert rows[990][1:] == ["1", "0"]


@pytest.mark.bus
def test_the_commit_of_one_slave_leaves_the_others_alone(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    result = run(build(START + NOT_COMMITTED + END, live), troll.bus)
    assert (result.returncode, result.stderr) == (0, "")


DOMAINS = """
[gateway]
listen = []
[[domain]]
divider = 50
[[domain]]
name = "digital"
slaves = ["2-3"]
[[domain]]
name = "analog"
divider = 2
slaves = [4]
"""


@pytest.mark.bus
def test_slaves_in_other_domains_of_the_bus(
    build: Callable[..., Path], live: Path, start_daemon: Callable[..., Daemon]
) -> None:
    """With a library that was generated when all slaves were in domain 0."""
    daemon = start_daemon("troll", config=DOMAINS)
    result = run(build(START + OUTPUTS + END, live), daemon.bus)
    assert result.returncode == 0, result.stderr
    rows = [line.split() for line in result.stdout.splitlines()]
    assert [rows[n][1:] for n in (15, 490, 990)] == [["0", "0"], ["1", "1"], ["1", "0"]]
    program = build("#include <unistd.h>" + START + ONE_CYCLE_PER_TIME + END, live)
    assert run(program, daemon.bus).returncode == 0


SLOW = """
#include "Plant.h"
int main(int argc, char **argv) {
  Plant_EL2008 block;
  int n;
  void *master = ecatm_master_open(argv[argc - 1], 1, 3, 1, 2, 1, 2, 0, 0, 0, "");
  Plant_EL2008_open(&block, master, 1);
  for (n = 0; n < 2; n++) Plant_EL2008_write(&block, 3 * n, ecatm_wait(master, 3 * n));
  ecatm_master_close(master);
  return 0;
}
"""


@pytest.mark.bus
def test_waiting_for_the_bus_keeps_the_lease(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    start = time.monotonic()
    result = run(build(SLOW, live), troll.bus)
    assert (result.returncode, result.stderr) == (0, "")
    assert time.monotonic() - start > 2.5, "longer than the lease"


TWICE = """
#include "Plant.h"
int main(int argc, char **argv) {
  Plant_EL2008 one, two;
  void *master = ecatm_master_open(argv[argc - 1], 1, 0.001, 1, 30, 1, 1, 0, 0, 0, "");
  Plant_EL2008_open(&one, master, 1);
  Plant_EL2008_open(&two, master, 1);
  Plant_EL2008_write(&one, 0, ecatm_wait(master, 0));
  Plant_EL2008_write(&two, 0, 0);
  return 0;
}
"""

ORPHAN = """
#include "Plant.h"
int main(int argc, char **argv) {
  Plant_EL2008 orphan, block;
  void *lost = ecatm_master_open(argv[argc - 1], 1, 0.001, 1, 30, 1, 1, 0, 0, 0, "");
  void *master = ecatm_master_open(argv[argc - 1], 1, 0.001, 1, 30, 1, 1, 0, 0, 0, "");
  Plant_EL2008_open(&orphan, lost, 1);
  Plant_EL2008_open(&block, master, 1);
  Plant_EL2008_write(&block, 0, ecatm_wait(master, 0));
  ecatm_master_close(master);
  return 0;
}
"""


@pytest.mark.bus
def test_two_blocks_that_write_one_slave(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    line = sentence(run(build(TWICE, live), troll.bus))
    names(line, "two blocks", "slave 3", f"'{troll.bus}'")


@pytest.mark.bus
def test_a_constructor_that_is_called_twice_does_no_harm(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    assert run(build(ORPHAN, live), troll.bus).returncode == 0


@pytest.mark.bus
def test_outputs_that_another_program_owns(
    build: Callable[..., Path], live: Path, troll: Daemon
) -> None:
    program = build(START + END, live)
    with troll.client() as owner, ThreadPoolExecutor() as pool:
        owner.claim(3, lease=30.0)
        ends = pool.submit(run, program, troll.bus)
        while not ends.done():
            owner.sample()
        line = sentence(ends.result())
    names(line, "slave 3 (EL2008)", "belongs to", f"pid {os.getpid()}", "readOnly")
