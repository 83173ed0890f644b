"""C programs that make the calls of the SDO blocks, against a live bus or without one."""

import subprocess
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from ecatd.etg.datatypes import DataType
from ecatdev.files import write_files
from ecatgen.static_library import static_files
from rigs import objects

RIG = str(Path(objects.__file__))
"""Slaves with objects of all types, without a mailbox, and one that does not answer."""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


class State(IntEnum):
    """What a step of a request returns."""

    NONE = 0
    BUSY = 1
    DONE = 2
    FAILED = 3


class When(IntEnum):
    """EtherCAT.Types.Request."""

    TRIGGERED = 1
    SAMPLED = 2
    INITIAL = 3


class Has(IntEnum):
    """What the block has of an object."""

    INTEGER = 1
    REAL = 2
    STRING = 3


PROGRAM = r"""
#include <limits.h>
#include "ecat_modelica.h"
static void *master;
static double now = 0;
static int sample(void) { return ecatm_wait(master, now += 0.001); }
static void text(const char *t) {
  for (; *t != '\0'; t++) {
    if (*t == '\\' || *t == '\n') printf("\\%03o", *t);
    else putchar(*t);
  }
}
/* state|value|abort code|count|abort text */
static void tell(void *object, int state) {
  ecatm_sdo *sdo = (ecatm_sdo *)object;
  printf("%d|", state);
  if (sdo->value == ECATM_INTEGER_VALUE) printf("%d", ecatm_sdo_integer(sdo, state));
  if (sdo->value == ECATM_REAL_VALUE) printf("%.17g", ecatm_sdo_real(sdo, state));
  if (sdo->value == ECATM_STRING_VALUE) text(ecatm_sdo_string(sdo, state));
  printf("|%d|%d|%s\n", ecatm_sdo_abort_code(sdo, state), ecatm_sdo_count(sdo, state),
         ecatm_sdo_abort_text(sdo, state));
}
static void answer(void *sdo) {
  int state = ECATM_SDO_BUSY;
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_read(sdo, now, sample(), 1);
  tell(sdo, state);
}
%FUNCTIONS%
int main(int argc, char **argv) {
  master = ecatm_master_open(argv[1], 1, 0.001, 1, 0.1, %FAILURE%, %FAILURE%, 0, 0, 0, "");
  (void)argc, (void)argv, (void)answer, (void)tell, (void)sample;
  %STATEMENTS%
  ecatm_master_close(master);
  return 0;
}
"""
ERROR, WAIT, CONTINUE = 1, 2, 3
"""EtherCAT.Types.BusFailure."""


def build(
    folder: Path,
    compiler: str,
    statements: str,
    *,
    functions: str = "",
    without_bus: int = ERROR,
) -> Path:
    """Compiles statements in C against the library EtherCAT; returns the program."""
    resources = {p: data for p, data in static_files().items() if p.startswith("Resources/")}
    write_files(folder, resources)
    source = PROGRAM.replace("%FUNCTIONS%", functions)
    source = source.replace("%FAILURE%", str(without_bus)).replace("%STATEMENTS%", statements)
    (folder / "program.c").write_text(source)
    (archive,) = (folder / "Resources" / "Library").rglob("libecat.a")
    done = subprocess.run(
        [
            *(compiler, "-Wall", "-Wextra", "-Werror", "-std=c99", "-O1", "-g"),
            *("-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
            *("-I", str(folder / "Resources" / "Include")),
            *("-I", str(folder / "Resources" / "Source" / "standalone")),
            *(str(folder / "program.c"), str(archive), "-lm"),
            *("-o", str(folder / "program")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "program"


def run(program: Path, bus: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Runs a program to its end."""
    return subprocess.run(
        [str(program), bus, *arguments],
        env={"ASAN_OPTIONS": "detect_leaks=0"},  # texts live until the end, and errors end at once
        capture_output=True,
        text=True,
        check=False,
    )


def opened(
    index: int,
    data_type: int,
    has: Has = Has.INTEGER,
    *,
    subindex: int = 0,
    slave: int = 0,
    when: When = When.TRIGGERED,
    period: float = 0,
    scale: float = 1,
    offset: float = 0,
    text: str = "",
) -> str:
    """The call that makes the object of a block."""
    return (
        f'ecatm_sdo_open(master, {slave}, "", {index}, {subindex}, {int(data_type)}, {int(has)}, '
        f'{int(when)}, {period}, {scale}, {offset}, "{text}", "")'
    )


def read(*arguments: object, **options: object) -> str:
    """Reads an object and tells the answer."""
    return f"answer({opened(*arguments, **options)});"  # type: ignore[arg-type]


def write(
    index: int, data_type: DataType, value: float | str, has: Has = Has.INTEGER, **options: object
) -> str:
    """Writes an object and tells the answer."""
    if isinstance(value, str):
        value = '"' + "".join(f"\\{byte:03o}" for byte in value.encode()) + '"'
    elif has is Has.REAL:
        value = value.hex() if isinstance(value, float) else f"{value}.0"
    elif value == -(2**31):
        value = "INT_MIN"  # is no literal in C
    return f"""{{
      void *sdo = {opened(index, data_type, has, **options)};
      int state = ECATM_SDO_BUSY;
      while (state == ECATM_SDO_BUSY)
        state = ecatm_sdo_write_{has.name.lower()}(sdo, now, sample(), 1, {value});
      tell(sdo, state);
    }}"""


class Answer:
    """What a block shows after a request."""

    def __init__(self, line: str) -> None:
        state, value, code, count, self.text = line.split("|", 4)
        self.state, self.code, self.count = State(int(state)), int(code), int(count)
        self.value = value

    def __repr__(self) -> str:
        return f"{self.state.name} {self.value!r} {self.code} {self.text!r}"


def answers(result: "subprocess.CompletedProcess[str]") -> list[Answer]:
    """The lines of a program that ended as it should."""
    assert result.returncode == 0, result.stderr + result.stdout
    return [Answer(line) for line in result.stdout.splitlines()]
