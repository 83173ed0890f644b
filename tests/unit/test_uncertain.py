"""What is said of slaves whose process data are uncertain, and of what slaves refuse."""

import pytest

from conftest import names
from ecatd.description.bus import Slave
from ecatd.description.conditions import Condition
from ecatd.server.start.object_access import RefusedError
from ecatd.server.start.scanned import Uncertain

SLAVE = Slave(2, "EL3008", 2, 10, 1)


@pytest.mark.parametrize(
    ("uncertain", "said"),
    [
        (Uncertain(Condition.SILENT, "no answer", ("0x1C12",), used=True), "no answer | 0x1C12"),
        (Uncertain(Condition.DAMAGED, used=True), "are known"),
        (Uncertain(Condition.DAMAGED, "bad", ("byte 5", "word 2"), why="none"), "byte 5 | word 2"),
        (Uncertain(Condition.CONTRADICTED, "contradictory", why="PDO 7"), "contradictory | PDO 7"),
        (Uncertain(Condition.STUCK, "not in PREOP", why="INIT", in_preop=False), "INIT"),
        (Uncertain(Condition.STUCK, why="AL status 0x1D"), "AL status 0x1D"),
    ],
)
def test_the_cause_and_what_becomes_of_the_slave_are_said(uncertain: Uncertain, said: str) -> None:
    names(uncertain.text, *said.split(" | "))
    assert ("is used" in uncertain.text) == uncertain.used
    assert ("takes no part" in uncertain.text) != uncertain.used
    stays = not uncertain.used and uncertain.in_preop
    assert ("stays in PREOP" in uncertain.text) == stays


def test_a_refusal_names_its_slave_once() -> None:
    error = RefusedError(SLAVE, "refuses 0x6060:00", "a.toml:5: slave[2].startup[0]")
    assert str(error) == "a.toml:5: slave[2].startup[0]: slave 2 (EL3008) refuses 0x6060:00"
    assert error.of_it == "a.toml:5: slave[2].startup[0]: it refuses 0x6060:00"
    assert RefusedError(SLAVE, "has no 0x6060:00").of_it == "it has no 0x6060:00"
