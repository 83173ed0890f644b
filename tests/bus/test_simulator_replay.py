"""A recorded start-up, replayed into the same rig, gets the same answers."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from masters import run
from test_simulator_tshark import master_recorded

from ecatsim.rig import Rig
from ecatsim.rigs import library as rigs
from replay import Datagram, Exchange, Replay, datagrams, pair, read_capture

pytestmark = pytest.mark.bus

HERE = Path(__file__)
EEPROM, MEMORY = 0x0500, 0x1000
CLOCKS = range(0x0900, 0x0A00)
PDI_WATCHDOG = {0x0110, 0x0440, 0x0442, 0x0443}
"""Registers with its state: DL status, watchdog status, counters."""
DL_STATUS_EVENT = 0x0004


def rig() -> Rig:
    """The rig `troll` with EEPROMs that answer at once: nobody waits in a replay."""
    result = rigs.make("troll")
    for device in result.devices:
        device.chip = replace(device.chip, eeprom_read_us=0)
    return result


@pytest.fixture(scope="module")
def start_up(tmp_path_factory: pytest.TempPathFactory) -> list[Exchange]:
    file = tmp_path_factory.mktemp("replay") / "start-up.pcap"
    run(HERE, master_recorded, str(file))
    return pair(read_capture(file))


def answers(exchanges: list[Exchange]) -> list[bytes]:
    replay = Replay(rig().devices)
    try:
        return [replay.answer(exchange) for exchange in exchanges]
    finally:
        replay.close()


def timeless(frames: list[bytes]) -> list[list[Datagram]]:
    """All datagrams but those that read clocks, which go on.

    The PDI watchdogs go on, too: one that expires while this process waits for the processor
    changes the DL status, and the event says so.
    """
    return [
        [
            replace(d, event=d.event & ~DL_STATUS_EVENT)
            for d in datagrams(frame)
            if d.offset not in CLOCKS and d.offset not in PDI_WATCHDOG
        ]
        for frame in frames
    ]


def test_a_replay_is_repeatable(start_up: list[Exchange]) -> None:
    assert len(start_up) > 500
    first, second = (timeless(answers(start_up)) for _ in range(2))
    assert [pair for pair in zip(first, second, strict=True) if pair[0] != pair[1]][:1] == []


def test_a_replay_answers_as_recorded(start_up: list[Exchange]) -> None:
    """Every EEPROM word and every mail the master got, it gets again."""
    compared = 0
    for exchange, answer in zip(start_up, answers(start_up), strict=True):
        for sent, recorded, found in zip(
            *map(datagrams, (exchange.request, exchange.reply, answer)), strict=True
        ):
            if sent.command == "FPRD" and recorded.counter:
                eeprom = EEPROM <= sent.offset < EEPROM + 0x10
                mail = sent.offset >= MEMORY
                if eeprom or mail:
                    assert (found.counter, found.data) == (1, recorded.data), exchange.number
                    compared += 1
    assert compared > 500
