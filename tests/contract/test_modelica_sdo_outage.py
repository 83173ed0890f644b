"""Requests of the SDO blocks while there is no bus, and when it goes and comes."""

import subprocess
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sdo_calls import CONTINUE, RIG, WAIT, Answer, State, When, answers, build, opened, run

from conftest import Daemon, names
from ecatd.etg.datatypes import DataType as T

pytestmark = [pytest.mark.bus, pytest.mark.long]

NO_BUS = "there_is_none"
FLUSH = "fflush(stdout);"

Start = Callable[..., Daemon]


@contextmanager
def running(program: Path, bus: str) -> Iterator["subprocess.Popen[str]"]:
    """A program that tells on stdout how far it is."""
    with subprocess.Popen(
        [str(program), bus],
        env={"ASAN_OPTIONS": "detect_leaks=0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def name() -> str:
    """Of a bus that nobody serves yet."""
    return f"t{uuid.uuid4().hex[:10]}"


def line(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    text = process.stdout.readline().rstrip("\n")
    if not text:
        raise AssertionError(f"it has ended: {process.communicate()[1]}")
    return text


def test_a_request_without_a_bus_fails_with_the_reason(tmp_path: Path, compiler: str) -> None:
    program = build(
        tmp_path,
        compiler,
        f"""
  void *read = {opened(0x1000, T.UNSIGNED32)}, *write = {opened(0x2005, T.UNSIGNED8)};
  void *initial = {opened(0x1000, T.UNSIGNED32, when=When.INITIAL)};
  int n, state = 0;
  answer(read);
  for (n = 0; n < 50; n++) ecatm_sdo_read(initial, now, sample(), 0);
  tell(initial, ecatm_sdo_read(initial, now, sample(), 0));
  for (n = 0; n < 3; n++) state = ecatm_sdo_write_integer(write, now, sample(), 1, 7);
  tell(write, state);
""",
        without_bus=CONTINUE,
    )
    found = answers(run(program, NO_BUS))
    assert len(found) == 3
    for answer in found:
        assert (answer.state, answer.code, answer.count) == (State.FAILED, -2, 0)
        names(answer.text, "not running", f"'{NO_BUS}'")


def test_a_list_without_a_bus_fails_with_the_reason(tmp_path: Path, compiler: str) -> None:
    program = build(
        tmp_path,
        compiler,
        r"""
  static const int table[] = {0x2002, 0, 2, 11};
  void *list = ecatm_sdo_list_open(master, 0, "", table, 1, 4, "");
  int n, state = 0;
  for (n = 0; n < 3; n++) state = ecatm_sdo_list_write(list, now, sample(), 1);
  printf("%d||%d|0|%s\n", state, ecatm_sdo_list_abort_code(list, 0),
         ecatm_sdo_list_abort_text(list, 0));
""",
        without_bus=CONTINUE,
    )
    (answer,) = answers(run(program, NO_BUS))
    assert (answer.state, answer.code) == (State.FAILED, -2)
    names(answer.text, "entry 1 of 1", "not running", f"'{NO_BUS}'")


GOES_AND_COMES = f"""
  void *read = {opened(0x1000, T.UNSIGNED32, when=When.SAMPLED, period=0.01)};
  void *stuck = {opened(0x1000, T.UNSIGNED32, slave=2)};
  int state = 0, count, n;
  while (ecatm_sdo_count(read, state) < 3) state = ecatm_sdo_read(read, now, sample(), 0);
  for (n = 0; n < 9; n++) ecatm_sdo_read(stuck, now, sample(), 1);
  puts("asked"); {FLUSH}
  do {{
    int cycle = sample();
    state = ecatm_sdo_read(read, now, cycle, 0);
    n = ecatm_sdo_read(stuck, now, cycle, 1);
  }} while (state != ECATM_SDO_FAILED || n != ECATM_SDO_FAILED);
  tell(read, state);
  tell(stuck, n); {FLUSH}
  for (count = ecatm_sdo_count(read, 0); ecatm_sdo_count(read, state) < count + 3;)
    state = ecatm_sdo_read(read, now, sample(), 0);
  printf("%d\\n", ((ecatm_master *)master)->requests);
  for (n = 0; ecatm_sdo_count(read, state) < count + 6;) {{
    int cycle = sample();
    state = ecatm_sdo_read(read, now, cycle, 0);
    n = ecatm_sdo_read(stuck, now, cycle, 0);
  }}
  printf("%d\\n", n);
"""


def test_requests_fail_with_the_bus_and_go_on_with_it(
    tmp_path: Path, compiler: str, start_daemon: Start
) -> None:
    daemon = start_daemon(RIG)
    program = build(tmp_path, compiler, GOES_AND_COMES, without_bus=CONTINUE)
    with running(program, daemon.bus) as process:
        assert line(process) == "asked"
        daemon.kill_all()
        read, stuck = Answer(line(process)), Answer(line(process))
        start_daemon(RIG, "--bus", daemon.bus).bus = daemon.bus
        out, errors = process.communicate()
        assert process.returncode == 0, errors
    assert {read.code, stuck.code} <= {-2, -12}  # killed slowly, it stands still first
    assert daemon.bus in stuck.text
    requests, state = map(int, out.split())
    assert requests in (0, 1)  # that of `read`: none was left behind by the outage
    assert state == State.FAILED  # a trigger that is still true is no edge
    assert "bus" in errors


def test_an_initial_request_is_sent_when_the_bus_comes(
    tmp_path: Path, compiler: str, start_daemon: Start, name: str
) -> None:
    program = build(
        tmp_path,
        compiler,
        f"""
  void *read = {opened(0x1000, T.UNSIGNED32, when=When.INITIAL)};
  void *write = {opened(0x2005, T.UNSIGNED8, when=When.INITIAL)};
  int state, other, n;
  do state = ecatm_sdo_read(read, now, sample(), 0);
  while (state != ECATM_SDO_FAILED);
  puts("failed"); {FLUSH}
  do {{
    int cycle = sample();
    state = ecatm_sdo_read(read, now, cycle, 0);
    other = ecatm_sdo_write_integer(write, now, cycle, 0, 7);
  }} while (state != ECATM_SDO_DONE || other != ECATM_SDO_DONE);
  for (n = 0; n < 50; n++) state = ecatm_sdo_read(read, now, sample(), 0);
  tell(read, state);
""",
        without_bus=CONTINUE,
    )
    with running(program, name) as process:
        assert line(process) == "failed"
        start_daemon(RIG, "--bus", name).bus = name
        answer = Answer(line(process))
    assert (answer.state, answer.value, answer.count) == (State.DONE, "5001", 1)


def test_a_wrong_position_is_told_when_the_bus_comes(
    tmp_path: Path, compiler: str, start_daemon: Start, name: str
) -> None:
    program = build(
        tmp_path,
        compiler,
        f"""
  void *read = {opened(0x1000, T.UNSIGNED32, slave=9)};
  puts("opened"); {FLUSH}
  for (;;) ecatm_sdo_read(read, now, sample(), 0);
""",
        without_bus=CONTINUE,
    )
    with running(program, name) as process:
        assert line(process) == "opened"
        start_daemon(RIG, "--bus", name).bus = name
        errors = process.communicate()[1]
    assert process.returncode == 1
    names(errors.splitlines()[-1], "slave 9", "3 slaves", 0, 2)


def test_a_model_that_waits_for_the_bus_asks_when_it_is_there(
    tmp_path: Path, compiler: str, start_daemon: Start, name: str
) -> None:
    program = build(
        tmp_path,
        compiler,
        f"void *read = {opened(0x1000, T.UNSIGNED32)}; answer(read);",
        without_bus=WAIT,
    )
    with running(program, name) as process:
        start_daemon(RIG, "--bus", name).bus = name
        assert Answer(line(process)).state is State.DONE
