"""Which PDOs slaves with CoE have, and what is asked for it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TypeVar

import pytest
from wire_bench import FIRST_STATION, Correspondent, corresponding, in_preop

from conftest import names, naming
from ecatd.base.errors import SdoAbortError, StateError
from ecatd.config import SlaveConfig
from ecatd.config.resolve.believed import Believed
from ecatd.description.bus import Slave
from ecatd.description.conditions import Condition
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import Sii
from ecatd.etg.sii_reader import read_sii
from ecatd.master.mailbox import mailbox_queue as queue_module
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, converse
from ecatd.master.mailbox.mailbox_queue import MailboxQueue
from ecatd.server.start.assignment import Assignment
from ecatd.server.start.scanned import Scanned
from ecatsim.slave import sii
from ecatsim.slave.device import Device

INFORMATION, COMPLETE_ACCESS = 0x02, 0x20


class Single(Device):
    """Eight entries in each of two PDOs a direction, to be read one by one."""

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


class Whole(Single):
    """The same with complete access."""

    order = "Whole"
    mailbox = sii.Mailbox(coe_details=0x2F)


class OneWay(Whole):
    """One without outputs, and without the object that would list them."""

    order = "OneWay"
    rx_pdos = ()

    def describe(self) -> None:
        if 0x1C12 in self.dictionary:
            self.dictionary.remove(0x1C12)


INFORMATION_SERVICE = 8  # in the CoE header
T = TypeVar("T")


class Counting(Coe):
    """Counts what is asked."""

    def __init__(self, position: int) -> None:
        super().__init__(position, FIRST_STATION + position, MailboxQueue())
        self.uploads = 0
        self.descriptions = 0

    def upload(
        self,
        index: int,
        subindex: int,
        *,
        complete: bool = False,
        tries: int = 3,
        size: int = 0,
    ) -> Conversation[bytes]:
        self.uploads += 1
        return super().upload(index, subindex, complete=complete, tries=tries, size=size)

    def ask(
        self,
        service: int,
        request: bytes,
        take: Callable[[int, bytes], T | None],
        patience_s: float | None = None,
    ) -> Conversation[T]:
        self.descriptions += service == INFORMATION_SERVICE
        return super().ask(service, request, take, patience_s)


def content(device: Device) -> Sii:
    image = device.sii_image().ljust(4096, b"\xff")
    return read_sii(lambda word, count: image[2 * word : 2 * (word + count)])


def read(
    *devices: Device, change: Callable[[Sii], None] = lambda _: None
) -> list[tuple[Slave, Counting]]:
    """What the devices tell, and by how many questions."""
    with in_preop(*devices) as (registers, _wire):
        found = [(Slave(n, device.order, 1, 2, 3), Counting(n)) for n, device in enumerate(devices)]
        siis = [content(device) for device in devices]
        for item in siis:
            change(item)
        converse(
            registers,
            [
                Assignment(Scanned(slave, item, SlaveConfig(slave.position)), coe).read()
                for (slave, coe), item in zip(found, siis, strict=True)
            ],
        )
    return found


def boast(image: Sii) -> None:
    """The SII promises complete access."""
    image.coe |= COMPLETE_ACCESS


def forget(image: Sii) -> None:
    """The SII has no names."""
    image.inputs.clear()
    image.outputs.clear()


LISTS, VALUES = 2 + 4, 2 * 2 + 4 * 8
NAMES = 4 * 8 + 4


def test_lists_are_read_at_once_where_the_slave_can() -> None:
    found = read(Single(), Whole())
    assert [(s.outputs, s.inputs) for s, _ in found] == [
        (list(Single.rx_pdos), list(Single.tx_pdos))
    ] * 2
    assert [(coe.uploads, coe.descriptions) for _, coe in found] == [
        (LISTS + VALUES, 0),
        (LISTS, 0),
    ]


def test_a_slave_that_is_not_good_at_complete_access_is_not_asked_that_way_again() -> None:
    ((slave, coe),) = read(Single(), change=boast)
    assert slave.outputs == list(Single.rx_pdos)
    assert coe.uploads == LISTS + VALUES + 1


def test_an_object_that_is_not_there_says_nothing_about_complete_access() -> None:
    ((slave, coe),) = read(OneWay())
    assert slave.outputs == []
    assert slave.inputs == list(Single.tx_pdos)
    assert coe.uploads == 2 + 3


def test_names_come_from_the_dictionary_where_the_sii_has_none() -> None:
    for slave, coe in read(Single(), Whole(), change=forget):
        assert (slave.outputs, slave.inputs) == (list(Single.rx_pdos), list(Single.tx_pdos))
        assert coe.descriptions == NAMES


def deny(image: Sii) -> None:
    """The SII says that there is no SDO information."""
    forget(image)
    image.coe &= ~INFORMATION


@pytest.mark.parametrize(("change", "tries"), [(forget, 3), (deny, 1)])
def test_a_slave_that_describes_nothing_is_not_asked_for_ever(
    change: Callable[[Sii], None], tries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(queue_module, "_ANSWER_S", 0.3)
    device = Single()
    device._services._coe._information.handle = lambda _request: []
    ((slave, coe),) = read(device, change=change)
    assert coe.descriptions == tries
    assert [pdo.name for pdo in slave.outputs] == ["", ""]
    assert {(e.name, e.data_type) for pdo in slave.outputs for e in pdo.entries} == {("", 6)}
    assert [pdo.bit_length for pdo in slave.inputs] == [256, 256]


def lists(objects: dict[tuple[int, int], bytes]) -> Slave:
    """A slave with these objects only, up to four bytes each."""
    return told(objects, Sii())[0]


def told(objects: dict[tuple[int, int], bytes], image: Sii) -> tuple[Slave, Believed]:
    """A slave with these objects only, and what is believed of it."""

    def answers(request: bytes) -> list[bytes]:
        index, subindex = struct.unpack_from("<HB", request, 9)
        data = objects.get((index, subindex))
        if data is None:
            body = b"\0\x20\x80" + request[9:12] + struct.pack("<I", 0x06020000)
        else:
            head = bytes([0x43 | (4 - len(data)) << 2])
            body = b"\0\x30" + head + request[9:12] + data.ljust(4, b"\0")
        return [struct.pack("<HHBB", len(body), 0, 0, 0x13) + body]

    slave = Correspondent(answers)
    with corresponding(slave) as (registers, _wire):
        found = Slave(0, "Odd", 1, 2, 3)
        coe = Coe(0, FIRST_STATION, MailboxQueue())
        (known,) = converse(
            registers, [Assignment(Scanned(found, image, SlaveConfig(0)), coe).read()]
        )
    return found, known


@pytest.mark.parametrize(
    ("objects", "text"),
    [
        ({(0x1C12, 0): b"\x41"}, "0x1C12:00 | 41 | 64"),
        ({(0x1C12, 0): b"\x01", (0x1C12, 1): b"\x01"}, "0x1C12:01 | 1 | 2"),
        ({(0x1C12, 0): b"\x01"}, "slave 0 | 0x1C12:01 | 0x06020000"),
        (
            {(0x1C12, 0): b"\x01", (0x1C12, 1): b"\0\x16", (0x1600, 0): b"\xff"},
            "0x1600:00 | ff | 254",
        ),
    ],
)
def test_lists_that_make_no_sense(objects: dict[tuple[int, int], bytes], text: str) -> None:
    with pytest.raises((StateError, SdoAbortError), match=naming(*text.split(" | "))):
        lists(objects)


def test_a_slave_without_assigned_pdos_has_none() -> None:
    found = lists({(0x1C12, 0): b"\0", (0x1C13, 0): b"\x01", (0x1C13, 1): b"\0\x1a"})
    assert found.outputs == []
    assert found.inputs == [Pdo(0x1A00, "", 3, [])]


def test_an_index_with_exchanged_bytes() -> None:
    objects = {
        (0x1C13, 0): b"\x02",
        (0x1C13, 1): b"\x1a\x00",
        (0x1C13, 2): b"\x00\x60",  # with its bytes exchanged it is none, either
        (0x1A00, 0): b"\x01",
        (0x1A00, 1): bytes.fromhex("10 01 00 60"),
        (0x6000, 0): b"\x00",
    }
    found = lists(objects)
    assert [pdo.index for pdo in found.inputs] == [0x1A00, 0x6000]
    assert [pdo.bit_length for pdo in found.inputs] == [16, 0]


def test_assignments_that_make_no_sense() -> None:
    pdo, other = (Pdo(n, "", 3, [Entry(0x6000, 1, "", 6, 16)]) for n in (0x1A00, 0x1600))
    objects = {
        (0x1C13, 0): b"\x04",
        (0x1C13, 1): b"\x00\x00",
        (0x1C13, 2): b"\x00\x1a",
        (0x1C13, 3): b"\x00\x1a",
        (0x1C13, 4): b"\x00\x16",
        **{(n, 0): b"\x01" for n in (0x1A00, 0x1600)},
        **{(n, 1): bytes.fromhex("10 01 00 60") for n in (0x1A00, 0x1600)},
    }
    known = told(objects, Sii(inputs=[pdo], outputs=[other]))[1]
    assert known.condition == Condition.UNREADABLE
    names(known.why, "0x1C13:04", "PDO 0x1600", "outputs", "EEPROM")
    unknown = told(objects, Sii())[1]
    assert [pdo.index for pdo in unknown.inputs] == [0x1A00, 0x1A00, 0x1600]
    names(
        "; ".join(unknown.notes),
        *("0x1C13:01 is 0", "0x1C13:03", "0x1A00 a second time", "0x1C13:04", "outputs"),
    )
    agreed = told(objects, Sii(inputs=[pdo, other]))[1]
    assert not any("outputs" in note for note in agreed.notes)
