"""Domains of a model, outputs that leave together, and errors that leave nothing behind."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, takewhile
from pathlib import Path

import pytest
from plant_calls import compile_program, run, served

import ecatgen
from conftest import Daemon
from ecatdev import sample_buses
from ecatgen import generate
from modelica_clock import Clock, Event, RefusedError

RIG = str(Path(__file__).parents[1] / "rigs" / "data_types.py")

Build = Callable[..., Path]


@dataclass(frozen=True)
class Sampled:
    """An instant, the bus cycle of its sample, and the last value of the slave in both domains."""

    event: Event
    cycle: int
    first: float
    second: float


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
/* Two blocks of one slave, whose input is a sine; each is read in a domain of its own. Each line of
 * the input has a time, whether the model calls ecatm_wait(), and whether the domains are sampled.
 * The answer has the cycle of the sample and the last values of the blocks. */
int main(int argc, char **argv) {
  static Plant_EL3008 one, two;
  double time;
  int waits, first, second, cycle = 0;
  void *master = ecatm_master_open(argv[1], atoi(argv[2]), atof(argv[3]), 2, 0.1, 1, 1, 0, 0, 0,
                                   "");
  if (ecat_open(&bus, argv[1]) != 0) return 11;
  input = ecat_lookup(bus, "4/0x6070:11", ECAT_INPUT);
  if (input < 0) return 12;
  Plant_EL3008_open(&one, master, 1);
  Plant_EL3008_open(&two, master, 2);
  while (scanf("%lf %d %d %d", &time, &waits, &first, &second) == 4) {
    if (waits) cycle = ecatm_wait(master, time);
    if (first) Plant_EL3008_read(&one, time, cycle);
    if (first && second) new_value();
    if (second) Plant_EL3008_read(&two, time, cycle);
    printf("%d %.9g %.9g\\n", ((ecatm_master *)master)->session.cycle, one.aiStandardChannel8Value,
           two.aiStandardChannel8Value);
  }
  Plant_EL3008_close(&one);
  Plant_EL3008_close(&two);
  ecatm_master_close(master);
  ecat_close(bus);
  return argc != 4;
}
"""

LIBRARY = Path(ecatgen.__file__).parent / "modelica" / "EtherCAT"
FUNCTIONS, MASTER = LIBRARY / "Functions", (LIBRARY / "EtherCATMaster.mo").read_text("utf-8")

EACH_FOR_ITSELF = """
block Master "Domains with a sample() each"
  parameter Real sampleTime[:];
equation
  for d in 1:size(sampleTime, 1) loop
    sampled[d] = sample(0, sampleTime[d]);
  end for;
  when sampled[1] then
    cycle = EtherCAT.Functions.waitCycle(master, time);
  end when;
end Master;
"""

WINDOWS = ((0.0, 0.0205), (5.0, 5.0605))
"""Parts of the simulation that are made with the bus; what is between them only takes its time."""


@pytest.fixture(scope="module")
def two_domains(tmp_path_factory: pytest.TempPathFactory, compiler: str, troll: Daemon) -> Path:
    folder = tmp_path_factory.mktemp("two_domains")
    troll.ctl("generate", "Plant", str(folder / "out"))
    return compile_program(compiler, TWO_DOMAINS, folder / "out", folder)


def replay(program: Path, bus: str, block: str, times: list[float], wait: bool) -> list[Sampled]:
    """What the domains of a master read, in the order in which OpenModelica samples them."""
    clock = Clock(FUNCTIONS, block, {"sampleTime": times})
    until = takewhile(lambda event: event.time < WINDOWS[-1][1], clock.events())
    events = [e for e in until if any(low - 1e-9 < e.time < high for low, high in WINDOWS)]
    result = run(
        program,
        *(bus, f"{wait:d}", f"{clock.values.get('baseTime', times[0])}"),
        lines=[
            f"{e.time!r} {'waitCycle' in e.calls:d} {e.sampled[0]:d} {e.sampled[1]:d}"
            for e in events
        ],
    )
    assert (result.returncode, result.stderr) == (0, "")
    answers = [line.split() for line in result.stdout.splitlines()]
    return [
        Sampled(event, int(cycle), float(first), float(second))
        for event, (cycle, first, second) in zip(events, answers, strict=True)
    ]


@pytest.mark.bus
@pytest.mark.parametrize(
    ("times", "base", "wait"),
    [([1, 4], 1, True), ([4, 1], 1, True), ([4, 6], 2, True), ([1, 4], 1, False)],
    ids=str,
)
def test_domains_stay_together_however_long_the_model_runs(
    two_domains: Path, troll: Daemon, times: list[int], base: int, wait: bool
) -> None:
    samples = replay(two_domains, troll.bus, MASTER, [0.001 * t for t in times], wait)
    assert all(sample.event.calls == ["waitCycle", "masterState"] for sample in samples)
    assert all(before.cycle <= sample.cycle for before, sample in pairwise(samples))
    ticks = [round(sample.event.time / 0.001) for sample in samples]
    assert ticks == [n for n in (*range(21), *range(5000, 5061)) if n % base == 0]
    for tick, sample in zip(ticks, samples, strict=True):
        assert sample.event.sampled == tuple(tick % t == 0 for t in times)
        if all(sample.event.sampled):
            assert sample.first == sample.second
    together = [sample for sample in samples if all(sample.event.sampled)]
    assert len({sample.second for sample in together}) > 0.7 * len(together)  # a sine


@pytest.mark.parametrize(
    ("times", "base"),
    [
        ([0.001], 0.001),
        ([0.01, 0.001, 3600.0], 0.001),
        ([0.001, 0.003 * (1 + 1e-10)], 0.001),
        ([0.002, 0.003], 0.001),
        ([0.001, 0.0011], 0.0001),
        ([1 / 3000, 0.001, 1 / 500], 1 / 3000),
        ([0.001, 0.00101], "no multiples of one time of at least a tenth of the shortest"),
        ([0.001, 0.004 * (1 + 1e-9)], "no multiples of one time"),
        ([0.001, math.pi], "no multiples of one time"),
        ([0.001, 0.0], "must be positive; change sampleTime"),
        ([], "needs a sample time"),
    ],
    ids=str,
)
def test_the_base_of_sample_times(times: list[float], base: float | str) -> None:
    if isinstance(base, str):
        with pytest.raises(RefusedError, match=f"^EtherCAT: .*{base}"):
            Clock(FUNCTIONS, MASTER, {"sampleTime": times})
    else:
        clock = Clock(FUNCTIONS, MASTER, {"sampleTime": times})
        assert clock.values["baseTime"] == pytest.approx(base)


@pytest.mark.bus
def test_the_replay_sees_domains_that_drift_apart(two_domains: Path, troll: Daemon) -> None:
    """With a `sample()` for each domain, the slow one sees an earlier cycle after some seconds."""
    samples = replay(two_domains, troll.bus, EACH_FOR_ITSELF, [0.001, 0.004], True)
    early = [sample for sample in samples if sample.event.time < 1]
    assert len(early) == 21  # together at first
    late = [
        (sample, after)
        for sample, after in pairwise(samples)
        if sample.event.sampled == (False, True) and after.event.time - sample.event.time < 1e-9
    ]
    assert len(late) == 16  # all instants of both
    assert any(slow.cycle < fast.cycle and slow.second != fast.first for slow, fast in late)


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
        *("is not running", "there is no domain 2", "slave 1 of bus", "no input 0x1234:00"),
        *("cannot be scaled by 0", "was generated for 32 bits"),
    )
    for line, text in zip(result.stdout.splitlines(), expected, strict=True):
        assert text in line
