"""Start-up lists: objects of a slave that are written one after the other."""

import functools
from collections.abc import Sequence

import pytest
from sdo_calls import Run, State, answers, read

from conftest import names
from ecatd.etg.datatypes import DataType as T

pytest_plugins = ["sdo_fixtures"]
pytestmark = [pytest.mark.bus, pytest.mark.long]

STEPS = r"""
static int steps(void *list) {
  int state = ecatm_sdo_list_write(list, now, sample(), 0);
  state = ecatm_sdo_list_write(list, now, sample(), 1);
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_list_write(list, now, sample(), 1);
  printf("%d||%d|0|%s\n", state, ecatm_sdo_list_abort_code(list, state),
         ecatm_sdo_list_abort_text(list, state));
  return state;
}
"""


@pytest.fixture
def call(call: Run) -> Run:
    """The same with the function of these tests."""
    return functools.partial(call, functions=STEPS)


def opened(table: Sequence[Sequence[int]], *, slave: int = 0, columns: int = 4) -> str:
    """A block that declares a list."""
    numbers = ", ".join(str(int(number)) for row in table for number in row) or "0"
    return (
        f"static const int table[] = {{{numbers}}};\n"
        f'void *list = ecatm_sdo_list_open(master, {slave}, "", table, {len(table)}, {columns}, '
        '"");\n'
    )


def test_all_entries_are_written_in_their_order(call: Run) -> None:
    found = answers(
        call(
            opened(
                [
                    (0x2001, 0, T.BOOLEAN, 1),
                    (0x2002, 0, T.INTEGER8, -3),
                    (0x2004, 0, T.INTEGER32, 1),
                    (0x2006, 0, T.UNSIGNED16, 65535),
                    (0x2004, 0, T.INTEGER32, -(2**31) + 1),
                ]
            )
            + "steps(list);"
            + read(0x2001, T.BOOLEAN)
            + read(0x2002, T.INTEGER8)
            + read(0x2004, T.INTEGER32)
            + read(0x2006, T.UNSIGNED16)
        )
    )
    assert found[0].state is State.DONE
    assert found[0].text == ""
    assert [int(answer.value) for answer in found[1:]] == [1, -3, -(2**31) + 1, 65535]


def test_it_ends_with_the_first_entry_that_fails_and_names_it(call: Run) -> None:
    failed, before, after, again = answers(
        call(
            opened(
                [
                    (0x2002, 0, T.INTEGER8, 11),
                    (0x5FFF, 1, T.INTEGER8, 12),
                    (0x2003, 0, T.INTEGER16, 13),
                ]
            )
            + "steps(list);"
            + read(0x2002, T.INTEGER8)
            + read(0x2003, T.INTEGER16)
            + "steps(list);"
        )
    )
    assert (failed.state, failed.code) == (State.FAILED, 0x06020000)
    names(failed.text, "entry 2 of 3", "0x5FFF:01")
    assert (before.value, after.value != "13") == ("11", True)
    assert (again.state, again.text) == (failed.state, failed.text)


def test_an_empty_list_is_done(call: Run) -> None:
    (answer,) = answers(call(opened([]) + "steps(list);"))
    assert answer.state is State.DONE


def test_only_an_edge_begins_it_and_the_last_evaluation_of_a_time_counts(call: Run) -> None:
    result = call(
        opened([(0x2005, 0, T.UNSIGNED8, 9)])
        + r"""
  int cycle = sample(), state, n;
  printf("%d\n", ecatm_sdo_list_write(list, now, cycle, 1));
  printf("%d\n", ecatm_sdo_list_write(list, now, cycle, 0));
  for (n = 0; n < 9; n++) state = ecatm_sdo_list_write(list, now, sample(), 0);
  printf("%d\n", state);
  state = ecatm_sdo_list_write(list, now, sample(), 1);
  printf("%d\n", state);
  while (state == ECATM_SDO_BUSY) state = ecatm_sdo_list_write(list, now, sample(), n++ & 1);
  for (n = 0; n < 9; n++) state = ecatm_sdo_list_write(list, now, sample(), 1);
  (void)steps;
"""
    )
    assert result.returncode == 0, result.stderr
    assert [int(line) for line in result.stdout.split()] == [
        State.BUSY,
        State.NONE,
        State.NONE,
        State.BUSY,
    ]


def test_a_slave_that_does_not_answer_fails_the_list(call: Run) -> None:
    (answer,) = answers(call(opened([(0x2005, 0, T.UNSIGNED8, 9)], slave=2) + "steps(list);"))
    assert (answer.state, answer.code) == (State.FAILED, -11)


@pytest.mark.parametrize(
    ("block", "tokens"),
    [
        (
            opened([(0x2002, 0, T.INTEGER8, 1), (0x2002, 0, T.INTEGER8, 128)]),
            "entry 2 | slave 0 | 0x2002:00 | 128 | -128 | 127",
        ),
        (
            opened([(0x2008, 0, T.REAL32, 1)]),
            "entry 1 | slave 0 | 0x2008:00 | third column",
        ),
        (opened([(0x12002, 0, T.INTEGER8, 1)]), "index 73730 | subindex 0"),
        (opened([(0x2002, 0, T.INTEGER8, 1)], slave=7), "slave 7 | 3 slaves | 0 | 2"),
        (
            opened([(0x2002, 0, T.INTEGER8)], columns=3),
            "slave 0 | 3 columns | 4 | index | subindex | data type | value",
        ),
    ],
)
def test_what_can_only_be_a_mistake_ends_the_simulation(call: Run, block: str, tokens: str) -> None:
    result = call(block + "steps(list);")
    assert result.returncode == 1
    assert result.stderr.startswith("EtherCAT: ")
    names(result.stderr, *tokens.split(" | "))
