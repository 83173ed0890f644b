"""How the PDOs of many slaves are read on a segment, also of one in a bad condition."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_simulator_topology import FIRST, run

from ecatd.base.errors import EcatError
from ecatd.base.timeouts import Timeout
from ecatd.config import Config
from ecatd.etg.al import AlState
from ecatd.etg.pdo import Entry, Pdo
from ecatd.master.mailbox import conversation
from ecatd.master.master import Master
from ecatd.server.start import mapping
from ecatd.server.start.scanned import identify_slaves
from ecatsim import Rig
from ecatsim.control import Simulator
from ecatsim.devices.library import library, make
from ecatsim.faults.methods import FaultMethods
from ecatsim.slave import sii
from ecatsim.slave.device import Device

pytestmark = pytest.mark.bus

HERE = Path(__file__)
SLAVES = 66


class Single(Device):
    """Eight entries in each of two PDOs a direction, to be read one by one, names included."""

    vendor, product, revision, order = 0x0000FFFF, 0x1, 1, "Single"
    mailbox = sii.Mailbox(coe_details=0x0F)
    rx_pdos = tuple(
        Pdo(0x1600 + i, f"Out {i}", 2, [Entry(0x7000 + i, n, f"o{n}", 6, 16) for n in range(1, 9)])
        for i in range(2)
    )
    tx_pdos = tuple(
        Pdo(0x1A00 + i, f"In {i}", 3, [Entry(0x6000 + i, n, f"i{n}", 7, 32) for n in range(1, 9)])
        for i in range(2)
    )

    def sii_image(self) -> bytes:
        image = bytearray(super().sii_image())
        at = 0x80
        while (kind := int.from_bytes(image[at : at + 2], "little")) != sii.Category.END:
            if kind in (sii.Category.TX_PDO, sii.Category.RX_PDO):
                image[at + 1] = 0x0F  # a category of the vendor
            at += 4 + 2 * int.from_bytes(image[at + 2 : at + 4], "little")
        return bytes(image)


class Segmented(Single):
    """The same with complete access, in mails that are too small for a list."""

    product, order = 0x2, "Segmented"
    mailbox = sii.Mailbox(receive_size=24, send=0x1080, send_size=24, coe_details=0x2F)


def rig() -> Rig:
    """Slaves of many kinds in turn."""
    kinds = [Single, Segmented, *(lambda name=item.name: make(name) for item in library())]
    return Rig("lists", [kinds[n % len(kinds)]() for n in range(SLAVES)])


def facts(pdos: Any) -> list[Any]:
    return [
        [pdo.index, pdo.name, pdo.sync_manager]
        + [[e.index, e.subindex, e.name, e.data_type, e.bit_length] for e in pdo.entries]
        for pdo in pdos
    ]


def lose_frames(faults: FaultMethods) -> None:
    faults.drop(all_frames=True, count=0, probability=0.01)
    faults.drop(all_frames=True, count=0, probability=0.02, seed=2, way_back=True)


def send_emergencies(faults: FaultMethods) -> None:
    for code in (0x1000, 0x8130):
        faults.emergency(0, code, register=0x81)


TROUBLE: dict[str, Callable[[FaultMethods], object]] = {
    "loss": lose_frames,
    "emergencies": send_emergencies,
    "slow": lambda faults: faults.mailbox(1, "slow", delay_s=0.05),
    "garbage": lambda faults: faults.mailbox(1, "garbage"),
}


def master_that_scans(*trouble: str) -> Any:
    """What the scan finds, and the emergencies that came."""

    def converse(*arguments: Any) -> Any:
        for name in trouble:
            TROUBLE[name](simulator.faults)
        return conversation.converse(*arguments)

    mapping.converse = converse  # where the trouble begins
    master = Master([FIRST])
    try:
        with Simulator() as simulator:
            master.scan(Timeout(60))
            master.al_states.wait_for(AlState.PREOP, Timeout(60))
            found = identify_slaves(master)
            mapping.configure_slaves(master, found, Config())
    except EcatError as error:
        return [type(error).__name__, str(error)]
    finally:
        master.close()
    return [
        [[facts(item.slave.outputs), facts(item.slave.inputs)] for item in found],
        [item.emergencies for item in found],
        [item.silence for item in found],
    ]


@pytest.fixture(scope="module")
def found() -> list[Any]:
    """What the scan finds where nothing is wrong."""
    slaves, emergencies, silence = run(HERE, master_that_scans)
    assert emergencies == [[]] * SLAVES
    assert silence == [""] * SLAVES
    return slaves


def test_slaves_of_all_kinds_tell_their_process_data(found: list[Any]) -> None:
    kinds = 2 + len(library())
    described = [
        [
            [pdo.index, f"{kind} {pdo.index & 0xFF}", pdo.sync_manager]
            + [[e.index, e.subindex, e.name, e.data_type, e.bit_length] for e in pdo.entries]
            for pdo in pdos
        ]
        for kind, pdos in (("Out", Single.rx_pdos), ("In", Single.tx_pdos))
    ]
    for number, pdos in enumerate(found):
        if number % kinds < 2:
            assert pdos == described
        else:
            item = library()[number % kinds - 2]
            sizes = [sum(bits for pdo in side for *_, bits in pdo[3:]) for side in pdos]
            assert [(bits + 7) // 8 for bits in sizes] == [item.output_size, item.input_size]


@pytest.mark.long
@pytest.mark.parametrize("trouble", [["loss"], ["slow"], ["emergencies"], ["slow", "loss"]])
def test_trouble_changes_nothing_of_what_is_found(found: list[Any], trouble: list[str]) -> None:
    slaves, emergencies, _ = run(HERE, master_that_scans, *trouble)
    assert slaves == found
    told = [[0x1000, 0x81], [0x8130, 0x81]] if "emergencies" in trouble else []
    assert emergencies == [told] + [[]] * (SLAVES - 1)


@pytest.mark.long
def test_a_slave_that_answers_nonsense_is_named(found: list[Any]) -> None:
    slaves, _, silence = run(HERE, master_that_scans, "garbage")
    assert silence[1].startswith("slave 1, 0x1C12:0")
    assert [n for n, text in enumerate(silence) if text] == [1]
    assert slaves[2:] == found[2:]
