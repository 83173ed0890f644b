"""The clock of SynchronizeRealtime, driven by the calls that the block makes.

Nothing here depends on how fast the machine is: a step may come late, but never early.
"""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import names

RESOURCES = Path(__file__).parents[2] / "codegen/ecatgen/modelica/EtherCAT/Resources"

HEAD = """
#include "ecatm_realtime.h"
#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>

static double calculation, available, lateness, missed;

ECATM_FUNCTION void step(void *clock, double time, double scaling, double max_delay) {
  double results[4];
  ecatm_realtime_step(clock, time, scaling, max_delay, results);
  calculation = results[0], available = results[1], lateness = results[2], missed = results[3];
}

ECATM_FUNCTION void require(int line, int condition) {
  if (condition) return;
  fprintf(stderr, "line %d: calculation %g, available %g, lateness %g, missed %g\\n", line,
          calculation, available, lateness, missed);
  exit(2);
}
#define REQUIRE(condition) require(__LINE__, condition)

int main(void) {
"""

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def run(tmp_path: Path, compiler: str) -> Run:
    """Compiles the body of a main() and runs it."""

    def compile_and_run(body: str, *flags: str) -> "subprocess.CompletedProcess[str]":
        file, program = tmp_path / "program.c", tmp_path / "program"
        file.write_text(HEAD + body + "  return 0;\n}\n")
        subprocess.run(
            [
                *(compiler, "-Wall", "-Wextra", "-Werror", *flags),
                *("-I", str(RESOURCES / "Include")),
                *("-I", str(RESOURCES / "Source" / "standalone")),
                *(str(file), "-o", str(program)),
            ],
            check=True,
        )
        return subprocess.run([str(program)], capture_output=True, text=True, check=False)

    return compile_and_run


def succeed(result: "subprocess.CompletedProcess[str]") -> None:
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("scaling", [0.5, 1, 3])
def test_the_model_never_runs_ahead_of_the_clock(run: Run, scaling: float) -> None:
    result = run(f"""
  int i;
  double origin;
  void *clock = ecatm_realtime_open(0);
  step(clock, 7, {scaling}, 0.1);
  origin = ecatm_now();
  REQUIRE(calculation == 0 && available == 0 && lateness == 0 && missed == 0);
  for (i = 1; i <= 50; i++) {{
    double begun = ecatm_now();
    step(clock, 7 + 0.001 * i, {scaling}, 0.1);
    REQUIRE(ecatm_now() - origin >= {scaling} * 0.001 * i - 0.001); /* the origin was before it */
    REQUIRE(ecatm_now() >= ((ecatm_realtime *)clock)->goal);
    REQUIRE(calculation >= 0 && calculation <= ecatm_now() - origin + 0.001);
    REQUIRE(lateness == 0 || lateness >= begun - ((ecatm_realtime *)clock)->goal);
  }}
  ecatm_realtime_close(clock);
""")
    succeed(result)


DELAYED = """
  int i;
  double origin;
  ecatm_realtime *clock = (ecatm_realtime *)ecatm_realtime_open(0);
  step(clock, 0, 1, MAX_DELAY);
  origin = clock->goal;
  ecatm_sleep_until(ecatm_now() + 0.03);
  step(clock, 0.001, 1, MAX_DELAY);
  REQUIRE(calculation >= 0.03 && available <= 0.001 && lateness >= 0.029 && missed == 1);
"""


def test_steps_after_a_delay_catch_up(run: Run) -> None:
    result = run(
        DELAYED
        + """
  for (i = 2; i <= 60; i++) step(clock, 0.001 * i, 1, MAX_DELAY);
  REQUIRE(fabs(clock->goal - origin - 0.060) < 1e-6); /* as if there had been no delay */
  REQUIRE(missed >= 20); /* those that fell into the delay came too late as well */
  ecatm_realtime_close(clock);
""",
        "-DMAX_DELAY=1000",
        "-includemath.h",
    )
    succeed(result)


def test_a_long_delay_is_not_made_up_for(run: Run) -> None:
    result = run(
        DELAYED
        + """
  (void)i;
  REQUIRE(clock->goal - origin >= 0.03);
  origin = clock->goal;
  step(clock, 0.002, 1, 1000);
  REQUIRE(clock->goal - origin > 0.0009 && clock->goal - origin < 0.0011);
  ecatm_realtime_close(clock);
""",
        "-DMAX_DELAY=0.01",
    )
    succeed(result)


def test_the_same_step_twice_has_the_same_results(run: Run) -> None:
    result = run("""
  double first;
  void *clock = ecatm_realtime_open(0);
  step(clock, 0, 1, 1000);
  ecatm_sleep_until(ecatm_now() + 0.005);
  step(clock, 0.001, 1, 1000);
  first = calculation;
  step(clock, 0.001, 1, 1000);
  REQUIRE(calculation == first && missed == 1);
  step(clock, 0, 1, 1000); /* the tool begins again */
  REQUIRE(calculation == 0 && missed == 0);
  ecatm_realtime_close(clock);
""")
    succeed(result)


def test_scaling_zero_does_not_wait(run: Run) -> None:
    result = run("""
  void *clock = ecatm_realtime_open(0);
  step(clock, 0, 0, 1000);
  step(clock, 1e9, 0, 1000); /* some 30 years */
  REQUIRE(lateness == 0 && missed == 0);
  step(clock, 1e9 + 1, 1e-9, 1000);
  ecatm_realtime_close(clock);
""")
    succeed(result)


@pytest.mark.parametrize("scaling", ["-1", "0.0 / 0.0"])
def test_nonsense_is_refused(run: Run, scaling: str) -> None:
    result = run(f"  step(ecatm_realtime_open(0), 0, {scaling}, 1);\n")
    assert result.returncode == 1
    names(result.stderr, "EtherCAT: ", "scaled", "negative")


@pytest.mark.parametrize(("number", "name"), [(4, "High"), (5, "Realtime")])
def test_a_priority_that_is_not_permitted_is_told(run: Run, number: int, name: str) -> None:
    result = run(f"""
  struct rlimit none = {{0, 0}};
  void *clock;
  if (setrlimit(RLIMIT_RTPRIO, &none) != 0 || setrlimit(RLIMIT_NICE, &none) != 0) return 2;
  if (geteuid() == 0 && setuid(65534) != 0) return 3;
  clock = ecatm_realtime_open({number});
  step(clock, 0, 1, 1);
  step(clock, 0.001, 1, 1);
  ecatm_realtime_close(clock);
""")
    assert result.returncode == 0
    (line,) = result.stderr.splitlines()
    assert f"permit {name} (" in line
    assert "/etc/security/limits.conf" in line


def test_a_low_priority_is_taken_and_given_back(run: Run) -> None:
    result = run("""
  int before = getpriority(PRIO_PROCESS, 0);
  void *clock = ecatm_realtime_open(2);
  REQUIRE(getpriority(PRIO_PROCESS, 0) == 10);
  ecatm_realtime_close(clock);
  REQUIRE(getpriority(PRIO_PROCESS, 0) == (geteuid() == 0 ? before : 10));
""")
    succeed(result)


def test_a_simulation_that_is_lower_already_is_left_there(run: Run) -> None:
    result = run("""
  void *clock;
  if (setpriority(PRIO_PROCESS, 0, 15) != 0) return 2;
  if (geteuid() == 0 && setuid(65534) != 0) return 3;
  clock = ecatm_realtime_open(2);
  REQUIRE(getpriority(PRIO_PROCESS, 0) == 15);
  ecatm_realtime_close(clock);
  clock = ecatm_realtime_open(1);
  REQUIRE(getpriority(PRIO_PROCESS, 0) == 19);
  ecatm_realtime_close(clock);
""")
    succeed(result)


@pytest.mark.parametrize("foreign", [(), ("-include", "stdio.h", "-include", "time.h")])
@pytest.mark.parametrize("standard", ["c89", "gnu89", "c99", "gnu99", "c11", "gnu17"])
def test_any_dialect_and_any_header_before_it(
    run: Run, standard: str, foreign: tuple[str, ...]
) -> None:
    body = "  ecatm_realtime_close(ecatm_realtime_open(0));\n"
    succeed(run(body, f"-std={standard}", "-pedantic-errors", *foreign))
