"""Requests to the mailboxes of slaves, as the blocks SDORead and SDOWrite make them."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatgen.static_library import static_files

pytestmark = pytest.mark.bus

BOOLEAN, INTEGER8, UNSIGNED8, INTEGER16, UNSIGNED16, INTEGER32, UNSIGNED32 = range(1, 8)
BUSY, DONE, FAILED = 1, 2, 3

PROGRAM = """
#include "ecat_modelica.h"
static void *master;
static double now;
static int sample(void) { return ecatm_wait(master, now += 0.001); }
static int answer(void *sdo, int state) {
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_read(sdo, now, sample(), 1);
  printf("%%d %%d %%d\\n", state, ecatm_sdo_value(sdo, 0), ecatm_sdo_abort_code(sdo, 0));
  return state;
}
int main(int argc, char **argv) {
  master = ecatm_master_open(argv[argc - 1], 1, 0.001, 1, 0.1, 1, 1, 0);
  (void)answer, (void)sample;
  %s
  ecatm_master_close(master);
  return 0;
}
"""


@pytest.fixture
def run(
    tmp_path: Path, compiler: str, troll: Daemon
) -> Callable[[str], "subprocess.CompletedProcess[str]"]:
    """Runs statements in C against the library EtherCAT and the live bus."""

    def run_(statements: str) -> "subprocess.CompletedProcess[str]":
        for path, data in static_files().items():
            if path.startswith("Resources/"):
                (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
                (tmp_path / path).write_bytes(data)
        (tmp_path / "program.c").write_text(PROGRAM % statements)
        (archive,) = (tmp_path / "Resources" / "Library").rglob("libecat.a")
        done = subprocess.run(
            [
                *(compiler, "-Wall", "-Wextra", "-Werror", "-std=c99"),
                *("-I", str(tmp_path / "Resources" / "Include")),
                *("-I", str(tmp_path / "Resources" / "Source" / "standalone")),
                *(str(tmp_path / "program.c"), str(archive), "-lm"),
                *("-o", str(tmp_path / "program")),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return subprocess.run(
            [str(tmp_path / "program"), troll.bus],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )

    return run_


def answers(result: "subprocess.CompletedProcess[str]") -> list[tuple[int, ...]]:
    assert result.returncode == 0, result.stderr
    return [tuple(map(int, line.split())) for line in result.stdout.splitlines()]


def read(index: int, data_type: int, subindex: int = 0, slave: int = 0) -> str:
    return f"""{{
      void *sdo = ecatm_sdo_open(master, {slave}, {index}, {subindex}, {data_type});
      answer(sdo, ecatm_sdo_read(sdo, now, sample(), 1));
    }}"""


def write(index: int, data_type: int, value: int) -> str:
    return f"""{{
      void *sdo = ecatm_sdo_open(master, 0, {index}, 0, {data_type});
      int state = ECATM_SDO_BUSY;
      while (state == ECATM_SDO_BUSY) state = ecatm_sdo_write(sdo, now, sample(), 1, {value});
      answer(sdo, state);
    }}"""


Run = Callable[[str], "subprocess.CompletedProcess[str]"]


def test_values_of_all_sizes_are_read(run: Run) -> None:
    result = run(
        read(0x1000, UNSIGNED32)
        + read(0x1001, UNSIGNED8)
        + read(0x605A, INTEGER16)
        + read(0x606D, UNSIGNED16)
        + read(0x60B1, INTEGER32)
    )
    assert answers(result) == [(DONE, value, 0) for value in (0x20192, 0, 2, 500, 0)]


def test_a_value_is_written_and_read_back(run: Run) -> None:
    low = -(1 << 30)
    result = run(
        write(0x60B1, INTEGER32, low) + read(0x60B1, INTEGER32) + write(0x60B1, INTEGER32, 0)
    )
    assert answers(result) == [(DONE, 0, 0), (DONE, low, 0), (DONE, 0, 0)]


def test_an_abort_leaves_a_code_and_a_message(run: Run) -> None:
    result = run(read(0x5FFF, UNSIGNED8) + write(0x1000, UNSIGNED32, 1) + read(0x1000, UNSIGNED32))
    assert answers(result) == [
        (FAILED, 0, 0x06020000),
        (FAILED, 0, 0x06010002),
        (DONE, 0x20192, 0),
    ]
    assert "EtherCAT: upload of object 0x5FFF:00 of slave 0 failed: " in result.stderr
    assert "EtherCAT: download of object 0x1000:00 of slave 0 failed: " in result.stderr


def test_a_slave_without_mailbox_leaves_a_code(run: Run) -> None:
    ((state, _, code),) = answers(run(read(0x1000, UNSIGNED32, slave=2)))
    assert state == FAILED
    assert code != 0


def test_more_requests_than_a_client_may_have_at_once(run: Run) -> None:
    result = run(
        """
  void *sdo[20];
  int n, open = 20, state[20];
  for (n = 0; n < 20; n++) sdo[n] = ecatm_sdo_open(master, 0, 0x1000, 0, 7);
  while (open > 0) {
    int cycle = sample();
    open = 0;
    for (n = 0; n < 20; n++) {
      state[n] = ecatm_sdo_read(sdo[n], now, cycle, 1);
      open += state[n] == ECATM_SDO_BUSY;
    }
  }
  for (n = 0; n < 20; n++) answer(sdo[n], state[n]);
"""
    )
    assert answers(result) == [(DONE, 0x20192, 0)] * 20


def test_only_an_edge_sends_and_the_last_evaluation_of_a_time_counts(run: Run) -> None:
    result = run(
        """
  void *sdo = ecatm_sdo_open(master, 0, 0x60B1, 0, 6);
  int cycle = sample(), n;
  printf("%d\\n", ecatm_sdo_write(sdo, now, cycle, 0, 1));
  printf("%d\\n", ecatm_sdo_write(sdo, now, cycle, 1, 2)); /* evaluated again, now with an edge */
  printf("%d\\n", ecatm_sdo_write(sdo, now, cycle, 0, 3)); /* and again: there was none */
  cycle = sample();
  printf("%d\\n", ecatm_sdo_write(sdo, now, cycle, 1, 4));
  printf("%d\\n", ecatm_sdo_write(sdo, now, cycle, 1, 5)); /* this value is written */
  for (n = 0; n < 100; n++) ecatm_sdo_write(sdo, now, sample(), 1, 6);
  printf("%d\\n", ecatm_sdo_write(sdo, now, sample(), 1, 7)); /* still true: no edge */
"""
        + read(0x60B1, INTEGER32)
        + write(0x60B1, INTEGER32, 0)
    )
    lines = result.stdout.split("\n")
    assert lines[:6] == ["0", "1", "0", "1", "1", "2"]
    assert lines[6] == "2 5 0"


@pytest.mark.parametrize(
    ("statements", "sentence"),
    [
        (
            write(0x6060, INTEGER8, 200),
            "200 is out of range for object 0x6060:00 of slave 0: -128 to 127 are allowed",
        ),
        (
            write(0x6060, UNSIGNED8, -1),
            "-1 is out of range for object 0x6060:00 of slave 0: 0 to 255 are allowed",
        ),
        (
            read(0x1000, UNSIGNED8),
            "object 0x1000:00 of slave 0 has 4 bytes, but the dataType of its block has 1",
        ),
        (
            read(0x1000, UNSIGNED32, slave=9),
            "has no slave 9: it has 8 slaves, 0 to 7",
        ),
    ],
)
def test_what_can_only_be_a_mistake_ends_the_simulation(
    run: Run, statements: str, sentence: str
) -> None:
    result = run(statements)
    assert result.returncode == 1
    assert result.stderr.startswith("EtherCAT: ")
    assert sentence in result.stderr


def test_a_value_that_is_too_large_for_an_integer(run: Run, troll: Daemon) -> None:
    troll.ctl("sdo-write", "0", "0x6081", "0", "0x80000000")
    try:
        result = run(read(0x6081, UNSIGNED32))
    finally:
        troll.ctl("sdo-write", "0", "0x6081", "0", "1000")
    assert result.returncode == 1
    assert "is 2147483648, which is too large for a Modelica Integer" in result.stderr
