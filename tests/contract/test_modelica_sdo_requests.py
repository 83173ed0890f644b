"""When the SDO blocks ask, and what they show when a request fails, waits or meets another."""

import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest
from sdo_calls import RIG, Answer, Run, State, When, answers, build, opened, read, write

from conftest import Daemon, names
from ecatd.etg.datatypes import DataType as T
from ecatd.shm import contract as shm
from handle import Handle

pytest_plugins = ["sdo_fixtures"]
pytestmark = [pytest.mark.bus, pytest.mark.long]

NO_OBJECT, READ_ONLY = 0x06020000, 0x06010002


def numbers(result: "subprocess.CompletedProcess[str]") -> list[int]:
    assert result.returncode == 0, result.stderr
    return [int(word) for word in result.stdout.split()]


# --- Requests that fail ----------------------------------------------------------------------


def test_an_abort_leaves_its_code_and_text_and_the_next_request_clears_them(call: Run) -> None:
    found = answers(
        call(
            read(0x5FFF, T.UNSIGNED8)
            + write(0x1000, T.UNSIGNED32, 1)
            + read(0x1018, T.UNSIGNED32, subindex=9)
            + f"""{{
      void *sdo = {opened(0x2005, T.UNSIGNED8)};
      int state = ECATM_SDO_BUSY;
      while (state == ECATM_SDO_BUSY) state = ecatm_sdo_write_integer(sdo, now, sample(), 1, 7);
      ((ecatm_sdo *)sdo)->transfer.index = 0x5FFF; /* as if the slave had lost it */
      ecatm_sdo_read(sdo, now, sample(), 0);
      answer(sdo);
      ((ecatm_sdo *)sdo)->transfer.index = 0x2005;
      ecatm_sdo_read(sdo, now, sample(), 0);
      answer(sdo);
    }}"""
        )
    )
    assert [(a.state, a.code) for a in found] == [
        (State.FAILED, NO_OBJECT),
        (State.FAILED, READ_ONLY),
        (State.FAILED, 0x06090011),
        (State.FAILED, NO_OBJECT),
        (State.DONE, 0),
    ]
    assert "0x5FFF:00" in found[0].text
    assert "does not exist" in found[0].text
    assert "read-only" in found[1].text
    assert [a.value for a in found] == ["0", "0", "0", "0", "7"]
    assert [a.count for a in found[3:]] == [1, 2]
    assert found[4].text == ""


@pytest.mark.parametrize(
    ("index", "kind"),
    [
        pytest.param(0x5FFF, T.UNSIGNED8, id="refused by the slave"),
        pytest.param(0x1000, T.UNSIGNED8, id="of another length"),
    ],
)
def test_the_log_has_the_same_failure_once(call: Run, index: int, kind: T) -> None:
    result = call(
        f"""
  void *sdo = {opened(index, kind, when=When.SAMPLED, period=0.01)};
  int n;
  for (n = 0; n < 300; n++) ecatm_sdo_read(sdo, now, sample(), 0);
  printf("%d\\n", (int)((ecatm_sdo *)sdo)->trigger.samples);
"""
    )
    assert int(result.stdout) > 20
    (line,) = result.stderr.splitlines()
    names(line, "EtherCAT: ", "reading", f"0x{index:04X}:00", "slave 0")


def test_a_slave_without_mailbox(call: Run) -> None:
    (answer,) = answers(call(read(0x1000, T.UNSIGNED32, slave=1)))
    assert answer.state is State.FAILED
    assert answer.code == -17
    assert "EL2008" in answer.text
    assert "CoE" in answer.text


def test_a_slave_that_does_not_answer_holds_up_nothing_but_the_request(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, slave=2)};
  int state = ECATM_SDO_BUSY, samples = 0;
  for (; state == ECATM_SDO_BUSY; samples++) state = ecatm_sdo_read(sdo, now, sample(), 1);
  tell(sdo, state);
  fprintf(stderr, "%d\\n", samples);
"""
    )
    (answer,) = answers(result)
    assert (answer.state, answer.code) == (State.FAILED, -11)
    assert "does not answer" in answer.text
    # The slave is given up after seconds: that many samples were not held up.
    assert int(result.stderr.splitlines()[-1]) > 100


# --- When it is asked ------------------------------------------------------------------------


def test_a_trigger_that_is_true_from_the_start_is_a_request(call: Run) -> None:
    (answer,) = answers(call(read(0x1000, T.UNSIGNED32)))
    assert (answer.state, answer.count) == (State.DONE, 1)


def test_only_an_edge_asks_and_the_last_evaluation_of_a_time_counts(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x2004, T.INTEGER32)}, *other = {opened(0x2004, T.INTEGER32)};
  int cycle = sample(), n;
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, cycle, 0, 1));
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, cycle, 1, 2)); /* again, now with an edge */
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, cycle, 0, 3)); /* and again: there was none */
  cycle = sample();
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, cycle, 1, 4));
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, cycle, 1, 5)); /* this value is written */
  while (ecatm_sdo_write_integer(sdo, now, sample(), 1, 6) == 1) continue; /* 1: it is busy */
  for (n = 0; n < 100; n++) ecatm_sdo_write_integer(sdo, now, sample(), 1, 6);
  printf("%d\\n", ecatm_sdo_write_integer(sdo, now, sample(), 1, 7)); /* still true: no edge */
  answer(other);
"""
    )
    *states, last = result.stdout.splitlines()
    assert states == ["0", "1", "0", "1", "1", "2"]
    assert Answer(last).value == "5"


def test_an_evaluation_that_is_taken_back_leaves_what_was_shown(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x5FFF, T.UNSIGNED8)};
  int cycle;
  answer(sdo);
  ecatm_sdo_read(sdo, now, sample(), 0);
  cycle = sample();
  ecatm_sdo_write_integer(sdo, now, cycle, 1, 1000); /* out of range, but not to stay */
  tell(sdo, ecatm_sdo_write_integer(sdo, now, cycle, 0, 0));
  tell(sdo, ecatm_sdo_write_integer(sdo, now, sample(), 0, 0));
"""
    )
    found = answers(result)
    assert [(a.state, a.code) for a in found] == [(State.FAILED, NO_OBJECT)] * 3
    assert found[0].text == found[1].text == found[2].text != ""


def test_triggers_of_a_busy_request_are_ignored(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, slave=2)};
  int n, state = 0;
  for (n = 0; n < 50; n++) state = ecatm_sdo_read(sdo, now, sample(), n & 1);
  printf("%d\\n", state);
"""
    )
    assert numbers(result) == [State.BUSY]
    assert result.stderr == ""


def test_sampled_requests_come_every_period_however_often_a_time_is_evaluated(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, when=When.SAMPLED, period=0.05)};
  int n, begun = 0, before = 0;
  for (n = 0; n < 1001; n++) {{
    int cycle = sample(), state = ecatm_sdo_read(sdo, now, cycle, n & 1);
    if (ecatm_sdo_read(sdo, now, cycle, 1) != state) return 2;
    begun += state == ECATM_SDO_BUSY && before != ECATM_SDO_BUSY;
    before = state;
  }}
  while (before == ECATM_SDO_BUSY) before = ecatm_sdo_read(sdo, now, sample(), 0);
  printf("%d %d\\n", begun, ecatm_sdo_count(sdo, 0));
"""
    )
    begun, count = numbers(result)
    assert begun == count
    assert 2 <= begun <= 21  # one is left out when the one before it is not answered yet


def test_the_first_sampled_request_is_at_the_start_and_the_next_after_a_period(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, when=When.SAMPLED, period=10)};
  int state = ecatm_sdo_read(sdo, now, sample(), 0);
  printf("%d\\n", state);
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_read(sdo, now, sample(), 0);
  printf("%d\\n", state);
  now = 10.0005; /* the first sample was at 0.001 */
  printf("%d\\n", ecatm_sdo_read(sdo, now, 0, 0));
  now = 10.001;
  printf("%d\\n", ecatm_sdo_read(sdo, now, 0, 0));
"""
    )
    assert numbers(result) == [State.BUSY, State.DONE, State.DONE, State.BUSY]


def test_an_initial_request_is_one(call: Run) -> None:
    result = call(
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, when=When.INITIAL)};
  int n, state = ecatm_sdo_read(sdo, now, sample(), 0);
  printf("%d\\n", state);
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_read(sdo, now, sample(), 0);
  for (n = 0; n < 50; n++) state = ecatm_sdo_read(sdo, now, sample(), n & 1);
  printf("%d %d %d\\n", state, ecatm_sdo_integer(sdo, 0), ecatm_sdo_count(sdo, 0));
"""
    )
    assert numbers(result) == [State.BUSY, State.DONE, 5001, 1]


@pytest.mark.parametrize("order", ["n", "19 - n"])
def test_more_requests_than_a_client_may_have_at_once(call: Run, order: str) -> None:
    result = call(
        f"""
  void *sdo[20];
  int n, open = 20, state[20];
  for (n = 0; n < 20; n++)
    sdo[n] = {opened(0x1000, T.UNSIGNED32, when=When.INITIAL)};
  while (open > 0) {{
    int cycle = sample();
    open = 0;
    for (n = 0; n < 20; n++) {{
      state[n] = ecatm_sdo_read(sdo[{order}], now, cycle, 0);
      open += state[n] == ECATM_SDO_BUSY;
    }}
  }}
  for (n = 0; n < 20; n++) tell(sdo[n], ecatm_sdo_read(sdo[n], now, 0, 0));
"""
    )
    assert [(a.state, a.count) for a in answers(result)] == [(State.DONE, 1)] * 20


def test_requests_that_never_pause_leave_none_out(call: Run) -> None:
    result = call(
        f"""
  void *sdo[12];
  int n, done = 0, samples = 0;
  for (n = 0; n < 12; n++)
    sdo[n] = {opened(0x1000, T.UNSIGNED32, when=When.SAMPLED, period=0.001)};
  while (done < 12 && samples++ < 20000) {{
    int cycle = sample();
    for (done = n = 0; n < 12; n++) {{
      ecatm_sdo_read(sdo[n], now, cycle, 0);
      done += ecatm_sdo_count(sdo[n], 0) >= 5;
    }}
  }}
  printf("%d\\n", done);
"""
    )
    assert numbers(result) == [12]


def test_without_a_place_for_another_client_a_request_fails_instead_of_waiting(
    call: Run, bus: Daemon
) -> None:
    with ExitStack() as stack:
        for _ in range(shm.SLOTS):
            other = stack.enter_context(Handle(bus.bus))
            assert other.sdo_start(0, 0x1000, 0, None, 0) >= 0
        (answer,) = answers(call(read(0x1000, T.UNSIGNED32)))
    assert (answer.state, answer.code) == (State.FAILED, -13)
    assert f"all {shm.SLOTS} client slots" in answer.text


# --- The bus goes and comes ------------------------------------------------------------------


def test_a_bus_that_ends_in_the_middle_of_a_request_fails_it(tmp_path: Path, compiler: str) -> None:
    folder = tmp_path / "daemon"
    folder.mkdir()
    daemon = Daemon(folder, RIG, cycle_time_us=1000).wait_ready()
    program = build(
        tmp_path,
        compiler,
        f"""
  void *sdo = {opened(0x1000, T.UNSIGNED32, slave=2)};
  int state = ECATM_SDO_BUSY;
  now = 1;
  state = ecatm_sdo_read(sdo, now, sample(), 1);
  now = 2;
  state = ecatm_sdo_read(sdo, now, sample(), 1); /* it is sent */
  puts("asked");
  fflush(stdout);
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_read(sdo, now += 1, 0, 1);
  tell(sdo, state);
""",
    )
    process = subprocess.Popen(
        [str(program), daemon.bus],
        env={"ASAN_OPTIONS": "detect_leaks=0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "asked\n"
        daemon.kill_all()
        out, errors = process.communicate()
    finally:
        process.kill()
        daemon.close()
    assert process.returncode == 0, errors
    answer = Answer(out.strip())
    assert answer.state is State.FAILED
    # A daemon that is killed slowly stands still first.
    assert ("daemon" if answer.code == -2 else "stands still") in answer.text
    assert answer.code in (-2, -12)
