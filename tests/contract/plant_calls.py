"""Programs that make the calls of a generated library `Plant`; one makes them step by step."""

from __future__ import annotations

import subprocess
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ecatd.description.bus import Bus
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.shm.files import make_folder

ERROR, WAIT, CONTINUE = 1, 2, 3
"""EtherCAT.Types.BusFailure."""

MISSING, STANDS_STILL, INCOMPLETE, NOT_OPERATIONAL, OPERATIONAL = 1, 2, 3, 4, 5
"""EtherCAT.Types.BusState."""

NOT_AVAILABLE, INIT, PREOP, BOOT, SAFEOP, OP = 1, 2, 3, 4, 5, 6
"""EtherCAT.Types.ALState."""

STEPS = """
#include "Plant.h"
int main(int argc, char **argv) {
  static Plant plant;
  double time, age;
  int output, connected, missed, state, counter, expected, cycle;
  double lease = argc > 8 ? atof(argv[8]) : 30.0;
  void *master = ecatm_master_open(argv[1], atoi(argv[2]), 0.001, 1, lease, atoi(argv[3]),
                                   atoi(argv[4]), atof(argv[5]), argc > 6 && atoi(argv[6]),
                                   argc > 7 && atoi(argv[7]), "");
  Plant_open(&plant, master, 1);
  printf("open\\n");
  fflush(stdout);
  while (argc >= 6 && scanf("%lf %d", &time, &output) == 2) {
    cycle = ecatm_wait(master, time);
    connected = ecatm_master_state(master, time, cycle, &age, &missed, &state, &counter, &expected);
    Plant_read(&plant, time, cycle);
    plant.el2008.channel1Output = output;
    Plant_write(&plant, time, cycle);
    printf("%d %d %d %.9f %d %d %d %d %d %d %d %d %.9f\\n", connected, state, cycle, age, missed,
           counter, expected, plant.el1018.valid, plant.el1018.alState, plant.el1018.alStatusCode,
           plant.el1018.channel1Input, plant.el3008.aiStandardChannel1Value != 0, ecatm_now());
    fflush(stdout);
  }
  Plant_close(&plant);
  ecatm_master_close(master);
  return 0;
}
"""
"""Arguments: bus, waitForBus, whenMissing, whenFailed, patience; may be left out: readOnly,
requireOperational and lease. Each line of its input has a simulation time and the value of an
output, which is wired to the input 0 of the slave EL1018."""


def compile_program(compiler: str, source: str, out: Path, folder: Path, *flags: str) -> Path:
    """Compiles a C program against the libraries in `out`; returns the program."""
    program = folder / f"program{len(list(folder.iterdir()))}"
    file = program.with_suffix(".c")
    file.write_text(source)
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    done = subprocess.run(
        [
            *(compiler, "-Wall", "-Wextra", "-Werror", "-O1", *flags),
            f"-I{resources / 'Include'}",
            f"-I{resources / 'Source' / 'standalone'}",
            f"-I{out / 'Plant' / 'Resources' / 'Source'}",
            *(str(file), str(archive), "-lm", "-o", str(program)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return program


def run(
    program: Path, *arguments: str, lines: Iterable[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Runs a program, with these lines as its input, to its end."""
    return subprocess.run(
        [str(program), *arguments],
        input="".join(f"{line}\n" for line in lines),
        capture_output=True,
        text=True,
        check=False,
    )


def sentence(result: subprocess.CompletedProcess[str]) -> str:
    """The one sentence with which a program has ended."""
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("EtherCAT: ")
    return line


@contextmanager
def served(bus: Bus, name: str = "") -> Iterator[str]:
    """The shared memory of a bus, without anything that exchanges it; yields its name."""
    bus.name = name or f"m{uuid.uuid4().hex[:8]}"
    image = lay_out(bus, set())
    shared = SharedMemory(bus.name, make_folder(print))
    shared.fill(bus, image, 5_000_000, 500_000_000)
    shared.header.cycle_end_ns = 1 << 62  # "just now" for ever
    shared.publish()
    try:
        yield bus.name
    finally:
        shared.close()


@dataclass(frozen=True)
class Step:
    """What the model knows in one sample; `clock` is CLOCK_MONOTONIC at its end."""

    connected: bool
    state: int
    cycle: int
    age: float
    missed: int
    counter: int
    expected: int
    valid: bool
    al_state: int
    al_status_code: int
    input: bool
    analog: bool
    clock: float


class Model:
    """The program `STEPS`, which runs and takes samples when it is told to."""

    def __init__(self, program: Path, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [str(program), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.time = -0.001

    def opened(self) -> Model:
        """Waits until its constructors have returned."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line == "open\n", self.end()
        return self

    def send(self, output: int = 0) -> None:
        """Begins the next sample."""
        assert self._process.stdin is not None
        self.time += 0.001
        self._process.stdin.write(f"{self.time:.9f} {output}\n")
        self._process.stdin.flush()

    def receive(self) -> Step:
        """Its result; waits for it."""
        assert self._process.stdout is not None
        words = self._process.stdout.readline().split()
        assert words, self.end()
        return Step(
            *(bool(int(words[0])), int(words[1]), int(words[2]), float(words[3])),
            *(int(words[4]), int(words[5]), int(words[6]), bool(int(words[7]))),
            *(int(words[8]), int(words[9]), bool(int(words[10])), bool(int(words[11]))),
            float(words[12]),
        )

    def step(self, output: int = 0) -> Step:
        """One sample."""
        self.send(output)
        return self.receive()

    def until(self, condition: Callable[[Step], bool], output: int = 0) -> Step:
        """Samples until something has come about."""
        deadline = time.monotonic() + 120
        while not condition(step := self.step(output)):
            assert time.monotonic() < deadline, step
        return step

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    def end(self) -> tuple[int, str]:
        """Ends its input; exit status, and what it has said."""
        try:
            _, said = self._process.communicate()
        except BrokenPipeError:
            assert self._process.stderr is not None
            said = self._process.stderr.read()
        return self._process.wait(), said

    def close(self) -> None:
        """Ends it, if it still runs."""
        self._process.kill()
        self._process.communicate()
