"""Blocks of EtherCAT.CAN that are written by hand: their calls, without a block of the terminal."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "contract"))

from can_client import CONFIG, SLAVE, Others
from plant_calls import compile_program

from conftest import Daemon, names
from ecatdev import sample_buses
from ecatgen import generate

pytestmark = pytest.mark.bus

PROGRAM = """
#include "ecat_modelica.h"
static void *master;
static void *terminal(int position, const char *name, const char *block) {
  void *domain = ecatm_domain_open(master, 1, block);
  return ecatm_slave_open(domain, position, name, 0, 0, 0, "CAN terminal", "", "", block);
}
int main(int argc, char **argv) {
  static const int all[5] = {0};
  int position = argc > 3 ? atoi(argv[3]) : 7, start = argc > 4 ? atoi(argv[4]) : 16, i, cycle;
  double period = argc > 5 ? atof(argv[5]) : 0, t;
  int both, trigger, data[8], length, missed, count;
  double age;
  void *one, *other, *low, *high, *nmt, *raw;
  master = ecatm_master_open(argv[1], 1, 0.008, 1, 30.0, 1, 1, 0, 0, 0, "");
  one = ecatm_can_open(terminal(position, "", "Model.one"), 500, 0, 0, 1, 4, 1, 0, 0, 0);
  other = ecatm_can_open(terminal(position, "", "Model.other"), 500, 0, 0, 1, 4,
                         period > 0 ? 2 : 1, period, 0, 0);
  low = ecatm_can_signal_open(one, "low", 0, 16, 0, 1, 1, 0, -1e300, 1e300, "", all);
  high = ecatm_can_signal_open(other, "high", start, 16, 0, 1, 1, 0, -1e300, 1e300, "", all);
  nmt = ecatm_can_open(terminal(position, "", "Model.nmt"), 0x7E0, 0, 0, 1, 2, 4, 0, 1, 0);
  raw = ecatm_can_open(terminal(-1, argv[2], "Model.raw"), 0x7E1, 0, 0, 0, 0, 1, 0, 0, 0);
  printf("open\\n");
  fflush(stdout);
  for (t = 0; scanf("%d %d %d", &both, &trigger, &data[0]) == 3; t += 0.008) {
    cycle = ecatm_wait(master, t);
    data[1] = 255;
    ecatm_can_send(one, t, ecatm_can_write_integer(low, t, cycle, cycle % 1000), 0);
    if (both) ecatm_can_send(other, t, ecatm_can_write_integer(high, t, cycle, cycle % 1000), 0);
    ecatm_can_write_frame(nmt, t, cycle, data);
    i = ecatm_can_send(nmt, t, cycle, trigger);
    ecatm_can_message(raw, t, cycle, &age, &count, &missed, &length);
    printf("%d %d %d %d %d %d\\n", cycle % 1000, i, count, length,
           ecatm_can_read_byte(raw, t, cycle, 1), ecatm_can_read_byte(raw, t, cycle, 8));
    fflush(stdout);
  }
  ecatm_master_close(master);
  return 0;
}
"""
"""Arguments: bus, name of the terminal; may be left out: position of those that send, start bit of
the second signal of a message, and the period of the block with it. Each line of its input says
whether both signals are written, and has a trigger and a byte for another message."""


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll-can", config=CONFIG)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> Path:
    folder = tmp_path_factory.mktemp("plant")
    generate(sample_buses.troll(), "Plant", folder)
    return compile_program(compiler, PROGRAM, folder, folder)


@pytest.fixture
def others(daemon: Daemon) -> Iterator[Others]:
    client = Others(daemon.bus, SLAVE)
    client.channel.claim()
    yield client
    client.close()


class Model:
    """The program, running."""

    def __init__(self, program: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [str(program), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "open\n", self.end()

    def step(self, *, both: bool = True, trigger: int = 0, byte: int = 7) -> tuple[int, ...]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{int(both)} {trigger} {byte}\n")
        self.process.stdin.flush()
        words = self.process.stdout.readline().split()
        assert words, self.end()
        return tuple(map(int, words))

    def end(self) -> str:
        _, said = self.process.communicate()
        return said


@pytest.fixture
def model(program: Path, daemon: Daemon) -> Iterator[Model]:
    running = Model(program, daemon.bus, "canTerminal")
    yield running
    running.end()


def pairs(others: Others) -> list[tuple[int, int]]:
    """Both signals of all frames."""
    return [
        (int.from_bytes(frame.data[:2], "little"), int.from_bytes(frame.data[2:], "little"))
        for frame in others.frames(500)
    ]


def test_signals_of_two_blocks_leave_in_one_frame(model: Model, others: Others) -> None:
    cycles = [model.step()[0] for _ in range(20)]
    others.wait(lambda: len(pairs(others)) >= len(cycles))
    assert pairs(others) == [(cycle, cycle) for cycle in cycles]


def test_a_frame_leaves_although_one_block_is_sampled_less_often(
    model: Model, others: Others
) -> None:
    cycles = [model.step(both=number % 2 == 0)[0] for number in range(9)]
    others.wait(lambda: len(pairs(others)) >= len(cycles))
    assert pairs(others) == [
        (cycle, cycles[number - number % 2]) for number, cycle in enumerate(cycles)
    ]


def test_a_message_on_a_trigger(model: Model, others: Others) -> None:
    for _ in range(3):
        assert model.step(trigger=0)[1] == 0
    for trigger, count in ((1, 1), (1, 1), (5, 2), (5, 2), (4, 3)):
        assert model.step(trigger=trigger, byte=trigger)[1] == count
    others.wait(lambda: len(others.frames(0x7E0)) >= 3)
    assert [frame.data for frame in others.frames(0x7E0)] == [b"\1\xff", b"\5\xff", b"\4\xff"]


def test_the_bytes_of_a_message(model: Model, others: Others) -> None:
    model.step()
    others.send(0x7E1, b"\x2a\0\0\0\0\0\0\xfe")
    others.send(0x7E1, b"\x2b")
    while (step := model.step())[2] < 2:
        pass
    assert step[3:] == (1, 0x2B, 0), "the last one counts, and has one byte"


def test_a_byte_is_a_number_up_to_255(model: Model) -> None:
    with pytest.raises(AssertionError) as refused:
        model.step(byte=256)
    names(str(refused.value), "Model.nmt", "byte 1", "0x7E0", "256")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["canTerminal", "7", "8"], ["Model.other", "signal high", "bits of signal low", "0x1F4"]),
        (["canTerminal", "7", "17"], ["Model.other", "signal high", "within the data"]),
        (["canTerminal", "7", "16", "0.5"], ["Model.other", "period", "equal", "0x1F4"]),
        (["canTerminal", "3"], ["Model.one", "slave 3", "[slave.can]", "EL2008"]),
        (["canTerminal", "99"], ["Model.one", "slave 99", "position"]),
        (["nowhere"], ["Model.raw", "nowhere"]),
    ],
)
def test_mistakes(program: Path, daemon: Daemon, arguments: list[str], words: list[str]) -> None:
    with pytest.raises(AssertionError) as refused:
        Model(program, daemon.bus, *arguments)
    names(str(refused.value), *words)
    assert "regenerate" not in str(refused.value)


def test_an_identifier_that_a_block_reserves(model: Model, others: Others) -> None:
    model.step(trigger=1)
    with pytest.raises(Exception, match="0x7E0"):
        others.send(0x7E0, b"")
