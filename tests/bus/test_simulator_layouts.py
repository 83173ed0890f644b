"""Slaves with process data in unusual places come to OP, and every bit is where it belongs."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from conftest import Daemon, wait_for
from ecatd.client import Client
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = Path(__file__).parents[1] / "rigs" / "layouts.py"
SIZES = [(2, 2), (6, 6), (2, 2), (2, 2)]
NIBBLES, MANY, RELAYS = 0, 1, 2
TURNS = 20


@pytest.fixture(scope="module")
def layouts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path_factory.mktemp("layouts"), str(RIG)).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def entries(client: Client, *, output: bool) -> dict[tuple[int, int, int], int]:
    """Bits of each entry by slave, index and subindex; outputs as the inputs that follow them."""
    shift = 0x1000 if output else 0
    return {
        (signal.slave, signal.index - shift, signal.subindex): signal.bit_length
        for signal in client.signals()
        if signal.output == output
    }


def test_sizes(layouts: Daemon) -> None:
    rows = layouts.slave_rows("slaves")
    assert [row["state"] for row in rows] == ["OP"] * 4
    assert [(row["output_bytes"], row["input_bytes"]) for row in rows] == SIZES


def test_every_bit_arrives(layouts: Daemon) -> None:
    dice = random.Random(1)
    with layouts.client() as client:
        there, back = (entries(client, output=output) for output in (True, False))
        assert there == back
        outputs = {key: client.signal(key[0], key[1] + 0x1000, key[2]) for key in there}
        inputs = {key: client.signal(*key) for key in back}
        for slave in range(4):
            client.claim(slave, lease=30)
        for turn in range(TURNS):
            values = {key: dice.randrange(1 << bits) for key, bits in there.items()}
            if turn < 2:  # all of them, and none
                values = {key: (1 << bits) - 1 if turn else 0 for key, bits in there.items()}
            for key, value in values.items():
                outputs[key].raw = value
            client.commit()

            def same() -> bool:
                client.wait()
                client.sample()
                return {k: i.raw for k, i in inputs.items()} == values  # noqa: B023

            wait_for(same, layouts)


def test_fmmus_map_whole_bytes(layouts: Daemon) -> None:
    """So a controller needs no distance between them (Beckhoff, ESC data sheet, section I)."""
    with Simulator(str(layouts.child_pid("ecatsim"))) as simulator:
        for slave, channels in ((NIBBLES, 4), (MANY, 6), (RELAYS, 2)):
            rows = simulator.registers(slave, 0x0600, 16 * channels)
            fmmus = [rows[at : at + 16] for at in range(0, len(rows), 16)]
            assert all(row[12] == 1 for row in fmmus), "each of them is on"
            assert [(row[6], row[7], row[10]) for row in fmmus] == [(0, 7, 0)] * channels
        # One of two bytes for the outputs that lie side by side: its second one is for the inputs.
        (outputs, inputs) = (simulator.registers(RELAYS, at, 6) for at in (0x0600, 0x0610))
        assert (outputs[4], inputs[4]) == (2, 2)


def test_pdos_are_shown_where_they_are(layouts: Daemon) -> None:
    lines = layouts.ctl("pdos", str(NIBBLES)).stdout.splitlines()
    places = [line.split()[0] for line in lines if "bit  UNSIGNED8" in line]
    assert places == ["0.0", "0.1", "1.0", "0.0", "0.1", "1.0"]
